"""Figure of an assessment: sensitivity with its zones, Nyquist plot, compliance, noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambkit.base.arrays import grouped
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.capacity import Capacity
from ambkit.judge.loop.margins import UnstablePole, grid, rates
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule, Vector

LOOKS = ("measurement", "estimate", "series 2", "series 3", "series 4")
"""Styles of the loops, in order, repeated as needed."""

SHOWN = 1e-4  #: Lower end of the frequency axis, over half the sampling rate.


class Curves(NamedTuple):
    """An axis of a stable loop, with its label."""

    name: str
    loop: Loop
    axis: int = 0


# Range of the Nyquist plot around -1, with nearly round circles.
NYQUIST_REAL = Axis("real part of L", limits=(-3.2, 1.2))
NYQUIST_IMAGINARY = Axis("imaginary part of L", limits=(-2.1, 2.1))


def assessment_figure(
    title: str,
    loops: Sequence[Curves],
    *,
    zones: Sequence[tuple[str, float]],
    top: float,
    static: float | None,
    gain: float,
    full_loop: Loop | None = None,
    left_out: Sequence[str] = (),
) -> Figure:
    """Plot stable loops of one axis, or the axes of one loop."""
    nyquist = loops[0].loop.nyquist
    frequency = Axis("frequency", "Hz", scale="log", limits=(SHOWN * nyquist, nyquist))
    bode = zone_lines(zones, top)
    curves: list[Item] = []
    compliance: list[Item] = []
    stiffness: list[Item] = []
    noise: list[Item] = []
    for items, value in (compliance, static), (stiffness, static and 1 / static):
        if value is not None:
            items.append(Rule(value, signal="bound", label="static, without the integral"))
    peaks, softest = list[float](), 0.0
    for k, (name, loop, axis) in enumerate(loops):
        look = LOOKS[k % len(LOOKS)]
        f = grid(loop)
        f = f[f >= SHOWN * nyquist]
        S = loop.of_axis(axis, f)
        L = 1 / S - 1
        peaks.append(20 * math.log10(float(np.abs(S).max())))
        bode.append(Line(f, 20 * np.log10(np.abs(S)), signal=look, label=name))
        curves.append(near(Line(L.real, L.imag, signal=look, label=name)))
        yielding = np.abs(loop.compliance(f)[:, axis, axis])
        softest = max(softest, float(yielding.max()))
        compliance.append(Line(f, yielding, signal=look, label=name))
        stiffness.append(Line(f, 1 / yielding, signal=look, label=name))
        noise.append(Line(f, gain * _noise(loop, axis, f), signal=look, label=name))
    yields = Axis("compliance", "µm/N", 1e6, scale="log", limits=(2e-4 * softest, 3 * softest))
    limits = (1 / (3 * softest), 1 / (2e-4 * softest))
    withstands = Axis("dynamic stiffness", "N/µm", 1e-6, scale="log", limits=limits)
    passes = Axis("current by noise", "A/µm", 1e-6, scale="log")
    heights = Axis("sensitivity |S|", "dB", limits=(-14.0, max(16.0, 2 + max(peaks))))
    unstable = f" Unstable and not drawn: {', '.join(left_out)}." if left_out else ""
    return Figure(
        "assessment",
        title,
        f"The loop is broken at the measurement, as in ISO 14839-3. {ZONE_CAPTION} Frequencies up "
        f"to half the sampling rate; loads are constant over a sample.{unstable}",
        [
            Panel(frequency, heights, bode, title="Sensitivity"),
            nyquist_panel(curves, zones),
            Panel(frequency, yields, compliance, title="Compliance"),
            Panel(frequency, withstands, stiffness, title="Dynamic stiffness"),
            Panel(frequency, passes, noise, title="Noise to current"),
            *([] if full_loop is None else _full_loop_panels(full_loop, frequency, zones, top)),
        ],
        columns=2,
        panel_height=2.6,
    )


def unstable_figure(
    title: str, loop: Loop, axes: Sequence[str], poles: Sequence[UnstablePole]
) -> Figure:
    """Plot an unstable loop: Nyquist, loop gain and poles."""
    nyquist = loop.nyquist
    f = grid(loop)
    f = f[f >= SHOWN * nyquist]
    S = loop.along_axes(f)
    curves, gains, phases = list[Item](), list[Item](), list[Item]()
    gains.append(Rule(0.0, signal="limit", label=""))

    def alike(k: int, other: int) -> bool:
        return np.allclose(S[:, k, k], S[:, other, other], rtol=1e-6, atol=0)

    for count, same in enumerate(grouped(S.shape[1], alike)):
        look, L = LOOKS[count % len(LOOKS)], 1 / S[:, same[0], same[0]] - 1
        names = " and ".join(axes[k] for k in same)
        label = f"axis {names}" if len(axes) > 1 else "loop"
        curves.append(near(Line(L.real, L.imag, signal=look, label=label)))
        gains.append(Line(f, 20 * np.log10(np.abs(L)), signal=look, label=label))
        phase = np.degrees(np.angle(L))
        phase[1:][np.abs(np.diff(phase)) > 180] = np.nan  # break the line where the phase wraps
        phases.append(Line(f, phase, signal=look, label=label))
    for item in poles:
        if item.frequency > SHOWN * nyquist:  # name the fastest growing
            text = f"{item.frequency:.4g} Hz, {item.growth:+.3g}/s" if item is poles[0] else ""
            gains.append(Rule(item.frequency, axis="x", signal="spike", label="", text=text))
    frequency = Axis("frequency", "Hz", scale="log", limits=(SHOWN * nyquist, nyquist))
    panels = [
        nyquist_panel(curves, label="−1"),
        _of_poles(loop, poles),
        Panel(frequency, Axis("loop gain |L|", "dB", limits=(-60.0, 60.0)), gains,
              title="Loop gain"),
        Panel(frequency, Axis("phase of L", "°", limits=(-180.0, 180.0)), phases, title="Phase"),
    ]  # fmt: skip
    grows = "; ".join(
        f"{pole.frequency:.4g} Hz grows by {pole.growth:.3g}/s, doubles in {pole.doubling:.3g} s"
        for pole in poles
    )
    others = ", each axis with all other loops closed" if len(axes) > 1 else ""
    return Figure(
        "unstable-loop", title,
        f"Broken at the measurement{others}, up to half the sampling rate. Poles of the closed "
        f"loop: {grows}.",
        panels, columns=2, panel_height=2.8,
    )  # fmt: skip


def _of_poles(loop: Loop, poles: Sequence[UnstablePole]) -> Panel:
    """Plot the poles of a closed loop around the unstable ones."""
    result = rates(loop)
    result = result[result.imag >= 0]
    max_growth = max((pole.growth for pole in poles), default=0.0)
    highest = max((pole.frequency for pole in poles), default=0.0)
    min_decay = -float(result.real[result.real < 0].max(initial=-math.inf))
    wide = max(1.5 * max_growth, 0.5 * min_decay if math.isfinite(min_decay) else 0.0, 1.0)
    high = min(loop.nyquist, max(1.6 * highest, wide / math.pi))
    visible = (result.real > -3 * wide) & (result.imag <= 2 * math.pi * high)
    stable, grow = result[visible & (result.real < 0)], result[visible & (result.real >= 0)]
    items: list[Item] = [
        Rule(0.0, axis="x", signal="limit", label="limit of stability"),
        Points(stable.real, stable.imag / (2 * math.pi), signal="estimate", label="stable pole"),
        Points(grow.real, grow.imag / (2 * math.pi), signal="spike", label="unstable pole"),
    ]
    return Panel(
        Axis("growth rate", "1/s", limits=(-3 * wide, wide)),
        Axis("frequency", "Hz", limits=(-0.05 * high, 1.05 * high)), items,
        title="Poles of the closed loop",
    )  # fmt: skip


def _noise(loop: Loop, axis: int, f: Vector) -> Vector:
    """Return the gain from noise at an axis's summing point to its control signal (k,) [V/m]."""
    result = loop.noise_to_control(f)
    return np.abs((result if loop.added is None else result @ loop.added)[:, axis, axis])


def _full_loop_panels(
    loop: Loop, frequency: Axis, zones: Sequence[tuple[str, float]], top: float
) -> list[Panel]:
    """Plot singular values of S, and the determinant of 1 + L around 0."""
    f = grid(loop)
    f = f[f >= SHOWN * loop.nyquist]
    S = loop.along_axes(f)
    values = 20 * np.log10(np.maximum(np.linalg.svd(S, compute_uv=False), 1e-6))
    items = zone_lines(zones, top)
    items += [
        Line(f, values[:, k], signal=look, label=f"{which} singular value")
        for k, look, which in ((0, "series 2", "largest"), (-1, "series 3", "smallest"))
    ]
    heights = Axis("singular values of S", "dB", limits=(-14.0, max(16.0, 2 + values.max())))
    det = 1 / np.linalg.det(loop.sensitivity(f))
    det = det * np.abs(det) ** (1 / loop.axes - 1)
    origin = Points(np.array([0.0]), np.array([0.0]), signal="spike", label="")
    curve = near(Line(det.real, det.imag, signal="estimate", label=""))
    return [
        Panel(frequency, heights, items, title="Singular values"),
        Panel(Axis("real part", limits=(-2.2, 2.2)),
              replace(NYQUIST_IMAGINARY, label="imaginary part"), [origin, curve],
              title=f"det(1 + L), its magnitude to the power of 1/{loop.axes}"),
    ]  # fmt: skip


ZONE_CAPTION = (
    "Lines A, B and C are the upper limits of the zones of ISO 14839-3: A of new machines, B "
    "acceptable without time limit, C for a limited time, D above; circles about −1 are the same "
    "limits for the open loop."
)
"""Caption of the zones' lines."""


def zone_lines(zones: Sequence[tuple[str, float]], top: float) -> list[Item]:
    """Return the upper ends of the zones over the frequency [dB], and the end of their range."""
    items = zone_rules([(name, 20 * math.log10(limit)) for name, limit in zones])
    return [*items, Rule(top, axis="x", signal="reference", label="end of the standard's range")]


def zone_rules(zones: Sequence[tuple[str, float]]) -> list[Item]:
    """Return the upper ends of the zones, of which the legend names all in one."""
    ends = f"upper limits of zones {', '.join(name for name, _ in zones)}"
    return [
        Rule(limit, signal="limit", text=name, label=ends if k == 0 else "")
        for k, (name, limit) in enumerate(zones)
    ]


def nyquist_panel(
    curves: Sequence[Item], zones: Sequence[tuple[str, float]] = (), label: str = ""
) -> Panel:
    """Plot open loops around -1, and the circles that bound the zones."""
    angle = np.linspace(0, 2 * np.pi, 181)
    marks: list[Item] = [
        Line(np.cos(angle) / limit - 1, np.sin(angle) / limit, signal="limit", label="")
        for _, limit in zones
    ]
    marks.append(Points(np.array([-1.0]), np.array([0.0]), signal="spike", label=label))
    return Panel(NYQUIST_REAL, NYQUIST_IMAGINARY, [*marks, *curves], title="Open loop")


def near(line: Line) -> Line:
    """Omit a curve where it is far outside the Nyquist plot."""
    far: Vector = np.maximum(np.abs(line.x), np.abs(line.y))
    return Line(line.x, np.where(far < 10, line.y, np.nan), signal=line.signal, label=line.label)


def capacity_figure(
    title: str,
    loops: Mapping[str, Capacity],
    demands: Mapping[str, tuple[float, float]] | None = None,
) -> Figure:
    """Plot the harmonic load at which current, displacement and voltage reach their limits."""
    if not loops:
        raise AmbkitError("no loop is stable: there is nothing to draw")
    f = next(iter(loops.values())).frequency
    frequency = Axis("frequency", "Hz", scale="log", limits=(float(f[0]), float(f[-1])))
    load = Axis("amplitude of the disturbance force", "N", scale="log")
    kinds = {"current at its limit": "current", "out of zone A of ISO 14839-2": "displacement",
             "voltage at its limit": "voltage"}  # fmt: skip
    panels = []
    for heading, kind in kinds.items():
        items: list[Item] = [
            Line(f, getattr(item, kind), signal=LOOKS[k % len(LOOKS)], label=name)
            for k, (name, item) in enumerate(loops.items())
            if getattr(item, kind) is not None
        ]
        if items:
            items += [
                Points(np.array([at]), np.array([force]), signal="spike",
                       label="force of the unbalance" if k == 0 else "")
                for k, (at, force) in enumerate((demands or {}).values())
            ]  # fmt: skip
            panels.append(Panel(frequency, load, items, title=heading[0].upper() + heading[1:]))
    return Figure(
        "capacity",
        title,
        "Amplitude of a harmonic force, in addition to the constant one, at which the linear "
        "closed loop reaches a limit. Noise, unbalance, runout and the constant force reduce each "
        "limit (the voltage: the constant force only). Marks: unbalance force at the speed.",
        panels,
        columns=min(2, len(panels)),
        panel_height=2.8,
    )
