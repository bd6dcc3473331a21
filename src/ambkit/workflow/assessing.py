"""The verdict on a loop: sensitivity, margins and noise, with a filter in it and without."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.asked import Given, in_si, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Shown
from ambkit.judge.loop.demands import Demands, demands, of_runout, of_unbalance
from ambkit.judge.loop.margins import BodeIntegral, Margins, bode_integral, grid, highest, margins
from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.pieces import WorkPoint
from ambkit.simulation.scenario import PID
from ambkit.workflow.balance import Grade, of_grades
from ambkit.workflow.loop_of import ZONES, LoopOf, ideal_pieces, zone_of

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
class AssessedAxis:
    """One axis of a stable loop, all other loops closed.

    Attributes
    ----------
    name : str
        Of the axis.
    margins : Margins
        Of its loop.
    peak, peak_frequency : float
        Greatest of abs(S) within the standard's range [1], and where [Hz].
    current_noise, position_noise : float
        Standard deviations of the demanded current [A] and of the position [m] by the sensors'
        white noise and the amplifiers' noise.
    demands : Demands
        What it asks of the machine, and what load it bears.
    """

    name: str
    margins: Margins
    peak: float
    peak_frequency: float
    current_noise: float
    position_noise: float
    demands: Demands

    @property
    def zone(self) -> str:
        """Zone A to D."""
        return zone_of(self.peak)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        m, d = self.margins, self.demands
        return {
            "zone": self.zone,
            "peak": self.peak,
            "peak_frequency": self.peak_frequency,
            "current_noise": self.current_noise,
            "position_noise": self.position_noise,
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
            "displacement": d.displacement,
            "displacement_zone": d.zone,
            "clearance": d.clearance,
            "current": d.current,
            "copper_loss": d.copper_loss,
            "static_load": list(d.capacity.static),
            "least_load": d.capacity.least[0],
            "least_load_at": d.capacity.least[1],
        }


@dataclass(frozen=True, eq=False)
class AssessedLoop:
    """One loop, of one axis or of several, and what is said of it.

    Attributes
    ----------
    name : str
        By what its controllers are fed.
    loop : Loop
        The linear loop, to be asked for any response.
    stable : bool
        Whether it is; nothing below means anything else.
    axes : dict of str to AssessedAxis
        By their names; empty of an unstable loop.
    largest : tuple of float
        Greatest singular value of S up to half the sampling rate [1], and where [Hz]; NaN of an
        unstable loop.
    integral : BodeIntegral
        The check of all of it.
    """

    name: str
    loop: Loop
    stable: bool
    axes: dict[str, AssessedAxis]
    largest: tuple[float, float]
    integral: BodeIntegral

    @property
    def worst(self) -> AssessedAxis | None:
        """The axis that decides the zone: that of the greatest peak; None of an unstable loop."""
        # Of axes that are alike, the first: rounding does not choose.
        return max(self.axes.values(), key=lambda each: float(f"{each.peak:.9g}"), default=None)

    @property
    def margins(self) -> Margins | None:
        """Those of the worst axis; None of an unstable loop."""
        return None if self.worst is None else self.worst.margins

    @property
    def peak(self) -> float:
        """Greatest of abs(S) of any axis within the standard's range [1]; NaN if unstable."""
        return math.nan if self.worst is None else self.worst.peak

    @property
    def peak_frequency(self) -> float:
        """Where that is [Hz]."""
        return math.nan if self.worst is None else self.worst.peak_frequency

    @property
    def current_noise(self) -> float:
        """Greatest standard deviation of a demanded current by noise [A]; NaN if unstable."""
        return max((each.current_noise for each in self.axes.values()), default=math.nan)

    @property
    def position_noise(self) -> float:
        """Greatest standard deviation of a position by noise [m]; NaN if unstable."""
        return max((each.position_noise for each in self.axes.values()), default=math.nan)

    @property
    def demands(self) -> Demands | None:
        """Those of the axis that goes farthest in its clearance; None of an unstable loop."""
        each = [axis.demands for axis in self.axes.values()]
        return max(each, key=lambda one: one.displacement / one.clearance, default=None)

    @property
    def zone(self) -> str:
        """Zone A to D; ``"unstable"`` of a loop that is."""
        return zone_of(self.peak) if self.stable else "unstable"

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI: of the worst axis, and of several of each."""
        poles = self.loop.closed.poles()
        with np.errstate(divide="ignore"):
            rates = np.log(np.abs(poles)) / self.loop.T
        found: dict[str, Any] = {
            "stable": self.stable,
            "zone": self.zone,
            "peak": self.peak,
            "peak_frequency": self.peak_frequency,
            "slowest_pole": float(rates.max()),
            "current_noise": self.current_noise,
            "position_noise": self.position_noise,
            "bode_integral": self.integral.integral,
            "bode_poles": self.integral.poles,
            "bode_holds": self.integral.holds,
            "poles": [[float(at.real), float(at.imag)] for at in poles],
        }
        if self.loop.axes > 1:
            found |= {
                "axes": {name: each.to_dict() for name, each in self.axes.items()},
                "largest_singular_value": self.largest[0],
                "largest_singular_value_at": self.largest[1],
                "worst_axis": None if self.worst is None else self.worst.name,
            }
        elif self.worst is not None:
            found |= self.worst.to_dict()
        return found


@dataclass(frozen=True, eq=False)
class Assessment(Shown):
    """Loops of one bearing or machine and its controllers, assessed.

    Attributes
    ----------
    of : LoopOf
        Plant, controllers and work point.
    estimators : dict of str to Estimator
        Those in the loops.
    least : tuple of float
        Peaks of S and T, by their largest singular values, that no controller can be below with
        this plant.
    loops : dict of str to AssessedLoop
        By what the controllers are fed, the measurement first.
    """

    _card_by = "workflow.cards:assessment"

    of: LoopOf
    estimators: dict[str, Estimator]
    least: tuple[float, float]
    loops: dict[str, AssessedLoop]

    @property
    def bearing(self) -> Any:
        """The plant, a `Bearing` or a `Machine`."""
        return self.of.bearing

    @property
    def controller(self) -> PID:
        """Gains, with what was not said tuned to the bearing; of a machine's first axis."""
        return self.of.controllers[0]

    @property
    def point(self) -> WorkPoint:
        """Where it is linearised: control current [A] and displacement [m]."""
        return self.of.point

    @property
    def top(self) -> float:
        """End of the range that the zones are taken from [Hz]."""
        return self.of.top

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
        found: dict[str, Any] = {
            "basis": BASIS,
            "range": self.top,
            "half_the_sampling_rate": 0.5 / self.bearing.sampling_time,
            "least_peak": self.least[0],
            "least_complementary_peak": self.least[1],
            "loops": {name: each.to_dict() for name, each in self.loops.items()},
        }
        if self.of.machine is None:
            return found | {
                "bearing": self.bearing.name,
                "controller": self.controller.model_dump(mode="json"),
                "control_current": self.point.iu,
                "displacement": self.point.x,
            }
        of_axes = zip(self.of.axes, self.of.controllers, self.point.iu, strict=True)
        return found | {
            "machine": self.bearing.name,
            "speed": self.bearing.speed,
            "axes": {
                name: {"controller": pid.model_dump(mode="json"), "control_current": float(iu)}
                for name, pid, iu in of_axes
            },
            "balance_grades": [each._asdict() for each in self.grades()],
        }

    def grades(self, filter: str | None = None) -> list[Grade]:
        """Return what unbalance of each balance quality grade would do at the machine's speed.

        Parameters
        ----------
        filter : str, optional
            By what the controllers of the loop are fed; by default the last one.

        Returns
        -------
        list of Grade
            None of one axis, of a machine that does not turn, or of an unstable loop.
        """
        loop = list(self.loops.values())[-1] if filter is None else self.loops[filter]
        machine = self.of.machine
        if machine is None or not machine.speed or not loop.stable:
            return []
        return of_grades(loop.loop, machine, self.point)

    def shares(self, filter: str | None = None) -> dict[str, float]:
        """Return the peak of abs(S) as it is, and with each piece of the loop ideal in turn [1].

        The worst axis within the standard's range; controllers, filter and work point stay as they
        are, so that what is told is the piece's own. Infinite where the loop is unstable then.

        Parameters
        ----------
        filter : str, optional
            By what the controllers of the loop are fed; by default the last one.

        Returns
        -------
        dict of str to float
            ``"as it is"``, and by the pieces that are not ideal already: ``"amplifier"`` without
            lag, ``"sensor"`` without lag, ``"delay"`` without dead time but for the hold,
            ``"filter"`` replaced by the measurement.
        """
        name = list(self.loops)[-1] if filter is None else filter
        estimator = self.estimators.get(name)
        found = {"as it is": self.loops[name].peak if self.loops[name].stable else math.inf}
        for piece, plant in ideal_pieces(self.bearing).items():
            there = LoopOf(plant, self.of.fed_by(estimator), point=self.point)
            found[piece] = there.peak(estimator)
        if estimator is not None:
            found["filter"] = self.of.peak()
        return found

    def figure(self, filter: str | None = None) -> Figure:
        """Return Bode of S with the zones, Nyquist, compliance and noise as a picture.

        Of one axis with all loops; of a machine with all axes of one loop, singular values, and the
        determinant of the return difference.

        Parameters
        ----------
        filter : str, optional
            Of a machine, by what the controllers of the loop are fed; by default the last one.
        """
        from ambkit.show.plots.assessment import Curves, assessment_figure

        title = f"{self.bearing.name}: sensitivity with the filter in the loop"
        stable = {name: each.loop for name, each in self.loops.items() if each.stable}
        whole = None
        if self.of.machine is None:
            curves = [Curves(name, loop) for name, loop in stable.items()]
        else:
            name = list(self.loops)[-1] if filter is None else filter
            whole = stable.get(name)
            curves = [] if whole is None else [
                Curves(" and ".join(same), whole, self.of.axes.index(same[0]))
                for same in self.alike(name)
            ]  # fmt: skip
            title = f"{self.bearing.name}: sensitivity of each axis, controllers fed by {name}"
        return assessment_figure(
            title, curves, zones=ZONES, top=self.top, static=self._static_compliance(),
            gain=self.of.alone[0].amplifier.gain, whole=whole,
        )  # fmt: skip

    def alike(self, filter: str) -> list[list[str]]:
        """Return the names of a loop's axes, those together whose curves are the same.

        Parameters
        ----------
        filter : str
            By what the controllers of the loop are fed.
        """
        found: list[list[str]] = []
        axes = self.loops[filter].axes
        for name, each in axes.items():
            for same in found:
                other = axes[same[0]]
                if math.isclose(each.peak, other.peak, rel_tol=1e-6) and math.isclose(
                    each.margins.crossover, other.margins.crossover, rel_tol=1e-6
                ):
                    same.append(name)
                    break
            else:
                found.append([name])
        return found

    def capacity_figure(self, filter: str | None = None) -> Figure:
        """Return the load that each loop, or each axis of a machine, bears over the frequency.

        Parameters
        ----------
        filter : str, optional
            Of a machine, by what the controllers of the loop are fed; by default the last one.
        """
        from ambkit.show.plots.capacity import capacity_figure

        if self.of.machine is None:
            each = {name: loop.demands for name, loop in self.loops.items()}
        else:
            name = list(self.loops)[-1] if filter is None else filter
            axes = self.loops[name].axes
            each = {" and ".join(same): axes[same[0]].demands for same in self.alike(name)}
        return capacity_figure(
            f"{self.bearing.name}: the load that the loop bears",
            {name: asked.capacity for name, asked in each.items() if asked},
        )

    def _static_compliance(self) -> float | None:
        """Deflection by a load at rest, if there were no integral [m/N]; None: none.

        Of several axes the softest.
        """
        point = zip(np.atleast_1d(self.point.iu), np.atleast_1d(self.point.x), strict=True)
        softest = 0.0
        for b, pid, (iu, x) in zip(self.of.alone, self.of.controllers, point, strict=True):
            k_i, k_s = (float(k) for k in magnet_of(b).tangent(float(iu), float(x)))
            stiffness = k_i * pid.kp - k_s
            softest = max(softest, 1 / stiffness if stiffness > 0 else math.inf)
        return softest if math.isfinite(softest) else None


def assess(
    bearing: Bearing | Machine,
    filter: Estimator
    | str
    | os.PathLike[str]
    | Sequence[Estimator | str | os.PathLike[str]]
    | Mapping[str, Estimator]
    | None = None,
    controller: PID | None = None,
    *,
    x: Given = 0.0,
    load: Given | Mapping[str, Given] = 0.0,
    lqg: bool = False,
) -> Assessment:
    """Assess a loop as ISO 14839-3 looks at it: broken at the measurement, filter and all.

    The loop is linearised at its work point, sampled as it is: dead time, amplifier, sensor,
    controller and the estimator with the gain that it settles to there, fed with the control signal
    that goes out. Beside it stands the same controller on the measurement. Limits of current and
    voltage, rounding of the sensor and sensor noise with a memory are not in it.

    Of a whole machine each axis is looked at with all others closed, at its summing point, where
    its controller takes its position; the worst axis decides, and the largest singular value stands
    beside. It is at the machine's speed; `ambkit.assess_over_speed` looks at others.

    Parameters
    ----------
    bearing : Bearing or Machine
        The plant.
    filter : Estimator, str, path, sequence of them, or mapping of str to Estimator, optional
        In the loop: an estimator, the name of a kind, or a file of ``ambkit tune``; several are
        assessed one beside the other. None: the measurement alone.
    controller : PID, optional
        What is not said of it is tuned to the bearing, or to each axis alone. Whether it is fed by
        measurement or estimate is left to the loop.
    x : float or str, optional
        Displacement at which the rotor of a bearing is held [m].
    load : float or str, optional
        Constant disturbance force there [N]; of a machine a mapping, by the names of the axes.
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
        `bearing` is neither.

    References
    ----------
    ISO 14839-3, Mechanical vibration: Vibration of rotating machinery equipped with active magnetic
    bearings, Part 3: Evaluation of stability margin.
    """
    of_type(Bearing, Machine, bearing=bearing)
    of = LoopOf(bearing, controller, in_si("x", x, "m"), given_load(bearing, load))
    if of.machine is not None and in_si("x", x, "m"):
        raise AmbkitError(f"{bearing.name} is a whole machine: x is of one axis")
    estimators = given_estimators(filter, bearing)
    loops = {MEASUREMENT: assessed(MEASUREMENT, of.loop(), of)}
    if lqg:
        loops[BASELINE] = assessed(BASELINE, of.lqg(), of)
    loops |= {name: assessed(name, of.loop(each), of) for name, each in estimators.items()}
    return Assessment(of, estimators, of.least(), loops)


def given_load(bearing: Bearing | Machine, load: Any) -> Any:
    """Return a constant load in SI: a number [N], or of a machine a mapping by its axes.

    Parameters
    ----------
    bearing : Bearing or Machine
        What is loaded.
    load : optional
        See `assess`.

    Raises
    ------
    AmbkitError
        It is a number and a machine's, or a mapping and a bearing's.
    """
    if isinstance(load, Mapping) != isinstance(bearing, Machine) and load not in (0.0, None):
        kind = "a mapping by axes" if isinstance(bearing, Machine) else "a number"
        raise AmbkitError(f"load: of {bearing.name} it must be {kind}, is {load!r}")
    if isinstance(load, Mapping):
        return {name: in_si(f"load of {name}", each, "N") for name, each in load.items()}
    return None if isinstance(bearing, Machine) else in_si("load", load, "N")


def given_estimators(given: Any, bearing: Bearing | Machine) -> dict[str, Estimator]:
    """Return the estimators that were given or named, by their names.

    Parameters
    ----------
    given : optional
        See `assess`.
    bearing : Bearing or Machine
        What they run on.

    Raises
    ------
    AmbkitError
        There is no such estimator, it has another sampling time, or two have one name.
    """
    from ambkit.estimate.base import Estimator

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
            found |= _named(os.fspath(each), bearing)
    for name, each in found.items():
        T = each.bearing.sampling_time
        if abs(T - bearing.sampling_time) > 1e-9 * T:
            raise AmbkitError(
                f"{name}: its sampling_time is {T:g} s, that of {bearing.name} "
                f"{bearing.sampling_time:g} s"
            )
    return found


def _named(name: str, bearing: Bearing | Machine) -> dict[str, Estimator]:
    """Return the estimators of a kind or in a file, made anew."""
    from ambkit.estimate.registry import KINDS, kind_called, learned_magnet
    from ambkit.workflow.estimators import factories

    if isinstance(bearing, Machine):
        kind = kind_called(name).name
        try:
            return {kind: KINDS[kind].make(bearing, learned_magnet(kind, bearing))}
        except ValueError as error:  # of one axis alone
            raise AmbkitError(str(error)) from error
    return {name: make() for name, make in factories([name], bearing).items()}


def assessed(name: str, loop: Loop, of: LoopOf) -> AssessedLoop:
    """Return a loop with all that is said of it.

    Parameters
    ----------
    name : str
        By what its controllers are fed.
    loop : Loop
        Of `of`, or of another controller on its plant.
    of : LoopOf
        Gives plant and work point.
    """
    integral = bode_integral(loop)
    if not loop.is_stable:
        return AssessedLoop(name, loop, False, {}, (math.nan, math.nan), integral)
    f = grid(loop)
    f = np.unique(np.append(f, of.top))
    S, counts, p = loop.along_axes(f), f <= of.top, loop.axes
    noise = np.sqrt(np.diag(loop.noise_covariance(*of.noise())))
    currents = np.array([b.amplifier.gain for b in of.alone]) * noise[p:]
    turned = of_runout(loop, of.bearing)
    if of.machine is not None and of.machine.speed and of.machine.unbalance:
        turned.append(of_unbalance(loop, of.machine, of.point))
    asked = demands(loop, of.bearing, of.point, currents, noise[:p], turned)
    axes = {}
    for k, axis in enumerate(of.axes):
        seen = S[:, k, k]
        peak, where = highest(partial(loop.of_axis, k), f[counts], seen[counts])
        axes[axis] = AssessedAxis(
            axis,
            margins(loop, k, f, seen),
            peak,
            where,
            float(currents[k]),
            float(noise[k]),
            asked[k],
        )
    largest = highest(loop.largest_sensitivity, f, np.linalg.norm(S, 2, axis=(1, 2)))
    return AssessedLoop(name, loop, True, axes, largest, integral)
