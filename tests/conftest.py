"""Settings of all tests, the command as several of them call it, and what they export."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import objects
import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from ambkit.export.c import CExport

# A busy machine must not fail a test: what must be fast is measured in benchmarks/.
settings.register_profile("ambkit", deadline=None)
settings.load_profile("ambkit")

subprocess.run = objects.run


class Result(NamedTuple):
    """Exit code, stdout and stderr of a call."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


@pytest.fixture
def call(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Result]:
    """Call ambkit in this process, in an empty folder."""
    from ambkit.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Result:
        with pytest.raises(SystemExit) as left:
            main([str(argument) for argument in arguments])
        return Result(int(left.value.code or 0), *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., CExport]:
    """Export a kind of `export_cases.KINDS` in a precision, each one once; to be read only."""
    import export_cases

    folder = tmp_path_factory.mktemp("export")
    made: dict[tuple[str, str], CExport] = {}

    def export(kind: str, precision: str = "float") -> CExport:
        key = kind, precision
        if key not in made:
            made[key] = export_cases.export(kind, folder / "-".join(key), precision=precision)
        return made[key]

    return export
