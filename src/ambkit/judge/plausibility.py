"""Plausibility check of a record for a machine: rate, range, noise and signs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, block_means, interpolated
from ambkit.base.units import engineering, percent
from ambkit.data.reading.channel_statistics import LOOKED_AT
from ambkit.data.reading.clock import instant
from ambkit.data.reading.faults import find, noise, spike_free
from ambkit.data.reading.plausibility import longest_run, suspects
from ambkit.data.reading.position_search import NO_NOISE, in_steps, rotor
from ambkit.data.record import Record
from ambkit.data.signals import ON
from ambkit.estimate.noise_model import COARSE
from ambkit.judge.signs import channels, judge_signs
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, magnet_of, own_time

_START = 0.25  # share of a record that may be a start, with the rotor in contact

_NEAR, _AT_STOP = 4.0, 0.005  # standard deviations of the noise, and shares of the clearance

_RESTS = 3.0  # in time constants of the plant

_LEAST = 400  # minimum number of samples that determine the motion

_EXPLAINED = 0.5  # minimum share of the acceleration that these must explain

_OTHER = 3.0  # ratio to the machine beyond which it is another rig; noise causes at most 2

_TWICE = 0.25  # tolerance of a disturbance of twice the weight

_HELD = 1.0  # mean disturbance over the weight that is unlikely for a ball below one magnet

_CLEAR = 10.0  # ratio of slow motion to noise above which it is significant

# shares of samples; a control signal repeats with a coarsely quantised y
_CUT_OFF = {"y": 0.01, "u": 0.2}

_LONGEST = 30  # maximum length of a running mean, in samples

_WHITE = 0.5  # log ratio that indicates colour, beyond any value for white noise


class Verdict(NamedTuple):
    """Objections to a record being of a machine."""

    problems: tuple[str, ...]  #: Contradictions to this machine.
    remarks: tuple[str, ...]  #: Anomalies that may be legitimate.


def evaluate_record(record: Record, machine: Machine) -> Verdict:
    """Compare a record with the machine that it is supposed to be of."""
    problems = list(_rate(record, machine))
    sensors = [reading.sensor for reading in machine.readings]
    coarse = any((s.quantisation or 0.0) ** 2 > COARSE * s.noise_variance for s in sensors)
    remarks = list(suspects(record.t, record.signals, record.units, coarse=coarse))
    remarks += _cut_off(record, machine, coarse=coarse)
    if not machine.single:  # the forces of all axes move each
        signs = [] if problems else list(judge_signs(record, machine))
        return _verdict(problems, [(False, text) for text in remarks] + signs)
    limits = [*_position(record, machine), *_control(record, machine)]
    fit = not problems and not any(wrong for wrong, _ in limits)
    signs = list(judge_signs(_without_stops(record, machine), machine)) if fit else []
    lying = list(_lies(record, machine))
    remarks = [
        *lying,
        *(text for text in remarks if not (lying and "in contact with a stop" in text)),
    ]
    if not any(wrong for wrong, _ in signs):
        remarks = [*_gravity(record, machine), *remarks]
        if not problems:
            remarks += [*_motion(record, machine)] or [*_balance(record, machine)]
    return _verdict(problems, [*signs, *((False, text) for text in remarks), *limits])


def _verdict(problems: Sequence[str], findings: Sequence[tuple[bool, str]]) -> Verdict:
    wrong, odd = (
        [text for is_wrong, text in findings if is_wrong is which] for which in (True, False)
    )
    return Verdict((*problems, *wrong), tuple(odd))


def off_rate(record: Record, machine: Machine) -> bool:
    """Return whether a record's sampling time differs from the machine's."""
    return abs(record.sampling_time / machine.sampling_time - 1) > 1e-3


def _rate(record: Record, machine: Machine) -> Iterator[str]:
    ours, theirs = record.sampling_time, machine.sampling_time
    if off_rate(record, machine):
        yield (
            f"it is sampled every {engineering(ours, 's', digits=4)}, the machine's sampling_time "
            f"is {engineering(theirs, 's', digits=4)}"
        )


def _cut_off(record: Record, machine: Machine, *, coarse: bool) -> Iterator[str]:
    """Yield signals that saturate below the machine's limits."""
    for name in channels(machine):
        if name not in record or np.ptp(interpolated(record[name])) == 0:
            continue
        # A coarse sensor repeats its codes while a rotor is near equilibrium.
        kinds = ("saturated", "frozen") if name[0] == "y" and not coarse else ("saturated",)
        stretches = [
            fault
            for fault in find(name, record[name], record.t, record.units[name])
            if fault.kind in kinds
        ]
        share = sum(fault.samples for fault in stretches) / len(record)
        if share < _CUT_OFF[name[0]]:
            continue
        limits = [
            abs(limit / axis.amplifier.gain)
            for axis in isolated_axes(machine)
            for limit in (axis.current_min, axis.current_max)
        ]
        ends = float(np.nanmax(record[name])), float(np.nanmin(record[name]))
        if name[0] == "u" and max(map(abs, ends)) > 0.98 * min(limits):
            continue
        yield (
            f"{name} stands still, at {engineering(ends[0], record.units[name], digits=3)} or "
            f"{engineering(ends[1], record.units[name], digits=3)} or in between, in "
            f"{_percent(share)} of the samples: was it cut off, or the sensor stuck?"
        )


def _position(record: Record, machine: Machine) -> Iterator[tuple[bool, str]]:
    if "y" not in record or not np.isfinite(record["y"]).any():
        return
    y = record["y"][np.isfinite(record["y"])] / machine.sensor.gain
    farthest = float(np.abs(y).max())
    range_text = f"y reaches {engineering(farthest, 'm', digits=4)}"
    gap, travel = machine.magnet.air_gap, machine.clearance
    if np.ptp(y) == 0:
        yield (
            False,
            f"y stands still at {engineering(float(y[0]), 'm', digits=4)}: is it the sensor's?",
        )
        return
    # A single extreme sample is a spike, which a filter rejects; many indicate a wrong map.
    beyond = float(np.mean(np.abs(y) > gap))
    if beyond > 0.01:
        limit = f"beyond the air gap of {engineering(gap, 'm')}"
        yield True, f"{range_text}, {limit}: is a unit, scale or offset wrong?"
    elif farthest > travel:
        part = float(np.mean(np.abs(y) > travel))
        limit = f"beyond clearance, {engineering(travel, 'm')}"
        yield False, f"{range_text}, {limit}, in {_percent(part)} of the samples"
    elif np.ptp(y) < 1e-3 * travel:
        yield (
            False,
            f"y moves by {engineering(float(np.ptp(y)), 'm', digits=3)} alone, less than a "
            f"thousandth of clearance: is its unit wrong?",
        )
    step = machine.sensor.quantisation or 0.0
    rough, expected = noise(record["y"]), math.sqrt(machine.sensor.noise_variance + step**2 / 12)
    if rough < NO_NOISE * float(y.std()):
        rough = 0.0  # error of the rounding
    resolved = rough > 0 or not (step and in_steps(y))  # steps can hide the noise
    if expected > 0 and resolved and not 0.2 < rough / expected < 5:
        less = "was y smoothed before it was logged, which a filter does better itself?"
        why = less if rough < expected else "is a unit or scale wrong, or the sensor disturbed?"
        yield (
            False,
            f"the noise of y is about {engineering(rough, 'm', digits=2)} rms, the bearing's "
            f"sensor has {engineering(expected, 'm', digits=2)}; {why}",
        )
    elif expected > 0 and machine.sensor.coloured_noise is None and (mean := averaged(y)):
        yield (
            False,
            f"the noise of y, {engineering(rough, 'm', digits=2)} rms, is that of means of {mean} "
            "samples, where the bearing's sensor's is white: was y smoothed before it was logged?",
        )
    elif expected > 0 and machine.sensor.coloured_noise is None and _smoothed(y):
        yield (
            False,
            f"the noise of y, {engineering(rough, 'm', digits=2)} rms, is not white, as the "
            "bearing's sensor's is: was y smoothed before it was logged?",
        )


def _smoothed(y: Array) -> bool:
    """Return whether the noise of a position (n,) is smoother than white noise."""
    # Fourth differences of white noise have 70 times its variance, second differences 6 times.
    # Repeated values were rounded after any smoothing, and are not evaluated.
    if y.size < _LEAST or in_steps(y):
        return False
    second, fourth = (float(np.median(abs(np.diff(y, order)))) for order in (2, 4))
    return fourth > 0 and 2 * math.log(fourth / second) < math.log(70 / 6) - _WHITE


def averaged(y: Array) -> int:
    """Return the length in samples of the running mean in a position (n,); 0 if there is none."""
    # Second differences of white noise correlate over two samples only. Those of a mean of N are
    # ``e0 - e1 - eN + e(N+1)``, so N samples apart their correlation is -1/2, and 1/4 one before
    # and one after. Slow motion and lines have the same sign there.
    if y.size < _LEAST:
        return 0
    bend = np.diff(y, 2)
    most = 5 * float(np.median(abs(bend)))
    bend = np.clip(bend, -most, most)  # excludes spikes
    own = float(bend @ bend)
    if own == 0:
        return 0
    alike = [float(bend[k:] @ bend[:-k]) / own for k in range(1, _LONGEST + 2)]
    for n in range(3, _LONGEST + 1):
        before, there, after = alike[n - 2 : n + 1]
        if there < -0.3 and min(before, after) > 0.12:
            return n
    return 0


def _motion(record: Record, machine: Machine) -> Iterator[str]:
    """Yield a fall, or a response to the current, that differs from the machine's."""
    if "y" not in record or "u" not in record or len(record) < _LEAST:
        return
    rows = np.array([interpolated(record[name])[:LOOKED_AT] for name in ("y", "u")])
    if (np.ptp(rows, axis=1) == 0).any() or (result := rotor(rows, 0, 1)) is None:
        return
    if not result.fit.sure or result.fit.explained < _EXPLAINED:
        return
    stiffness = ConstantStiffness.of(machine)
    mass, step = machine.rotor.mass, record.sampling_time
    theirs = math.sqrt(abs(stiffness.k_s) / mass)
    gain = machine.sensor.gain * machine.amplifier.gain * stiffness.k_i / mass
    pole, moved = result.fit.pole / step, result.gain / step**2
    for what, ours, expected, unit in (
        ("the rotor falls with an unstable pole of", pole, theirs, "rad/s"),
        ("a volt of u accelerates it by", moved, gain, "m/s^2"),
    ):
        if not 1 / _OTHER < ours / expected < _OTHER:
            yield (
                f"{what} {ours:.3g} {unit}, the bearing's rotor {expected:.3g} {unit}: is the "
                "record of another rig, or a unit or a scale wrong?"
            )


def _balance(record: Record, machine: Machine) -> Iterator[str]:
    """Yield that a control signal is too small to hold the machine's rotor along its path."""
    # In equilibrium the rotor needs a current of k_s/k_i per metre; in motion, or under stiff
    # control, it needs more, never less.
    if "y" not in record or "u" not in record:
        return
    stiffness = ConstantStiffness.of(machine)
    y, u, size = _flying(record, machine)
    if y.size < 20 or u.std() == 0 or not y.std() > _CLEAR * noise(record["y"]) / math.sqrt(size):
        return
    needed = abs(stiffness.k_s / stiffness.k_i) / (machine.amplifier.gain * machine.sensor.gain)
    if u.std() * _OTHER < needed * y.std():
        spread, least = float(u.std()), needed * float(y.std())
        moves = engineering(float(y.std()), "m", digits=3)
        yield (
            f"u varies by {engineering(spread, 'V', digits=3)} rms, where y does by {moves}: to "
            "hold the bearing's rotor there takes "
            f"{engineering(least, 'V', digits=3)}; is the record of another rig, or a unit or a "
            "scale wrong?"
        )


def _flying(record: Record, machine: Machine) -> tuple[Array, Array, int]:
    """Return the slow part of y and u without contact, and the samples per mean."""
    # Means over half the plant's time constant, without the first quarter: it may be a start.
    size = max(1, round(0.5 * own_time(machine) / record.sampling_time))
    record, _ = spike_free(record)
    first = int(_START * len(record))
    lies = _at_stop(record, machine, -1) | _at_stop(record, machine, 1)
    y, u = (block_means(np.where(lies, np.nan, record[name])[first:], size) for name in ("y", "u"))
    there = np.isfinite(y) & np.isfinite(u)
    return y[there], u[there], size


def _lies(record: Record, machine: Machine) -> Iterator[str]:
    """Yield a rotor that rests at a stop for longer than a bounce."""
    if "y" not in record:
        return
    travel = machine.clearance
    for side in (-1, 1):
        there = _at_stop(record, machine, side)
        start, length = longest_run(there)
        if length * record.sampling_time > _RESTS * own_time(machine):
            first, last = (instant(record.t[k], record.sampling_time)
                           for k in (start, start + length - 1))  # fmt: skip
            yield (
                f"y rests at {engineering(side * travel, 'm', digits=3)}, the rotor's stop, in "
                f"{_percent(float(np.mean(there)))} of the samples, from {first} to {last} at a "
                "stretch: only the filter contact models the force of the stop; is this interval "
                "intended?"
            )


def _without_stops(record: Record, machine: Machine) -> Record:
    """Return a record without the positions in contact, or without magnet current."""
    if "y" not in record:
        return record
    lies = _at_stop(record, machine, -1) | _at_stop(record, machine, 1)
    if ON in record:
        lies |= record[ON] == 0
    return replace(record, signals={**record.signals, "y": np.where(lies, np.nan, record["y"])})


def _at_stop(record: Record, machine: Machine, side: int) -> NDArray[np.bool_]:
    """Return where a rotor is at the stop of a side (n,); nowhere if noise hides the clearance."""
    y, gain, travel = record["y"], machine.sensor.gain, machine.clearance
    near = max(_NEAR * noise(y) / gain, _AT_STOP * travel)
    if near > 0.5 * travel:
        return np.zeros(y.size, bool)
    result: NDArray[np.bool_] = side * y / gain > travel - near  # a soft stop yields
    return result


def _percent(share: float) -> str:
    """Return a share with two digits, and as 100 % near 1."""
    return f"{100 * share:.0f} %" if share > 0.99 else percent(share)


def _control(record: Record, machine: Machine) -> Iterator[tuple[bool, str]]:
    if "u" not in record or not np.isfinite(record["u"]).any():
        return
    current_command = machine.amplifier.gain * record["u"][np.isfinite(record["u"])]
    low, high = machine.current_min, machine.current_max
    slack = 0.02 * (high - low)
    beyond = float(np.mean((current_command < low - slack) | (current_command > high + slack)))
    if beyond == 0:
        return
    most = float(current_command[np.argmax(np.abs(current_command))])
    text = (
        f"u asks for {engineering(most, 'A', digits=3)}, the control current goes from "
        f"{engineering(low, 'A', digits=3)} to {engineering(high, 'A', digits=3)}; beyond in "
        f"{_percent(beyond)} of the samples"
    )
    wrong = beyond > 0.5
    yield wrong, f"{text}: is a unit, scale or offset wrong?" if wrong else text


def _gravity(record: Record, machine: Machine) -> Iterator[str]:
    """Yield a magnet that acts with gravity, as in a record with both signs swapped."""
    # On average the magnet's force, the weight and the disturbance are in balance. With both signs
    # swapped the force that holds the weight adds to it, which leaves a disturbance of twice the
    # weight.

    weight = machine.weight
    if weight == 0.0 or "y" not in record or "u" not in record:
        return
    first = int(_START * len(record))
    x = record["y"][first:] / machine.sensor.gain
    iu = machine.amplifier.gain * record["u"][first:]
    lies = (_at_stop(record, machine, -1) | _at_stop(record, machine, 1))[first:]
    sound = np.isfinite(iu) & (np.abs(x) < machine.clearance) & ~lies
    if np.count_nonzero(sound) < 20:
        return
    iu = np.clip(iu[sound], machine.current_min, machine.current_max)
    force = float(magnet_of(machine).force(iu, x[sound]).mean())
    load = -(force + weight)
    if abs(load / (-2 * weight) - 1) < _TWICE:
        pull, held = (engineering(abs(item), "N", digits=3) for item in (force, load))
        yield (
            f"at the mean of the record the magnet pulls with gravity, by {pull}: a load of "
            f"{held}, about twice the weight, would have to hold the rotor. Are the signs of y and "
            "of u both swapped, or is rotor.gravity?"
        )
    elif machine.magnet.type == "one-sided" and abs(load) > _HELD * abs(weight):
        force_texts = (engineering(abs(item), "N", digits=3) for item in (force, weight, load))
        yield (
            "at the mean of the record the magnet pulls by {} where the weight is {}: a load of {} "
            "would have to be on the rotor. Is an offset or a scale of y or of u wrong, or the "
            "record of another rig?".format(*force_texts)
        )
