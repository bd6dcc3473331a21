"""Fault isolation beside an exported filter: ``core/include/ambkit/isolation.h``."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import c_literals, cost, filter_test_cases
from ambkit.export.c.c_literals import Constants, CPrecision, Crc, Name
from ambkit.export.c.exported import Export
from ambkit.export.c.filter_test_cases import TestCase
from ambkit.judge.isolation.isolation import FaultIsolation

FROM = 60  #: Sample at which faults of the self-test begin.
TEMPLATES = {"{}_faults.h": "faults.h", "{}_faults.c": "faults.c"}

_COUNTS = (
    "states", "forces", "sensors", "columns", "gradients", "forms", "tones", "window", "spare",
    "late",
)  # fmt: skip
_REALS = ("limit", "margin", "like", "fine", "alike")
_FAULT = ("column", "columns", "load", "group")
_TERM = ("column", "direction", "signal", "gradient", "weight")
_ARRAYS = ("A", "b", "H", "bias", "F_0", "unit", "K", "form", "h", "k_s", "gradient", "lag", "turn")


def context(export: Export) -> dict[str, Any]:
    """Return what the templates say of the faults."""
    isolation, name = FaultIsolation(export.filter), export.name
    of = isolation.constants
    faults, terms = [tuple(map(int, row)) for row in of["faults"]], of["terms"]
    arrays = {key: np.array(of[key], float) for key in _ARRAYS if of[key] is not None}
    fields = {key: of[key] for key in _COUNTS} | {key: of[key] for key in _REALS}
    fields["spare"] = isolation.window  # a search may take as long as a window
    fields |= {"faults": len(faults), "terms": len(terms)}
    fields |= {key: Name(f"isolation_{key}" if key in arrays else "NULL") for key in _ARRAYS}
    fields |= {"fault": Name("faults_of"), "term": Name("terms_of")}
    row, work = isolation.core.room
    scheduled = export.of_model.turning is not None
    speed = c_literals.number(of["speed"], export.precision) if scheduled else ""
    controlled = export.one is not None
    return {
        "faults": [
            {"name": s.name, "macro": re.sub(r"\W", "_", s.name).upper(), "about": s.about,
             "unit": s.unit}
            for s in isolation.signatures
        ],
        "window": isolation.window,
        "spare": isolation.window,
        "kf": "&filter->kf" if speed else f"&{name}_kalman",
        "faster": f"(filter->speed - {speed}) * {name}_kalman.set.T" if speed else "AMB_C(0.0)",
        "ring": 2 * isolation.window * row,
        "work": work,
        "bytes": (2 * isolation.window * row + work) * (4 if export.precision == "float" else 8),
        "cost": cost.stored(cost.STORED).get("faults") if export.filter.engine.built_in else None,
        "limits": export.distinction.table if export.distinction else None,
        "of": "control" if controlled else "filter",
        "filter": "&control" if controlled else "&control.filter" if export.beside else "&filter",
        "now": "&out" if controlled else "&now.estimates" if export.beside else "&now",
        "state_type": f"{name}_state",
        "output_type": f"{name}_{'output' if controlled else 'estimates'}",
        "arrays": [
            *c_literals.declared(
                {f"isolation_{key}": values for key, values in arrays.items()}, export.precision
            ),
            _rows("amb_fault", "faults_of", faults, export.precision),
            _rows("amb_fault_term", "terms_of", terms, export.precision),
        ],
        "crc": _crc(export, arrays, faults, terms, of),
        "struct": c_literals.struct(fields, export.precision),
    }  # fmt: skip


def _crc(
    export: Export, arrays: dict[str, Any], faults: Sequence[Any], terms: Sequence[Any],
    of: dict[str, Any],
) -> Crc:  # fmt: skip
    """Return the CRC of the constants."""
    crc = Constants(export.precision)
    for key, values in arrays.items():
        crc.array(f"isolation_{key}", values)
    for name, rows, keys in (("faults_of", faults, _FAULT), ("terms_of", terms, _TERM)):
        crc.structs(name, rows, keys)
    counts = {key: of[key] for key in (*_COUNTS, *_REALS)} | {"spare": of["window"]}
    crc.fields("isolation", counts, arrays=False)
    return crc.crc()


def _rows(kind: str, name: str, rows: Sequence[Any], precision: CPrecision) -> dict[str, Any]:
    """Return an array of structs whose integers are unsigned."""

    def text(value: Any) -> str:
        return c_literals.number(value, precision) if type(value) is float else f"{int(value)}U"

    items = [f"    {{{', '.join(map(text, row))}}},\n" for row in rows]
    return {"type": kind, "name": name, "length": len(rows), "text": "".join(items)}


def test_case(filter: Estimator) -> TestCase:
    """The zero of a sensor moves, and controls act by a half."""
    case = filter_test_cases.quiet(filter)
    y, u = case.y.reshape(len(case.y), -1), case.u.reshape(len(case.u), -1)
    y[FROM:, 0] += 0.1 * (filter.view.gains * filter.view.travel_seen)[0]
    u[FROM:, 0] *= 2
    return case._replace(name="two faults")


def of_controller(export: Export) -> dict[str, Any]:
    """Return a run with faults for the self-test of an axis's controller, and its search."""
    case, filter = test_case(export.filter), export.filter
    y, u = (np.asarray(of, np.dtype(filter.precision)) for of in (case.y, case.u))
    numbers = {"y": y.ravel(), "u": u.ravel(), "mean": np.asarray(filter.initial_state(y))}
    arrays = {key: c_literals.array(of, export.precision) for key, of in numbers.items()}
    return tested(export, [(y, u)]) | arrays | {"samples": len(y)}


def tested(export: Export, runs: Sequence[tuple[Array, Array]]) -> dict[str, Any]:
    """Return the results of a search at the end of each run of the self-test."""
    filter, isolation = export.filter, FaultIsolation(export.filter)
    number = np.dtype(filter.precision).type
    searches = []
    for run in runs:
        y, u = (np.asarray(values, number) for values in run)
        filter.reset(filter.initial_state(y))
        searches.append(isolation.core.run(filter.core, y, u, len(y)))
    columns = [
        [of["likelihood"].T, of["size"][0], of["variance"][0], of["since"].T, of["instead"].T]
        for of in searches
    ]
    results = np.array([np.hstack(of) for of in columns])
    assert np.isfinite(results).all()
    return {
        "ends": len(searches),
        "results": c_literals.rows(results.reshape(len(searches), -1), export.precision),
    }
