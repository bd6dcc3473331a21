"""The figures of merit of a loop, each defined once: a new one is one line here."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.assessment.loop import AssessedAxis, AssessedLoop
from ambkit.base import units
from ambkit.base.units import engineering
from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.capacity import ROOM
from ambkit.judge.loop.loop_builder import ZONE_A, LoopBuilder
from ambkit.judge.loop.margins import UnstablePole
from ambkit.result.row import At, Row, put
from ambkit.rotordynamics.unbalance_response import Grade

VERDICT = "zone overall"  #: Row with the verdict on a loop.

USUAL_GRADES = (2.5e-3, 6.3e-3)
"""Balance quality grades of most rotors on magnetic bearings [m/s]."""

PIECES = {
    "as it is": "as described",
    "amplifier": "amplifier without lag",
    "sensor": "sensor without lag",
    "delay": "no dead time but the hold",
    "filter": "fed by the measurement",
}
"""Name of a loop with one ideal element."""

LESS_IS_WORSE = frozenset((
    "gain_margin_up", "phase_margin", "delay_margin", "disk_margin", "disk_gain", "disk_phase",
    "least_load", "time_to_coil_temperature_limit",
))  # fmt: skip
"""Keys of the rows for which less is worse."""


def of_axis(axis: AssessedAxis, of: LoopBuilder) -> list[Row]:
    """Return the figures of one axis of a stable loop, with all others closed."""
    m, d, top = axis.margins, axis.demands, engineering(of.top, "Hz", 4)
    warm, load = d.heating, At("least_load_at", d.capacity.least[1])
    hottest = None if warm is None else warm.temperature
    machine = of.isolated[of.axes.index(axis.name)]
    wide = At("peak_to_half_the_sampling_rate_at", m.peak_frequency)
    return [
        Row("zone", "zone of ISO 14839-3", axis.zone),
        Row("peak", f"  peak of |S| to {top}", axis.peak, "|S|", below=ZONE_A,
            at=At("peak_frequency", axis.peak_frequency)),
        Row("peak_to_half_the_sampling_rate", "peak of |S| to half the sampling rate", m.peak,
            "|S|", at=wide, detail=True),
        Row("complementary_peak", "peak of |T|", m.complementary_peak),
        Row("gain_margin_up", "gain margin, up", m.gain_up, "dB"),
        Row("gain_margin_down", "gain margin, down", m.gain_down, "dB"),
        Row("phase_margin", "phase margin", m.phase, "deg"),
        Row("delay_margin", "delay margin", m.delay, "s", 3),
        Row("disk_margin", "disk margin", m.disk, detail=True),
        Row("disk_gain", "  gain, either way", m.disk_gain[1], "dB", detail=True),
        Row("disk_phase", "  phase, either way", m.disk_phase, "deg", detail=True),
        Row("bandwidth", "bandwidth (|S| below -3 dB)", m.bandwidth, "Hz", 3, detail=True),
        Row("crossover", "highest crossover frequency", m.crossover, "Hz", 3, detail=True),
        Row("current_noise", "current noise, rms", axis.current_noise, "A", 3),
        Row("position_noise", "position noise, rms", axis.position_noise, "m", 3),
        Row("displacement_zone", "zone of ISO 14839-2", d.zone),
        Row("displacement", "  maximum displacement", d.displacement, "m", 3,
            below=ROOM[0][1] * d.clearance),
        Row("clearance", "  clearance", d.clearance, "m", 3, detail=True),
        Row("current", "maximum control current", d.current, "A", 3, below=machine.current_max),
        Row("static_load", "static load capacity", d.capacity.static, "N", 3),
        Row("least_load", "dynamic load capacity, minimum", d.capacity.least[0], "N", 3,
            at=load),
        Row("copper_loss", "copper loss", d.copper_loss, "W", 3),
        Row("coil_temperature", "temperature of the hottest coil", hottest, "degC",
            below=None if warm is None else warm.limit),
        Row("time_to_coil_temperature_limit", "  time to its limit at the maximum current",
            None if warm is None else warm.until_limit, "s", 3, detail=True),
    ]  # fmt: skip


def of_loop(loop: AssessedLoop) -> list[Row]:
    """Return the figures of a loop: its own, and the worst of each figure of its axes."""
    axes, check = [of_axis(axis, loop.of) for axis in loop.axes.values()], loop.integral
    several: list[Row] = []
    if loop.worst is not None and len(axes) > 1:
        value, where = loop.largest
        several = [
            Row("worst_axis", "  worst axis", loop.worst.name),
            Row("largest_singular_value", "largest singular value of S", value,
                at=At("largest_singular_value_at", where)),
        ]  # fmt: skip
    worst = [_worst(same) for same in zip(*axes, strict=True)]
    orbit = loop.of.point.orbit
    with np.errstate(divide="ignore"):
        slowest_pole = float((np.log(np.abs(loop.loop.closed.poles())) / loop.loop.T).max())
    return [
        Row("verdict", VERDICT, loop.verdict, below="A"),
        Row("stable", "stable", loop.stable, detail=True),
        *worst[:2], *several, *worst[2:],
        Row("maximum_orbit", "orbit of the linearisation",
            None if orbit is None else float(np.abs(orbit.x).max()), "m", 3, detail=orbit is None),
        Row("slowest_pole", "slowest pole", slowest_pole, "1/s", detail=True),
        Row("bode_integral", "check: Bode's integral of ln|det S|", check.integral, digits=9,
            detail=True),
        Row("bode_poles", "  expected from the unstable poles", check.poles, digits=9, detail=True),
        Row("bode_holds", "  holds", check.holds, detail=True),
    ]  # fmt: skip


def _worst(same: Sequence[Row]) -> Row:
    """Return the worst of one figure over several axes; of equal ones the first."""

    def badness(row: Row) -> Any:
        value: Any = row.value
        if isinstance(value, str):
            return value
        size = value[0] - value[1] if isinstance(value, tuple) else value
        share = size / row.below if isinstance(row.below, float) else size
        rounded = float(f"{share:.9g}")  # independent of rounding
        return -rounded if row.key in LESS_IS_WORSE else rounded

    known = [row for row in same if row.value is not None]
    return max(known, key=badness) if known else same[0]


def of_grade(grade: Grade) -> list[Row]:
    """Return the response to the unbalance of a balance quality grade."""
    return put([
        Row("grade", "grade", grade.grade, "mm/s"),
        Row("unbalance", "unbalance", grade.unbalance, "g mm"),
        Row("force", "force", grade.force, "N", 3),
        Row("displacement", "orbit", grade.displacement, "m", 3),
        Row("clearance_share", "share of the clearance", grade.clearance_share, "%"),
        Row("current", "current", grade.current, "A", 3),
    ], of=f"G {1e3 * grade.grade:g}", detail=grade.grade not in USUAL_GRADES)  # fmt: skip


def of_unstable_poles(poles: Sequence[UnstablePole]) -> list[Row]:
    """Return the unstable poles of a loop."""
    return [
        row
        for place, pole in enumerate(poles, 1)
        for row in put([
            Row("frequency", "frequency", pole.frequency, "Hz"),
            Row("growth", "growth rate", pole.growth, "1/s"),
            Row("time_to_double", "doubling time",
                pole.doubling if math.isfinite(pole.doubling) else None, "s", 3),
        ], of=str(place))
    ]  # fmt: skip


def facts_of(loop: AssessedLoop, of: LoopBuilder, estimator: Estimator | None) -> dict[str, str]:
    """Return the conditions of one loop's figures."""
    machine = of.machine
    facts = {"machine": machine.name, "controller fed by": loop.name, "held at": held_at(of)}
    if machine.speed:
        facts["speed"] = units.rpm(machine.speed)
    orbit = loop.of.point.orbit
    if orbit is not None:
        facts["along the orbit of"] = ", ".join(
            f"{engineering(float(abs(x)), 'm', 3)} ({name})"
            for name, x in zip(of.axes, orbit.x, strict=True)
        )
    facts |= _control(of.control_for(estimator))
    plain = of.plain(estimator)
    facts |= {} if plain is None else {"plain control": plain}
    gains: dict[str, list[str]] = {}
    for name, pid in of.pids(estimator).items():
        if pid.feed_forward:
            facts["feed-forward"] = f"{pid.feed_forward:g} of the estimated disturbance force"
        parts = ((pid.kp, "A/m"), (pid.ki, "A/(m s)"), (pid.kd, "A s/m"))
        text = ", ".join(f"{value:g} {unit}" for value, unit in parts)
        lag = engineering(pid.derivative_filter, "s", 3)
        gains.setdefault(f"{text}, derivative filter {lag}", []).append(name)
    times = (machine.sampling_time, machine.delay or 0.0)
    return facts | {f"kp, ki, kd of {', '.join(axes)}": text for text, axes in gains.items()} | {
        "sampling time, dead time": ", ".join(engineering(time, "s") for time in times),
        "assessed up to": engineering(of.top, "Hz"),
    }  # fmt: skip


def held_at(of: LoopBuilder) -> str:
    """Return displacement and control current of each axis at the operating point, as text."""
    parts = [
        f"{engineering(float(x), 'm')}, {engineering(float(iu), 'A', 3)}"
        for x, iu in zip(of.point.x, of.point.iu, strict=True)
    ]
    if len(parts) == 1:
        return parts[0]
    return ", ".join(f"{name} {held}" for name, held in zip(of.axes, parts, strict=True))


def _control(control: Control) -> dict[str, str]:
    """Return the controllers in words, unless there is one PID per axis."""
    facts: dict[str, str] = {}
    if control.type not in (None, "decentralised"):
        scheduled = ", gains scheduled by speed" if control.gain_scheduling else ""
        facts["control"] = f"{control.type}{scheduled}"
    if control.cross_feedback:
        facts["cross feedback"] = f"{control.cross_feedback:g} of the gyroscopic torques"
    if control.unbalance != "off":
        facts["unbalance"] = control.unbalance
    return facts
