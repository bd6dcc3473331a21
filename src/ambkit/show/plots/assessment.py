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
    """A stable loop, and what it is called."""

    name: str
    loop: Loop


def assessment_figure(
    title: str,
    loops: Sequence[Curves],
    *,
    zones: Sequence[tuple[str, float]],
    top: float,
    static: float | None,
    gain: float,
) -> Figure:
    """Show stable loops of one axis.

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
    noise: list[Item] = []
    if static is not None:
        compliance.append(Rule(static, signal="bound", label="static, without the integral"))
    peaks, softest = list[float](), 0.0
    for k, (name, loop) in enumerate(loops):
        look = LOOKS[k % len(LOOKS)]
        f = grid(loop)
        f = f[f >= SHOWN * nyquist]
        S, L = loop.sensitivity(f)[:, 0, 0], loop.open(f)[:, 0, 0]
        peaks.append(20 * math.log10(float(np.abs(S).max())))
        bode.append(Line(f, 20 * np.log10(np.abs(S)), signal=look, label=name))
        nyquist_items.append(near(Line(L.real, L.imag, signal=look, label=name)))
        yielding = np.abs(loop.compliance(f)[:, 0, 0])
        softest = max(softest, float(yielding.max()))
        compliance.append(Line(f, yielding, signal=look, label=name))
        noise.append(
            Line(f, gain * np.abs(loop.noise_to_control(f)[:, 0, 0]), signal=look, label=name)
        )
    yields = Axis("compliance", "µm/N", 1e6, scale="log", limits=(2e-4 * softest, 3 * softest))
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
            Panel(frequency, passes, noise, title="Noise to current"),
        ],
        columns=2,
        panel_height=2.6,
    )


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
