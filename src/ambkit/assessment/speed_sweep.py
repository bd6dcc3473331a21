"""A machine's loop over the speed of rotation: margins, modes, and run-up with unbalance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.arguments import LoopArguments
from ambkit.assessment.assess import MEASUREMENT, on_orbit
from ambkit.assessment.sweep_figures import over_speed_figure, run_up_figure
from ambkit.base import units
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike
from ambkit.base.threads import one_thread
from ambkit.control.linear.closed_loop import Loop
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop import capacity
from ambkit.judge.loop.loop_builder import ZONE_A, ZONES, LoopBuilder, zone_of
from ambkit.judge.loop.margins import BodeIntegral, bode_integral, grid, highest
from ambkit.judge.modal_reduction import reduction
from ambkit.judge.whirl_modes import max_speed
from ambkit.machine.components import Unbalance
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import At, Row, Section, put
from ambkit.rotordynamics.separation_margins import Separation, separations

COUNT = 41  #: Default number of speeds.
COARSE, NEAR = 250, 9  #: Points of the grid of a peak at one speed, and around each pole.
MAXIMA = ("maxima",)  #: Section of the maxima.


@dataclass(frozen=True, eq=False, repr=False)
class OverSpeed(Result):
    """A machine's loop at several speeds of rotation."""

    signed = True

    machine: Machine  #: The machine.
    fed_by: str  #: Feedback of its controllers.
    axes: tuple[str, ...]  #: Names of its p axes.
    speed: Array  #: (n,) Speeds of rotation [rad/s], ascending.
    #: (n, p) Peak of abs(S) of each axis within the range of ISO 14839-3 [1]; NaN where the loop is
    #: unstable.
    peaks: Array
    largest: Array  #: (n,) Greatest singular value of S up to half the sampling rate [1].
    #: (n,) Of the closed loop at each speed, as rates [1/s].
    poles: tuple[NDArray[np.complex128], ...]
    #: (n, p) Largest distance from the centre: equilibrium, unbalance, runout, and three times the
    #: rms noise [m].
    orbit: Array
    current: Array  #: (n, p) Maximum control current, likewise [A].
    #: (n, p) Maximum coil voltage without noise, over its limit [1]; None without limit.
    voltage: Array | None
    #: (n, p) Of the hottest coil in continuous operation at the speed [K], infinite for thermal
    #: runaway; None unless the cooling of all coils is known.
    temperature: Array | None
    #: Numerical check at standstill, at the machine's speed, and at the maximum.
    integrals: dict[float, BodeIntegral]
    #: Separation of the machine's speed from each critical speed.
    apart: tuple[Separation, ...] = ()

    @property
    def clearance(self) -> Array:
        """Clearance along each axis (p,) [m]."""
        return np.array([axis.bearing.clearance for axis in self.machine.axes])

    @property
    def current_limit(self) -> Array:
        """Current limit of each axis (p,) [A]."""
        return np.array([axis.bearing.amplifier.current_limit for axis in self.machine.axes])

    @property
    def hottest(self) -> tuple[float, float] | None:
        """Maximum coil temperature [K], and its speed [rad/s]; None if unknown."""
        return None if self.temperature is None else self._max_and_speed(self.temperature)

    @property
    def temperature_limit(self) -> float | None:
        """Lowest permissible coil temperature [K]; None if unknown."""
        coils = [axis.bearing.coil for axis in self.machine.axes]
        limits = [coil.temperature_limit for coil in coils if coil is not None]
        return min((limit for limit in limits if limit is not None), default=None)

    @property
    def judged(self) -> int:
        """Number of speeds up to the machine's speed; all if it is none of them."""
        own = abs(self.machine.speed)
        count = int(np.searchsorted(self.speed, own * (1 - 1e-9))) + 1
        return count if own and count < len(self.speed) else len(self.speed)

    @property
    def worst(self) -> tuple[float, float]:
        """Maximum of abs(S) [1], and its speed [rad/s]; infinite if unstable there."""
        return self._max_and_speed(self.peaks, unknown=np.inf)

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-3 at the worst speed."""
        return zone_of(self.worst[0])

    @property
    def farthest(self) -> tuple[float, float]:
        """Maximum share of a clearance [1], and its speed [rad/s]."""
        return self._max_and_speed(self.orbit / self.clearance)

    @property
    def hardest(self) -> tuple[float, float]:
        """Maximum share of a current limit [1], and its speed [rad/s]."""
        return self._max_and_speed(self.current / self.current_limit)

    def _max_and_speed(
        self, share: Array, unknown: float = -np.inf, beyond: bool = False
    ) -> tuple[float, float]:
        where = slice(self.judged, None) if beyond else slice(self.judged)
        parts = np.where(np.isnan(share), unknown, share).max(axis=1)[where]
        at = int(np.argmax(parts))
        return float(parts[at]), float(self.speed[where][at])

    TITLE = "Loop of {0.machine.name} over speed"

    @property
    def finding(self) -> str:
        text = f"{self.machine.name}, controllers fed by {self.fed_by}, to {self._end}: "
        return f"{text}{_zone_and_peak(*self.worst)}."

    @property
    def _end(self) -> str:
        return units.rpm(float(self.speed[self.judged - 1]))

    @property
    def rows(self) -> list[Row]:
        (peak, at), (far, there), (used, where) = self.worst, self.farthest, self.hardest
        worst_rows = [
            Row("zone", "zone of ISO 14839-3", self.zone),
            Row("peak", "  peak of |S|, worst axis", peak, "|S|", below=ZONE_A,
                at=At("peak_speed", at, "rpm")),
            Row("maximum_singular_value", "  largest singular value of S",
                float(self.largest.max())),
            Row("displacement_share", "share of the clearance", far, "%",
                below=capacity.ROOM[0][1], at=At("displacement_speed", there, "rpm")),
            Row("current_share", "share of the current limit", used, "%", below=1.0,
                at=At("current_speed", where, "rpm")),
        ]  # fmt: skip
        if self.hottest is not None:
            kelvin, where = self.hottest
            worst_rows.append(
                Row("maximum_coil_temperature", "coil temperature", kelvin, "degC",
                    below=self.temperature_limit, at=At("temperature_speed", where, "rpm"))
            )  # fmt: skip
        result = put(worst_rows, section=MAXIMA, of=self.fed_by)
        for speed, integral in self.integrals.items():
            result += put([
                Row("integral", "integral", integral.integral, digits=9),
                Row("poles", "expected from the unstable poles", integral.poles, digits=9),
                Row("holds", "holds", integral.holds),
            ], section=("bode",), of=units.rpm(speed), detail=True)  # fmt: skip
        for apart in self.apart:
            result += apart.rows()
        return result

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        own = units.rpm(self.machine.speed)
        return {
            MAXIMA: Section(f"{self.machine.name}, a slow run-up from rest to {self._end}"),
            ("bode",): Section("Check: Bode's integral of ln|det S|", across=True),
            ("critical_speeds",): Section(f"Separation of {own} from critical speeds", across=True),
        }

    @property
    def notes(self) -> list[str]:
        notes, compared = [], reduction(self.machine)
        if self.judged < len(self.speed):
            peak = self._max_and_speed(self.peaks, unknown=np.inf, beyond=True)
            notes = [f"Beyond, to {units.rpm(float(self.speed[-1]))}: {_zone_and_peak(*peak)}."]
        return notes if compared is None or compared.good else [*notes, f"{compared.text()}."]

    @property
    def series(self) -> dict[str, Any]:
        return {
            "machine": self.machine.name,
            "fed_by": self.fed_by,
            "axes": list(self.axes),
            "speed": self.speed.tolist(),
            "peaks": self.peaks.tolist(),
            "largest_singular_value": self.largest.tolist(),
            "displacement": self.orbit.tolist(),
            "clearance": self.clearance.tolist(),
            "current": self.current.tolist(),
            "current_limit": self.current_limit.tolist(),
            "voltage_share": None if self.voltage is None else self.voltage.tolist(),
            "coil_temperature": None if self.temperature is None else self.temperature.tolist(),
            "poles": [[[float(p.real), float(p.imag)] for p in pole] for pole in self.poles],
        }

    def figures(self) -> list[Figure]:
        return [over_speed_figure(self, ZONES), run_up_figure(self)]


def _zone_and_peak(peak: float, speed: float) -> str:
    at = units.rpm(speed, 4)
    return (
        f"unstable at {at}" if math.isinf(peak)
        else f"zone {zone_of(peak)}, peak of |S| {peak:.3f} at {at}"
    )  # fmt: skip


@one_thread()
def assess_over_speed(
    arguments: LoopArguments,
    *,
    fastest: QuantityLike | None = None,
    count: int = COUNT,
    orbit: bool = False,
    apart: Sequence[Separation] | None = None,
) -> OverSpeed:
    """Assess a machine's loop over its speed of rotation, with gyroscopics."""
    # apart: separations of the same loop, if known.
    machine = arguments.machine
    fastest, limit = max_speed(machine, fastest), math.pi / machine.sampling_time
    if not fastest < limit:
        raise AmbkitError(
            f"fastest must be less than {limit:.6g} rad/s, half a revolution within a sample; is "
            f"{fastest:g} rad/s"
        )
    if count < 2:
        raise AmbkitError(f"count must be 2 or more, is {count}")
    ((name, estimator),) = arguments.filters.items() or [(MEASUREMENT, None)]
    run = _Run(arguments, estimator, orbit, fastest)
    speeds = np.linspace(0.0, fastest, count)
    parts = zip(*(run.at(float(speed)) for speed in speeds), strict=True)
    peaks, largest, poles, far, current, volts, warm = parts
    checked = sorted({0.0, fastest, *([machine.speed] if 0 < machine.speed < fastest else [])})
    return OverSpeed(
        machine=machine,
        fed_by=name,
        axes=run.axes,
        speed=speeds,
        peaks=np.array(peaks),
        largest=np.array(largest),
        poles=poles,
        orbit=np.array(far),
        current=np.array(current),
        voltage=None if any(item is None for item in volts) else np.array(volts),
        temperature=None if any(item is None for item in warm) else np.array(warm),
        integrals={speed: bode_integral(run.loop(speed)[1]) for speed in checked},
        apart=tuple(
            separations(machine, loop=run.of, fed_by=estimator, max_speed=float(speeds[-1]))
            if apart is None
            else apart
        ),
    )


class _Run:
    """A machine and its loop, at one speed after another."""

    def __init__(
        self, arguments: LoopArguments, fed_by: Estimator | None, orbit: bool, max_speed: float
    ) -> None:
        machine = arguments.machine
        planes = tuple(
            Unbalance(place=place, amount=amount, angle=angle)
            for place, amount, angle in machine.unbalances()
        )
        self.machine = machine.model_copy(update={"unbalance": planes})
        self.fed_by, self.orbit = fed_by, orbit
        of = LoopBuilder(self.machine, arguments.controller, load=arguments.disturbance)
        self.point, self.axes = of.point, of.axes
        self.of = of.with_controllers(fed_by, max_speed)

    def loop(self, speed: float) -> tuple[LoopBuilder, Loop]:
        """Return the loop at a speed [rad/s], and its `LoopBuilder`."""
        of, inner = self.of.at_speed(speed, self.fed_by)
        if self.orbit and speed:
            of = on_orbit(of, inner)
        return of, of.loop(inner)

    def at(self, speed: float) -> tuple[Any, ...]:
        """Return `OverSpeed`'s quantities at a speed [rad/s], from the peaks to the temperature."""
        of, loop = self.loop(speed)
        with np.errstate(divide="ignore"):
            poles = np.asarray(np.log(loop.closed.poles()) / loop.T, complex)
        p = loop.axes
        if not loop.is_stable:
            unknown = np.full(p, math.nan)
            return unknown, math.nan, poles, unknown, unknown, unknown, unknown
        f = grid(loop, COARSE, NEAR)
        f = np.unique(np.append(f, of.top))
        S, counts = loop.along_axes(f), f <= of.top
        peaks = [highest(partial(loop.of_axis, k), f[counts], S[counts, k, k])[0] for k in range(p)]
        sizes = np.linalg.norm(S, 2, axis=(1, 2))
        largest = highest(loop.largest_sensitivity, f, sizes)[0]
        responses = of.harmonic_responses(loop)
        return np.array(peaks), largest, poles, *self._loads(of, loop, responses)

    def _loads(
        self, of: LoopBuilder, loop: Loop, responses: list[capacity.HarmonicResponse]
    ) -> tuple[Array, Array, Array | None, Array | None]:
        """Return displacement [m], current [A], voltage [1] and temperature [K] of each axis."""
        p, point = loop.axes, self.point
        noise = np.sqrt(np.diag(loop.noise_covariance(*of.noise())))
        gains = np.array([b.amplifier.gain for b in of.isolated])
        far, swing, square = capacity.swings(
            point, capacity.synchronous_pairs(of.machine), gains * noise[p:], noise[:p], responses
        )
        volts = [self.share(of, k, responses) for k in range(p)]
        known = [volt for volt in volts if volt is not None]
        warm = [
            capacity.heating(b, capacity.coil_current_squares(b, float(iu), float(mean)))
            for b, iu, mean in zip(of.isolated, point.iu, square, strict=True)
        ]
        temperatures = [item.temperature for item in warm if item is not None]
        return (
            far, np.abs(point.iu) + swing, np.array(known) if len(known) == p else None,
            np.array(temperatures) if len(temperatures) == p else None,
        )  # fmt: skip

    def share(
        self, of: LoopBuilder, axis: int, responses: list[capacity.HarmonicResponse]
    ) -> float | None:
        """Return the maximum voltage of an axis's coils, over its limit [1]."""
        b, limit = of.isolated[axis], of.isolated[axis].amplifier.voltage_limit
        iu, x = float(self.point.iu[axis]), float(self.point.x[axis])
        f = np.array([of.machine.speed / (2 * math.pi)])
        coil_voltages = [
            capacity.voltage(
                b, iu, x, f, np.array([response.i[axis]]), np.array([response.x[axis]])
            )
            for response in responses
            or [capacity.HarmonicResponse(0 * self.point.x + 0j, 0 * self.point.x + 0j)]
        ]
        known = [of_coil for of_coil in coil_voltages if of_coil is not None]
        if limit is None or len(known) < len(coil_voltages):
            return None
        used = [
            limit - coil[0][0] + sum(float(volts[0]) for _room, volts in coil)
            for coil in zip(*known, strict=True)
        ]
        return float(max(used) / limit)
