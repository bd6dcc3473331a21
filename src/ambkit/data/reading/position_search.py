"""The rotor's position and its current among unnamed channels, from their dynamics and noise.

The estimates of a rig's own filter are more predictable than its measurements. Of channels with the
same motion the rawest is therefore chosen: a converter's values come in steps, while computed
values hardly ever repeat; otherwise the noisier one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.data.reading import derived_channels as derived
from ambkit.data.reading import levitation_test as levitation
from ambkit.data.reading.faults import noise
from ambkit.data.reading.levitation_test import Band, LevitationFit
from ambkit.data.reading.voltage_test import voltage_fits

REPEATS = 0.6  #: Share of different values below which a channel is a converter's.

SIX_DIGITS = 1e-5
"""Noise that six digits leave, over standard deviation: such a channel may be a reference."""

NO_NOISE = 1e-6  #: Noise over standard deviation below which a channel is computed.
TRIED = 12  #: Channels that are tried with instruments, where plain regression tells nothing.
CLOSE = 0.98  #: Correlation of a channel and an estimate of it, where slow bands have no noise.
DOUBT = 0.5  #: Evidence against, relative to that for a result, that leaves it undecided.
LEAST = 0.5  #: Evidence below which nothing is guessed, where no converter's steps speak for it.
CLEARLY = 1.5  #: Ratio of the noise of a position to its estimate's that is conclusive.
SAME_POLE = 2.0  #: Ratio of the poles that a channel and an estimate of it tell; noise moves them.
RELATED = 0.9  #: The same for two positions with one current, or two currents.
SWIFT = 0.75  #: Correlation with the rate of a channel, in a band, of its velocity.
SAME_GAIN = 1.25  #: Ratio of the gains of a channel and its estimate over all bands.


@dataclass(frozen=True)
class Rotor:
    """Which channels are the position and the current of a levitated rotor."""

    position: int  #: Rows of the array that was searched.
    control: int
    fit: LevitationFit  #: What told them; of an estimate perhaps, in whose place they are.
    gain: float  #: Acceleration per control [units / sample²]; negative: inverted.
    positions: tuple[int, ...]  #: Rows of the same motion: estimates, the rawest first.
    controls: tuple[int, ...]
    others: tuple[tuple[int, int], ...]  #: Positions with controls, of other axes.

    @property
    def turned(self) -> bool:
        """Whether a greater control moves the rotor towards smaller positions."""
        return self.gain < 0

    def renumbered(self, places: Sequence[int]) -> Rotor:
        """Return the same with other numbers for the rows."""
        return Rotor(
            places[self.position], places[self.control], self.fit, self.gain,
            tuple(places[k] for k in self.positions), tuple(places[k] for k in self.controls),
            tuple((places[a], places[b]) for a, b in self.others),
        )  # fmt: skip


def in_steps(values: Array) -> bool:
    """Whether a channel (n,) repeats its values, as what a converter measured does."""
    return bool(np.unique(values).size < REPEATS * values.size)


def rotor(channels: Array, position: int | None = None, control: int | None = None) -> Rotor | None:
    """Find the position and the current of a levitated rotor."""
    # channels (m, n)
    unit = derived.standardised(channels)
    listed = list(levitation.bands(unit))
    if not listed:
        return None
    search = _Search(channels, unit, listed, (position, control))
    result = search.rotor()
    if result is not None and result.fit.sure:
        return result
    by_voltage = search.driven_by_voltage()
    if result is None or by_voltage is None:
        return result or by_voltage
    same = (result.position, result.control) == (by_voltage.position, by_voltage.control)
    return result if same else None  # neither is sure


class _Search:
    """Channels (m, n), two of which may be known to be the position and the control."""

    def __init__(
        self, channels: Array, unit: Array, listed: list[Band], known: tuple[int | None, int | None]
    ) -> None:
        self.channels, self.unit, self.bands, self.known = channels, unit, listed, known
        self.hiss = [noise(values) for values in unit]
        self.raw = [
            in_steps(v) and derived.rough(u) > SIX_DIGITS
            for v, u in zip(channels, unit, strict=True)
        ]
        self.rates = (derived.velocities(unit) | derived.filters_of_others(unit, self.raw)) - {
            *known
        }
        self.swift = _fast_candidates(listed)

    def rotor(self) -> Rotor | None:
        """Return the pair of channels that most of the evidence is for; None where it is vague."""
        result, usable, plain, level = self._fits()
        if not usable:
            return None
        raw, listed = self.raw, self.bands
        near = {box: _families(listed, box) for box in {f.box for f in result}}
        close = np.array([levitation.turning(band) for band in listed[-3:]]).max(0) > level

        def same(f: LevitationFit, g: LevitationFit) -> bool:
            """Whether two fits are of one rotor: one position with a current and its estimate."""
            alike = near[f.box] | near[g.box] | close
            return bool(
                alike[f.position, g.position] and alike[f.control, g.control]
                and f.pole / SAME_POLE < g.pole < f.pole * SAME_POLE
            )  # fmt: skip

        def evidence(f: LevitationFit) -> float:
            return sum(g.evidence for g in result if same(f, g))

        both = [f for f in usable if raw[f.position] and raw[f.control]]
        best = max(both or usable, key=lambda f: (f.sure, evidence(f)))
        motion = [best, *(f for f in result if same(best, f))]
        positions, controls = self._members(best, motion, near[best.box])
        if not both and (
            evidence(best) < LEAST
            or any(_is_ambiguous(fits, positions, controls) for fits in (result, plain))
        ):
            return None
        fits = [*result, *plain]
        positions = self._rawest(positions, best.position, {f.position for f in fits})
        controls = self._rawest(controls, best.control, {f.control for f in fits})
        if self._is_vague(positions, controls, fits):
            return None
        others: dict[int, int] = {}
        for item in result:
            if item.sure and not {*positions, *controls} & {item.position, item.control}:
                others.setdefault(item.position, item.control)
        gain = best.gain * gains(listed, best.position)[positions[0]]
        gain /= gains(listed, best.control)[controls[0]]
        gain *= self.channels[positions[0]].std() / self.channels[controls[0]].std()
        return Rotor(
            positions[0], controls[0], best, float(gain),
            tuple(positions[1:]), tuple(controls[1:]), tuple(others.items()),
        )  # fmt: skip

    def driven_by_voltage(self) -> Rotor | None:
        """Return the position and the voltage that drives its coil; None where it is vague."""
        free = [k for k in range(len(self.unit)) if k not in self.rates]
        rawest = sorted(free, key=lambda k: not self.raw[k])
        position, control = self.known
        fits = [
            f for f in voltage_fits(self.unit, rawest[:12])
            if position in (None, f.position) and control in (None, f.control)
        ]  # fmt: skip
        places = sorted({f.position for f in fits})
        fits = [f for f in fits if not self.swift[f.position, places].any()]
        if not fits:
            return None
        best = fits[0]
        close = levitation.turning(self.bands[-1])[best.position] > RELATED
        y = max((k for k in free if close[k] and k != best.control), key=lambda k: (
            k in self.known, self.raw[k], self.hiss[k]))  # fmt: skip
        rivals = [f.evidence for f in fits if not close[f.position] or f.control != best.control]
        is_fitted = any((f.position, f.control) == (y, best.control) for f in fits)
        if not is_fitted or max(rivals, default=0.0) > best.evidence / 2:
            return None  # the rawest may be another quantity
        gain = best.gain * gains(self.bands, best.position)[y]
        gain *= self.channels[y].std() / self.channels[best.control].std()
        others = tuple(f.position for f in fits if f.position != y)
        return Rotor(y, best.control, best, float(gain), tuple(dict.fromkeys(others)), (), ())

    def _fits(self) -> tuple[list[LevitationFit], list[LevitationFit], list[LevitationFit], float]:
        """Return all fits, those to choose from, those of plain regression, and what is close."""
        raw, position, control = self.raw, *self.known
        formulas = {k for k, values in enumerate(self.unit) if derived.is_formula(values)} - {
            control
        }

        def fitting(listed: list[LevitationFit]) -> list[LevitationFit]:
            return [
                f for f in listed
                if not {f.position, f.control} & self.rates and f.control not in formulas
                and position in (None, f.position) and control in (None, f.control)
            ]  # fmt: skip

        plain = result = fitting(levitation.levitation_fits(self.bands))
        usable = [f for f in result if f.sure or raw[f.position] or raw[f.control]]
        slow = _without(self.swift, result)
        if any(f in usable for f in slow):
            result, usable = slow, [f for f in usable if f in slow]
        if usable:
            return result, usable, plain, RELATED
        candidates = sorted(
            (k for k in range(len(self.unit)) if k not in self.rates), key=lambda k: not raw[k]
        )
        plain += (result := fitting(levitation.instrumented(self.unit, sorted(candidates[:TRIED]))))
        result = _without(self.swift, result) or result
        return result, result, plain, CLOSE

    def _members(
        self, best: LevitationFit, motion: list[LevitationFit], family: Bools
    ) -> tuple[list[int], list[int]]:
        """Return all channels that tell the same position, and the same current."""
        controls = list(dict.fromkeys(f.control for f in motion if f.control != best.position))
        positions = list(dict.fromkeys(f.position for f in motion if f.position not in controls))
        free = {*range(len(self.unit))} - {*positions, *controls, *self.rates}
        positions += sorted(k for k in free if family[best.position, k])
        if len(positions) == 1 and not self.raw[best.position] and self.known[0] is None:
            unlike = sorted({*range(len(self.unit))} - {*positions, *controls})
            positions += derived.raw_counterparts(self.unit, self.bands, best.position, unlike)
        controls += sorted(k for k in free if family[best.control, k] and k not in positions)
        return positions, controls

    def _rawest(self, members: list[int], chosen: int, fitted: set[int]) -> list[int]:
        gain = gains(self.bands, chosen)

        def rank(k: int) -> tuple[bool, bool, bool, float]:
            is_informative = k in fitted or self.raw[k]
            return k in self.known, is_informative, self.raw[k], self.hiss[k] / abs(gain[k])

        return sorted(members, key=rank, reverse=True)

    def _is_vague(
        self, positions: list[int], controls: list[int], fits: Sequence[LevitationFit]
    ) -> bool:
        """Whether the rawest two may yet be estimates."""
        raw, y, u = self.raw, positions[0], controls[0]
        left = {*range(len(self.unit))} - {*positions, *controls, *self.rates}
        rougher = [] if raw[u] else derived.raw_counterparts(self.unit, self.bands, u, [y, *left])
        if self.known[1] is None and rougher and (rougher != [y] or any(raw[k] for k in left)):
            return True  # an estimate is no current, where what it is of, or a converter's, is left
        if {*self.known} != {None} or (raw[y] and raw[u]):
            return False
        is_fitted = any((f.position, f.control) == (y, u) for f in fits)
        return not is_fitted or not (raw[y] or _has_most_noise(positions, self.unit, self.bands))


def _fast_candidates(listed: Sequence[Band]) -> Bools:
    """Tell which channels go as the speed of which others (m, m), in some band."""
    # A filter's velocity does; and the current of a quiet loop, in fast bands, where its controller
    # answers to the speed.
    most = np.zeros(listed[0].ss.shape[1:])
    for band in listed:
        own = np.einsum("bii->bi", band.ss)
        weight = [
            np.divide(1.0, item, out=np.zeros_like(item), where=item > levitation.TINY)
            for item in (own + np.median(own, axis=0), band.vv + np.median(band.vv, axis=0))
        ]
        both = np.sqrt(weight[0])[:, :, None] * np.sqrt(weight[1])[:, None, :]
        size = (both * own[:, :, None]).sum(0) * (both * band.vv[:, None, :]).sum(0)
        shared = abs((both * band.vs.transpose(0, 2, 1)).sum(0))
        most = np.maximum(most, shared / np.sqrt(np.maximum(size, levitation.TINY)))
    return np.asarray(most > SWIFT)


def _without(swift: Bools, results: Sequence[LevitationFit]) -> list[LevitationFit]:
    """Leave out fits of a velocity instead of the current, or of the position."""
    places = {f.position for f in results}
    return [
        f for f in results
        if not swift[f.control, f.position] and not swift[f.position, sorted(places)].any()
    ]  # fmt: skip


def _has_most_noise(members: Sequence[int], unit: Array, listed: Sequence[Band]) -> bool:
    """Whether the first of a channel and its estimates has clearly the most noise."""
    # A filter that takes out the lag of a sensor makes more noise of it, not less; but no white
    # one.
    gain = gains(listed, members[0])
    hiss = [noise(unit[k]) / abs(gain[k]) for k in members]
    others = [item for item in hiss[1:] if item > NO_NOISE]
    is_white = abs(derived.colour(unit[members[0]])) < derived.WHITE
    return not others or (hiss[0] > CLEARLY * max(others) and is_white)


def _is_ambiguous(
    results: Sequence[LevitationFit], positions: Sequence[int], controls: Sequence[int]
) -> bool:
    """Whether other fits speak against what is taken for the position and the control."""
    # One channel is not both; and what moves a position is one current, or copies of it.
    both = sum(f.evidence for f in results if f.position in positions and f.control in controls)
    swapped_evidence = sum(
        f.evidence for f in results if f.position in controls or f.control in positions
    )
    rivals = [f.evidence for f in results if (f.position in positions) != (f.control in controls)]
    return max([swapped_evidence, *rivals]) > max(DOUBT * both, LEAST)


def gains(listed: Sequence[Band], of: int) -> Array:
    """Return how much each channel moves where one of them does (m,), with signs."""
    # In the slowest band, where noise is least, and from the sizes of both: noise on what is
    # regressed on would make a slope less.
    band = listed[-1]
    size = np.sqrt(np.maximum(np.median(np.einsum("bii->bi", band.ss), axis=0), levitation.TINY))
    sign = np.where(np.median(band.ss[:, :, of], axis=0) < 0, -1.0, 1.0)
    return np.asarray(sign * size / size[of])


def _families(listed: Sequence[Band], box: int) -> Bools:
    """Tell which channels move as one, with the same gain at all speeds around a band (m, m)."""
    # A current goes with its position too; but the faster, the more of it. Of two the noise of one
    # does not matter where it is regressed on the other, so one of the two slopes has to be steady.
    near = [band for band in listed if box / 2 <= band.box <= 4 * box]
    near = near or [min(listed, key=lambda band: abs(np.log(band.box / box)))]
    slope = np.array(
        [
            np.median(
                band.ss / np.maximum(np.einsum("bii->bi", band.ss), levitation.TINY)[:, None, :],
                axis=0,
            )
            for band in near
        ]
    )  # of the channel in the row on that in the column
    steady = abs(slope).max(0) < SAME_GAIN * abs(slope).min(0)
    steady &= abs(np.sign(slope).sum(0)) == len(near)
    close = np.array([levitation.turning(band) for band in near]).max(0) > CLOSE
    return np.asarray((steady | steady.T) & close) | np.eye(len(close), dtype=bool)
