"""Which channels move as a levitated rotor and its current do: by physics, not by prediction.

Near its operating point a levitated rotor moves by ``x'' = a x + b i + c`` with a > 0. Other pairs
of channels do not: references and stable loops have a < 0, and a velocity follows the derivative of
the current. Each pair is fitted in frequency bands, and adjacent bands must agree on the pole.
Channels and their second derivatives are filtered by the same B-spline of order six (Shinbrot 1957,
modulating functions). Everything is in samples, in any units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from ambkit.base.arrays import Array

BOXES = 6  #: Boxes that the kernel is made of: four stay where it is differentiated twice.
ROWS = 20  #: Rows, half a box apart, of a block; its mean is free: offsets drop out.
LEAST_BLOCKS = 8  #: So many blocks a band has at least: the record is long compared with the pole.
POLE = (0.1, 1.0)  #: Pole times box for which a band identifies the pole.
ALIKE = 1.35  #: Poles, and gains, of three neighbouring bands are within this ratio.

AGREE = ((3, ALIKE, 0.1), (2, 2.0, 0.2))
"""Neighbouring bands that agree, ratio of poles and gains, share explained: sure, or sufficient."""

TURNS = 0.97  #: Correlation from which on a channel is a copy of the other.

OPPOSED = 0.3
"""Least correlation of position and force against each other: ``b <x i> = -a <x²> - <v²>``."""

TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class LevitationFit:
    """Two channels that move as a levitated rotor and its current do."""

    position: int  #: Rows of the array that was searched.
    control: int
    pole: float  #: The unstable pole [1/sample].
    gain: float  #: Acceleration [position's unit / sample²] per unit of the control.
    explained: float  #: Share of the acceleration's variance explained in the best band.
    box: int  #: Length of the kernel's box in that band [samples].
    evidence: float  #: Sum of these shares over all bands that agree.
    sure: bool  #: Whether three neighbouring bands tell the same; else it is two, and more loosely.
    rate: float = 0.0  #: Of the coil that a voltage drives, R/L [1/sample]; 0 of a current.

    @property
    def voltage(self) -> bool:
        """Whether the control is a voltage, which the current lags behind."""
        return self.rate > 0


@dataclass(frozen=True)
class Band:
    """Sums over the rows of each block, of smoothed channels S and their derivatives V and A."""

    box: int  #: Length of the kernel's box [samples].
    #: (blocks, m, m) Of S, A and V of the channel in the row with S of the channel in the column.
    ss: Array
    as_: Array
    vs: Array
    aa: Array  #: (blocks, m) Of each channel with itself.
    av: Array
    vv: Array


def bands(channels: Array) -> Iterator[Band]:
    """Sum up channels in bands of frequency, from fast to slow."""
    # channels (m, n)
    for box, thin, values in decimated(channels):
        step = max(1, box // 2)
        rows = values.shape[1] - BOXES * (box - 1) - 2
        blocks = -(-rows // step) // ROWS if rows > 0 else 0
        if blocks < LEAST_BLOCKS:
            return
        four = moving_averages(values, box, 4)
        bent = (four[:, 2 * box :] - 2 * four[:, box:-box] + four[:, : -2 * box]) / box**2
        smooth = moving_averages(four, box, 2)[:, 1 : 1 + bent.shape[1]]
        inside, a = (
            item[:, ::step][:, : blocks * ROWS].reshape(-1, blocks, ROWS).transpose(1, 0, 2)
            for item in (smooth, bent / thin**2)
        )
        v = np.gradient(inside, step * thin, axis=2)
        s, v, a = (item - item.mean(axis=2, keepdims=True) for item in (inside, np.asarray(v), a))
        transposed = s.transpose(0, 2, 1)
        own = ((a * a).sum(2), (a * v).sum(2), (v * v).sum(2))
        yield Band(box * thin, s @ transposed, a @ transposed, v @ transposed, *own)


def decimated(channels: Array) -> Iterator[tuple[int, int, Array]]:
    """Yield boxes from short to long, the decimation of the record for each, and that record."""
    # Slow bands need not all samples: they get means of two, of four, and so on.
    for box in (2, 3, 4, 5, 6):
        yield box, 1, channels
    thin = 1
    while channels.shape[1] > BOXES * 8:
        for box in (8, 10, 13):
            yield box, thin, channels
        size = channels.shape[1] // 2 * 2
        channels, thin = 0.5 * (channels[:, :size:2] + channels[:, 1:size:2]), 2 * thin


def moving_averages(values: Array, box: int, times: int) -> Array:
    """Return running means (m, n - times (box - 1)) over `box` samples, so many times."""
    for _ in range(times):
        sums = np.cumsum(values, axis=1)
        sums = np.concatenate([np.zeros((len(values), 1)), sums], axis=1)
        values = (sums[:, box:] - sums[:, :-box]) / box
    return values


def fitted(band: Band) -> tuple[Array, Array, Array]:
    """Fit ``p'' = a p + b c`` to all pairs of channels, robustly over the blocks."""
    # a (m, m); b (m, m); explained (m, m)
    own = np.einsum("bii->bi", band.ss)
    pp, cc, pc = own[:, :, None], own[:, None, :], band.ss
    ap, ac, aa = np.einsum("bii->bi", band.as_)[:, :, None], band.as_, band.aa[:, :, None]
    usual = 1 / (aa + np.median(aa, axis=0) + TINY)
    weight = np.broadcast_to(usual, pc.shape)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(8):  # reweighted: blocks where the rotor lies, starts or is hit count less
            pp_, pc_, cc_, ap_, ac_ = ((weight * item).sum(0) for item in (pp, pc, cc, ap, ac))
            a, b = _two(pp_, pc_, cc_, ap_, ac_)
            left = aa - 2 * a * ap - 2 * b * ac + a * a * pp + 2 * a * b * pc + b * b * cc
            left = np.maximum(left, 0)
            weight = usual / (1 + left / (np.median(left, axis=0) + TINY) / 9)
        explained = 1 - (weight * left).sum(0) / ((weight * aa).sum(0) + TINY)
        none = ~(pp_ * cc_ * 1e-8 < pp_ * cc_ - pc_ * pc_) | ~np.isfinite(a * b)
        # The same with the velocity, which is taken out of all others first.
        pv, cv = np.einsum("bii->bi", band.vs)[:, :, None], band.vs
        pv_, cv_, av_, vv_ = (
            (weight * item).sum(0) for item in (pv, cv, band.av[:, :, None], band.vv[:, :, None])
        )
        free, _ = _two(
            pp_ - pv_ * pv_ / vv_, pc_ - pv_ * cv_ / vv_, cc_ - cv_ * cv_ / vv_,
            ap_ - av_ * pv_ / vv_, ac_ - av_ * cv_ / vv_,
        )  # fmt: skip
        none |= ~(free > 0.5 * a)
    return np.where(none, -1.0, a), np.where(none, 0.0, b), np.where(none, 0.0, explained)


def _two(pp: Array, pc: Array, cc: Array, ap: Array, ac: Array) -> tuple[Array, Array]:
    """Solve the normal equations of two regressors."""
    inverse = 1 / (pp * cc - pc * pc)
    return inverse * (ap * cc - ac * pc), inverse * (ac * pp - ap * pc)


def levitation_fits(listed: Sequence[Band]) -> list[LevitationFit]:
    """Find the pairs of channels that move as a levitated rotor and its current."""
    if len(listed) < 3:
        return []
    a, b, share = (np.array(entry) for entry in zip(*map(fitted, listed), strict=True))
    pole = np.sqrt(np.maximum(a, 0))
    copies = np.array([turning(band) for band in listed])
    against = -np.sign(b) * np.array([_correlation(band) for band in listed])
    best: dict[tuple[int, int], LevitationFit] = {}
    apart = ~np.eye(len(a[0]), dtype=bool)
    for sure, (count, ratio, least) in zip((True, False), AGREE, strict=True):
        for k in range(1, len(listed) - 1):
            near = slice(k - 1, k - 1 + count)
            p, g, r = pole[near], b[near], share[near]
            mean_pole = p.mean(0) * listed[k].box
            good = (p.min(0) > 0) & (p.max(0) <= ratio * p.min(0)) & (r.min(0) > least)
            good &= (abs(g).max(0) <= ratio * abs(g).min(0)) & (abs(np.sign(g).sum(0)) == count)
            good &= (POLE[0] < mean_pole) & (mean_pole < POLE[1]) & (copies[k] < TURNS)
            good &= against[near].min(0) > OPPOSED
            for i, j in np.argwhere(good & apart).tolist():
                known = best.get((i, j))
                if known is not None and known.sure > sure:
                    continue
                share_here, before = float(r[:, i, j].mean()), known.evidence if known else 0.0
                if known is None or share_here > known.explained:
                    known = LevitationFit(
                        i, j, float(p[:, i, j].mean()), float(b[k, i, j]), share_here,
                        listed[k].box, 0.0, sure,
                    )  # fmt: skip
                best[i, j] = replace(known, evidence=before + share_here)
    return sorted(best.values(), key=lambda item: (item.sure, item.evidence), reverse=True)


def _correlation(band: Band) -> Array:
    """Return the correlation (m, m) of channels over all blocks, whose sizes count alike."""
    own = np.einsum("bii->bi", band.ss)
    usual = np.median(own, axis=0) + own
    weight = np.divide(1.0, usual, out=np.zeros_like(usual), where=usual > TINY)[:, :, None]
    covariance = (weight * band.ss).sum(0)
    size = np.sqrt((weight * own[:, :, None]).sum(0) * (weight * own[:, None, :]).sum(0))
    return np.asarray(covariance / np.maximum(size, TINY))


def turning(band: Band) -> Array:
    """Return the usual correlation (m, m), without its sign, of channels within a block."""
    size = np.sqrt(np.einsum("bii->bi", band.ss))
    with np.errstate(divide="ignore", invalid="ignore"):
        likeness = abs(band.ss) / (size[:, :, None] * size[:, None, :])
    return np.asarray(np.median(np.nan_to_num(likeness), axis=0))


AGO = 3  #: Boxes between what is regressed and its instruments: half of the kernel.
LONG = 60  #: Boxes that a record has at least.
NO_FIT = (-1.0, 0.0, 0.0, 0.0)  #: Pole, rate, gain and evidence of a pair that is none.
COIL = (0.05, 20.0)  #: Of the coil's rate R/L over the unstable pole; a current beyond.
TELLS = (2.0, 13.0)  #: Least pole and gain over standard error: in each band, in sum.


def instrumented(channels: Array, rows: Sequence[int]) -> list[LevitationFit]:
    """Find the pairs of channels that move as a rotor and its current do; the best first."""
    return agreed_pairs(channels, rows, _sums, _fit, TELLS, ALIKE)


def agreed_pairs(
    channels: Array, rows: Sequence[int], prepared: Callable[..., tuple[Any, ...]],
    fit: Callable[..., tuple[float, ...]], tells: tuple[float, float], ratio: float,
) -> list[LevitationFit]:  # fmt: skip
    """Fit all pairs of channels in each band, and return those whose bands agree."""
    # channels (m, n)
    fits: dict[tuple[int, int], list[Array]] = {}
    for box, thin, values in decimated(channels[list(rows)]):
        if values.shape[1] < LONG * box:
            break
        of_band = prepared(values, box, thin)
        for i, j in permutations(range(len(rows)), 2):
            of_pair = fits.setdefault((rows[i], rows[j]), [])
            of_pair.append(np.array([box * thin, *fit(*of_band, i, j)]))
    results = (_agreed(*pair, bands, tells, ratio) for pair, bands in fits.items())
    return sorted(filter(None, results), key=lambda item: -item.evidence)


def _sums(values: Array, box: int, thin: int) -> tuple[Array, Array, Array, Array, int]:
    """Return products of instruments, of smoothed channels and their derivatives, and the rows."""
    four = moving_averages(values, box, 4)
    bent = (four[:, 2 * box :] - 2 * four[:, box:-box] + four[:, : -2 * box]) / (box * thin) ** 2
    smooth = moving_averages(four, box, 2)[:, 1 : 1 + bent.shape[1]]
    ago, step = AGO * box, max(1, box // 2)
    rate = np.gradient(smooth, thin, axis=1)
    z = np.concatenate([smooth, rate])[:, :-ago:step]
    s, v, a = (item[:, ago::step] for item in (smooth, rate, bent))
    z, s, v, a = (item - item.mean(axis=1, keepdims=True) for item in (z, s, v, a))
    both = np.concatenate([s, a, v])
    return z @ z.T, z @ both.T, s @ both.T, np.einsum("ik,ik->i", a, a), s.shape[1]


def _fit(
    zz: Array, zb: Array, sb: Array, aa: Array, count: int, i: int, j: int
) -> tuple[float, float, float, float]:
    """Return pole, no rate, gain, and by how many standard errors the less certain is off zero."""
    m = len(aa)
    z, x = [i, j, m + i, m + j], [i, j]
    try:
        estimate, spread = two_stages(zz, zb, z, x, m + i)
        free, _ = two_stages(zz, zb, z, [i, j, 2 * m + i], m + i)
    except np.linalg.LinAlgError:
        return NO_FIT
    a, b = estimate
    if not (free[0] > 0.5 * a and a > 0):  # friction explains it as well
        return NO_FIT
    left = aa[i] - 2 * (a * sb[i, m + i] + b * sb[j, m + i])
    left += a * a * sb[i, i] + 2 * a * b * sb[i, j] + b * b * sb[j, j]
    # Rows half a box apart share their kernel: a quarter of them count.
    error = spread * np.sqrt(max(left, 0.0) / count * 4)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(a)), 0.0, float(b), float((np.abs([a, b]) / error).min())


def two_stages(zz: Array, zb: Array, z: list[int], x: list[int], y: int) -> tuple[Array, Array]:
    """Regress y on x with instruments z, all columns: coefficients, and their unscaled errors."""
    cross = zb[np.ix_(z, x)]
    weighed = np.linalg.solve(zz[np.ix_(z, z)], zb[np.ix_(z, [*x, y])])
    normal = cross.T @ weighed[:, :-1]
    return (
        np.linalg.solve(normal, cross.T @ weighed[:, -1]),
        np.sqrt(np.maximum(np.diag(np.linalg.inv(normal)), 0)),
    )


def _agreed(
    i: int, j: int, bands: Sequence[Array], tells: tuple[float, float], ratio: float
) -> LevitationFit | None:
    """Return what three neighbouring bands tell, if they tell the same."""
    best = None
    for near in zip(bands, bands[1:], bands[2:], strict=False):
        box, pole, rate, gain, evidence = np.array(near).T
        if not (pole.min() > 0 and abs(np.sign(gain).sum()) == 3):
            continue
        size, middle, coil = abs(gain), pole.mean() * box[1], rate[1]
        if (
            pole.max() <= ALIKE * pole.min() and size.max() <= ratio * size.min()
            and rate.max() <= ALIKE**2 * rate.min()
            and POLE[0] < middle < POLE[1] and evidence.min() > tells[0]
            and evidence.sum() > tells[1]
            and (not coil or COIL[0] * pole.mean() < rate.mean() < COIL[1] * pole.mean())
            and (best is None or evidence.sum() > best.evidence)
        ):  # fmt: skip
            best = LevitationFit(
                i, j, float(pole.mean()), float(gain[1] / (coil or 1.0)), 0.0,
                int(box[1]), float(evidence.sum()), False, float(rate.mean()),
            )  # fmt: skip
    return best
