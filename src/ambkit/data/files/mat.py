"""MATLAB files: version 5 by SciPy, 7.3 (HDF5) by pymatreader; names are ``structure[0].field``."""

import math
import os
import re
import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base import memory_limit
from ambkit.base.errors import RecordError, library
from ambkit.base.escaping import one_line
from ambkit.data.files.hdf5 import check_within, memory_of
from ambkit.data.files.log import Log, Request, check_readable, integers, library_errors
from ambkit.data.files.timestamps import layouts_of

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_USER_BLOCKS = (0, 512, 1024, 2048)
_HEADER = 128  # bytes at the start of a MATLAB 5 file; the last two define the byte order
_COMPRESSED = 15  # type of such an element
_PART = 1 << 20


def read(path: str, request: Request) -> Log:
    """Read all numeric arrays, and times as text; see `ambkit.data.files.tables.read_log`."""
    inside = {k: v for k, v in content(path).items() if not k.startswith("__")}
    arrays = {
        one_line(name): values
        for key, value in inside.items()
        for name, values in _flat(key, value)
    }
    closed = [message for key, value in inside.items() for message in _objects(key, value)]
    if closed and not arrays:
        raise RecordError(f"{path}: {'; '.join(closed)}")
    cells = {k: v.ravel().tolist() for k, v in arrays.items() if v.dtype.kind == "U"}
    titles = _titles(arrays)
    arrays = {name: values for name, values in arrays.items() if name not in cells}
    stamped = {k: v for k, v in cells.items() if k in request.texts or layouts_of(v)}
    remarks = closed
    for name, values in arrays.items():
        if values.dtype.kind in "iu" and values.size == max(values.shape):
            arrays[name], remark = integers(name, values.ravel())
            remarks += remark
    numbers = {name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()}
    chosen = numbers
    if request.columns is not None:
        known = {k: v for k, v in numbers.items() if k in request.columns}
        # All of them if one is missing, so that the message can list them.
        chosen = known if {*request.columns} <= {*known, *stamped} else numbers
    units = {name: unit for name, (_, unit) in titles.items() if unit and name in chosen}
    titles_of = {name: title for name, (title, _) in titles.items() if name in chosen}
    return Log(path, chosen, units, remarks=tuple(remarks), texts=stamped, titles=titles_of)


def content(path: str) -> dict[str, Any]:
    """Read a file as it is: arrays, texts, cells, and its header under names with ``__``."""
    check_readable(path)
    return _content_of_7_3(path) if _is_7_3(path) else _content(path)


_TITLE = re.compile(r"(.*?)\s*(?:\[(.*)\])?\s*")


def _titles(arrays: dict[str, NDArray[Any]]) -> dict[str, tuple[str, str]]:
    """Return the names of values in Simulink's labels, and the unit in brackets behind them."""
    results = {}
    for name, label in arrays.items():
        place, _, field = name.rpartition(".")
        text = str(label.ravel()[0]).strip() if label.dtype.kind == "U" and label.size == 1 else ""
        title_match = _TITLE.fullmatch(text)
        if field == "label" and text and title_match:
            results[f"{place}.values"] = one_line(title_match[1]), one_line(title_match[2] or "")
    return results


def _is_7_3(path: str) -> bool:
    with Path(path).open("rb") as file:
        for start in _USER_BLOCKS:
            file.seek(start)
            if file.read(8) == _SIGNATURE:
                return True
    return False


def _content(path: str) -> dict[str, Any]:
    from scipy.io import loadmat

    with library_errors(path):
        packed = _unpacked(Path(path))
        memory_limit.check(path, packed, exact=False)
        memory_limit.check(path, _memory_of(path, packed))
        return dict(loadmat(path))


def _memory_of(path: str, unpacked: int) -> int:
    """Return the memory of a MATLAB 5 file of this length, as it is and as float64 [byte]."""
    # Numbers may be stored in a shorter type, so those of arrays count by their shape; structures
    # and cells count by their bytes.
    from scipy.io import whosmat

    numbers = sum(8 * math.prod(shape) for _, shape, kind in whosmat(path))
    return numbers + max(numbers, unpacked)


def _unpacked(path: Path) -> int:
    """Return the length of a MATLAB 5 file with its elements unpacked, up to the limit."""
    total, most = 0, memory_limit.limit()
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(_HEADER)[-2:])
        while order and len(tag := file.read(8)) == 8 and total <= most:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind != _COMPRESSED:
                total += size
                file.seek(size, os.SEEK_CUR)
                continue
            unpack = zlib.decompressobj()
            while size > 0 and total <= most and (part := file.read(min(size, _PART))):
                size -= len(part)
                while part and total <= most:
                    total += len(unpack.decompress(part, _PART))
                    part = unpack.unconsumed_tail
    return total


def _content_of_7_3(path: str) -> dict[str, Any]:
    h5py, reader = (
        library(name, f"{path}: a MATLAB 7.3 file", "mat", "pymatreader and h5py")
        for name in ("h5py", "pymatreader")
    )
    with library_errors(path):
        with h5py.File(path, "r") as file:
            check_within(path, file)
            sizes: list[int] = []
            file.visititems(
                lambda _, item: sizes.append(memory_of(item)) if hasattr(item, "dtype") else None
            )
            memory_limit.check(path, sum(sizes))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects without numbers
            return dict(reader.read_mat(path))


def _is_text(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "U"


_PARTS_OF_OBJECT = ("s0", "s1", "s2", "arr")  #: SciPy's form of an object of a MATLAB class.


def _is_object(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.names == _PARTS_OF_OBJECT


def _objects(name: str, value: Any) -> Iterator[str]:
    """Return objects that only MATLAB can open, such as a timeseries of Simulink."""
    if not isinstance(value, np.ndarray) or not value.dtype.names:
        return
    for element in value.ravel():
        if _is_object(value):
            own, kind = (
                one_line(part.decode("latin-1") if isinstance(part, bytes) else str(part))
                for part in (element["s0"], element["s2"])
            )
            own = own if name == "None" else name
            yield (
                f"{own} is an object of the class {kind}, which only MATLAB opens: save its "
                f"numbers there, as in {own}_t = {own}.Time; {own}_y = {own}.Data, or log as a "
                "structure with time"
            )
        else:
            for key in value.dtype.names:
                yield from _objects(f"{name}.{key}", element[key])


def _flat(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of numbers and text within a value, by their full names."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}", inner)
    elif _is_object(value):
        return
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for place, element in enumerate(value.ravel()):
            full_name = name if value.size == 1 else f"{name}[{place}]"
            for key in value.dtype.names:
                yield from _flat(f"{full_name}.{key}", element[key])
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        elements = value if isinstance(value, list) else value.ravel().tolist()
        if elements and all(isinstance(item, int | float) for item in elements):
            yield name, np.array(elements, dtype=np.float64)
            return
        texts = [item.item() if _is_text(item) and item.size == 1 else item for item in elements]
        if len(texts) > 1 and all(isinstance(text, str) for text in texts):
            yield name, np.array(texts)
            return
        for place, inner in enumerate(elements):
            yield from _flat(name if len(elements) == 1 else f"{name}[{place}]", inner)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiubU" and value.ndim > 0:
        # Simulink: a sample is a matrix with one row
        if value.ndim > 2 and value.dtype.kind != "U":
            value = value.reshape([size for size in value.shape if size > 1] or [1])
        if value.ndim <= 2:
            yield name, value
    elif isinstance(value, bool | int | float | np.integer | np.floating):
        yield name, np.array([value], dtype=np.float64)
