"""Compute what docs/explanation/comparison.md shows: python docs/make_comparison.py, some minutes.

Writes docs/images/compare_*.png, and prints the figures that the page states. The pictures are
committed, so that the pages are built without it.
"""

import json

from make_images import FOLDER, small

import ambkit
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison import figures as figures
from ambkit.judge.comparison.cases import CASES
from ambkit.judge.comparison.study import across, study

RUNS, BUDGET = 32, 32

if __name__ == "__main__":
    machine = ambkit.preset("zittau_axial")
    benches = across(machine, CASES, list(KINDS), runs=RUNS, budget=BUDGET)
    found = study(machine, "paper", list(KINDS), runs=RUNS, budget=BUDGET)
    assert None not in (found.model, found.steps, found.wrong_k, found.limit_steps)
    pictures = {
        "cases": figures.cases_figure(benches),
        "matrix": figures.matrix_figure(found),
        "cost": figures.cost_figure(found),
        "steps": figures.sweep_figure("steps", found.steps),
        "wrong_k": figures.sweep_figure("wrong_k", found.wrong_k),
        "limit": figures.sweep_figure("limit_steps", found.limit_steps),
    }
    for name, figure in pictures.items():
        (FOLDER / f"compare_{name}.png").write_bytes(small(figure.image(".png"), 200))
    numbers = {
        "f_d": {
            case: {name: [s.mean("f_d"), s.half_width("f_d")] for name, s in bench.best.items()}
            for case, bench in benches.items()
        },
        "x": {
            case: {name: s.mean("x") for name, s in bench.best.items()}
            for case, bench in benches.items()
        },
        "nees": {
            case: {name: s.mean("nees") for name, s in bench.best.items()}
            for case, bench in benches.items()
        },
        "default_nees": {name: s.mean("nees") for name, s in found.default.items()},
        "efficiency": {
            name: [found.model.efficiency(name, signal) for signal in ("x", "v", "f_d")]
            for name in found.model.best
        },
        "limit": dict(found.model.limit),
        "cost": {name: s.mean("cost") for name, s in found.best.items()},
        "steps": {name: list(errors["f_d"]) for name, errors in found.steps.errors.items()}
        if found.steps
        else {},
        "wrong_k": {name: list(errors["f_d"]) for name, errors in found.wrong_k.errors.items()}
        if found.wrong_k
        else {},
        "tuned": {name: dict(s.values) for name, s in found.tuned.items()},
    }
    print(json.dumps(numbers, indent=1))
