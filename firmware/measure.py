"""Measure what each kind of exported filter costs, for ``ambkit export cost``."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ambkit import Machine, Record, stiffness_map
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS
from ambkit.export.c import cost, export_c
from ambkit.export.stiffness_table import tabulate
from ambkit.fuzzy.expert import Expert
from ambkit.machine.magnets import MagnetModel
from ambkit.simulation.run import simulate
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Step
from ambkit.workflow.diagnose import distinguished
from firmware import harness, path

BEARING = Machine.preset("zittau_axial")
SAMPLES = 2000
FEW = 9  # rules of the smaller expert; what a rule costs is the difference to 25


@cache
def record(samples: int = SAMPLES) -> Record:
    """Return a step, with samples lost and frozen in it, and a saturated current."""
    T = BEARING.sampling_time
    reference = Step(amplitude=BEARING.clearance / 4, time=0.1 * samples * T)
    run = simulate(
        BEARING,
        Scenario(
            duration=(samples - 1) * T, reference=reference, controller=PID.for_bearing(BEARING)
        ),
    )
    y, u = run["y"].copy(), run["u"].copy()
    at = samples // 2
    y[at : at + 3] = 1e3 * BEARING.clearance
    y[at + 20 : at + 40] = y[at + 20]
    u[at + 60] = 3 * BEARING.current_max / BEARING.amplifier.gain
    return Record(run.t, {"y": y, "u": u}, {"y": "m", "u": "V"})


@cache
def expert() -> Expert:
    """Return an expert of 25 rules."""
    return Expert.from_map(stiffness_map(BEARING))


class Case(NamedTuple):
    """One filter: in Python, as exported and compiled, and what the processor gave."""

    estimator: Estimator
    export: Path
    firmware: harness.Firmware
    there: harness.Run


UNMEASURED = "constant-velocity"
"""Its step is that of any model, which costs what its states cost."""


@cache
def magnets() -> dict[str, MagnetModel | None]:
    """Return what each kind is given of its magnet, by its name; None: what it takes itself."""
    given = {"table": tabulate(expert(), BEARING, precision="float32"), "adaptive": expert()}
    return {name: given.get(name) for name in KINDS if name != UNMEASURED}


def bearing_of(kind: str) -> Machine:
    """Return what a kind is measured on; its rotor may lie on a stop where the filter knows one."""
    stop = {"stiffness": 1e8, "damping": 0.3}
    return BEARING.replace(stop=stop) if kind == "contact" else BEARING


def case(
    kind: str, magnet: MagnetModel | None, folder: Path, bearing: Machine | None = None
) -> Case:
    """Export, build and run one filter; `folder` takes what is made."""
    bearing = bearing or bearing_of(kind)
    estimator = KINDS[kind].make(bearing, magnet, precision="float32")
    export = export_c(bearing, estimator, folder / "export", prefix="filter").folder
    firmware = harness.build(export, folder / "build")
    recorded = record()
    there = harness.run(firmware, recorded["y"], recorded["u"])
    return Case(estimator, export, firmware, there)


def faults(folder: Path) -> dict[str, int]:
    """Return what fault isolation beside the extended filter takes; `folder` takes what is made."""
    estimator = KINDS["extended"].make(BEARING, precision="float32")
    distinction = distinguished(BEARING, estimator)
    made = export_c(BEARING, estimator, folder / "export", prefix="filter", distinction=distinction)
    firmware = harness.build(made.folder, folder / "build", main=harness.HERE / "faults.c")
    T, n = BEARING.sampling_time, 2400
    run = simulate(BEARING, Scenario(duration=(n - 1) * T))
    samples = np.column_stack([run["y"], np.append(0.0, run["u"][:-1])]).astype("<f4")
    samples[-300:, 0] += 0.1 * BEARING.clearance
    samples.tofile(folder / "input.bin")
    harness.emulated(firmware.elf, folder)
    counted = np.fromfile(folder / "instructions.bin", "<u4").tolist()
    return dict(zip(("sample", "search", "alarm"), counted, strict=True))


def figures(measured: Case) -> dict[str, Any]:
    """Return what a filter costs."""
    run, size = measured.there, harness.size(measured.firmware)
    return {
        "instructions": int(np.median(run.instructions)),
        "most": int(run.instructions.max()),
        "bound": bound(measured.firmware),
        "trusted": int(np.median(run.trusted)) if run.trusted.any() else None,
        "code": size.code,
        "constants_without_arrays": size.constants - cost.bytes_of_arrays(measured.estimator),
        "state": run.state,
        "stack": run.stack,
        "selftest": run.selftest,
    }


def bound(firmware: harness.Firmware) -> int:
    """Return how many instructions a step takes at most, along any path."""
    found = path.bound(firmware.elf, "filter_step", objects=0b11)  # state and estimates
    if found.instructions is None:
        raise RuntimeError(f"no bound: {found.why}")
    return found.instructions


def measure(folder: Path) -> dict[str, Any]:
    """Return all that ``cost.json`` holds; `folder` takes what is exported and built."""
    found: dict[str, dict[str, Any]] = {}
    for kind, magnet in magnets().items():
        measured = case(kind, magnet, folder / kind)
        found[cost.made_of(measured.estimator)] = figures(measured)
    fuzzy, whole = found["Kalman, Fuzzy"], expert()
    few = figures(case("adaptive", fewer_rules(FEW), folder / "few"))
    rule = (fuzzy["instructions"] - few["instructions"]) / (len(whole.rules) - FEW)
    fuzzy["instructions_a_rule"] = round(rule, 2)
    for name in ("instructions", "most", "trusted"):
        fuzzy[name] = round(fuzzy[name] - rule * len(whole.rules))
    rule = (fuzzy["bound"] - few["bound"]) / (len(whole.rules) - FEW)
    fuzzy["bound_a_rule"] = round(rule, 2)
    fuzzy["bound"] = round(fuzzy["bound"] - rule * len(whole.rules))
    return {
        "compiler": harness.compiler(),
        "estimators": found,
        "faults": faults(folder / "faults"),
    }


def fewer_rules(count: int) -> Expert:
    """Return the expert with its first rules only."""
    whole = expert()
    return whole.model_copy(update={"rules": whole.rules[:count]})
