"""Picture of an assessment: sensitivity with its zones, Nyquist, compliance, noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ambkit.judge.loop.margins import grid
from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Item, Line, Points, Rule

if TYPE_CHECKING:
    from ambkit.show.report.items import Vector
    from ambkit.simulation.linear.closed import Loop

LOOKS = ("measurement", "estimate", "series 2", "series 3", "series 4")
"""Of the loops, in their order; further ones begin again."""

SHOWN = 1e-4
"""Of half the sampling rate, where pictures begin."""


class Curves(NamedTuple):
    """An axis of a stable loop, and what it is called."""

    name: str
    loop: Loop
    axis: int = 0


def assessment_figure(
    title: str,
    loops: Sequence[Curves],
    *,
    zones: Sequence[tuple[str, float]],
    top: float,
    static: float | None,
    gain: float,
    whole: Loop | None = None,
) -> Figure:
    """Show stable loops of one axis, or the axes of one loop.

    Parameters
    ----------
    title : str
        Of which bearing.
    loops : sequence of Curves
        At least one.
    zones : sequence of (str, float)
        Names, and the peaks of abs(S) below which they are.
    top : float
        End of the range that counts for them [Hz].
    static : float, optional
        Deflection by a load at rest without the controller's integral [m/N].
    gain : float
        Of the amplifier [A/V].
    whole : Loop, optional
        Whose singular values and determinant are shown as well.

    Raises
    ------
    AmbkitError
        None of the loops is stable.
    """
    from ambkit.base.errors import AmbkitError

    if not loops:
        raise AmbkitError("no loop is stable: there is nothing to draw")
    nyquist = loops[0].loop.nyquist
    frequency = Axis("frequency", "Hz", scale="log", limits=(SHOWN * nyquist, nyquist))
    bode = zone_lines(zones, top)
    nyquist_items: list[Item] = [circle(1 / limit) for _, limit in zones]
    nyquist_items.append(Points(np.array([-1.0]), np.array([0.0]), signal="spike", label=""))
    compliance: list[Item] = []
    stiffness: list[Item] = []
    noise: list[Item] = []
    if static is not None:
        compliance.append(Rule(static, signal="bound", label="static, without the integral"))
        stiffness.append(Rule(1 / static, signal="bound", label="static, without the integral"))
    peaks, softest = list[float](), 0.0
    for k, (name, loop, axis) in enumerate(loops):
        look = LOOKS[k % len(LOOKS)]
        f = grid(loop)
        f = f[f >= SHOWN * nyquist]
        S = loop.of_axis(axis, f)
        L = 1 / S - 1
        peaks.append(20 * math.log10(float(np.abs(S).max())))
        bode.append(Line(f, 20 * np.log10(np.abs(S)), signal=look, label=name))
        nyquist_items.append(near(Line(L.real, L.imag, signal=look, label=name)))
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
    real = Axis("real part of L", limits=NYQUIST_REAL)
    imaginary = Axis("imaginary part of L", limits=NYQUIST_IMAGINARY)
    return Figure(
        "assessment",
        title,
        "The loop is broken at the measurement, as ISO 14839-3 has it; lines are the upper ends "
        "of its zones, the circles about −1 the same for the open loop. Up to half the sampling "
        "rate; loads are held over a sample.",
        [
            Panel(frequency, heights, bode, title="Sensitivity"),
            Panel(real, imaginary, nyquist_items, title="Open loop"),
            Panel(frequency, yields, compliance, title="Compliance"),
            Panel(frequency, withstands, stiffness, title="Dynamic stiffness"),
            Panel(frequency, passes, noise, title="Noise to current"),
            *([] if whole is None else _of_whole(whole, frequency, zones, top)),
        ],
        columns=2,
        panel_height=2.6,
    )


def _noise(loop: Loop, axis: int, f: Vector) -> Vector:
    """Return how noise at an axis's summing point comes to its control signal (k,) [V/m]."""
    found = loop.noise_to_control(f)
    return np.abs((found if loop.added is None else found @ loop.added)[:, axis, axis])


def _of_whole(
    loop: Loop, frequency: Axis, zones: Sequence[tuple[str, float]], top: float
) -> list[Panel]:
    """Show singular values of S, and the determinant of 1 + L about 0."""
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
              Axis("imaginary part", limits=NYQUIST_IMAGINARY), [origin, curve],
              title=f"det(1 + L), its magnitude to the power of 1/{loop.axes}"),
    ]  # fmt: skip


NYQUIST_REAL, NYQUIST_IMAGINARY = (-3.2, 1.2), (-2.1, 2.1)
"""What the Nyquist plot shows: the surroundings of -1, with circles that are nearly round."""


def zone_lines(zones: Sequence[tuple[str, float]], top: float) -> list[Item]:
    """Return the upper ends of the zones over the frequency [dB], and the end of their range.

    Parameters
    ----------
    zones : sequence of (str, float)
        Names, and the peaks of abs(S) below which they are.
    top : float
        End of the range [Hz].
    """
    ends = f"ends of zones {', '.join(name for name, _ in zones)}"
    items: list[Item] = [
        Rule(20 * math.log10(limit), signal="limit", text=name, label=ends if k == 0 else "")
        for k, (name, limit) in enumerate(zones)
    ]
    return [*items, Rule(top, axis="x", signal="reference", label="end of the standard's range")]


def circle(radius: float) -> Line:
    """Return the circle about -1 that an open loop stays out of, of a radius [1]."""
    angle = np.linspace(0, 2 * np.pi, 181)
    return Line(radius * np.cos(angle) - 1, radius * np.sin(angle), signal="limit", label="")


def near(line: Line) -> Line:
    """Leave gaps where a curve is far outside of the Nyquist plot."""
    far: Vector = np.maximum(np.abs(line.x), np.abs(line.y))
    return Line(line.x, np.where(far < 10, line.y, np.nan), signal=line.signal, label=line.label)
