"""What is wrong with a study: keys that are not there, values that cannot be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ambkit.base.config import Read
from ambkit.base.errors import AmbkitError
from ambkit.workflow.campaign.keys import OF_RUN, Key, key_in
from ambkit.workflow.campaign.varied import Choice, Varied, Wrong

Problem = tuple[str, str]

MOST_DIMENSIONS = 1000
"""Quantities that vary."""

CHOSEN = ("tuned", "textbook")
"""Controllers that every bearing has."""

NOT_VARIED = {
    "sampling_time": "is the controller's, and no tolerance",
    "name": "is a name",
    "description": "is a text",
    "source": "is a text",
    "scenario.seed": "is the study's seed",
    "scenario.run": "is the run's own number",
    "scenario.duration": "is one for all runs",
    "magnet.type": "is what the controller is made for",
}
"""What cannot vary, and why."""


def contradictions(read: Read) -> Iterator[Problem]:
    """Yield (key, what is wrong) of a study."""
    try:
        bearing = bearing_of(read("bearing")) if isinstance(read("bearing"), str) else None
    except AmbkitError as error:
        yield "bearing", str(error)
        bearing = None
    if isinstance(read("estimator"), str):
        yield from _estimator("estimator", read("estimator"))
    yield from _how_many(read)
    yield from _recorded(read)
    vary = read("vary")
    if bearing is None or not isinstance(vary, tuple):
        return
    seen = dict[str, int]()
    for at, each in enumerate(vary):
        here = f"vary.{at}"
        if each.what in seen:
            yield f"{here}.what", f"{each.what} varies already, in vary[{seen[each.what]}]"
        seen[each.what] = at
        try:
            key = key_of(each, bearing, read("scenario"), read("estimator"))
            each.marginal(key)
        except Wrong as error:
            yield f"{here}.{error.key}", str(error)
            continue
        except AmbkitError as error:
            yield f"{here}.what", str(error)
            continue
        yield from _grid(here, each, read("sampling"))
        yield from _sensor_gain(here, each, read("scenario"))
        yield from _choices(here, each, key, bearing, read)
    yield from _correlated(read, list(seen))


def bearing_of(name: str) -> Any:
    """Return a preset, or the bearing in a file."""
    from ambkit.machine import presets
    from ambkit.machine.bearing import Bearing

    return Bearing.preset(name) if name in presets.names() else Bearing.load(name)


def key_of(varied: Varied, bearing: Any, scenario: Any, estimator: Any) -> Key:
    """Return what stands at the key of what varies.

    Raises
    ------
    AmbkitError
        There is no such key, or it cannot vary.
    """
    what = varied.what
    if what in ("estimator", "controller"):
        if not isinstance(varied, Choice):
            raise AmbkitError(f'{what} is no number: let it vary by type = "choice"')
        return Key(estimator if what == "estimator" else "tuned", "")
    if what in NOT_VARIED:
        raise AmbkitError(f"{what} cannot vary: it {NOT_VARIED[what]}")
    if what.startswith(OF_RUN):
        return key_in(completed(scenario, bearing), what.removeprefix(OF_RUN))
    return key_in(bearing, what)


def completed(scenario: Any, bearing: Any) -> Any:
    """Return a scenario whose controller has all its gains, tuned to the nominal bearing."""
    from ambkit.simulation.scenario import Scenario

    if not isinstance(scenario, Scenario):
        return Scenario()
    return scenario.model_copy(update={"controller": scenario.controller.completed(bearing)})


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


def _recorded(read: Read) -> Iterator[Problem]:
    from ambkit.simulation.scenario import Scenario
    from ambkit.workflow.campaign.parts import TRACES, Passes, Recorded, limit_of

    record, passes, scenario = read("record"), read("passes"), read("scenario")
    if isinstance(record, Recorded):
        for at, name in enumerate(record.traces):
            if name not in TRACES and not name.endswith("_estimate"):
                known = f"{', '.join(TRACES)}, and states of the estimator as x_estimate"
                yield f"record.traces.{at}", f"there is no signal {name}; known: {known}"
        if isinstance(scenario, Scenario) and record.settling >= scenario.duration:
            yield "record.settling", "must be less than the duration of a run"
    if isinstance(passes, Passes):
        for name, given in passes.at_most.items():
            try:
                limit_of(name, given)
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
    """A controller that is fed by the measurement takes the rotor elsewhere by a wrong gain."""
    from ambkit.simulation.waveforms import Constant

    if getattr(scenario, "controller", None) is None:
        return
    if varied.what == "amplifier.gain" and scenario.controller.type == "lqg":
        yield f"{here}.what", "amplifier.gain does not vary under a regulator of the states"
    if varied.what != "sensor.gain":
        return
    reference = scenario.reference
    rests = isinstance(reference, Constant) and reference.value == 0
    if scenario.controller.feedback == "measurement" and not rests:
        yield f"{here}.what", "sensor.gain varies only about a reference of 0 without an estimate"


def _choices(here: str, varied: Varied, key: Key, bearing: Any, read: Read) -> Iterator[Problem]:
    """Check words to choose from, each where it would stand."""
    if not isinstance(varied, Choice) or key.unit:
        return
    controllers = read("controllers")
    for at, value in enumerate(varied.values):
        there = f"{here}.values.{at}"
        if not isinstance(value, str):
            yield there, f"must be a text, is {value:g}"
        elif varied.what == "estimator":
            yield from _estimator(there, value)
        elif varied.what == "controller":
            known = [*CHOSEN, *(controllers if isinstance(controllers, dict) else ())]
            if value not in known:
                yield there, f'there is no controller "{value}"; known: {", ".join(known)}'
        else:
            of = read("scenario") if varied.what.startswith(OF_RUN) else bearing
            try:
                of.replace(**{varied.what.removeprefix(OF_RUN): value})
            except AmbkitError as error:
                yield there, str(error)


def _correlated(read: Read, known: list[str]) -> Iterator[Problem]:
    given = read("correlation")
    if not isinstance(given, tuple):
        return
    matrix, wrong = np.eye(len(known)), False
    vary = read("vary")
    for at, each in enumerate(given):
        for place, name in enumerate(each.between):
            if name not in known:
                wrong = True
                yield f"correlation.{at}.between.{place}", f"{name} does not vary"
            elif isinstance(vary[known.index(name)], Choice):
                wrong = True
                yield f"correlation.{at}.between.{place}", f"{name} is a choice, not a number"
        if each.between[0] == each.between[1]:
            wrong = True
            yield f"correlation.{at}.between", "must be two quantities"
        if not wrong:
            i, j = (known.index(name) for name in each.between)
            matrix[i, j] = matrix[j, i] = each.coefficient
    if given and not wrong and np.linalg.eigvalsh(matrix).min() <= 1e-12:
        yield "correlation", "these coefficients contradict each other: no quantities vary so"
