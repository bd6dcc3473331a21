"""Assessment of a loop: sensitivity, margins and noise, with and without a filter."""

import math
from typing import Any

import numpy as np

from ambkit.arguments import LoopArguments
from ambkit.assessment.assessment import HINF, LQG, Assessment
from ambkit.assessment.loop import AssessedLoop, assessed
from ambkit.base.arrays import Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.base.threads import one_thread
from ambkit.base.units import engineering
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint, Orbit
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.capacity import of_unbalance, orbit, synchronous_pairs
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.machine.magnets import magnet_of

TURNS, SAME = 60, 1e-6
"""Maximum number of iterations, and relative change of an orbit at which they end."""

HELD = 0.9  #: Maximum orbit, over the air gap.


def on_orbit(
    of: LoopBuilder, estimator: Estimator | None, amplitude: float | None = None
) -> LoopBuilder:
    """Return a loop at the operating point of its orbit."""
    # Harmonic balance of first order (Nayfeh and Mook 1979): the magnets' force at the speed of
    # rotation beyond that of their mean stiffnesses is returned to the loop, and their mean force
    # equals that in equilibrium. The orbit excludes runout.
    machine, single = of.machine, len(of.isolated) == 1
    if not machine.speed:
        raise AmbkitError(f"{machine.name} does not rotate: it has no orbit")
    if amplitude is not None and not amplitude > 0:
        raise AmbkitError(f"an orbit must be greater than 0 m, is {amplitude:g} m")
    if single and amplitude is None:
        raise AmbkitError(f"{machine.name} has no unbalance for an orbit: give its amplitude")
    if not single and not of.machine.unbalance:
        raise AmbkitError(f"{machine.name} has no unbalance for an orbit")
    rest, there, scale, last = of.point, of, 1.0, None
    for _ in range(TURNS):
        loop = there.loop(estimator)
        if not loop.is_stable:
            return there
        result = (
            _forced(there, loop, amplitude or 0.0) if single
            else _unbalanced(there, loop, scale)
        )  # fmt: skip
        _within(machine, there, result)
        far = float(orbit(np.atleast_1d(result.x), synchronous_pairs(machine)).max())
        now = np.concatenate([np.atleast_1d(result.x), [scale * far]])
        there = there.at(OperatingPoint(_carried(there, rest, result), rest.x, result))
        if last is not None and np.abs(now - last).max() <= SAME * np.abs(now).max():
            break
        last = now
        if amplitude is not None and not single:
            scale *= amplitude / far
    else:
        raise AmbkitError(f"{machine.name}: its orbit diverges, pulled outwards by the magnets")
    return there.with_unbalance(scale) if not single and amplitude is not None else there


def _flowing(of: LoopBuilder, demanded: Complex) -> Any:
    """Return the currents that follow from the commanded ones: delayed, held, and lagging."""
    T, f = of.machine.sampling_time, of.machine.speed / (2 * math.pi)
    late = np.exp(-2j * np.pi * f * ((of.machine.delay or 0.0) + T / 2)) * np.sinc(f * T)
    lags = [1 + 1j * f / b.amplifier.bandwidth if b.amplifier.bandwidth else 1 for b in of.isolated]
    return late * demanded / np.array(lags)


def _forced(of: LoopBuilder, loop: Loop, amplitude: float) -> Orbit:
    """Return the orbit of one axis under a synchronous load."""
    f = np.array([of.machine.speed / (2 * math.pi)])
    demanded = of.isolated[0].amplifier.gain * loop.control_by_load(f)[0, :, 0]
    x = np.array([amplitude + 0j])
    demanded = demanded / loop.compliance(f)[0, :, 0] * x
    return Orbit(_flowing(of, demanded), x, demanded)


def _unbalanced(of: LoopBuilder, loop: Loop, scale: float) -> Orbit:
    """Return the orbit due to a machine's unbalance, with the magnets' nonlinear force."""
    machine = of.machine
    f = np.array([machine.speed / (2 * math.pi)])
    gains = np.array([b.amplifier.gain for b in of.isolated])
    response = of_unbalance(loop, machine, of.point)
    beyond = _beyond(of)
    x = scale * response.x + loop.compliance(f)[0] @ beyond
    demanded = scale * response.i + gains * (loop.control_by_load(f)[0] @ beyond)
    return Orbit(_flowing(of, demanded), x, demanded)


def _beyond(of: LoopBuilder) -> Complex:
    """Return the synchronous force beyond that of the mean stiffnesses (p,) [N]."""
    result = np.zeros(len(of.isolated), complex)
    if of.point.orbit is None:
        return result
    swings = zip(of.point.orbit.iu, of.point.orbit.x, strict=True)
    for k, (b, (iu, x), (i, far)) in enumerate(
        zip(of.isolated, of.point.along_orbit(), swings, strict=True)
    ):
        law, turn = magnet_of(b), np.exp(-2j * np.pi * np.arange(len(iu)) / len(iu))
        k_i, k_s = (float(np.mean(item)) for item in law.tangent(iu, x))
        result[k] = 2 * np.mean(law.force(iu, x) * turn) - k_i * i - k_s * far
    return result


def _carried(of: LoopBuilder, rest: OperatingPoint, swing: Orbit) -> Any:
    """Return the mean currents for which the mean force is that in equilibrium."""
    point = OperatingPoint(of.point.iu, rest.x, swing)
    results = []
    rests = zip(np.atleast_1d(rest.iu), np.atleast_1d(rest.x), strict=True)
    for b, (iu, x), (iu0, x0) in zip(of.isolated, point.along_orbit(), rests, strict=True):
        law = magnet_of(b)
        static_force = float(law.force(float(iu0), float(x0)))
        k_i = float(np.mean(law.tangent(iu, x)[0]))
        results.append(float(np.mean(iu)) - (float(np.mean(law.force(iu, x))) - static_force) / k_i)
    return np.array(results)


def _within(machine: Any, of: LoopBuilder, result: Orbit) -> None:
    for b, x0, x in zip(
        of.isolated, np.atleast_1d(of.point.x), np.atleast_1d(result.x), strict=True
    ):
        if abs(x0) + abs(x) > HELD * b.magnet.air_gap:
            raise AmbkitError(
                f"{machine.name}: the orbit goes {engineering(abs(x), 'm', 3)} far along {b.name}, "
                f"where the air gap is {engineering(b.magnet.air_gap, 'm')}"
            )


MEASUREMENT = "measurement"  #: Name of the loop with the measurement as feedback.


@one_thread()
def assess(
    loop: LoopArguments,
    *,
    lqg: bool = False,
    hinf: bool = False,
    orbit: QuantityLike | bool = False,
) -> Assessment:
    """Assess a loop as in ISO 14839-3: opened at the measurement, including the filter."""
    of = LoopBuilder(loop.machine, loop.controller, loop.position, loop.disturbance)
    amplitude = None if isinstance(orbit, bool) else in_si("orbit", orbit, "m")

    def fed_by(name: str, estimator: Estimator | None) -> AssessedLoop:
        there = of if orbit is False else on_orbit(of, estimator, amplitude)
        return assessed(name, there.loop(estimator), there)

    loops = {}
    if not of.control.needs_estimate:
        loops[MEASUREMENT] = fed_by(MEASUREMENT, None)
    elif not loop.filters:
        raise AmbkitError(
            f"{loop.machine.name}: these controllers are fed by an estimate: give a filter"
        )
    if lqg:
        loops[LQG] = assessed(LQG, of.lqg(), of)
    if hinf:
        loops[HINF] = assessed(HINF, of.hinf(), of)
    loops |= {name: fed_by(name, item) for name, item in loop.filters.items()}
    return Assessment(of, loop.filters, of.least(), loops)
