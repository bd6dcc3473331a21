"""HDF5: each numeric data set by its path, ``rig/current``, with its unit."""

from typing import Any

import numpy as np

from ambkit.base import memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, library, shortened
from ambkit.base.escaping import one_line
from ambkit.data.files.log import Log, Request, check_readable, integers, library_errors
from ambkit.data.files.timestamps import layouts_of

_LESS = " a channel map that names fewer data sets takes less;"
_UNIT_NAMES = ("unit", "units", "Unit", "Units", "unit_string")


def read(path: str, request: Request) -> Log:
    """Read data sets; see `ambkit.data.files.tables.read_log`."""
    # The fields of a compound type are separate arrays, ``rig/log.current``.
    check_readable(path)
    h5py = library("h5py", f"{path}: an HDF5 file", "hdf5")
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    stamped: dict[str, Any] = {}
    remarks: list[str] = []
    with library_errors(path), h5py.File(path, "r") as file:
        check_within(path, file)
        chosen = _data_sets(file, h5py)
        if request.columns is not None and set(request.columns) <= set(chosen):
            chosen = {name: chosen[name] for name in chosen if name in request.columns}
        memory_limit.check(path, sum(memory_of(*item) for item in chosen.values()), _LESS)
        for name, (data, part) in chosen.items():
            request.progress(f"reading {name}")
            values = data[()] if part is None else data[part]
            if values.dtype.kind not in "fiub":
                cells = list(map(_plain, values.tolist()))
                is_text = all(isinstance(cell, str) for cell in cells)
                if is_text and (name in request.texts or layouts_of(cells)):
                    stamped[name] = cells
                continue
            arrays[name], remark = integers(name, values)
            remarks += remark
            unit = next((data.attrs[k] for k in _UNIT_NAMES if k in data.attrs), None)
            if unit is not None and part is None:
                units[name] = one_line(_plain(unit))
        about = {key: _plain(value) for key, value in file.attrs.items()}
    meta = {key: value for key, value in about.items() if isinstance(value, str | int | float)}
    return Log(path, arrays, units, meta=meta, remarks=tuple(remarks), texts=stamped)


def _data_sets(file: Any, h5py: Any) -> dict[str, tuple[Any, str | None]]:
    """Return vectors and matrices of numbers, and vectors of text; of a compound type by field."""
    results: dict[str, tuple[Any, str | None]] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
            return
        if item.dtype.names:
            for field in item.dtype.names:
                if item.dtype[field].kind in "fiub":
                    results[one_line(f"{name}.{field}")] = item, field
        elif item.dtype.kind in "fiub" or (item.dtype.kind in "SO" and item.ndim == 1):
            results[one_line(name)] = item, None

    file.visititems(visit)
    return results


def check_within(path: str, file: Any) -> None:
    """Reject an HDF5 file with external storage, which could refer to any file."""
    import h5py

    problems: list[str] = []

    def see_link(name: bytes, info: Any) -> None:
        if info.type not in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT):
            problems.append(f"{name.decode(errors='replace')} is a link to another file")

    def see(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            if item.external:
                problems.append(f"{name} has its numbers in {item.external[0][0]}")
            elif item.is_virtual:
                problems.append(f"{name} is made of data sets of other files")

    file.id.links.visit(see_link, info=True)
    file.visititems(see)
    if problems:
        advice = "nothing outside of the file is read: copy the numbers into it"
        problem = shortened([f"{path}: {one_line(problem)}; {advice}" for problem in problems])
        raise RecordError(problem, path)


def memory_of(data: Any, part: str | None = None) -> int:
    """Return the memory of a data set, or a field of it, as it is and as float64 [byte]."""
    kind = data.dtype if part is None else data.dtype[part]
    return int(data.size) * (int(kind.itemsize) + 8)


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return value.item() if isinstance(value, np.generic) else value
