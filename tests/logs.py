"""Logs as other programs write them, each by the library that reads or writes that format."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[np.float64]]

MAP = """
[signals.t]
column = "time"
unit = "s"
[signals.y]
column = "pos"
unit = "mm"
[signals.u]
column = "current"
unit = "A"
scale = "1 V/A"
"""
"""Channel map of the logs with the columns time, pos and current."""
TWO_CLOCKS = (MAP + 'time = "t_slow"\n[signals.t_slow]\ncolumn = "1/time"\nunit = "s"\n').replace(
    '"time"', '"0/time"'
)


def sound(n: int = 4000, seed: int = 1) -> dict[str, NDArray[np.float64]]:
    """Make a log without a fault: 3 Hz with noise, every millisecond."""
    rng = np.random.default_rng(seed)
    time = 1e-3 * np.arange(n)
    wave = np.sin(2 * np.pi * 3 * time)
    return {
        "time": time,
        "pos": 0.1 * wave + 0.01 * rng.normal(size=n),
        "current": -0.3 * wave + 0.01 * rng.normal(size=n),
    }


def csv(path: Path, columns: Columns, separator: str = ",", decimal: str = ".") -> None:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [
        separator.join("" if np.isnan(v) else repr(v).replace(".", decimal) for v in row)
        for row in rows
    ]
    path.write_text("\n".join([separator.join(columns), *lines]) + "\n", encoding="latin-1")


def parquet(path: Path, columns: Columns) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(dict(columns)), path)


def hdf5(path: Path, columns: Columns) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values)


def mat5(path: Path, columns: Columns) -> None:
    from scipy.io import savemat

    savemat(path, dict(columns))


def mat73(path: Path, columns: Columns) -> None:
    import hdf5storage

    # It opens its file relative to the folder it is in, and appends to one that is there.
    path.unlink(missing_ok=True)
    hdf5storage.savemat(os.fspath(path), dict(columns), format="7.3", store_python_metadata=False)


def mdf4(path: Path, *groups: Columns, units: Mapping[str, str] | None = None) -> None:
    """Write each group with its first column as its clock."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        for group in groups:
            (_, times), *channels = group.items()
            file.append(
                [Signal(v, times, name=k, unit=(units or {}).get(k, "")) for k, v in channels]
            )
        file.save(path, overwrite=True)


WRITERS: dict[str, Callable[[Path, Columns], None]] = {
    "log.csv": csv,
    "semicolon.csv": lambda path, columns: csv(path, columns, ";", ","),
    "tab.txt": lambda path, columns: csv(path, columns, "\t"),
    "log.parquet": parquet,
    "log.h5": hdf5,
    "v5.mat": mat5,
    "v73.mat": mat73,
    "log.mf4": mdf4,
}
"""How each kind of log is written."""
