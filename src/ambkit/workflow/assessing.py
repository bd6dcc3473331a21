"""The verdict on a loop: sensitivity, margins and noise, with a filter in it and without."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ambkit.base.asked import Given, in_si, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import PID, Control
from ambkit.workflow.assessed_loop import AssessedLoop, assessed
from ambkit.workflow.assessment import HINF, LQG, Assessment
from ambkit.workflow.given import given_estimators, given_load
from ambkit.workflow.orbiting import on_orbit

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator

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
    controller: PID | Control | None = None,
    *,
    x: Given = 0.0,
    load: Given | Mapping[str, Given] = 0.0,
    lqg: bool = False,
    hinf: bool = False,
    orbit: Given | bool = False,
) -> Assessment:
    """Assess a loop as ISO 14839-3 looks at it: broken at the measurement, filter and all.

    The loop is linearised at its work point, sampled as it is: dead time, amplifier, sensor,
    controller and the estimator with the gain that it settles to there, fed with the control signal
    that goes out. Beside it stands the same controller on the measurement. Limits of current and
    voltage, rounding of the sensor and sensor noise with a memory are not in it.

    Each axis is looked at with all others closed, at its summing point, where its controller takes
    its position; of several the worst axis decides, and the largest singular value stands beside.
    It is at the machine's speed; `ambkit.assess_over_speed` looks at others.

    Parameters
    ----------
    bearing : Bearing or Machine
        The plant.
    filter : Estimator, str, path, sequence of them, or mapping of str to Estimator, optional
        In the loop: an estimator, the name of a kind, or a file of ``ambkit tune``; several are
        assessed one beside the other. None: the measurement alone.
    controller : PID or Control, optional
        Settings that it omits are tuned to each axis. Whether it is fed by measurement or estimate
        is left to the loop. What only an estimate can feed has no loop with the measurement.
    x : float or str, optional
        Displacement along the axes at which the rotor is held [m].
    load : float, str or mapping, optional
        Constant disturbance force there [N], on the first axis; or by the names of the axes.
    lqg : bool, optional
        Whether the loop of the linear-quadratic-Gaussian controller that needs least control stands
        beside, as ``"LQG"``.
    hinf : bool, optional
        Whether the loop of H-infinity controllers stands beside, as ``"H-infinity"``: of a machine
        one for each axis alone, judged in the whole loop. It needs python-control with slycot.
    orbit : float, str or bool, optional
        Whether each loop is linearised along the orbit that its unbalance makes at the machine's
        speed, with the mean stiffnesses of a turn; or the orbit's greatest half axis [m], for which
        the unbalance is scaled, and which a bearing of one axis needs.

    Returns
    -------
    Assessment
        With tables (`to_dict`) and a picture (`figure`).

    Raises
    ------
    AmbkitError
        There is no such estimator, it has another sampling time, or it does not settle to a gain;
        nothing holds the rotor at the work point; slycot is not installed.
    TypeError
        `bearing` is neither.

    References
    ----------
    ISO 14839-3, Mechanical vibration: Vibration of rotating machinery equipped with active magnetic
    bearings, Part 3: Evaluation of stability margin.
    """
    of_type(Machine, bearing=bearing)
    of = LoopOf(bearing, controller, in_si("x", x, "m"), given_load(bearing, load))
    estimators = given_estimators(filter, bearing)
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
    loops |= {name: fed_by(name, each) for name, each in estimators.items()}
    return Assessment(of, estimators, of.least(), loops)
