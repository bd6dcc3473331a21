"""What happens in a run where nobody says it all: controller, length, step, load; and the run."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.asked import Given, in_si, of_type
from ambkit.base.errors import AmbkitError
from ambkit.estimate.base import Estimator
from ambkit.judge.comparison import EVALUATED, rmse
from ambkit.machine.bearing import Bearing
from ambkit.machine.forces.map_of import surface_in
from ambkit.machine.magnets import ConstantStiffness
from ambkit.simulation.run import simulate_run as looped
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Recorded, Step
from ambkit.workflow.estimators import factories

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.magnets import MagnetModel
    from ambkit.simulation.imposed import Imposed
    from ambkit.simulation.run import Run

STEP_AT, LOAD_AT = 0.1, 0.5
"""When the step of the reference and that of the load come, in lengths of the run."""

OWN_PERIODS = 40
"""Length of an experiment, in periods of the plant's own frequency, where it is not given."""


def scenario_for(
    bearing: Bearing,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    *,
    duration: Given | None = None,
    step: Given | None = None,
    load: Given | None = None,
    seed: int | None = None,
    reference: str | Path | None = None,
    injection: str | Path | None = None,
    from_estimate: bool = True,
) -> Scenario:
    """Return a scenario for a bearing, with its controller tuned, and a step or a load put in.

    Parameters
    ----------
    bearing : Bearing
        The controller is tuned to it, as far as `scenario` does not say otherwise.
    scenario : Scenario or path, optional
        What is said already.
    duration : float or str, optional
        Length of the run [s].
    step : float or str, optional
        Step of the reference [m], such as 5e-5 or ``"50 µm"``, after a tenth of the run.
    load : float or str, optional
        Load on the rotor [N], after half of the run.
    seed : int, optional
        Seed of the noise.
    reference : path, optional
        A record whose ``r`` is the reference; without `duration` the run is as long as it.
    injection : path, optional
        A record whose ``injected`` is added to the measurement, as `reference`.
    from_estimate : bool
        Whether the estimate is fed back, or the measurement, where `scenario` does not say it.

    Raises
    ------
    AmbkitError
        A file cannot be read; both a step and a record are given for the reference; one of
        the quantities is none.
    TypeError
        `bearing` is no bearing, or `scenario` no scenario.
    """
    of_type(Bearing, bearing=bearing)
    duration, step = in_si("duration", duration, "s"), in_si("step", step, "m")
    load = in_si("load", load, "N")
    happening = Scenario() if scenario is None else scenario
    if isinstance(happening, str | os.PathLike):
        happening = Scenario.load(happening)
    of_type(Scenario, scenario=happening)
    controller = happening.controller.completed(bearing)
    if not from_estimate and "feedback" not in happening.controller.model_fields_set:
        controller = controller.model_copy(update={"feedback": "measurement"})
    happening = happening.replace(controller=controller)
    if duration is not None:
        happening = happening.replace(duration=duration)
    if reference is not None:
        if step is not None:
            raise AmbkitError("the reference is either a step or a record's: give one of them")
        happening = _along(Path(reference), happening, duration, "reference", "r")
    if injection is not None:
        happening = _along(Path(injection), happening, duration, "injection", "injected")
    if step is not None:
        stepping = Step(amplitude=step, time=STEP_AT * happening.duration)
        happening = happening.replace(reference=stepping)
    if load is not None:
        disturbance = Step(amplitude=load, time=LOAD_AT * happening.duration)
        happening = happening.replace(disturbance=disturbance)
    return happening if seed is None else happening.replace(seed=seed)


def _along(
    path: Path, scenario: Scenario, duration: float | None, what: str, signal: str
) -> Scenario:
    """Return a scenario that takes reference or injection from a signal of a record."""
    from ambkit.data.record import Record

    if duration is None:
        t = Record.load(path).t
        scenario = scenario.replace(duration=float(t[-1]))
    return scenario.replace(**{what: Recorded(file=str(path), signal=signal)})


def simulate_run(
    bearing: Bearing,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    *,
    estimator: Estimator | str | None = None,
    magnet: MagnetModel | None = None,
    force_map: str | os.PathLike[str] | None = None,
    magnets: Mapping[str, MagnetModel] | None = None,
    imposed: Imposed | None = None,
    duration: Given | None = None,
    step: Given | None = None,
    load: Given | None = None,
    seed: int | None = None,
    reference: str | Path | None = None,
    injection: str | Path | None = None,
) -> Run:
    """Simulate plant, amplifier, sensor, controller and estimator in closed loop.

    What ``ambkit simulate`` does; :func:`ambkit.simulation.run.simulate_run` says how. A loop with
    an estimator in single precision is computed in single precision, plant and all.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    scenario : Scenario or path, optional
        What happens to it; the controller is tuned to the bearing, as far as it says nothing else.
    estimator : Estimator or str, optional
        In the loop, or beside it where the controller is fed by the measurement: an object, a kind,
        a filter's file, or ``"none"``. By default the linear filter where the controller needs one.
    magnet : MagnetModel, optional
        The plant's own magnet, where it is not what the bearing describes.
    force_map : path, optional
        The same as points of iu, x and f_mag.
    magnets : mapping of str to MagnetModel, optional
        What an estimator that is named knows of the magnet, such as
        ``{"adaptive": Expert.load("expert.json")}``.
    imposed : Imposed, optional
        Series of disturbance, noise and magnet from outside.
    duration, step, load, seed, reference, injection
        See :func:`ambkit.scenario_for`.

    Returns
    -------
    Run
        The record, with truth, and the estimate (None without an estimator).

    Raises
    ------
    AmbkitError
        A file cannot be read, there is no such estimator, or the controller is to be fed by an
        estimate and there is none; a magnet is given twice.
    ValueError
        A series has not one value a sample.

    Examples
    --------
    >>> from ambkit import Bearing, simulate_run
    >>> run = simulate_run(Bearing.preset("zittau_axial"), step="0.3 mm", estimator="closed-law")
    >>> run.estimate.estimator
    'adaptive Kalman filter'
    """
    if estimator is not None:
        of_type(Estimator, str, estimator=estimator)
    without = isinstance(estimator, str) and estimator == "none"
    happening = scenario_for(
        bearing, scenario, duration=duration, step=step, load=load, seed=seed, reference=reference,
        injection=injection, from_estimate=not without,
    )  # fmt: skip
    if without and happening.controller.feedback == "estimate":
        place = f"{os.fspath(scenario)}: " if isinstance(scenario, str | os.PathLike) else ""
        raise AmbkitError(
            f'{place}the controller is fed by the estimate (controller.feedback = "estimate"), so '
            "the estimator cannot be none"
        )
    made = estimator if not isinstance(estimator, str) else None
    if isinstance(estimator, str) and not without:
        built = factories([estimator], bearing, magnets)
        if len(built) > 1:
            raise AmbkitError("a loop has one estimator: name one of them, not all")
        made = built[estimator]()
    if force_map is not None:
        if magnet is not None:
            raise AmbkitError("the plant's magnet is either a model or a force map: give one")
        magnet = surface_in(force_map, bearing)
    return looped(bearing, happening, estimator=made, magnet=magnet, imposed=imposed)


def simulate(
    bearing: Bearing,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    *,
    estimator: Estimator | str | None = None,
    magnet: MagnetModel | None = None,
    force_map: str | os.PathLike[str] | None = None,
    magnets: Mapping[str, MagnetModel] | None = None,
    imposed: Imposed | None = None,
    duration: Given | None = None,
    step: Given | None = None,
    load: Given | None = None,
    seed: int | None = None,
    reference: str | Path | None = None,
    injection: str | Path | None = None,
) -> Record:
    """Simulate the closed loop, as ``ambkit simulate`` does, and return the record that it writes.

    Parameters
    ----------
    bearing, scenario, estimator, magnet, force_map, magnets, imposed
        See :func:`ambkit.simulate_run`, which also returns the estimate.
    duration, step, load, seed, reference, injection
        See :func:`ambkit.scenario_for`.

    Returns
    -------
    Record
        With truth.

    Raises
    ------
    AmbkitError, ValueError
        As :func:`ambkit.simulate_run`.

    Examples
    --------
    >>> from ambkit import Bearing, simulate
    >>> record = simulate(Bearing.preset("zittau_axial"), step="0.3 mm", load="3 N")
    >>> record.meta["stop_touched"]
    0
    """
    run = simulate_run(
        bearing, scenario, estimator=estimator, magnet=magnet, force_map=force_map, magnets=magnets,
        imposed=imposed, duration=duration, step=step, load=load, seed=seed, reference=reference,
        injection=injection,
    )  # fmt: skip
    return run.record


def experiment_duration(bearing: Bearing) -> float:
    """Return how long an experiment lasts where nobody says it [s]."""
    own = math.sqrt(ConstantStiffness.of(bearing).k_s / bearing.rotor.mass) / (2 * math.pi)
    return float(f"{OWN_PERIODS / own:.2g}")


@dataclass(frozen=True)
class RunSummary:
    """What a run came to."""

    bearing: Bearing  #: What was simulated.
    run: Run  #: Record, and estimate if there was an estimator.

    @property
    def samples_at_the_stop(self) -> int:
        """Samples in which the rotor touched a stop."""
        return int(self.run.record.meta["stop_touched"])

    @property
    def first_at_the_stop(self) -> float | None:
        """When a sample first found the rotor at a stop [s]; None where it left before its end."""
        record = self.run.record
        there = np.abs(record["x"]) >= self.bearing.rotor.travel_limit
        return float(record.t[int(np.argmax(there))]) if there.any() else None

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        record, estimate, b = self.run.record, self.run.estimate, self.bearing
        found: dict[str, Any] = {
            "bearing": b.name,
            "samples": len(record),
            "duration": record.t[-1],
            "seed": record.meta["seed"],
            "greatest_displacement": np.max(np.abs(record["x"])),
            "greatest_current": np.max(np.abs(record["iu"])),
            "samples_at_the_current_limit": int(
                np.sum((record["iu"] >= b.current_max) | (record["iu"] <= b.current_min))
            ),
            "samples_at_the_stop": record.meta["stop_touched"],
        }
        if estimate is not None:
            found["estimator"] = estimate.estimator
            found["rmse"] = {name: rmse(estimate, record, name) for name in EVALUATED}
            found["nis"] = np.mean(estimate.nis[1:])
        return found
