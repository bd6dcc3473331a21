"""Modes of a free rotor: rigid body, bending modes up to a frequency, residual flexibility.

In one plane the rotor moves by ``w(z) = x + z tilt + sum over k of phi_k(z) m_k``, with z from the
centre of mass and each shape scaled to 1 m/m where it is largest. Modes of a free rotor are
orthogonal to its rigid motions, so that mass and stiffness are diagonal; gyroscopics couple.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.rotors.beam import Matrices, shapes

RANGE = 2000.0  #: Minimum upper end of ISO 14839-3's range [Hz]; else three times the speed.
BEYOND = 1.15  #: Maximum speed of the comparison, over the machine's: overspeed test [1].
SPARE = 1.25  #: Upper end of the retained modes, over the range: their tails reach into it [1].

SHARP = 0.01
"""Share of the tolerance for whirl frequencies: a regulator with a modelled mode is as sharp as the
mode is damped, and near it the error of the sensitivity is a multiple of that of the whirl [1].
"""

STEPS = 3  #: Speeds at which whirls are compared: errors grow with the speed.
STILL = 1e-6  #: Share of the first bending frequency below which a whirl is a rigid translation.


class WhirlError(NamedTuple):
    """Whirl with the largest truncation error."""

    share: float = 0.0  #: Relative error of the frequency [1].
    kept: float = math.nan  #: Frequency of the truncated model [rad/s].
    #: Frequency with the full matrices, negative for backward whirl [rad/s].
    full: float = math.nan
    speed: float = 0.0  #: Speed of rotation [rad/s].
    left_out: float = math.nan
    """Whirl within the range that the truncated model lacks, negative for backward whirl [rad/s];
    NaN: none.
    """
    left_out_at: float = 0.0  #: Its speed of rotation [rad/s].

    @property
    def error(self) -> float:
        """The relative error [1]; infinite if a whirl is missing."""
        return self.share if math.isnan(self.left_out) else math.inf


def max_frequency(T: float, speed: float | None = None) -> float:
    """Return the upper end of the standard's range [Hz]."""
    return min(max(RANGE, 3 * abs(speed or 0.0) / (2 * math.pi)), 0.5 / T)


def speeds_of(speed: float) -> Array:
    """Return the speeds at which models are compared, except standstill [rad/s]."""
    return np.linspace(0.0, BEYOND * abs(speed), STEPS + 1)[1:] if speed else np.zeros(0)


def whirl(rotor: Any, bending: Bending, speed: float, modes: int | None = None) -> Array:
    """Return the whirl frequencies of the free, undamped rotor, ascending [rad/s]."""
    # returns (2 (2 + modes),)
    n = len(bending.frequency) if modes is None else modes
    mass = np.concatenate([[rotor.mass, rotor.transverse_inertia], bending.mass[:n]])
    gyroscopic = np.zeros((n + 2, n + 2))
    gyroscopic[1:, 1:] = speed * bending.polar[: n + 1, : n + 1]
    gyroscopic /= np.sqrt(np.outer(mass, mass))
    own = np.diag(np.concatenate([[0.0, 0.0], bending.frequency[:n]]))
    return np.linalg.eigvalsh(np.block([[np.zeros_like(own), own], [own, gyroscopic]]))


def whirl_error(
    rotor: Any, reduced_bending: Bending, highest: float, speeds: Sequence[float] | Array,
    modes: int | None = None,
) -> WhirlError:  # fmt: skip
    """Return the whirl with the largest truncation error."""
    worst, still = WhirlError(), STILL * float(reduced_bending.frequency[0])
    for speed in map(float, speeds):
        full, some = (
            whirl(rotor, bending, speed, count)
            for bending, count in ((rotor.every_mode, None), (reduced_bending, modes))
        )
        for way in (1.0, -1.0):
            right, result = (np.sort(way * item[way * item > still]) for item in (full, some))
            right = right[right <= 2 * math.pi * highest]
            n = min(len(right), len(result))
            if n < len(right):
                worst = worst._replace(left_out=way * float(right[n]), left_out_at=speed)
            shares = np.abs(result[:n] / right[:n] - 1)
            if n and shares.max() > worst.share:
                k = int(np.argmax(shares))
                worst = worst._replace(
                    share=float(shares[k]), kept=float(result[k]), full=way * float(right[k]),
                    speed=speed,
                )  # fmt: skip
    return worst


def enough(rotor: Any, T: float, speed: float, tolerance: float) -> float:
    """Return the upper limit of retained modes for accurate whirls and sensitivity [Hz]."""
    # All modes within 1.25 times the range of ISO 14839-3 are retained, and as many more as give
    # every whirl in that range up to `BEYOND` times the speed the accuracy `SHARP` times the
    # tolerance; none is faster than half the sampling rate.
    every = rotor.every_mode
    f = every.frequency / (2 * math.pi)
    highest, speeds = max_frequency(T, speed), speeds_of(speed)
    seen = max(1, int(np.count_nonzero(f < 0.5 / T)))
    n = min(seen, max(1, int(np.count_nonzero(f <= SPARE * highest))))
    sharp = SHARP * tolerance
    while n < seen and whirl_error(rotor, every, highest, speeds, n).error > sharp:
        n += 1
    return above(f, n)


def above(f: Array, n: int) -> float:
    """Return a round frequency between the n-th of these and the next [Hz]."""
    if n == len(f):
        return 1.01 * float(f[-1])
    between = math.sqrt(f[n - 1] * f[n])
    rounded = float(f"{between:.3g}")
    return rounded if f[n - 1] < rounded < f[n] else between


@dataclass(frozen=True, eq=False)
class Bending:
    """Bending modes of a free rotor, besides its rigid body."""

    frequency: Array  #: (modes,) Undamped, at standstill [rad/s].
    mass: Array  #: (modes,) Modal masses, for shapes with maximum 1 [kg].
    #: (2 + modes, 2 + modes) Non-rotating, over x, tilt and the modes [N s/m], [N s].
    damping: Array
    #: (1 + modes, 1 + modes) Polar inertias over tilt and the modes [kg m^2], [kg m], [kg].
    polar: Array
    #: Deflection of each mode (modes,) [1] at a place [m] in the rotor's coordinate.
    shape: Callable[[float], Array]
    ends: tuple[float, float]  #: Range of the shapes [m].
    #: (modes, modes) Rotating damping over the modes [N s/m]: of the velocity relative to the
    #: rotating frame.
    internal: Array
    left_out: tuple[float, ...] = ()  #: Frequencies of some truncated bending modes [rad/s].
    #: Residual flexibility (places, places) [m/N] of all truncated modes.
    residual: Residual | None = None
    #: Number of last modes that are static deflections by forces at places, for the residual
    #: flexibility (Rubin 1975).
    attached: int = 0

    @property
    def stiffness(self) -> Array:
        """Modal stiffnesses (modes,) [N/m]."""
        return np.asarray(self.mass * self.frequency**2)

    @property
    def damping_ratio(self) -> Array:
        """Of each uncoupled mode, at standstill (modes,) [1]."""
        both = np.diag(self.damping)[2:] + np.diag(self.internal)
        return np.asarray(both / (2 * self.mass * self.frequency))

    @property
    def names(self) -> tuple[str, ...]:
        """Short names, ``m1``, ``m2``, ..."""
        return tuple(f"m{k}" for k in range(1, len(self.frequency) + 1))


@dataclass(frozen=True, eq=False)
class Body:
    """A rotor as a rigid body."""

    mass: float  #: m [kg].
    centre: float  #: Position of the centre of mass [m].
    transverse_inertia: float  #: I_t and I_p about the centre of mass [kg m^2].
    polar_inertia: float
    first_end: float  #: Position of the first and of the last node [m].
    second_end: float


def body_of(matrices: Matrices) -> Body:
    """Return the rigid body of matrices."""
    z = matrices.place
    across, tilted = np.zeros((2, 2 * len(z)))
    across[::2], tilted[::2], tilted[1::2] = 1.0, z, 1.0
    mass = across @ matrices.M @ across
    centre = float(across @ matrices.M @ tilted / mass)
    tilted = tilted - centre * across
    return Body(
        float(mass), centre, float(tilted @ matrices.M @ tilted),
        float(tilted @ matrices.G @ tilted), float(z[0]), float(z[-1]),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class NodalShape:
    """Shapes from deflections at nodes, interpolated by the beam's functions."""

    vectors: Array  #: w and th of each node for each mode (2 nodes, modes).
    place: Array  #: Of the nodes (nodes,) [m].
    shear: Array  #: Phi of each element (nodes - 1,).

    def __call__(self, place: float) -> Array:
        """Return each mode's deflection (modes,) [1] at a place [m]."""
        return np.asarray(self.row(place) @ self.vectors)

    def row(self, place: float) -> Array:
        """Return the deflection at a place as a linear form of w and th (2 nodes,)."""
        last = len(self.place) - 2
        k = int(np.clip(np.searchsorted(self.place, place, "right") - 1, 0, last))
        length = self.place[k + 1] - self.place[k]
        share = np.array([(place - self.place[k]) / length])
        row = np.zeros(2 * len(self.place))
        row[2 * k : 2 * k + 4] = shapes(share, length, self.shear[k]).w[0]
        return row


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual flexibility of the truncated modes."""

    over: NodalShape
    modes: Array = field(repr=False)  #: All bending modes (2 nodes, all), of unit mass [kg].
    squares: Array = field(repr=False)  #: Their squared frequencies (all,) [1/s^2].
    kept: int  #: Number of retained modes.

    def __call__(self, places: Sequence[float]) -> Array:
        """Return static deflections (places, places) [m/N]."""
        rows = np.array([self.over.row(place) for place in places]) @ self.modes[:, self.kept :]
        return np.asarray((rows / self.squares[self.kept :]) @ rows.T)


def reduced(
    matrices: Matrices,
    highest: float,
    damping_ratio: float | None,
    attachments: Sequence[float] = (),
    internal_ratio: float | None = None,
) -> Bending:
    """Return the modes of a rotor up to a frequency."""
    squares, modes = matrices.free_modes
    mode_count = int(np.count_nonzero(squares <= highest**2))
    over = NodalShape(np.zeros((len(modes), 0)), matrices.place, matrices.shear)
    frequencies, vectors = np.sqrt(squares[:mode_count]), modes[:, :mode_count]
    attached = 0
    if attachments:
        extra, more = _attached(over, modes[:, mode_count:], squares[mode_count:], attachments)
        vectors, attached = np.hstack([vectors, extra]), len(more)
        frequencies = np.concatenate([frequencies, more])
    if not len(frequencies):
        first = math.sqrt(squares[0]) / (2 * math.pi)
        raise ValueError(f"must be at least {first:.6g} Hz, the first bending mode")
    w = vectors[::2]
    largest = w[np.abs(w).argmax(axis=0), np.arange(w.shape[1])]
    vectors = vectors / largest
    mass = np.einsum("ik,ij,jk->k", vectors, matrices.M, vectors)
    body = body_of(matrices)
    across, tilted = np.zeros((2, len(vectors)))
    across[::2], tilted[::2], tilted[1::2] = 1.0, matrices.place - body.centre, 1.0
    with_rigid = np.column_stack([across, tilted, vectors])
    polar = with_rigid[:, 1:].T @ matrices.G @ with_rigid[:, 1:]
    if damping_ratio is not None:
        modal_damping = 2 * damping_ratio * mass * frequencies
        damping = np.diag(np.concatenate([[0.0, 0.0], modal_damping]))
    elif matrices.D is not None:
        damping = with_rigid.T @ matrices.D @ with_rigid
    elif internal_ratio is not None or matrices.D_internal is not None:
        damping = np.zeros((2 + len(mass), 2 + len(mass)))
    else:
        raise ValueError("missing: no damping of the modes is given")
    return Bending(
        frequencies, mass, (damping + damping.T) / 2, (polar + polar.T) / 2,
        NodalShape(vectors, matrices.place, matrices.shear), (body.first_end, body.second_end),
        _internal(matrices, vectors, internal_ratio, mass * frequencies),
        tuple(np.sqrt(squares[mode_count : mode_count + 3]).tolist()),
        Residual(over, modes, squares, len(squares) if attached else mode_count), attached,
    )  # fmt: skip


def _internal(matrices: Matrices, vectors: Array, ratio: float | None, sizes: Array) -> Array:
    """Return the rotating damping over modes with given m omega."""
    if ratio is not None:
        return np.diag(2 * ratio * sizes)
    if matrices.D_internal is None:
        return np.zeros((len(sizes), len(sizes)))
    result = vectors.T @ matrices.D_internal @ vectors
    return np.asarray((result + result.T) / 2)


def _attached(
    over: NodalShape, modes: Array, squares: Array, places: Sequence[float]
) -> tuple[Array, Array]:
    """Return unit-mass shapes and frequencies with the static compliance of all modes at places."""
    from scipy.linalg import eigh

    rows = np.array([over.row(place) for place in dict.fromkeys(places)]) @ modes
    static = rows.T / squares[:, None]  # amplitudes of the modes by forces of 1 N
    static = static / np.sqrt(np.einsum("ik,ik->k", static, static))
    K, M = static.T @ (squares[:, None] * static), static.T @ static
    own, mixed = eigh(K, M)
    return modes @ (static @ mixed), np.sqrt(own)
