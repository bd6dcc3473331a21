"""What self-tests of machines do not see is known, with its reason: mutants, and lines."""

import random
import shutil
from functools import cache

import mutants
import numpy as np
import pytest
import unseen
from exporting import export_c
from machine_cases import gained

from ambkit import KalmanFilter, Scenario
from ambkit.control.control import Control, LiftOff
from ambkit.simulation.scenario import settled_scenario

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed"),
]

KNOWN = unseen.lists(True, True, False)
LIFTING = {"start": "landed", "sequence": LiftOff()}
CROSSED = Control(type="translation and tilt", cross_feedback=0.5)
FLOWN = {
    "pid": ("tum_mlps", Scenario(controller=CROSSED, **LIFTING).fed("estimate")),
    "lqg": ("tum_mlps", Scenario(controller=Control(type="lqg"), **LIFTING).fed("estimate")),
    "measured": ("tum_mlps", Scenario(**LIFTING)),
    "late": ("compressor", None),
}
"""Machines by what flies them; the last one has slow amplifiers and delays."""
SAMPLE = 60  # Mutants, which are judged in minutes; ``tests/mutants.py --machine`` judges all.


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    made = {}

    @cache
    def of(name):
        preset, flight = FLOWN[name]
        machine = gained(preset)
        to = tmp_path_factory.mktemp(name) / "c"
        made[name] = mutants.Bench(
            export_c(machine, None, to, prefix="f", loops=True, scenario=flight).folder, "f"
        )
        return made[name]

    yield of
    for each in made.values():
        each.close()


def test_operators_that_became_others_are_seen(bench):
    """A sample of what runs in the first machine, the core's by the others too."""
    first = bench("pid")
    never = first.never_run
    running = [m for m in first.operators() if (m.file, m.line) not in never]
    some = random.Random(0).sample(running, SAMPLE)
    unknown = [m for m in some if mutants.why(first, m, KNOWN) is None]
    alive = [m for m in unknown if seen_by_none(bench, m)]
    assert [str(m) for m in alive if not first.is_the_same(m)] == []


def seen_by_none(bench, mutant):
    names = list(FLOWN) if mutant.file.startswith("core/") else ["pid"]
    return all(
        mutant.file not in bench(name).flying or bench(name).judge(mutant).exact for name in names
    )


def test_the_supervisor_is_seen_whole(bench):
    first = bench("pid")
    of = [m for m in first.operators() if mutants.function_of(first, m) == "supervise"]
    assert len(of) > 20
    unknown = [m for m in of if mutants.why(first, m, KNOWN) is None]
    alive = [m for m in unknown if first.judge(m).exact]
    assert [str(m) for m in alive if not first.is_the_same(m)] == []


def has(name, data):
    """What decides which lines run, of the estimator, the flight and the text of the data file."""
    preset, flight = FLOWN[name]
    machine = gained(preset)
    flight, kalman = settled_scenario(machine, flight), KalmanFilter(machine, precision="float32")
    known = kalman.core.parameters["set"]
    gains, freed = "of_fed_back" in data, "of_motion" in data
    return unseen.ModelFeatures(
        len(kalman.states), "model_B_u_column" in data and bool(kalman.engine.model.B_u.any()),
        bool(np.any(known["rise"])), controlled=True, fed=flight.feedback == "estimate",
        gains=gains, unbalance_control=freed,
        isolated=flight.controller.type == "decentralised" and not gains and not freed,
        tracking=".T_t = 0.0F" not in data, rounded=bool(np.any(known["step"])),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["pid", "lqg", "measured"])  # of rotors that do not bend
def test_what_does_not_run_is_known(name, bench):
    """Each line with an operator that never runs is listed with its reason."""
    one = bench(name)
    entries = unseen.not_run(has(name, one.text("f_data.c")))
    never = one.never_run
    left = [
        str(m)
        for m in one.operators()
        if (m.file, m.line) in never
        and not any(
            m.file.endswith(e.file) and mutants.function_of(one, m) == e.function
            and e.text in m.text
            for e in entries
        )
    ]  # fmt: skip
    assert left == []


def test_what_is_explained_stands_in_the_sources(bench):
    """What explains nothing any more hides nothing."""
    texts = {file: bench("pid").text(file) for file in bench("pid").flying}
    gone = [
        known
        for known in KNOWN
        if not any(f.endswith(known.file) and known.text in text for f, text in texts.items())
    ]
    assert gone == []
