"""Smooth force surface through measured points: the machine's law, and a correction.

The law is the described one, or one with fitted magnet constant and air gap if these are more
likely.

The correction is a Gaussian process (kriging; Rasmussen and Williams 2006, chapter 2): near points
it has their accuracy, and far from all points it is zero with the estimated uncertainty of the law.
Inaccurate points therefore have little effect, and without points the law remains.

scikit-learn (1.9) was tried: its surfaces through the same points are as accurate (9x9 points of
0.3 N: 0.109 N, here 0.111 N), but prior knowledge of the law's error, its length scale and the
scatter can only be given as bounds, the estimated scatter counts as uncertainty of the surface, and
its search uses all points: 31 s for 1000 points (7 s on one thread), here 0.3 s. It would also add
37 MB to the installation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.machine.force_law import IsolatedAxis, Law
from ambkit.machine.forces.fitted_law import fitted_law
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.patches import PatchedForce
from ambkit.machine.laws import law_of

LAW_SHARE, LEAST_SHARE = 0.2, 0.05
"""Prior and minimum error of a law, over the spread of its force. Points that agree with it do not
prove that it is right elsewhere.
"""

SCALE, SHORTEST, FARTHEST = 0.5, 0.3, 1.0
"""Correlation length of the law's error: prior, minimum and maximum, over the area of the points.
5x5 rules could not follow a shorter one, nor could it be separated from noise; beyond the area a
correction soon ends.
"""

DOUBT = (3.0, 2.0, 2.0, 30.0)
"""Prior standard deviations, as factors: of the law's error, its correlation length in current and
in displacement, and the scatter of the points, whose prior is a tenth of the law's error.
"""

BEST = 1e-3  #: Minimum error of a point, over the law's error: limits the smoothness.
MOST = 1000  #: Beyond this number, neighbouring points are averaged first: the effort is cubic.
FITTED = 12  #: Minimum number of points for fitting magnet constant and air gap of the law.
JUDGES = 200  #: Points for estimating the law's error and its correlation length.


class ForceSurface(PatchedForce):
    """Force from measured points: the magnet of a plant or of a filter."""

    refitted = False  #: Whether the corrected law is fitted to the points, or the described one.

    # As a function it is the force itself, and can be given to :func:`ambkit.stiffness_map`; the C
    # core has it as smooth patches over the bearing's currents and travel, which are as near to it
    # as `ambkit.machine.forces.patches.ACCURACY` says.
    # How wrong the law is, how far its errors reach, and the scatter of points whose standard
    # errors are not known, are found from the points: the values of the largest posterior density,
    # known before as `LAW_SHARE`, `SCALE` and `DOUBT` say. An offset of all forces may be as large
    # as the law's error.

    def __init__(
        self,
        machine: IsolatedAxis,
        points: ForcePoints,
        law_error: float | None = None,
        *,
        like: ForceSurface | None = None,
    ) -> None:
        if law_error is not None and not (np.isfinite(law_error) and law_error > 0):
            raise AmbkitError(f"law_error must be greater than 0 N, is {law_error!r}")
        at = np.stack([points.current, points.displacement])
        self._origin, self._extent = at.min(axis=1, keepdims=True), np.ptp(at, axis=1)[:, None]
        if like is not None:
            self._origin, self._extent = like._origin, like._extent
        if not np.all(self._extent > 0):
            name = ("current", "displacement")[int(np.argmin(self._extent > 0))]
            raise AmbkitError(f"the points must differ in {name}, have all the same")
        self.machine, self.points, self._scale = machine, points, 1.0
        known = points.standard_error is not None
        if like is None:
            result = self._learned(at, law_error)
        else:
            result = _FittedParameters(
                like.law_error, like._reach, 1.0 if known else float(like.scatter or 1)
            )
            self.refitted = like.refitted
        self._law = self._base()
        self._at, off, error = self._off(at)
        self.law_error: float = result.law_error
        self._reach: Array = result.reach
        self.reach = tuple((self._reach * self._extent).ravel().tolist())
        self.scatter: float | None = None if known else result.scatter
        self._factor, self._pull = _solved(self._at, off, error, result)

    def _base(self) -> Law:
        """Return the law that is corrected: the described or the fitted one."""
        return fitted_law(self.machine, self.points)[1] if self.refitted else law_of(self.machine)

    def _off(self, at: Array) -> tuple[Array, Array, Array]:
        """Return places (2, n), and the points' deviations from the law with standard errors."""
        off = self.points.force - self._law.force(*at)
        known = self.points.standard_error
        error = np.ones_like(off) if known is None else known
        return _averaged((at - self._origin) / self._extent, off, error)

    def _learned(self, at: Array, law_error: float | None) -> _FittedParameters:
        """Select the law to correct and estimate its error, from some of the points."""
        share = np.linspace(0, 1, 41)
        box = np.meshgrid(*(self._origin + share * self._extent))
        results = []
        # A stated error refers to the described law.
        fits = law_error is None and len(self.points) >= FITTED
        for self.refitted in (False, True) if fits else (False,):
            self._law = self._base()
            places, off, error = self._off(at)
            few = np.random.default_rng(0).permutation(off.size)[:JUDGES]
            known, spread = self.points.standard_error is not None, self._law.force(*box)
            learned, surprise = _fitted(
                places[:, few], off[few], error[few], known, float(np.std(spread)), law_error
            )
            # Schwarz 1978: two more parameters.
            results.append((surprise + self.refitted * np.log(few.size), self.refitted, learned))
        _, self.refitted, best = min(results, key=lambda item: item[0])
        return best

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
        return self._scale * np.asarray(self._law.force(iu, x)) + self.correction(iu, x)

    def correction(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the difference of the force to the law's [N] at places (iu [A], x [m])."""
        iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
        places = self._places(iu, x)
        parts = np.array_split(places, 1 + places.shape[1] * self._pull.size // 2_000_000, axis=1)
        result = np.concatenate([self._pull @ _alike(self._at, p, self._reach) for p in parts])
        return np.asarray(self._scale * self.law_error**2 * result.reshape(iu.shape))

    def noise(self, points: ForcePoints) -> Array:
        """Return the standard deviations of points (n,) [N]: their own, or the scatter."""
        if points.standard_error is not None:
            return points.standard_error
        assert self.scatter is not None
        return np.full(len(points), self._scale * self.scatter)

    def standard_error(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the standard error of the force [N] at places (iu [A], x [m])."""
        from scipy.linalg import solve_triangular

        iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
        shared = self.law_error**2 * _alike(self._at, self._places(iu, x), self._reach)
        reduction = np.sum(solve_triangular(self._factor, shared, lower=True) ** 2, axis=0)
        # Prior: the law's error and the offset's.
        left = np.maximum(2 * self.law_error**2 - reduction, 0)
        return np.asarray(self._scale * np.sqrt(left).reshape(iu.shape))

    def _places(self, iu: Array, x: Array) -> Array:
        return np.asarray((np.stack([iu.ravel(), x.ravel()]) - self._origin) / self._extent)


class _FittedParameters(NamedTuple):
    law_error: float
    reach: Array
    scatter: float


def smooth(a: Array, b: Array, length_scale: Array) -> Array:
    """Return the correlation (n, m) of a law's errors at places (2, n) and (2, m)."""
    # Matérn's, nu = 5/2 (Rasmussen and Williams 2006, eq. 4.17): twice differentiable. a (2, n); b
    # (2, m); reach (2, 1)
    from scipy.spatial.distance import cdist

    far = np.sqrt(5) * cdist((a / length_scale).T, (b / length_scale).T)
    return np.asarray((1 + far + far**2 / 3) * np.exp(-far))


def _alike(a: Array, b: Array, length_scale: Array) -> Array:
    """Return the correlation of the law's errors at places (2, n), (2, m), plus the offset's 1."""
    return smooth(a, b, length_scale) + 1


def _solved(at: Array, off: Array, error: Array, result: _FittedParameters) -> tuple[Array, Array]:
    """Return the Cholesky factor of the points' covariance (n, n) [N], and the weights (n,)."""
    # The weights [1/N] are the inverse of the covariance times the deviations from the law.
    from scipy.linalg import cho_solve

    noise = np.hypot(result.scatter * error, BEST * result.law_error)
    covariance = result.law_error**2 * _alike(at, at, result.reach) + np.diag(noise**2)
    factor = np.asarray(np.linalg.cholesky(covariance), dtype=float)
    return factor, np.asarray(cho_solve((factor, True), off))


def _fitted(
    at: Array, off: Array, error: Array, known: bool, spread: float, law_error: float | None
) -> tuple[_FittedParameters, float]:
    """Return the parameters of a surface with maximum posterior density, and its logarithm."""
    from scipy.optimize import minimize

    prior_std = np.log(DOUBT)
    free = np.array([law_error is None, True, True, not known])
    ends = np.log(
        [(LEAST_SHARE / LAW_SHARE, 30), *2 * [(SHORTEST / SCALE, FARTHEST / SCALE)], (1e-3, 1e3)]
    )

    def unpacked(some: Array) -> _FittedParameters:
        change = np.zeros(4)
        change[free] = some
        law, across, along, scatter = np.exp(change).tolist()
        law *= LAW_SHARE * spread if law_error is None else law_error
        scatter = 1.0 if known else 0.1 * LAW_SHARE * spread * scatter
        return _FittedParameters(law, SCALE * np.array([[across], [along]]), scatter)

    def surprise(some: Array) -> float:
        factor, pull = _solved(at, off, error, unpacked(some))
        fit = 0.5 * off @ pull + np.sum(np.log(np.diag(factor)))
        return float(fit + 0.5 * np.sum((some / prior_std[free]) ** 2))

    start = np.zeros(int(free.sum()))
    with one_thread():
        result = minimize(surprise, start, method="L-BFGS-B", bounds=ends[free])
    return unpacked(result.x), float(result.fun)


def _averaged(at: Array, off: Array, error: Array) -> tuple[Array, Array, Array]:
    """Average neighbouring points, weighted by their variances, if there are too many."""
    if off.size <= MOST:
        return at, off, error
    side = int(np.sqrt(MOST))
    column, row = np.minimum((at * side).astype(int), side - 1)
    _, cell = np.unique(row * side + column, return_inverse=True)
    weight = error**-2.0
    total = np.bincount(cell, weight)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(cell, weight * values) / total)

    return np.stack([mean(at[0]), mean(at[1])]), mean(off), np.asarray(total**-0.5)
