"""Matrices of a rotor at nodes, from a file: NumPy's ``.npz`` or MATLAB's ``.mat``.

It has M, K, G and optionally D and D_internal, square matrices whose row i is the `direction` (x,
y, th_x, th_y; z and th_z are ignored) of the node `node` (from 0), and the `place` of each node
along the shaft. Rotations are right-handed: th_y increases the deflection along x, th_x decreases
that along y. D is the damping of stationary parts, D_internal of rotating parts, such as fits.
Units are consistent, with seconds and radians; `unit_of_length` and `unit_of_mass` state the
others.
"""

import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base import memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.base.units import parse
from ambkit.data.files import mat
from ambkit.data.files.log import check_readable
from ambkit.machine.rotors.beam import Matrices

NEEDED = ("M", "K", "G", "node", "direction", "place")
OPTIONAL = ("D", "D_internal")
DIRECTIONS = ("x", "y", "z", "th_x", "th_y", "th_z")
MOST_NODES = 1000
SAME = 1e-6  #: Tolerance for rounding by other programs, over the maximum entry of the same kind.


def read_matrices(path: str | os.PathLike[str]) -> Matrices:
    """Read the matrices of a free rotor, in one plane."""
    try:
        result = _content(path)
        lacking = [name for name in NEEDED if name not in result]
        if lacking:
            there = ", ".join(result) or "nothing"
            raise ValueError(f"has no {', '.join(lacking)}; it holds {there}")
        return _in_one_plane(_FileMatrices(result))
    except ValueError as error:
        raise RecordError(f"{os.fspath(path)}: {error}") from None


def _content(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file, by name."""
    check_readable(path)
    if os.fspath(path).lower().endswith(".mat"):
        arrays = mat.content(os.fspath(path))
        return {name: np.asarray(array) for name, array in arrays.items() if name[:2] != "__"}
    if not zipfile.is_zipfile(path):
        raise ValueError("is neither a .npz of NumPy nor a .mat of MATLAB")
    try:
        with zipfile.ZipFile(path) as file:
            return {
                item.filename.removesuffix(".npy"): _array(path, file, item)
                for item in file.infolist()
            }
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError) as error:
        raise ValueError(f"is damaged: {error}") from None


def _array(
    path: str | os.PathLike[str], file: zipfile.ZipFile, member: zipfile.ZipInfo
) -> NDArray[Any]:
    """Read one array, without objects: those could execute code."""
    name = member.filename
    with file.open(member) as stream:
        shape, kind, head = _head(stream, name)
        if kind.hasobject:
            raise ValueError(f"{name} holds Python objects (a pickle), which are not read")
        size = math.prod(shape) * kind.itemsize
        memory_limit.check(path, 2 * size)
        if head + size != member.file_size:
            raise ValueError(f"is damaged: {name} says it has {size} bytes, and has others")
    with file.open(member) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


def _head(stream: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    try:
        version = np.lib.format.read_magic(stream)
        reads = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        if version not in reads:
            raise ValueError("of an unknown version")
        shape, _, kind = reads[version](stream)
    except (ValueError, EOFError) as error:
        raise ValueError(f"is damaged: {name} is no array: {error}") from None
    return tuple(shape), kind, stream.tell()


class _FileMatrices:
    """The matrices of the file, in SI."""

    def __init__(self, results: Mapping[str, NDArray[Any]]) -> None:
        length, mass = (
            _unit(results, name, base) for name, base in (("length", "m"), ("mass", "kg"))
        )
        self.place = length * _numbers(results["place"], "place").ravel()
        nodes = len(self.place)
        if not 2 <= nodes <= MOST_NODES:
            raise ValueError(f"place must be of 2 to {MOST_NODES} nodes, is of {nodes}")
        self.direction = [_word(item) for item in np.ravel(results["direction"])]
        if len(self.direction) == 1 and np.size(results["node"]) > 1:  # character rows of MATLAB
            self.direction = [item.strip() for item in np.ravel(results["direction"]).tolist()]
        unknown = [item for item in self.direction if item not in DIRECTIONS]
        if unknown:
            raise ValueError(
                f"direction must be some of {', '.join(DIRECTIONS)}, is {unknown[0][:20]!r}"
            )
        n = len(self.direction)
        node = _numbers(results["node"], "node").ravel()
        if len(node) != n or not np.isin(node, np.arange(nodes)).all():
            raise ValueError(f"node must be {n} whole numbers from 0 to {nodes - 1}")
        self.node = node.astype(int)
        turns = np.array([item.startswith("th") for item in self.direction])
        in_si = np.where(turns, length, 1.0)  # a force of one unit of length per second squared
        scale = mass * np.outer(in_si, in_si)
        self.matrices: dict[str, Array] = {}
        for name in ("M", "K", "G", *OPTIONAL):
            if name not in results and name in OPTIONAL:
                continue
            values = _numbers(results[name], name)
            if values.shape != (n, n):
                shape = " by ".join(map(str, values.shape))
                raise ValueError(f"{name} must be {n} by {n}, as direction has it; is {shape}")
            self.matrices[name] = values * scale

    def rows(self, *directions: str) -> list[int]:
        """Return the rows of the nodes' directions, node by node in the order of places."""
        results = {
            (at, to): k for k, (at, to) in enumerate(zip(self.node, self.direction, strict=True))
        }
        if len(results) < len(self.direction):
            raise ValueError("direction names the same of one node twice")
        rows = []
        for at in np.argsort(self.place, kind="stable").tolist():
            for to in directions:
                if (at, to) not in results:
                    raise ValueError(
                        f"node {at} has no direction {to}; each needs x, y, th_x, th_y"
                    )
                rows.append(results[at, to])
        return rows


def _in_one_plane(shaft: _FileMatrices) -> Matrices:
    """Return the matrices of one plane, after checking that the shaft is axisymmetric."""
    x, y = shaft.rows("x", "th_y"), shaft.rows("y", "th_x")
    signs = np.where(np.arange(len(y)) % 2, -1.0, 1.0)  # the rotation in the y plane is -th_x
    both = np.outer(signs, signs)
    others = [k for k, to in enumerate(shaft.direction) if to in ("z", "th_z")]
    of: dict[str, Array] = {}
    place = np.sort(shaft.place, kind="stable")
    if (np.diff(place) <= 0).any():
        raise ValueError("place must be of nodes apart")
    for name, A in shaft.matrices.items():
        in_x, in_y = A[np.ix_(x, x)], A[np.ix_(y, y)] * both
        x_by_y, y_by_x = A[np.ix_(x, y)] * signs, A[np.ix_(y, x)] * signs[:, None]
        size = _sizes(A, x)
        if name == "G":
            mine, same, zero = x_by_y, -y_by_x, (in_x, in_y)
        else:
            mine, same, zero = in_x, in_y, (x_by_y, y_by_x)
        for what, wrong in (
            ("must be the same in the x and the y plane, as of a round shaft", mine - same),
            ("must be symmetric in a plane", mine - mine.T),
            ("must not couple the planes" if name != "G" else "must couple the planes alone",
             zero[0]),
            ("must not couple the planes" if name != "G" else "must couple the planes alone",
             zero[1]),
        ):  # fmt: skip
            if (np.abs(wrong) > SAME * size).any():
                raise ValueError(f"{name} {what}, and does not")
        if others and (np.abs(A[np.ix_(x, others)]).max() > SAME * np.abs(A).max()):
            raise ValueError(f"{name} couples bending with z or th_z, which is not modelled")
        of[name] = (mine + same) / 2
    if np.linalg.eigvalsh(of["M"]).min() <= 0:
        raise ValueError("M must be positive definite")
    if np.trace(of["G"]) < 0:
        raise ValueError(
            "G has the sign of a rotation from y to x, or of the other side: it must be that of "
            "M q'' + (D + speed G) q' + K q, from x to y"
        )
    internal = of.get("D_internal")
    if internal is not None:
        _strains_only(internal, place)
    shear = np.zeros(len(place) - 1)
    return Matrices(of["M"], of["K"], of["G"], of.get("D"), place, shear, internal)


def _strains_only(internal: Array, place: Array) -> None:
    """Raise ValueError if rotating damping resists a rigid-body motion."""
    rigid = np.zeros((2, len(internal)))
    rigid[0, ::2] = 1.0
    rigid[1, ::2], rigid[1, 1::2] = place - place.mean(), 1.0
    left = np.abs(rigid) @ np.abs(internal)
    if (np.abs(rigid @ internal) > SAME * left.max(axis=1, keepdims=True)).any():
        raise ValueError(
            "D_internal must leave the rigid body free: what turns with the rotor feels its "
            "bending alone"
        )


def _sizes(A: Array, rows: list[int]) -> Array:
    """Return the maximum entry of each kind: of deflections, rotations, and between both."""
    part = np.abs(A[rows])
    kind = np.arange(len(rows)) % 2
    of_kind = [max(part[kind == k].max(), 1e-300) for k in (0, 1)]
    parts = np.array(of_kind)[kind]
    return np.asarray(np.sqrt(np.outer(parts, parts)))


def _unit(results: Mapping[str, NDArray[Any]], what: str, base: str) -> float:
    name = f"unit_of_{what}"
    if name not in results:
        raise ValueError(f'has no {name}, such as "{base}"')
    unit = _word(results[name])
    size = parse(f"1 {unit}", base)
    if not size > 0:
        raise ValueError(f"{name} must be a unit, is {unit[:20]!r}")
    return size


def _word(value: Any) -> str:
    """Return a text from any nesting of arrays."""
    while isinstance(value, np.ndarray):
        if value.size != 1:
            raise ValueError("direction and units must be texts")
        value = value.ravel()[0]
    if not isinstance(value, str):
        raise ValueError(f"direction and units must be texts, found {str(value)[:20]!r}")
    return value.strip()


def _numbers(values: NDArray[Any], name: str) -> Array:
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be of real numbers")
    numbers = np.asarray(values, float)
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be finite")
    return numbers
