"""Options that several commands share, checked before any work is begun."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.machine.machine import Bearing, Machine

PICTURES = (".png", ".svg", ".pdf", ".html")
RECORDS = (".csv", ".parquet")
CONSTANT = "N m^2/A^2"
"""Unit of a magnet constant."""
_WRITTEN: set[str] = set()  # the options that name a file to write


def quantity(unit: str) -> Callable[[str], float]:
    """Return a parser of an option such as ``"0.5 mm"``, which gives SI."""

    def read(text: str) -> float:
        from ambkit.base.units import parse

        try:
            return parse(text, unit)
        except ValueError as error:
            raise typer.BadParameter(f"{error}; it is given in {unit} or a multiple") from None

    return read


def read_quantities(text: str, unit: str, option: str, count: int = 0) -> list[float]:
    """Read a list such as ``"0.1 mm,0.3 mm"`` into SI; exactly `count` of them if that is not 0."""
    try:
        values = [quantity(unit)(part) for part in text.split(",")]
    except typer.BadParameter as error:
        raise typer.BadParameter(error.message, param_hint=option) from None
    if count and len(values) != count:
        raise typer.BadParameter(f"{count} values expected, got {text!r}", param_hint=option)
    return values


def file_option(help: str, endings: tuple[str, ...], *names: str) -> Any:
    """Return an option that names a file to write, with one of the endings, in a real folder."""

    def check(path: Path | None) -> Path | None:
        if path is None:
            return None
        if path.suffix.lower() not in endings:
            raise typer.BadParameter(f"{path} must end with {' or '.join(endings)}")
        if path.is_dir():
            raise typer.BadParameter(f"{path} is a folder")
        if not path.parent.is_dir():
            raise typer.BadParameter(f"there is no folder {path.parent}")
        if not os.access(path.parent, os.W_OK):
            raise typer.BadParameter(f"the folder {path.parent} cannot be written")
        return path

    _WRITTEN.update(names)
    return typer.Option(*names, help=help, metavar="FILE", callback=check)


def keep_inputs(context: typer.Context) -> None:
    """Refuse to write a file that the command reads: a log cannot be recorded again."""
    written: dict[str, Path] = {}
    read: list[Path] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if _WRITTEN.intersection(parameter.opts):
            if value is not None and value.exists():
                written[parameter.opts[0]] = value
            continue
        values = value if isinstance(value, list | tuple) else [value]
        read += [Path(item) for item in values if isinstance(item, str | Path)]
    for option, path in written.items():
        if any(item.is_file() and item.samefile(path) for item in read):
            raise AmbkitError(f"{option}: {path} is read by this command, and would be overwritten")


BearingName = Annotated[
    str, typer.Argument(metavar="BEARING", help="A preset's name, or a TOML file.")
]
BearingOrFilter = Annotated[
    str,
    typer.Argument(
        metavar="BEARING", help="A preset's name, or a TOML file: of a bearing, or of a filter."
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Export it also where it is judged that it must not fly."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, for machines.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print all figures.")]
Plot = Annotated[
    Path | None, file_option("Draw a picture: .png, .svg, .pdf or .html.", PICTURES, "--plot")
]
MapFile = Annotated[
    Path | None,
    typer.Option(
        "--channels",
        metavar="MAP.toml",
        help="Channel map: what is what in a log; 'ambkit read --guess' proposes one.",
    ),
]
From = Annotated[
    float | None,
    typer.Option("--from", parser=quantity("s"), metavar="TIME", help="Start time."),
]
To = Annotated[
    float | None, typer.Option("--to", parser=quantity("s"), metavar="TIME", help="End time.")
]
ExpertFile = Annotated[
    Path | None,
    typer.Option(
        "--expert",
        metavar="FILE",
        help="Expert of the adaptive filter, from 'ambkit train', or a force map, points of iu, x "
        "and f_mag (.csv); trained anew without it.",
    ),
]


AxisName = Annotated[
    str | None,
    typer.Option("--axis", metavar="NAME", help="Which axis, of a machine with several: A1."),
]


Synchronous = Annotated[
    list[str] | None,
    typer.Option(
        "--synchronous",
        metavar="NAME",
        help="Of a machine: unbalance or runout, which are estimated too; may be repeated.",
    ),
]


def find_machine(text: str) -> Machine:
    """Return the machine that the user named: a preset, or one in a TOML file."""
    from ambkit.machine.loading import load_machine

    return load_machine(text)


def find_axis(text: str) -> Bearing:
    """Return the machine that the user named, which must have one axis."""
    return only_axis(find_machine(text), text)


def only_axis(machine: Machine, text: str) -> Bearing:
    """Return the axis of a machine that must have one."""
    if not machine.single:
        raise AmbkitError(f'"{text}" has several axes; this takes a machine with one')
    return machine.isolated_axis("")


def isolated(machine: Machine, axis: str | None) -> Bearing:
    """Return an axis of a machine alone; its name may be left out where there is only one."""
    from ambkit.machine import axes

    return axes.isolated(machine, axis)


def refuse_of_one_axis(machine: Machine, options: Mapping[str, Any]) -> None:
    """Refuse what a machine does not take."""
    for name, value in options.items():
        if value is not None:
            raise AmbkitError(f"--{name} is of one axis; {machine.name} is a machine")


@contextmanager
def arguments_of_the_user(prefix: str = "") -> Iterator[None]:
    """Around library calls whose arguments the user gave: their ValueErrors are the user's."""
    try:
        yield
    except ValueError as error:
        raise AmbkitError(f"{prefix}{error}") from error
