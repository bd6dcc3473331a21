"""Triangular mesh of outlines: Delaunay refinement, with a size that depends on the air gap.

Ruppert's algorithm (J. Algorithms 18, 1995) in rounds: edges whose diametral circle has a vertex
are halved, then circumcentres of triangles too large or too flat become vertices.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy  # its `spatial` is loaded by the first mesh, not by each command
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.magnetostatics.layout import Layout, Points, contains, flat

GRADE = 0.5  #: Growth of triangles with the distance from the gap.
#: Edges in the gap, and at corners beside it, over the width of the gap.
IN_GAP, AT_CORNER = 1.5, 0.1
LARGEST = 0.08  #: Longest edge, over the size of the section.
SAMPLES = 400  #: Points along the section at which the width of the gap is measured.
ROUNDS = 80
MOST = 100_000  #: Maximum number of corners; drawings have one to some ten thousand.
FLAT = 1.3  #: Circumradius by shortest edge above which a triangle is too flat (about 22 degrees).


class Mesh(NamedTuple):
    """Triangles of second order: corners and midpoints of their edges."""

    nodes: Points  #: (n,) Corners first.
    triangles: NDArray[np.intp]  #: (m, 6) Corners 0 1 2, midpoints of edges 12, 20 and 01.
    #: (m,) Index of the last region that contains it; -1 for the surrounding air.
    region: NDArray[np.intp]
    rim: NDArray[np.bool_]  #: (n,) Whether a node is on the boundary.


Size = Callable[[Points], Array]
Circles = Sequence[tuple[complex, float]]


def mesh_of(layout: Layout, fineness: float = 1.0, skin: float | None = None) -> Mesh:
    """Return the mesh of a layout; a larger fineness means shorter edges everywhere."""
    # skin: length of edges at the surface of iron that conducts [m]
    points, edges = checked_outlines(layout)
    size = _sizes(layout, fineness, skin)
    points, edges = _refined(points, edges, layout.circles, size)
    triangles = scipy.spatial.Delaunay(flat(points)).simplices.astype(np.intp)
    corners = points[triangles]
    turn = np.imag(np.conj(corners[:, 1] - corners[:, 0]) * (corners[:, 2] - corners[:, 0]))
    triangles[turn < 0] = triangles[turn < 0][:, ::-1]
    middle = corners.mean(axis=1)
    inside = contains(_followed(points, edges, layout.boundary.outline, layout), middle)
    triangles, middle = triangles[inside & (np.abs(turn) > 0)], middle[inside & (np.abs(turn) > 0)]
    region = np.full(len(triangles), -1)
    for number, part in enumerate(layout.regions):
        region[contains(_followed(points, edges, part.outline, layout), middle)] = number
    return _second_order(points, triangles, region, layout)


def checked_outlines(layout: Layout) -> tuple[Points, NDArray[np.intp]]:
    """Return unique vertices and edges of all outlines, cut at contacts."""
    # Raises if outlines intersect.
    outlines = [layout.boundary.outline, *(region.outline for region in layout.regions)]
    scale = float(np.abs(layout.boundary.outline).max())
    rounded = np.round(np.concatenate(outlines) / (1e-9 * scale))
    _, first, inverse = np.unique(rounded, return_index=True, return_inverse=True)
    points = np.concatenate(outlines)[first]
    edges, owner, start = [], [], 0
    for number, outline in enumerate(outlines):
        at = inverse[start : start + len(outline)]
        start += len(outline)
        for a, b in zip(at, np.roll(at, -1), strict=True):
            along = (points - points[a]) / (points[b] - points[a])
            on = (np.abs(along.imag) * abs(points[b] - points[a]) < 1e-8 * scale) & (
                (along.real > 1e-9) & (along.real < 1 - 1e-9)
            )
            chain = [a, *np.flatnonzero(on)[np.argsort(along.real[on])], b]
            edges += [sorted(pair) for pair in pairwise(chain)]
            owner += [number] * (len(chain) - 1)
    pairs, index = np.unique(np.array(edges), axis=0, return_index=True)
    _refuse_crossings(layout, points, pairs, np.array(owner)[index])
    return points, pairs


def _refuse_crossings(
    layout: Layout, points: Points, edges: NDArray[np.intp], owner: NDArray[np.intp]
) -> None:
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    tolerance = 1e-7 * float(np.abs(points).max())

    def side(place: Points) -> Array:
        off = np.imag(np.conj((b - a) / np.abs(b - a))[:, None] * (place[None, :] - a[:, None]))
        return np.sign(np.where(np.abs(off) > tolerance, off, 0.0))

    apart = side(a) * side(b) < 0
    shares = (edges[:, None, :, None] == edges[None, :, None, :]).any(axis=(2, 3))
    crossing = np.argwhere(apart & apart.T & ~shares)
    if len(crossing):
        one, other = sorted(owner[crossing[0]])
        keys = [layout.boundary.key, *(region.key for region in layout.regions)]
        raise AmbkitError(f"{keys[other]}: its outline crosses that of {keys[one]}")


def _sizes(layout: Layout, fineness: float, skin: float | None) -> Size:
    """Return the length of edges by place: from the width of the gap, and corners beside it."""
    parts: dict[bool, list[Points]] = {True: [], False: []}
    corners = []
    extent = float(np.ptp(layout.boundary.outline.real) + np.ptp(layout.boundary.outline.imag)) / 2
    for region in layout.regions:
        if region.coil >= 0:
            continue
        a = region.outline
        step = np.roll(a, -1) - a
        corners.append(a[np.abs(np.angle(step / np.roll(step, 1))) > np.radians(20)])
        parts[region.moves] += [
            start + along * np.arange(0.0, 1.0, extent / SAMPLES / abs(along))
            for start, along in zip(a, step, strict=True)
        ]
    moving, fixed = (np.concatenate(parts[key]) for key in (True, False))
    to_moving, to_fixed = scipy.spatial.cKDTree(flat(moving)), scipy.spatial.cKDTree(flat(fixed))
    rim = np.concatenate([moving, fixed])
    width = np.concatenate([to_fixed.query(flat(moving))[0], to_moving.query(flat(fixed))[0]])
    tree = scipy.spatial.cKDTree(flat(rim))
    sharp = np.concatenate(corners)
    beside = width[tree.query(flat(sharp))[1]]

    def size(places: Points) -> Array:
        far, nearest = tree.query(flat(places))
        plain = IN_GAP * width[nearest] + GRADE * far
        fine = AT_CORNER * beside + GRADE * np.abs(places[:, None] - sharp)
        if skin is not None:
            plain = np.minimum(plain, skin + GRADE * far)
        least = np.minimum(np.minimum(plain, LARGEST * extent), fine.min(axis=1))
        return np.asarray(least / fineness)

    return size


def _middle(points: Points, edges: NDArray[np.intp], circles: Circles) -> Points:
    """Return the midpoints of edges (n, 2), on their circles if both ends are."""
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    middle = 0.5 * (a + b)
    for centre, radius in circles:
        on = np.abs(b - a) < 0.3 * radius
        for end in (a, b):
            on &= np.abs(np.abs(end - centre) - radius) < 1e-7 * radius
        out = middle[on] - centre
        middle[on] = centre + radius * out / np.abs(out)
    return middle


def _refined(
    points: Points, edges: NDArray[np.intp], circles: Circles, size: Size
) -> tuple[Points, NDArray[np.intp]]:
    for _ in range(ROUNDS):
        middle = _middle(points, edges, circles)
        half = 0.5 * np.abs(points[edges[:, 1]] - points[edges[:, 0]])
        tree = scipy.spatial.cKDTree(flat(points))
        far, near = tree.query(flat(middle), k=3)
        other = (near != edges[:, :1]) & (near != edges[:, 1:])
        split = (2 * half > size(middle)) | (other & (far < 0.999 * half[:, None])).any(axis=1)
        if not split.any():
            new = _circumcentres(points, size)
            if not len(new):
                return points, edges
            ends = scipy.spatial.cKDTree(flat(middle))
            near = np.asarray(ends.query(flat(new), k=min(4, len(middle)))[1], dtype=np.intp)
            inside = np.abs(new[:, None] - middle[near]) < half[near]
            split[near[inside]] = True
            new = new[~inside.any(axis=1)]
            points = np.append(points, new)
        at = np.flatnonzero(split)
        number = len(points) + np.arange(len(at))
        points = np.append(points, middle[at])
        if len(points) > MOST:
            raise AmbkitError(
                f"the outlines cannot be meshed: more than {MOST} corners, as its thinnest gap is "
                "too thin for a section as large"
            )
        halves = [np.column_stack([edges[at, 0], number]), np.column_stack([number, edges[at, 1]])]
        edges = np.concatenate([edges[~split], *halves])
    raise AmbkitError(f"the outlines cannot be meshed: still not fine enough after {ROUNDS} rounds")


def _circumcentres(points: Points, size: Size) -> Points:
    """Return circumcentres of triangles that are too large or too flat, with a minimum distance."""
    triangles = scipy.spatial.Delaunay(flat(points)).simplices
    a, b, c = points[triangles].T
    u, v = b - a, c - a
    double = 2 * np.imag(np.conj(u) * v)
    with np.errstate(divide="ignore", invalid="ignore"):
        out = 1j * (v * np.abs(u) ** 2 - u * np.abs(v) ** 2) / -double
    radius, centre = np.abs(out), a + out
    shortest = np.minimum(np.minimum(np.abs(u), np.abs(v)), np.abs(b - c))
    large = radius > 0.7 * size((a + b + c) / 3)
    bad = np.isfinite(radius) & (large | (radius > FLAT * shortest))
    for part, of in ((centre.real, points.real), (centre.imag, points.imag)):
        bad &= (part > of.min()) & (part < of.max())
    order = np.flatnonzero(bad)[np.argsort(-radius[bad])]
    centre, radius = centre[order], radius[order]
    keep = np.ones(len(centre), dtype=bool)
    if len(centre) > 1:
        tree = scipy.spatial.cKDTree(flat(centre))
        for number, near in enumerate(tree.query_ball_point(flat(centre), 0.9 * radius)):
            if keep[number]:
                keep[[other for other in near if other > number]] = False
    return np.asarray(centre[keep])


def _followed(points: Points, edges: NDArray[np.intp], outline: Points, layout: Layout) -> Points:
    """Return an outline with arcs as fine as the mesh."""
    ends = np.roll(outline, -1)
    pairs = np.column_stack([np.arange(len(outline)), len(outline) + np.arange(len(outline))])
    chain = np.concatenate([outline, ends])
    for _ in range(6):
        middle = _middle(chain, pairs, layout.circles)
        number = len(chain) + np.arange(len(pairs))
        chain = np.append(chain, middle)
        pairs = np.column_stack([pairs[:, 0], number, number, pairs[:, 1]]).reshape(-1, 2)
    return chain[pairs[:, 0]]


def _second_order(
    points: Points, triangles: NDArray[np.intp], region: NDArray[np.intp], layout: Layout
) -> Mesh:
    sides = np.sort(triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    edges, inverse, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    middle = 0.5 * (points[edges[:, 0]] + points[edges[:, 1]])
    low, high = np.full(len(edges), 10**6), np.full(len(edges), -2)
    np.minimum.at(low, inverse, np.repeat(region, 3))
    np.maximum.at(high, inverse, np.repeat(region, 3))
    between = (low != high) | (count == 1)
    middle[between] = _middle(points, edges[between], layout.circles)
    nodes = np.append(points, middle)
    rim = np.zeros(len(nodes), dtype=bool)
    rim[edges[count == 1].ravel()] = True
    rim[len(points) + np.flatnonzero(count == 1)] = True
    return Mesh(nodes, np.hstack([triangles, len(points) + inverse.reshape(-1, 3)]), region, rim)
