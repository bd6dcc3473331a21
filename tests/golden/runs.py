"""Recorded runs: what the core answered to one short record, digit by digit.

A change of behaviour shows in the diff of the CSV files. ``input.csv`` is the record, and is not
written again, so that the runs do not depend on the simulation. Nor is ``linear_as_printed.csv``,
which the core answered when it knew no other model than eq. 15-21. Where a change is meant:

    python -m tests.golden
"""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ambkit

Table = dict[str, NDArray[Any]]

HERE = Path(__file__).resolve().parent
BEARING = ambkit.preset("zittau_axial")


def read(name: str) -> Table:
    """Read a table of numbers, all as float64."""
    with (HERE / f"{name}.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def write(name: str, table: Table) -> None:
    """Write a table with as many digits as bring back each number exactly."""
    lines = [",".join(table)]
    for row in zip(*table.values(), strict=True):
        digits = [f"{v:.9g}" if isinstance(v, np.float32) else f"{v:.17g}" for v in row]
        lines.append(",".join(digits))
    (HERE / f"{name}.csv").write_text("\n".join(lines) + "\n")


def filtered(magnet: Any, precision: Any, *, as_printed: bool = False) -> Table:
    """Run a filter of the core along the input; every fourth sample."""
    given = read("input")
    kf = ambkit.KalmanFilter(BEARING, magnet, precision=precision, as_printed=as_printed)
    kf.core.reset(np.zeros(4), np.array([3e-5, 1e-2, 5.0, 3e-5]))
    out = kf.core.run(given["y"], given["u"], covariance=True)
    columns = {name: out["mean"][:, i] for i, name in enumerate(("x", "v", "f_d", "x_m"))}
    columns |= {f"P_{name}": out["covariance"][:, i] for name, i in (("x", 0), ("f_d", 7))}
    columns |= {name: out[name] for name in ("innovation", "variance", "k_i", "k_s", "status")}
    return {name: values[::4] for name, values in columns.items()}


def learned() -> Table:
    """The ADALINE along the input; every fourth sample."""
    given = read("input")
    element = ambkit.Adaline(BEARING, start=1e-5)
    out = element.core.run(given["y"], given["u"], np.zeros_like(given["y"]))
    return {name: out[name][::4] for name in ("force", "k", "excitation", "status")}


RUNS: dict[str, Callable[[], Table]] = {
    "linear": lambda: filtered(None, "float64"),
    "closed_law": lambda: filtered(ambkit.ClosedLaw(BEARING), "float64"),
    "closed_law_float32": lambda: filtered(ambkit.ClosedLaw(BEARING), "float32"),
    "adaline": learned,
}
