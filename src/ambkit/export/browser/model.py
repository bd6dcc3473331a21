"""The model of the page's filters, as a sequence of numbers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from ambkit.estimate.core_model import NUMBERS, arrays, numbers
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.rebuild import Rebuild
from ambkit.estimate.registry import KINDS
from ambkit.machine.machine import Machine
from ambkit.models.machine_parts import PAPER_CONSTANTS

MOST_PAST = 3  #: Maximum dead time in samples of an axis's filters in the page.


def model_numbers(kf: Estimator, rebuild: Rebuild) -> list[float]:
    """Return pattern, plan and states of a filter's model in the order of ``web/core/model.c``."""
    of, pattern, settings = rebuild.fields, arrays(kf.model), kf._settings
    sparse = [pattern[name] for name in ("L", "b", "B_u", "h", "d", "c", "N", "rest")]
    counts = ("states", "forces", "controls", "sensors", "noises")
    lists = [[len(of[name]), *of[name]] for name in ("constant", "operation")]
    terms = (of[name] for name in ("row", "column", "use", "value", "k_i", "intensity"))
    _, *states = kf.view.sized(kf.states)
    loads = len(kf.machine.axes)
    return [
        *(pattern[name] for name in counts),
        *(item for start, column, _ in sparse for item in (*start, *column)), *pattern["role"],
        len(rebuild.names), *of["low"], *of["high"], *lists[0], *lists[1], *of["left"],
        *of["right"], len(of["row"]), *(item for part in terms for item in part),
        len(of["from"]), *of["from"],
        len(of["late"]), *(item for k, past, q in of["late"] for item in (k, len(past), *past, q)),
        *(item for part in states for item in part), loads, *settings["var_d"][loads:],
        settings["gate"], settings["frozen_limit"], settings["outlier_limit"],
        *_named(kf),
    ]  # fmt: skip


def _named(kf: Estimator) -> list[int]:
    """Return the number of values, and the index of each in the paper's axis, from 1."""
    if not kf.engine.built_in:
        return [0]
    places: dict[str, Any] = {name: np.zeros_like(getattr(kf.model, name)) for name in NUMBERS}
    for k, (matrix, *at) in enumerate(PAPER_CONSTANTS, 1):
        name = matrix.rstrip("0")
        places[name][(0, *at) if name == "N" else tuple(at)] = k
    described: Any = SimpleNamespace(**vars(kf.model) | places)
    of_numbers = numbers(described).astype(int).tolist()
    return [len(of_numbers), *of_numbers]


def axis_models() -> list[list[float]]:
    """Return the models of an axis by samples of dead time, each without and with a bandwidth."""
    paper = Machine.preset("zittau_axial")
    results = []
    for past in range(MOST_PAST + 1):
        for bandwidth in (None, 1e3):
            machine = paper.replace(
                delay=past * paper.sampling_time or None, amplifier__bandwidth=bandwidth
            )
            rebuild = Rebuild.of(machine, timed=True)
            any_value = {"low": [0.0] * len(rebuild.names), "high": [1e300] * len(rebuild.names)}
            rebuild = rebuild._replace(fields=rebuild.fields | any_value)
            results.append(model_numbers(KINDS["extended"].make(machine), rebuild))
    return results
