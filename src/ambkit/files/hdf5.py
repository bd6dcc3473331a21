"""HDF5: each data set of numbers by its path, ``rig/current``, with the unit that it carries."""

import os
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.errors import ExtraMissing
from ambkit.files.log import Log, check_readable, damaged, whole_numbers
from ambkit.files.timestamps import layouts_of

Array = NDArray[np.float64]

_UNIT_NAMES = ("unit", "units", "Unit", "Units", "unit_string")


def read(
    path: str | os.PathLike[str],
    wanted: Collection[str | int] | None = None,
    told: Callable[[str], object] = lambda _: None,
    lenient: bool = False,
    texts: Collection[str | int] = (),
) -> Log:
    """Read data sets; see `ambkit.files.log.read_log`.

    A data set of a compound type gives each of its fields, ``rig/log.current``.
    """
    check_readable(path)
    import pyarrow as pa

    try:
        import h5py
    except ModuleNotFoundError:
        raise ExtraMissing(f"{path}: an HDF5 file", "h5py", "hdf5") from None
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    stamped: dict[str, Any] = {}
    remarks: list[str] = []
    try:
        with h5py.File(path, "r") as file:
            found = _data_sets(file, h5py)
            known = wanted is not None and set(wanted) <= set(found)
            for name, (data, part) in found.items():
                if known and wanted is not None and name not in wanted:
                    continue
                told(f"reading {name}")
                values = data[()] if part is None else data[part]
                if values.dtype.kind not in "fiub":
                    cells = pa.array(map(_plain, values.tolist()), pa.string())
                    if name in texts or layouts_of(cells):
                        stamped[name] = cells
                    continue
                arrays[name], remark = whole_numbers(name, values)
                remarks += remark
                unit = next((data.attrs[k] for k in _UNIT_NAMES if k in data.attrs), None)
                if unit is not None and part is None:
                    units[name] = unit.decode() if isinstance(unit, bytes) else str(unit)
            about = {key: _plain(value) for key, value in file.attrs.items()}
    except Exception as error:  # h5py passes on whatever the HDF5 library says
        raise damaged(path, error) from error
    meta = {key: value for key, value in about.items() if isinstance(value, str | int | float)}
    return Log(os.fspath(path), arrays, units, meta=meta, remarks=tuple(remarks), texts=stamped)


def _data_sets(file: Any, h5py: Any) -> dict[str, tuple[Any, str | None]]:
    """Return vectors and matrices of numbers, and vectors of text; of a compound type by field."""
    found: dict[str, tuple[Any, str | None]] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
            return
        if item.dtype.names:
            for field in item.dtype.names:
                if item.dtype[field].kind in "fiub":
                    found[f"{name}.{field}"] = item, field
        elif item.dtype.kind in "fiub" or (item.dtype.kind in "SO" and item.ndim == 1):
            found[name] = item, None

    file.visititems(visit)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return value.item() if isinstance(value, np.generic) else value
