"""A first machine file from a log: what gravity says of a rotor that hangs below one magnet.

With ``m g = k (i/s)^2`` in balance, ``x'' = (2 g / s) x + (2 g / i) di``: the pole gives the gap,
the gain the unit of the position. Where a voltage drives the coil, its current is ``u / R``, late
by L/R.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.derived_channels import standardised
from ambkit.data.reading.position_search import Rotor
from ambkit.data.reading.voltage_test import voltage_fits

G = 9.81  #: Standard gravity, rounded [m/s²].
ABOVE = 0.99  #: Share of the samples in which a coil's current is not below zero, but for noise.
EXPLAINED = 0.5  #: Share of the acceleration's variance that the fit explains at least.
EVIDENCE = 30.0  #: Of a fit of a voltage: gain over its standard error, in sum over three bands.
UNITS = {"m": 1.0, "mm": 1e-3, "µm": 1e-6}
TRUST = 2.0  #: Ratio to a usual unit within which it is taken; noise reduces the length.


@dataclass(frozen=True)
class WeightScale:
    """What gravity tells of a rotor below one magnet."""

    gap: float  #: From the magnet to the rotor where it usually floats, as the magnet sees it [m].
    scale: float  #: Metres per unit of the logged position.
    zero: float  #: The logged position at which that gap would be 0.
    unit: str  #: The usual unit next to the scale.
    current: float  #: That carries the rotor there [A]; in volts, the coil's voltage.
    rate: float  #: Of the coil, R/L [1/sample]; 0 where its current is logged.

    def describe(self, label: str, unit: str) -> Iterator[str]:
        """Say it in lines."""
        yield (
            f"If one magnet carries it: by gravity {label} is about {self.scale:.2g} m a unit, and "
            f"its gap {1e3 * self.gap:.3g} mm at its median, so 0 near {self.zero:.3g}."
        )
        factor = self.scale / UNITS[self.unit]
        if not unit and not 1 / TRUST < factor < TRUST:
            yield (
                f"scale = {factor:.2g}  # by gravity: no usual unit. Check it: noise and hum put "
                "it off"
            )

    def machine(self, noise: float, most: float, step: float) -> Iterator[str]:
        """Write the machine file of such a rotor of 1 kg."""
        # noise [logged units], most current [A], step [s]; k from the balance m g = k (i/s)^2.
        constant, driven = G * self.gap**2 / self.current**2, self.rate > 0
        yield from (
            'name = "rig"', f'sampling_time = "{1e3 * step:.4g} ms"',
            "[magnet]", 'type = "one-sided"',
            f'magnet_constant = "{1e6 * constant:.4g} N mm^2/A^2"  # times the mass in kg'
            f"{' and the square of the resistance in ohm' if driven else ''}",
            f'air_gap = "{1e3 * self.gap:.4g} mm"  # may be too large by half, or more: measure it',
            f'bias_current = "{self.current:.4g} A"'
            f"{'  # over the resistance in ohm' if driven else ''}",
            "[rotor]", 'mass = "1 kg"  # weigh it', 'gravity = "-x"',
            f'clearance = "{0.8e3 * self.gap:.3g} mm"  # a guess',
            "[amplifier]",
            f'gain = "1 A/V"{"  # over the resistance in ohm: measure it" if driven else ""}',
            *([f'bandwidth = "{self.rate / step / math.tau:.3g} Hz"  # R/L'] if driven else []),
            'noise_variance = "1 mV^2"  # a guess',
            f'current_limit = "{max(most - self.current, self.current):.3g} A"',
            "[sensor]", "gain = 1", f'lag = "{1e2 * step:.2g} ms"  # a guess',
            f'noise_variance = "{1e12 * (noise * self.scale) ** 2:.3g} um^2"',
        )  # fmt: skip


def weight_scale(
    moves: Rotor, position: Array, control: Array, step: float, amperes: float = 1.0
) -> WeightScale | None:
    """Tell gap and scale of a hanging rotor; `amperes` a unit of the control, 0 for a voltage."""
    # position (n,); control (n,), which never falls below zero
    usual = float(np.median(control))
    if not (step > 0 and usual > 0) or np.mean(control > -0.05 * usual) < ABOVE:
        return None
    fit, gain = moves.fit, moves.gain
    if amperes == 0.0:
        unit = standardised(np.array([position, control]))
        fits = [fit for fit in voltage_fits(unit, [0, 1]) if fit.position == 0]
        if not fits or fits[0].evidence < EVIDENCE:
            return None
        fit, gain = fits[0], fits[0].gain * float(position.std() / control.std())
    elif not fit.sure or fit.explained < EXPLAINED:
        return None
    a, b = (fit.pole / step) ** 2, abs(gain) / step**2
    gap, scale = 2 * G / a, 2 * G / (b * usual)
    unit_name = min(UNITS, key=lambda name: abs(np.log(scale / UNITS[name])))
    away = gap / scale * (-1 if gain > 0 else 1)
    zero = float(np.median(position)) - away
    return WeightScale(gap, scale, zero, unit_name, (amperes or 1.0) * usual, fit.rate)
