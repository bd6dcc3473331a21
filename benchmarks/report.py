"""The measured tables as Markdown, and their place in README.md."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median

from ambkit.base import files
from benchmarks.hand import compiler_version
from benchmarks.timing import Times

README = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- measured -->", "<!-- /measured -->"


@dataclass(frozen=True)
class Limit:
    """What `times` may cost at most, as a multiple of the fastest of the yardsticks."""

    what: str
    times: Times
    yardsticks: tuple[Times, ...]
    most: float

    @property
    def measured(self) -> float:
        """Median ratio to the yardstick that is hardest to keep up with."""
        return max(median(self.times.ratios(yardstick)) for yardstick in self.yardsticks)

    @property
    def kept(self) -> bool:
        return self.measured <= self.most


def machine() -> str:
    """Processor, compiler and versions; no names, no dates."""
    cpu = {"x86_64": "x86-64", "AMD64": "x86-64"}.get(platform.machine(), platform.machine())
    others = (name for name in ("jax", "simdkalman", "statsmodels") if find_spec(name))
    names = ("numpy", "numba", "filterpy", *others)
    return ", ".join(
        [
            f"{cpu}, {len(os.sched_getaffinity(0))} cores",
            compiler_version(),
            f"Python {platform.python_version()}",
            *(f"{name} {version(name)}" for name in names),
        ]
    )


def table(times: Sequence[Times], yardstick: Times) -> str:
    """One row an entry: median time, median ratio, least and largest ratio."""
    rows = [
        f"| {t.entry.name} | {t.entry.samples:,} | {_digits(t.typical)} |"
        f" {_digits(median(t.ratios(yardstick)))} |"
        f" {_digits(min(t.ratios(yardstick)))} to {_digits(max(t.ratios(yardstick)))} |"
        for t in times
    ]
    head = "| | samples | ns a sample | times the first | least to most |"
    return "\n".join([head, "| --- | ---: | ---: | ---: | ---: |", *rows])


def limits_table(limits: Sequence[Limit]) -> str:
    """What is held to, and what was measured."""
    rows = [
        f"| {one.what} | {one.most:.3g} | {_digits(one.measured)} | {'yes' if one.kept else 'no'} |"
        for one in limits
    ]
    return "\n".join(["| | at most | measured | kept |", "| --- | ---: | ---: | --- |", *rows])


def write(measured: str) -> None:
    """Put the tables between the markers of README.md.

    Raises
    ------
    AmbkitError
        The file cannot be read or written.
    """
    text = files.read_text(README)
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    files.write_text(README, f"{before}{BEGIN}\n{measured}\n{END}{after}")


def _digits(value: float) -> str:
    """Three significant digits, or whole numbers with thousands separators."""
    return f"{value:,.0f}" if value >= 100 else f"{value:#.3g}"
