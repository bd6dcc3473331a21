"""Checks of a study: unknown keys, impossible values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ambkit.base.config import Read
from ambkit.base.config.document import Document
from ambkit.base.errors import AmbkitError
from ambkit.campaigns.distributions import Choice, InvalidValue, Varied
from ambkit.campaigns.keys import OF_RUN, Key, by_places, key_in
from ambkit.control.controllers import TYPES
from ambkit.machine.loading import load_machine

Problem = tuple[str, str]

MOST_DIMENSIONS = 1000  #: Maximum number of varied quantities.

CONTROLLERS = ("tuned", "textbook", *TYPES)
"""Controllers of every machine, but for those of tilt, which a mass has not."""

NOT_VARIED = {
    "sampling_time": "belongs to the controller, and is not a tolerance",
    "name": "is a name",
    "description": "is a text",
    "source": "is a text",
    "type": "defines the machine, and is not a tolerance",
    "file": "defines the machine, and is not a tolerance",
}
"""Keys of a machine that cannot vary, with reasons."""

NOT_VARIED_OF_RUN = {
    "seed": "is the study's seed",
    "run": "is the run's own number",
    "duration": "is one for all runs",
}
"""Keys of a run that cannot vary, with reasons."""


def contradictions(read: Read) -> Iterator[Problem]:
    """Yield (key, problem) of a study."""
    plant = None
    try:
        if isinstance(read("machine"), str):
            plant = load_machine(read("machine"))
    except AmbkitError as error:
        yield "machine", str(error)
    if isinstance(read("estimator"), str):
        yield from _estimator("estimator", read("estimator"))
    yield from _how_many(read)
    yield from _recorded(read, plant)
    vary = read("vary")
    if plant is None or not isinstance(vary, tuple):
        return
    run = read("scenario")
    if not isinstance(run, Document):  # reported by itself
        return
    seen = dict[str, int]()
    for at, item in enumerate(vary):
        here = f"vary.{at}"
        try:
            key_there = key_of(item, plant, run, read("estimator"))
            item.marginal(key_there)
        except InvalidValue as error:
            yield f"{here}.{error.key}", str(error)
            continue
        except AmbkitError as error:
            yield f"{here}.what", str(error)
            continue
        quantity = item.what
        if quantity not in ("estimator", "controller"):
            of_run = quantity.startswith(OF_RUN)
            quantity = by_places(run if of_run else plant, quantity.removeprefix(OF_RUN))
        if quantity in seen:
            yield f"{here}.what", f"{item.what} varies already, in vary[{seen[quantity]}]"
        seen.setdefault(quantity, at)
        yield from _grid(here, item, read("sampling"))
        yield from _sensor_gain(here, item, run)
        yield from _choices(here, item, key_there, plant, run, read)
    yield from _correlated(read, [entry.what for entry in vary])


def key_of(varied: Varied, plant: Any, run: Any, estimator: Any) -> Key:
    """Return the value at the key of a varied quantity."""
    what = varied.what
    if what in ("estimator", "controller"):
        if not isinstance(varied, Choice):
            raise AmbkitError(f'{what} is no number: let it vary by type = "choice"')
        return Key(estimator if what == "estimator" else "tuned", "")
    name = what.removeprefix(OF_RUN)
    of_run = name != what
    why = NOT_VARIED_OF_RUN.get(name) if of_run else NOT_VARIED.get(name.rpartition(".")[2])
    if why:
        raise AmbkitError(f"{what} cannot vary: it {why}")
    return key_in(completed(run, plant) if of_run else plant, name)


def completed(run: Any, plant: Any) -> Any:
    """Return a scenario with complete controller gains, tuned to the nominal machine."""
    from ambkit.simulation.scenario import Scenario, settled_scenario

    if not plant.single:
        return run
    if not isinstance(run, Scenario):
        return Scenario()
    return settled_scenario(plant, run)


def _estimator(key: str, name: str) -> Iterator[Problem]:
    from ambkit.estimate.registry import check_named

    if name == "none":
        return
    try:
        if name == "all":
            raise AmbkitError("a loop has one estimator; let it vary to compare several")
        check_named(name)
    except AmbkitError as error:
        yield key, str(error)


def _how_many(read: Read) -> Iterator[Problem]:
    sampling, runs = read("sampling"), read("runs")
    if sampling == "grid" and isinstance(runs, int):
        yield "runs", "a grid has as many runs as points; leave it out, or set repeats"
    if sampling != "grid" and runs is None:
        yield "runs", "missing: how many machines"
    if sampling != "grid" and read("repeats") != 1:
        yield "repeats", 'is for sampling = "grid"'
    if sampling in ("grid", "saltelli") and read("stop") is not None:
        yield "stop", f'does not go with sampling = "{sampling}", which is whole or nothing'
    if sampling in ("grid", "saltelli") and read("correlation"):
        yield (
            "correlation",
            f'does not go with sampling = "{sampling}": its columns are independent',
        )
    vary = read("vary")
    if not isinstance(vary, tuple):
        return
    if not vary and sampling in ("grid", "saltelli"):
        yield "vary", f'missing: sampling = "{sampling}" needs something that varies'
    if len(vary) > MOST_DIMENSIONS:
        yield "vary", f"must be at most {MOST_DIMENSIONS}, are {len(vary)}"
    if sampling == "saltelli" and isinstance(runs, int) and runs % (len(vary) + 2):
        size = len(vary) + 2
        yield (
            "runs",
            f"must be a multiple of {size} for Sobol indices of {len(vary)} quantities, is {runs}",
        )


def _recorded(read: Read, plant: Any) -> Iterator[Problem]:
    from ambkit.campaigns.study_tables import Criteria, Recorded, limit_of, traces_of
    from ambkit.simulation.scenario import Scenario

    record, passes = read("record"), read("passes")
    scenario, there = read("scenario"), traces_of(plant)
    if isinstance(record, Recorded):
        for at, name in enumerate(record.traces):
            if name not in there and not name.endswith("_estimate") and plant is not None:
                known = f"{', '.join(there)}, and states of the estimator as {there[0]}_estimate"
                yield f"record.traces.{at}", f"there is no signal {name}; known: {known}"
        if isinstance(scenario, Scenario) and record.settling >= scenario.duration:
            yield "record.settling", "must be less than the duration of a run"
    if isinstance(passes, Criteria):
        for name, limit in passes.at_most.items():
            try:
                limit_of(name, limit)
            except ValueError as error:
                yield f"passes.at_most.{name}", str(error)
        if isinstance(record, Recorded) and not record.margins:
            if passes.zone is not None:
                yield "passes.zone", "needs record.margins = true"
            if "peak_S" in passes.at_most:
                yield "passes.at_most.peak_S", "needs record.margins = true"
    if isinstance(scenario, Scenario):
        for name in ("seed", "run"):
            if name in scenario.model_fields_set and getattr(scenario, name):
                yield f"scenario.{name}", "the study has its own: leave it out"


def _grid(here: str, varied: Varied, sampling: Any) -> Iterator[Problem]:
    if sampling == "grid" and varied.levels is None and not isinstance(varied, Choice):
        yield f"{here}.levels", "missing: how many values a grid has of it"
    if sampling != "grid" and varied.levels is not None:
        yield f"{here}.levels", 'is for sampling = "grid"'
    if isinstance(varied, Choice) and varied.levels is not None:
        yield f"{here}.levels", "a choice has as many as values"


def _sensor_gain(here: str, varied: Varied, scenario: Any) -> Iterator[Problem]:
    """Reject a sensor gain error with measurement feedback: it moves the rotor elsewhere."""
    from ambkit.simulation.waveforms import Constant

    if varied.what != "sensor.gain" or getattr(scenario, "controller", None) is None:
        return
    reference = scenario.reference
    rests = isinstance(reference, Constant) and reference.value == 0
    if scenario.controller.feedback == "measurement" and not rests:
        yield f"{here}.what", "sensor.gain varies only about a reference of 0 without an estimate"


def _choices(
    here: str, varied: Varied, key: Key, plant: Any, run: Any, read: Read
) -> Iterator[Problem]:
    """Check the values of choices, each in its place."""
    if not isinstance(varied, Choice) or key.unit:
        return
    controllers = read("controllers")
    usual = [name for name in CONTROLLERS if plant.rotor.type != "mass" or "tilt" not in name]
    for at, value in enumerate(varied.values):
        there = f"{here}.values.{at}"
        if not isinstance(value, str):
            yield there, f"must be a text, is {value:g}"
        elif varied.what == "estimator":
            yield from _estimator(there, value)
        elif varied.what == "controller":
            known = [*usual, *(controllers if isinstance(controllers, dict) else ())]
            if value not in known:
                yield there, f'there is no controller "{value}"; known: {", ".join(known)}'
        else:
            of = run if varied.what.startswith(OF_RUN) else plant
            try:
                of.replace(**{varied.what.removeprefix(OF_RUN): value})
            except AmbkitError as error:
                yield there, str(error)


def _correlated(read: Read, known: list[str]) -> Iterator[Problem]:
    correlations = read("correlation")
    if not isinstance(correlations, tuple):
        return
    matrix, wrong = np.eye(len(known)), False
    vary = read("vary")
    for at, correlation in enumerate(correlations):
        for place, name in enumerate(correlation.between):
            if name not in known:
                wrong = True
                yield f"correlation.{at}.between.{place}", f"{name} does not vary"
            elif isinstance(vary[known.index(name)], Choice):
                wrong = True
                yield f"correlation.{at}.between.{place}", f"{name} is a choice, not a number"
        if correlation.between[0] == correlation.between[1]:
            wrong = True
            yield f"correlation.{at}.between", "must be two quantities"
        if not wrong:
            i, j = (known.index(name) for name in correlation.between)
            matrix[i, j] = matrix[j, i] = correlation.coefficient
    if correlations and not wrong and np.linalg.eigvalsh(matrix).min() <= 1e-12:
        yield "correlation", "these correlation coefficients contradict each other"
