"""Settings of all tests, the command as several of them call it, and what they export."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import objects
import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from ambkit.export.c import CExport
    from ambkit.machine.machine import Machine

# A busy machine must not fail a test: what must be fast is measured in benchmarks/.
settings.register_profile("ambkit", deadline=None, max_examples=50)
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
def bearing() -> Machine:
    """The paper's bearing, a machine with one axis."""
    from ambkit.machine.machine import Machine

    return Machine.preset("zittau_axial")


DEAREST = (
    "structure", "misra", "magnetostatics", "calibration", "export_bits", "c", "cli", "contact",
    "design_machine", "export_control", "pil", "corpus", "export_fmu_same", "contributing",
    "maximum_likelihood", "guess", "identify_command", "force_magnet", "machine_filters",
    "modes_left_out", "workbench", "eddy_current", "assess_controllers", "design", "models_emit",
    "campaign_cluster", "selftest", "mutants_of_machines", "isolation", "angle", "no_traceback",
)  # fmt: skip
"""Files of more than 20 s, before all others: the last ones to end are then short."""


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist keep our order; by itself it puts files of few tests at the end."""
    config.option.loadscopereorder = False


def pytest_collection() -> None:
    """Collect without looking for garbage: what is collected stays until the end."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave the tests and all modules out of later searches for garbage, which come rarely."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000, 50, 100)  # six of a hundred seconds


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the dearest files first."""
    place = {f"test_{name}": k for k, name in enumerate(DEAREST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


class Drawing:
    """Whether pictures are drawn, which takes most of their time, or only built."""

    real = False


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Draw pictures for tests that look at them, fixtures of a module included."""
    marks = {mark.name for mark in item.iter_markers()}
    Drawing.real = bool(marks & {"pictures", "long", "study"})
    # FMUs likewise: half of the time is the optimiser's, which must not change a bit.
    if (compiler := sys.modules.get("ambkit.export.fmu.sources")) is not None:
        flags = compiler._FLAGS[1:]
        compiler._FLAGS = ("-O2" if marks & {"optimised", "long", "study"} else "-O0", *flags)


@pytest.fixture(autouse=True)
def room_for_long_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sentences be one line; layout is tested where a test sets the width."""
    monkeypatch.setenv("COLUMNS", "1000")


@pytest.fixture(scope="session", autouse=True)
def pictures_that_nobody_looks_at() -> None:
    """Build them, see that each of their axes shows something, and write no pixels."""
    from ambkit.result.report import figure

    printed = figure.printed
    contents = {".png": ONE_PIXEL, ".svg": NO_LINES}

    def print_or_check(canvas: Any, ending: str, title: str) -> bytes:
        if Drawing.real or ending not in contents:
            return printed(canvas, ending, title)
        return _shown(canvas, contents[ending])

    figure.printed = print_or_check


ONE_PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108020000009077"
    "53de0000000c49444154789c63f8ffff3f0005fe02fe0def46b80000000049454e44ae426082"
)
NO_LINES = b'<svg xmlns="http://www.w3.org/2000/svg"/>'


SYMBOLS: set[str] = set()


def _texts(canvas: Any) -> Iterator[str]:
    """Yield the texts of ours; numbers at ticks are matplotlib's, and made when it draws."""
    from matplotlib.ticker import FuncFormatter

    texts = list(canvas.texts)
    for axes in canvas.axes:
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        texts += legend.get_texts() if (legend := axes.get_legend()) is not None else []
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), FuncFormatter):  # names, not numbers
                texts += axis.get_ticklabels()
    yield from (text.get_text() for text in texts)


def _shown(canvas: Any, content: bytes) -> bytes:
    from matplotlib.mathtext import MathTextParser

    for text in set(_texts(canvas)) - SYMBOLS:
        SYMBOLS.add(text)
        if "$" in text:  # what else only drawing would refuse
            MathTextParser("path").parse(text)
    blank = [axes for axes in canvas.axes if axes.axison and not axes.has_data()]
    assert canvas.axes
    assert not blank, "axes that show nothing"
    return content


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
