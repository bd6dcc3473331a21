"""The verdict on a loop: sensitivity, margins and noise, with a filter in it and without."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from ambkit.assessment.arguments import disturbance_argument, filter_arguments
from ambkit.assessment.assessment import HINF, LQG, Assessment
from ambkit.assessment.loop import AssessedLoop, assessed
from ambkit.assessment.orbit import on_orbit
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import Given, in_si, of_type
from ambkit.base.threads import one_thread
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.machine.machine import Machine

MEASUREMENT = "measurement"
"""What the loop is called whose controller is fed by the measurement."""


@one_thread()
def assess(
    bearing: Machine,
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
    hinf: bool = False,
    orbit: Given | bool = False,
) -> Assessment:
    """Assess a loop as ISO 14839-3 looks at it: broken at the measurement, filter and all."""
    of_type(Machine, bearing=bearing)
    of = LoopOf(bearing, controller, in_si("x", x, "m"), disturbance_argument(bearing, load))
    estimators = filter_arguments(filter, bearing)
    amplitude = None if isinstance(orbit, bool) else in_si("orbit", orbit, "m")

    def fed_by(name: str, estimator: Estimator | None) -> AssessedLoop:
        there = of if orbit is False else on_orbit(of, estimator, amplitude)
        return assessed(name, there.loop(estimator), there)

    loops = {}
    if not of.needs_estimate:
        loops[MEASUREMENT] = fed_by(MEASUREMENT, None)
    elif not estimators:
        raise AmbkitError(
            f"{bearing.name}: these controllers are fed by an estimate: give a filter"
        )
    if lqg:
        loops[LQG] = assessed(LQG, of.lqg(), of)
    if hinf:
        loops[HINF] = assessed(HINF, of.hinf(), of)
    loops |= {name: fed_by(name, item) for name, item in estimators.items()}
    return Assessment(of, estimators, of.least(), loops)
