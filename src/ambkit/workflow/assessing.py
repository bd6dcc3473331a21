"""The verdict on a loop: sensitivity, margins and noise, with a filter in it and without."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.asked import Given, in_si, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Shown
from ambkit.judge.loop.demands import Demands, demands
from ambkit.judge.loop.margins import BodeIntegral, Margins, bode_integral, grid, highest, margins
from ambkit.machine.bearing import Bearing
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.pieces import WorkPoint
from ambkit.simulation.scenario import PID
from ambkit.workflow.loop_of import ZONES, LoopOf, zone_of

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.show.report.figure import Figure

MEASUREMENT = "measurement"
"""What the loop is called whose controller is fed by the measurement."""

BASELINE = "LQG"
"""What the loop of the linear-quadratic-Gaussian controller is called."""

BASIS = (
    "Zones after ISO 14839-3, of a linear model: an aid, not a certificate, which asks for a "
    "measurement on the machine."
)


@dataclass(frozen=True, eq=False)
class AssessedLoop:
    """One loop, and what is said of it.

    Attributes
    ----------
    name : str
        By what its controller is fed.
    loop : Loop
        The linear loop, to be asked for any response.
    stable : bool
        Whether it is; nothing below means anything else.
    margins : Margins or None
        None of an unstable loop.
    peak, peak_frequency : float
        Greatest of abs(S) within the standard's range [1], and where [Hz]; NaN of an unstable loop.
    integral : BodeIntegral
        The check of all of it.
    current_noise, position_noise : float
        Standard deviations of the demanded current [A] and of the position [m] by the sensor's
        white noise and the amplifier's noise; NaN of an unstable loop.
    demands : Demands or None
        What it asks of the machine, and what load it bears; None of an unstable loop.
    """

    name: str
    loop: Loop
    stable: bool
    margins: Margins | None
    peak: float
    peak_frequency: float
    integral: BodeIntegral
    current_noise: float
    position_noise: float
    demands: Demands | None

    @property
    def zone(self) -> str:
        """Zone A to D; ``"unstable"`` of a loop that is."""
        if not self.stable:
            return "unstable"
        return zone_of(self.peak)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        poles = self.loop.closed.poles()
        with np.errstate(divide="ignore"):
            rates = np.log(np.abs(poles)) / self.loop.T
        slowest = float(rates.max())
        found: dict[str, Any] = {
            "stable": self.stable,
            "zone": self.zone,
            "peak": self.peak,
            "peak_frequency": self.peak_frequency,
            "slowest_pole": slowest,
            "current_noise": self.current_noise,
            "position_noise": self.position_noise,
            "bode_integral": self.integral.integral,
            "bode_poles": self.integral.poles,
            "bode_holds": self.integral.holds,
            "poles": [[float(at.real), float(at.imag)] for at in poles],
        }
        if self.margins is not None:
            m = self.margins
            found |= {
                "peak_to_half_the_sampling_rate": m.peak,
                "peak_to_half_the_sampling_rate_at": m.peak_frequency,
                "complementary_peak": m.complementary_peak,
                "gain_margin_up": m.gain_up,
                "gain_margin_down": m.gain_down,
                "phase_margin": m.phase,
                "delay_margin": m.delay,
                "disk_margin": m.disk,
                "crossover": m.crossover,
                "bandwidth": m.bandwidth,
            }
        if self.demands is not None:
            d = self.demands
            found |= {
                "displacement": d.displacement,
                "displacement_zone": d.zone,
                "clearance": d.clearance,
                "current": d.current,
                "copper_loss": d.copper_loss,
                "static_load": list(d.capacity.static),
                "least_load": d.capacity.least[0],
                "least_load_at": d.capacity.least[1],
            }
        return found


@dataclass(frozen=True, eq=False)
class Assessment(Shown):
    """Loops of one bearing and one controller, assessed.

    Attributes
    ----------
    bearing : Bearing
        The plant.
    controller : PID
        Its gains, with what was not said tuned to the bearing.
    point : WorkPoint
        Where it is linearised: control current [A] and displacement [m].
    top : float
        End of the range that the zones are taken from [Hz].
    least : tuple of float
        Peaks of abs(S) and abs(T) that no controller can be below with this plant.
    loops : dict of str to AssessedLoop
        By what the controller is fed, the measurement first.
    """

    _card_by = "workflow.cards:assessment"

    bearing: Bearing
    controller: PID
    point: WorkPoint
    top: float
    least: tuple[float, float]
    loops: dict[str, AssessedLoop]

    def __repr__(self) -> str:
        said = ", ".join(
            f"{name}: zone {each.zone}, peak {each.peak:.3g} at {each.peak_frequency:.4g} Hz"
            if each.stable
            else f"{name}: unstable"
            for name, each in self.loops.items()
        )
        return f"<Assessment of {self.bearing.name}: {said}>"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain data, in SI."""
        return {
            "bearing": self.bearing.name,
            "basis": BASIS,
            "controller": self.controller.model_dump(mode="json"),
            "control_current": self.point.iu,
            "displacement": self.point.x,
            "range": self.top,
            "half_the_sampling_rate": 0.5 / self.bearing.sampling_time,
            "least_peak": self.least[0],
            "least_complementary_peak": self.least[1],
            "loops": {name: each.to_dict() for name, each in self.loops.items()},
        }

    def figure(self) -> Figure:
        """Return Bode of S with the zones, Nyquist, compliance and noise as a picture."""
        from ambkit.show.plots.assessment import Curves, assessment_figure

        static = self._static_compliance()
        return assessment_figure(
            f"{self.bearing.name}: sensitivity with the filter in the loop",
            [Curves(name, each.loop) for name, each in self.loops.items() if each.stable],
            zones=ZONES, top=self.top, static=static, gain=self.bearing.amplifier.gain,
        )  # fmt: skip

    def capacity_figure(self) -> Figure:
        """Return the load that each loop bears over the frequency as a picture."""
        from ambkit.show.plots.capacity import capacity_figure

        return capacity_figure(
            f"{self.bearing.name}: the load that the loop bears",
            {name: each.demands.capacity for name, each in self.loops.items() if each.demands},
        )

    def _static_compliance(self) -> float | None:
        """Deflection by a load at rest, if the controller had no integral [m/N]; None: none."""
        from ambkit.machine.magnets import magnet_of

        k_i, k_s = (float(k) for k in magnet_of(self.bearing).tangent(*self.point))
        stiffness = k_i * self.controller.kp - k_s
        return 1 / stiffness if stiffness > 0 else None


def assess(
    bearing: Bearing,
    filter: Estimator
    | str
    | os.PathLike[str]
    | Sequence[Estimator | str | os.PathLike[str]]
    | Mapping[str, Estimator]
    | None = None,
    controller: PID | None = None,
    *,
    x: Given = 0.0,
    load: Given = 0.0,
    lqg: bool = False,
) -> Assessment:
    """Assess a loop as ISO 14839-3 looks at it: broken at the measurement, filter and all.

    The loop is linearised at its work point, sampled as it is: dead time, amplifier, sensor,
    controller and the estimator with the gain that it settles to there, fed with the control signal
    that goes out. Beside it stands the same controller on the measurement. Limits of current and
    voltage, rounding of the sensor and sensor noise with a memory are not in it.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    filter : Estimator, str, path, sequence of them, or mapping of str to Estimator, optional
        In the loop: an estimator, the name of a kind, or a file of ``ambkit tune``; several are
        assessed one beside the other. None: the measurement alone.
    controller : PID, optional
        What is not said of it is tuned to the bearing. Whether it is fed by measurement or
        estimate is left to the loop.
    x : float or str, optional
        Displacement at which the rotor is held [m].
    load : float or str, optional
        Constant disturbance force there [N].

    lqg : bool, optional
        Whether the loop of the linear-quadratic-Gaussian controller that needs least control stands
        beside, as ``"LQG"``.

    Returns
    -------
    Assessment
        With tables (`to_dict`) and a picture (`figure`).

    Raises
    ------
    AmbkitError
        There is no such estimator, it has another sampling time, or it does not settle to a gain;
        nothing holds the rotor at the work point.
    TypeError
        `bearing` is no bearing.

    References
    ----------
    ISO 14839-3, Mechanical vibration: Vibration of rotating machinery equipped with active magnetic
    bearings, Part 3: Evaluation of stability margin.
    """
    of_type(Bearing, bearing=bearing)
    of = LoopOf(bearing, controller, in_si("x", x, "m"), in_si("load", load, "N"))
    estimators = given_estimators(filter, bearing)

    def loop(name: str, estimator: Estimator | None) -> AssessedLoop:
        return _assessed(name, of.loop(estimator), of)

    loops = {MEASUREMENT: loop(MEASUREMENT, None)}
    if lqg:
        loops[BASELINE] = _assessed(BASELINE, of.lqg(), of)
    loops |= {name: loop(name, each) for name, each in estimators.items()}
    return Assessment(bearing, of.controller, of.point, of.top, of.least(), loops)


def given_estimators(given: Any, bearing: Bearing) -> dict[str, Estimator]:
    """Return the estimators that were given or named, by their names.

    Parameters
    ----------
    given : optional
        See `assess`.
    bearing : Bearing
        What they run on.

    Raises
    ------
    AmbkitError
        There is no such estimator, it has another sampling time, or two have one name.
    """
    from ambkit.estimate.base import Estimator
    from ambkit.workflow.estimators import factories

    if given is None:
        return {}
    found: dict[str, Estimator] = dict(given) if isinstance(given, Mapping) else {}
    alone = isinstance(given, Estimator | str | os.PathLike)
    for each in [given] if alone else () if isinstance(given, Mapping) else given:
        if isinstance(each, Estimator):
            if each.name in found:
                raise AmbkitError(f"two filters are called {each.name}: give them as a mapping")
            found[each.name] = each
        else:
            found |= {name: make() for name, make in factories([os.fspath(each)], bearing).items()}
    for name, each in found.items():
        T = each.bearing.sampling_time
        if abs(T - bearing.sampling_time) > 1e-9 * T:
            raise AmbkitError(
                f"{name}: its sampling_time is {T:g} s, that of {bearing.name} "
                f"{bearing.sampling_time:g} s"
            )
    return found


def _assessed(name: str, loop: Loop, of: LoopOf) -> AssessedLoop:
    """Return a loop with all that is said of it."""
    bearing, top, integral = of.bearing, of.top, bode_integral(loop)
    if not loop.is_stable:
        unknown = math.nan
        return AssessedLoop(
            name, loop, False, None, unknown, unknown, integral, unknown, unknown, None
        )
    f = grid(loop)
    within = np.append(f[f < top], top)
    peak, where = highest(lambda at: loop.sensitivity(at)[:, 0, 0], within)
    noise = loop.noise_covariance(bearing.sensor.noise_variance, bearing.amplifier.noise_variance)
    position, volts = (math.sqrt(value) for value in np.diag(noise))
    current = bearing.amplifier.gain * volts
    asked = demands(loop, bearing, of.point, current, position)
    return AssessedLoop(
        name, loop, True, margins(loop, f=f), peak, where, integral, current, position, asked
    )
