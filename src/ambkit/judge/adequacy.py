"""Adequacy of a filter for a machine: one judgement for all commands and exports."""

from __future__ import annotations

import hashlib
import logging
import math
import pickle
from collections.abc import Sequence
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.estimate.estimator import Estimator
from ambkit.judge import adequacy_criteria as criteria
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.contact import stop_notes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.simulation.scenario import Scenario, control_of, feedback_of


def judge_adequacy(
    filter: Any,
    plant: Machine | None = None,
    scenario: Scenario | None = None,
    nis: float = math.nan,
) -> list[Finding]:
    """Judge whether a filter is adequate for a machine."""
    own = getattr(filter, "machine", None)
    plant = own if plant is None else plant
    results = list(criteria.innovations(nis))
    if isinstance(filter, Estimator) and plant is not None:
        results += _static(filter, plant, *_control_of(plant, scenario))
    if plant is not None:
        results += criteria.modes_kept(plant)
    if plant is not None and scenario is not None:
        results += criteria.demands(plant, scenario)
    return results


def sentences(results: Sequence[Finding]) -> list[str]:
    """Return all objections, fatal ones first."""
    wrong = sorted((entry for entry in results if entry.sentence), key=lambda item: not item.fatal)
    return list(dict.fromkeys(entry.sentence for entry in wrong))


def require_adequate(
    filter: Estimator,
    plant: Machine | None = None,
    scenario: Scenario | None = None,
    *,
    force: bool,
) -> list[str]:
    """Reject the export of an inadequate filter; with `force` return why. The rest are notes."""
    result = judge_adequacy(filter, plant, scenario)
    fatal = sentences([item for item in result if item.fatal])
    if fatal and not force:
        raise AmbkitError(
            f"not exported, the filter is inadequate: {'; '.join(fatal)}. "
            "--force (in Python force=True) exports it"
        )
    for text in (*sentences(result), *stop_notes(filter.machine, filter.name)):
        logging.getLogger("ambkit").warning(text)
    return fatal


_JUDGED: dict[bytes, list[Finding]] = {}
_MOST_JUDGED = 1000


def _static(
    filter: Estimator, plant: Machine, control: Any, own_control: bool, fed_back: bool
) -> list[Finding]:
    """Return the findings that follow from filter and machine alone, cached."""
    key = _key(filter, plant, control, own_control, fed_back)
    if key not in _JUDGED:
        if len(_JUDGED) >= _MOST_JUDGED:
            _JUDGED.clear()
        results = [*criteria.identity(filter, plant), *criteria.of_machine(plant)]
        if not any(item.name == "axes" for item in results):
            results += [*criteria.noise(filter, plant), *criteria.settings(filter, plant)]
            with one_thread():
                results += criteria.of_filter(filter, plant, control, own_control, fed_back)
        _JUDGED[key] = results
    return _JUDGED[key]


def _key(filter: Estimator, plant: Any, control: Any, own_control: bool, fed_back: bool) -> bytes:
    held = filter.magnet.in_core(core_module())
    values = held if isinstance(held, list) else [held]
    parts = (
        type(filter).__name__, filter.name, str(dict(filter.options)),
        str(dict(getattr(filter, "inner", filter).options)), filter.variances,
        filter.machine.model_dump_json(), plant.model_dump_json(), own_control, fed_back,
        None if control is None else control.model_dump_json(),
        [pickle.dumps(getattr(one, "parameters", id(one))) for one in values],
    )  # fmt: skip
    return hashlib.sha256(pickle.dumps(parts)).digest()


def _control_of(plant: Any, scenario: Scenario | None) -> tuple[Any, bool, bool]:
    """Return the controller, whether the caller stated it, and whether the estimate feeds it."""
    if scenario is None:
        return None, False, True
    own_control = bool(scenario.controller.model_fields_set - {"feedback"})
    return control_of(plant, scenario), own_control, feedback_of(scenario) == "estimate"
