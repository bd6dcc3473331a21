"""What is uncertain of a plant, and points of it that cover it evenly."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ambkit.machine.machine import Machine


@dataclass(frozen=True)
class Spread:
    """How far each quantity may be from its nominal value, as a share of it: 0.2 is +-20 %."""

    # The plant takes the value; the estimators go on with the nominal one.

    #: Of the plant. A force map has its gap in it: only its constant varies.
    magnet_constant: float = 0.0
    mass: float = 0.0
    air_gap: float = 0.0
    noise: float = 0.0  #: Of the sensor: standard deviation of its noise, time constant.
    lag: float = 0.0
    load: float = 0.0  #: Of the disturbance.

    @classmethod
    def all(cls, share: float) -> Spread:
        """Return the same share for each."""
        return cls(*(share for _ in fields(cls)))

    def factors(self, runs: int, seed: int) -> list[Spread]:
        """Draw what each run takes of each nominal value: scrambled Sobol points (Owen 1998)."""
        from scipy.stats import qmc

        shares = np.array([getattr(self, field.name) for field in fields(self)])
        sobol = qmc.Sobol(shares.size, scramble=True, rng=np.random.default_rng([seed, 2]))
        points = sobol.random_base2(max(0, int(np.ceil(np.log2(runs)))))[:runs]
        return [Spread(*map(float, row)) for row in 1 + shares * (2 * points - 1)]

    def plant(self, nominal: Machine) -> Machine:
        """Return the bearing with its values times these factors."""
        magnet, sensor = nominal.magnet, nominal.sensor
        gap = magnet.air_gap * self.air_gap
        return nominal.replace(
            **magnet.with_constant(magnet.magnet_constant * self.magnet_constant),
            magnet__air_gap=gap,
            rotor__mass=nominal.rotor.mass * self.mass,
            # A narrower gap may leave less room than the stops did.
            rotor__clearance=min(nominal.rotor.clearance, 0.95 * gap),
            sensor__noise_variance=sensor.noise_variance * self.noise**2,
            sensor__lag=sensor.lag * self.lag,
        )


CERTAIN = Spread()  #: Nothing is uncertain.
