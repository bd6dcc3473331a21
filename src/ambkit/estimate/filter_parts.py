"""Tables of a filter file: machine, other files, noise."""

import os
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Any, Self

from ambkit.base import files
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import FilePath, Line, Name, ScalarOrList
from ambkit.base.errors import AmbkitError
from ambkit.machine import presets
from ambkit.machine.loading import load_machine


class Reference(Part):
    """A file used by a filter, with its hash at the time."""

    file: FilePath
    """Name, relative to the filter file."""
    sha256: Line = ""
    """Hash of its content. By default any content is accepted."""

    @classmethod
    def to(cls, path: str | os.PathLike[str]) -> Self:
        """Return a reference to a file in its present state."""
        return cls(file=os.fspath(path), sha256=files.sha256(path))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from _changed(read("file"), read("sha256"))


class PlantOf(Part):
    """Machine of a filter: a preset, or a file."""

    preset: Name | None = None
    """Name of a preset."""
    file: FilePath | None = None
    """Its TOML file."""
    sha256: Line = ""
    """Hash of that file. By default any content is accepted."""

    @cached_property
    def plant(self) -> Any:
        """The machine itself."""
        if self.file is None and self.preset not in presets.names():
            presets.text(self.preset or "")  # raises with the list of presets
        return load_machine(self.file or self.preset or "")

    @classmethod
    def of(cls, name: str | os.PathLike[str]) -> Self:
        """Return a preset by name, or a file in its present state."""
        if name in presets.names():
            return cls(preset=str(name))
        return cls(file=os.fspath(name), sha256=files.sha256(name))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        file, preset = read("file"), read("preset")
        if (file is None) == (preset is None):
            yield "file", "give either file or preset"
            return
        if not isinstance(file or preset, str | os.PathLike):
            return  # reported for the key itself
        yield from _changed(file, read("sha256"))
        try:
            cls.model_construct(file=file, preset=preset).plant  # noqa: B018
        except AmbkitError as error:
            yield "file" if file else "preset", str(error)


class NoiseSettings(Part):
    """Variances assumed by a filter; by default the machine's."""

    # With several axes one number is for all readings or axes, a list has one for each.

    measurement: (
        Annotated[float | tuple[float, ...], ScalarOrList("m^2", "225 µm^2", at_least=0)] | None
    ) = None
    """R, of the measured position [m^2]."""
    control: (
        Annotated[
            float | tuple[float, ...], ScalarOrList("V^2", "100 mV^2", at_least=0, also=("A^2",))
        ]
        | None
    ) = None
    """Of the control signal [V^2], or [A^2] where that is a current."""
    disturbance: (
        Annotated[float | tuple[float, ...], ScalarOrList("N^2/s", "77 N^2/s", at_least=0)] | None
    ) = None
    """Q: process noise intensity of the disturbance force [N^2/s]."""


def _changed(file: Any, sha256: Any) -> Iterator[tuple[str, str]]:
    """Yield missing or changed files."""
    if not isinstance(file, str):
        return
    try:
        now = files.sha256(file)
    except AmbkitError as error:
        yield "file", str(error)
        return
    if isinstance(sha256, str) and sha256 and sha256 != now:
        text = f"{file} is not what it was when this filter was made (its hash begins {now[:8]}, "
        text += f"not {sha256:.8}); make it anew, or leave out sha256 to take the file as it is"
        yield "sha256", text
