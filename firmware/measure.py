"""Measure what each kind of exported filter costs, for ``ambkit export c --cost``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ambkit import Bearing, ClosedLaw, Record, stiffness_map
from ambkit.export.c import export_c
from ambkit.export.c.data import arrays_of
from ambkit.export.tabulate import tabulate
from ambkit.fuzzy import Expert
from ambkit.magnets import ConstantStiffness, StiffnessSource, core_module
from ambkit.scenario import PID, Scenario
from ambkit.simulation import simulate
from ambkit.waveforms import Step
from firmware import harness

BEARING = Bearing.preset("zittau_axial")
SAMPLES = 2000
REAL = 4  # bytes
FEW = 9  # rules of the smaller expert; what a rule costs is the difference to 25


def record(samples: int = SAMPLES) -> Record:
    """Return a step, with samples lost and frozen in it, and a saturated current."""
    T = BEARING.sampling_time
    reference = Step(amplitude=BEARING.rotor.travel_limit / 4, time=0.1 * samples * T)
    run = simulate(
        BEARING,
        Scenario(
            duration=(samples - 1) * T, reference=reference, controller=PID.for_bearing(BEARING)
        ),
    )
    y, u = run["y"].copy(), run["u"].copy()
    at = samples // 2
    y[at : at + 3] = 1e3 * BEARING.rotor.travel_limit
    y[at + 20 : at + 40] = y[at + 20]
    u[at + 60] = 3 * BEARING.current_max / BEARING.amplifier.gain
    return Record(run.t, {"y": y, "u": u}, {"y": "m", "u": "V"})


def expert() -> Expert:
    """Return an expert of 25 rules."""
    return Expert.from_map(stiffness_map(BEARING))


def sources() -> dict[str, StiffnessSource]:
    """Return one source of stiffnesses for each magnet of the core, by its name there."""
    return {
        "Constant": ConstantStiffness.of(BEARING),
        "Law": ClosedLaw(BEARING),
        "Table": tabulate(expert(), BEARING, precision="float32"),
        "Fuzzy": expert(),
    }


def figures(source: StiffnessSource, folder: Path) -> dict[str, int]:
    """Build and run one filter; return what it costs."""
    export = export_c(BEARING, source, folder / "export", prefix="filter").folder
    firmware = harness.build(export, folder / "build")
    recorded = record()
    run = harness.run(firmware, recorded["y"], recorded["u"])
    size = harness.size(firmware)
    magnet = source.magnet(core_module("float32"))
    reals = sum(np.asarray(array).size for array in arrays_of(magnet.parameters).values())
    return {
        "instructions": int(np.median(run.instructions)),
        "most": int(run.instructions.max()),
        "trusted": int(np.median(run.trusted)),
        "code": size.code,
        "constants_without_arrays": size.constants - REAL * reals,
        "state": run.state,
        "stack": run.stack,
    }


def measure(folder: Path) -> dict[str, Any]:
    """Return all that ``cost.json`` holds; `folder` takes what is exported and built."""
    magnets: dict[str, dict[str, float]] = {
        name: dict(figures(source, folder / name)) for name, source in sources().items()
    }
    fuzzy, whole = magnets["Fuzzy"], expert()
    few = figures(whole.model_copy(update={"rules": whole.rules[:FEW]}), folder / "few")
    rule = (fuzzy["instructions"] - few["instructions"]) / (len(whole.rules) - FEW)
    fuzzy["instructions_a_rule"] = round(rule, 2)
    for name in ("instructions", "most", "trusted"):
        fuzzy[name] = round(fuzzy[name] - rule * len(whole.rules))
    return {"compiler": harness.compiler(), "magnets": magnets}
