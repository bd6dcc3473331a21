"""Magnet force on a grid of operating points, with its uncertainty, from closed-loop records.

The identified law is corrected at the nodes, bilinearly between them, by the innovations of the
Kalman filter (therefore unbiased in closed loop). Its error is assumed to be smooth: nodes between
visited ones are determined by them, and far from the visited range the law itself remains.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from ambkit._core import Magnet
from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import SCALE, smooth
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of, symmetric_current_limit

FINE = 65
"""Nodes per side of the filter's table over the range of the records: several per node of the map,
because the law is curved between them.
"""

ASSUMED = 0.2  #: Prior standard deviation of the law's error, over its range.
NODES = (9, 7, 5)  #: Default numbers of nodes per side, the finest first.
ENOUGH = 20  #: Samples per node for its separation from the neighbours.
LARGEST = 20_000_000  #: Maximum number of stored derivatives, one for each sample and node: 160 MB.
ROUNDS = 3  #: Gauss-Newton steps; the innovations are nearly linear in the force.


@dataclass(frozen=True, eq=False)
class ForceMap:
    """Magnet force at the nodes of a grid, with standard errors."""

    current: Array  #: (ni,) Nodes of the control current [A].
    displacement: Array  #: (nx,) Nodes of the displacement [m].
    #: (nx, ni) Magnet force [N], up to a constant that is equivalent to a disturbance.
    force: Array
    #: (nx, ni) Its standard error [N]; about `assumed` where the rotor never was.
    standard_error: Array
    law: Array  #: (nx, ni) Prior law [N].
    assumed: float  #: Prior standard deviation of the law's error [N].

    @property
    def seen(self) -> Bools:
        """Where the records dominate the prior: a standard error below a tenth of it."""
        return np.asarray(self.standard_error < 0.1 * self.assumed)

    @property
    def observed(self) -> Bools:
        """Where the records are informative: a standard error below half of the prior."""
        return np.asarray(self.standard_error < 0.5 * self.assumed)

    def points(self) -> ForcePoints:
        """Return the nodes as points for the training of an expert."""
        # Only those determined by the records (`observed`): the others show the law, and would
        # count as measurements that confirm it.
        if not self.observed.any():
            raise AmbkitError(
                "the records do not determine the magnet force: the rotor moves too little, see "
                "'ambkit excite'"
            )
        iu, x = np.meshgrid(self.current, self.displacement)
        at = self.observed
        return ForcePoints(iu[at], x[at], self.force[at], self.standard_error[at])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write them as ``.csv`` or ``.parquet`` for ``ambkit train map``."""
        self.points().save(path)


def force_map(
    model: LoopModel,
    records: Record | Sequence[Record],
    *,
    nodes: tuple[int, int] | None = None,
    settling: float = 0.0,
    note: Callable[[str], None] = lambda text: None,
) -> ForceMap:
    """Identify the force on a grid of operating points."""
    several = [records] if not isinstance(records, Sequence) else list(records)
    b = model.isolated
    iu = np.concatenate([b.amplifier.gain * model.corrected(r)["u"] for r in several])
    x = np.concatenate([model.corrected(r)["y"] / b.sensor.gain for r in several])
    limit = b.clearance
    visited = np.clip(iu, b.current_min, b.current_max), np.clip(x, -limit, limit)
    across, along = nodes_for(*visited) if nodes is None else nodes
    current = _nodes("currents", visited[0], across)
    displacement = _nodes("displacements", visited[1], along)
    grid = np.meshgrid(current, displacement)
    law = magnet_of(b).force(*grid)
    assumed = ASSUMED * float(np.ptp(law))

    def innovations(correction: Array) -> tuple[Array, Array, Bools]:
        magnet = _Corrected(b, (displacement, current), correction.reshape(law.shape), ranges)
        corrected = replace(model, magnet=magnet)
        parts = []
        for record in several:
            e, S, used = corrected.innovations(record)
            used[: max(1, round(settling / record.sampling_time))] = False
            parts.append((e, np.sqrt(S), used))
        e, sigma, used = (np.concatenate(column) for column in zip(*parts, strict=True))
        return e, sigma, used

    ranges = [_all_of(values) for values in visited]
    before = _known_before(current, displacement, assumed)
    correction, errors = _corrections(innovations, before, 0.05 * assumed, note)
    return ForceMap(
        current,
        displacement,
        law + correction.reshape(law.shape),
        errors.reshape(law.shape),
        law,
        assumed,
    )


def _corrections(
    innovations: Callable[[Array], tuple[Array, Array, Bools]],
    before: Array,
    step: float,
    note: Callable[[str], None],
) -> tuple[Array, Array]:
    """Return the corrections at the nodes (n,) and their standard errors, by least squares."""
    # before (n, n): information; step [N]: of the differences
    w = np.zeros(len(before))
    for k in range(ROUNDS):
        e, sigma, used = innovations(w)
        slopes = []
        for j in range(w.size):
            note(f"force map, round {k + 1} of {ROUNDS}, node {j + 1} of {w.size}")
            up, down = w.copy(), w.copy()
            up[j] += step
            down[j] -= step
            slopes.append((innovations(up)[0] - innovations(down)[0]) / (2 * step))
        # Their variances are constant: they change with the stiffness too, and least squares of
        # e/sigma would increase sigma (the other half of the likelihood, which hardly depends on
        # the force, is omitted).
        J = np.array(slopes)[:, used] / sigma[used]
        information = J @ J.T + before
        w = w - np.linalg.solve(information, J @ (e[used] / sigma[used]) + before @ w)
    # A constant force is equivalent to a disturbance: it is subtracted, in the mean of the records.
    seen = np.diag(J @ J.T)
    less_mean = np.eye(w.size) - seen / seen.sum()
    covariance = less_mean @ np.linalg.inv(information) @ less_mean.T
    return less_mean @ w, np.sqrt(np.diag(covariance))


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A machine's law with a correction between the nodes of a grid, as a table of the core."""

    # The core's magnets give their force as ``k_i iu + k_s x``; the correction is divided between
    # the two as in the paper's least squares (`symmetric_current_limit`), and its value at the
    # origin, which no stiffness can give, belongs to the disturbance.

    machine: Machine
    nodes: tuple[Array, Array]  #: Of displacement and current.
    w: Array
    ranges: list[tuple[float, float]]

    def in_core(self, core: ModuleType) -> Magnet:
        """Build the C implementation."""
        from scipy.interpolate import RegularGridInterpolator

        b = self.machine
        current, displacement = (np.linspace(low, high, FINE) for low, high in self.ranges)
        iu, x = np.meshgrid(current, displacement)
        bent = RegularGridInterpolator(self.nodes, self.w)
        inside = [np.clip(axis, nodes[0], nodes[-1])
                  for axis, nodes in zip((x, iu), self.nodes, strict=True)]  # fmt: skip
        origin = [np.clip(0.0, nodes[0], nodes[-1]) for nodes in self.nodes]
        more = bent(np.stack(inside, axis=-1)) - float(bent(np.array([origin]))[0])
        ampere, metre = symmetric_current_limit(b)
        size = (iu / ampere) ** 2 + (x / metre) ** 2
        part = np.divide(more, size, out=np.zeros_like(more), where=size > 0)
        k_i, k_s = magnet_of(b).stiffness(iu, x)
        return core.Table(  # type: ignore[no-any-return]
            x_min=displacement[0],
            dx=displacement[1] - displacement[0],
            iu_min=current[0],
            diu=current[1] - current[0],
            k_i=np.ascontiguousarray(k_i + part * iu / ampere**2),
            k_s=np.ascontiguousarray(k_s + part * x / metre**2),
        )


def nodes_for(iu: Array, x: Array) -> tuple[int, int]:
    """Return the numbers of nodes along current and displacement: the finest that fits."""
    # At least three of four nodes near the path of the rotor have `ENOUGH` samples, and the
    # derivatives fit into memory; otherwise the coarsest. iu (n,) [A]; x (n,) [m]
    share = []
    for visited in (iu, x):
        low, high = _ends(visited)
        share.append(np.clip((visited - low) / max(high - low, np.finfo(float).tiny), 0, 1))
    for count in NODES:
        nearest = [np.round((count - 1) * part) for part in share]
        cell = count * nearest[1] + nearest[0]
        samples = np.unique(cell[np.isfinite(cell)], return_counts=True)[1]
        if np.mean(samples >= ENOUGH) >= 0.75 and count**2 * iu.size <= LARGEST:
            return count, count
    return NODES[-1], NODES[-1]


def _known_before(current: Array, displacement: Array, assumed: float) -> Array:
    """Return the prior information on the law's errors at the nodes, (n, n) [1/N^2]."""
    iu, x = np.meshgrid(current, displacement)
    at = np.stack([iu.ravel() / np.ptp(current), x.ravel() / np.ptp(displacement)])
    alike = smooth(at, at, np.full((2, 1), SCALE))
    return np.asarray(np.linalg.inv(assumed**2 * alike))


def _all_of(visited: Array) -> tuple[float, float]:
    """Return the range with a margin, beyond which the filter's stiffnesses are constant."""
    low, high = float(np.nanmin(visited)), float(np.nanmax(visited))
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def _ends(visited: Array) -> Array:
    return np.asarray(np.nanpercentile(visited, [0.5, 99.5]))


def _nodes(name: str, visited: Array, count: int) -> Array:
    low, high = _ends(visited)
    if not high > low:
        raise AmbkitError(f"the records cover no range of {name}: excite the rotor")
    if count < 4:
        raise AmbkitError(f"nodes of {name} must be 4 or more, are {count}")
    return np.linspace(low, high, count)
