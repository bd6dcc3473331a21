"""Structures that a description lacks are named by `identify`, and right plants are not accused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit.base.units import engineering
from ambkit.identification.maximum_likelihood.alternatives import play
from ambkit.identification.maximum_likelihood.load_steps import (
    fit_between_load_steps,
    names_of_parts,
)
from ambkit.identification.maximum_likelihood.parameters import OFFSETS, named, usual
from ambkit.identification.maximum_likelihood.structure import Structure, examine
from ambkit.machine.axes import with_axis
from ambkit.workflow.identify import starting_model
from benchmarks.wrong_plants import MACHINES, NAMES, WRONG, Case, simulate

QUICK = ("hysteresis", "payload", "")
AMONG = [({}, ""), ({"sensor__cubic": -5e6}, "sensor cubic")]


def examined(case, record):
    start = starting_model(MACHINES[case.machine][0])
    options = {"improve_start": False, "profile": False}
    return fit_between_load_steps([record], start, usual(start), **options)[2]


def test_wrong_structures_are_named_and_a_right_one_is_not():
    cases = [Case("slow axis", wrong, 7) for wrong in QUICK]
    for case, record in zip(cases, simulate(cases, 4000), strict=True):
        structure = examined(case, record)
        [verdict] = [row.value for row in structure.rows() if row.key == "verdict"]
        if not case.wrong:
            assert structure.suspect == ""
            assert verdict == "no departure"
            gap = record["u"].copy()
            gap[50] = np.nan
            found = SimpleNamespace(start=None, model=None, parameters=[], settling=0.0)
            [row] = examine(found, [ambkit.Record(record.t, {"y": record["y"], "u": gap})]).rows()
            assert row.value == "not tested: no motion, or gaps in u"
            continue
        assert set(structure.suspect.split(", ")) & NAMES.get(case.wrong, {case.wrong}), case
        assert verdict == structure.suspect
        if case.wrong == "hysteresis":  # 0.12 A wide: 4 % of the bias current to either side
            [width] = [d for d in structure.departures if d.kind.name == "hysteresis"]
            assert abs(width.size - 0.12) < 3 * width.error < 0.1
            assert any("hysteresis over the current" in text for text in structure.notes)
        if case.wrong == "payload":
            [change] = [d for d in structure.departures if d.kind.name == "change"]
            assert change.where.startswith(("0.5", "500 ms", "499", "501"))
            assert change.size == pytest.approx(1 / 1.25 - 1, rel=0.15)
            assert change.error < 0.01


@pytest.mark.parametrize("machine", quick(["coarse spindle", "ball"], [], ["ball"]))
def test_most_of_nine_wrong_plants_are_named(machine):
    cases = [Case(machine, wrong, 8) for wrong in WRONG] + [Case(machine, "", s) for s in (9, 10)]
    missed, accused = [], []
    for case, record in zip(cases, simulate(cases), strict=True):
        names = set(examined(case, record).suspect.split(", ")) - {""}
        if not case.wrong and names:
            accused.append((case, names))
        elif case.wrong and not names & NAMES.get(case.wrong, {case.wrong}):
            missed.append((case, names))
    assert not accused
    assert len(missed) <= 1, missed


def test_a_wrong_structure_is_not_called_good():
    case = Case("slow axis", "friction", 7)
    [record] = simulate([case], 2800)
    found = ambkit.identify(
        MACHINES[case.machine][0], record,
        free=["magnet_constant", "delay", "measurement_noise", "disturbance_noise"],
    )  # fmt: skip
    assert "friction" in found.structure.suspect
    assert not found.validation[0].good
    assert "The structure of the model is suspect: " in found.validation[0].verdict
    assert f"suspect: {found.structure.suspect}." in found.finding
    assert found.to_dict()["structure"]["structure"]["verdict"] == found.structure.suspect
    assert any(note.startswith("Friction of ") for note in found.notes)
    [check] = found.validation
    better = {kind: {k: 0.5 * error for k, error in check.errors["error"].items()}
              for kind in ("arx", "subspace")}  # fmt: skip
    own = {"without_later_controls": check.errors["error"]}
    other = replace(check, suspect="", errors=check.errors | own | better)
    assert "ARX and subspace predicted better" in other.verdict
    assert other.good == replace(check, suspect="").good
    half = record.between(0.3, 0.7)
    assert not found.validate(half).validation[0].good


@pytest.mark.parametrize(
    ("machine", "step", "load", "duration", "seed"),
    [
        ("zittau_axial", "0.3 mm", "3 N", 0.5, 101),
        pytest.param("zittau_axial", "0.3 mm", "3 N", 0.5, 0, marks=pytest.mark.study),
        pytest.param("inteco_ml", None, "0.36 N", 1.5, 0, marks=pytest.mark.study),
    ],
)
def test_a_load_step_is_no_defect_and_its_record_is_identified_in_parts(
    machine, step, load, duration, seed
):
    described = ambkit.preset(machine)
    record = ambkit.simulate(
        described, step=step, disturbance=load, duration=duration, seed=seed
    ).record
    start = starting_model(described)
    found, parts, structure = fit_between_load_steps([record], start, usual(start), profile=False)
    assert structure.suspect == ""
    assert len(parts) == 2
    assert parts[1].t[0] == pytest.approx(record.t[-1] / 2, abs=20 * described.sampling_time)
    assert sum(map(len, parts)) == len(record)
    names = names_of_parts(["a.csv"], [record], parts)
    assert names == ["a.csv", f"a.csv from {engineering(parts[1].t[0], 's', 3)}"]
    if "magnet_constant" in {p.name for p in found.parameters}:
        off = found["magnet_constant"] - described.magnet.magnet_constant
        assert abs(off) < 3 * found.standard_error("magnet_constant")


@pytest.mark.parametrize(
    ("changes", "name"), quick([*AMONG, ({"amplifier__bandwidth": 300}, "lag")], [], AMONG)
)
def test_an_axis_among_others_is_tested_by_the_same_text(changes, name):
    """No fit, with offsets or without: the model is the description."""
    machine, n = ambkit.preset("tum_mlps"), 2500
    plant = with_axis(machine, "A1", machine.isolated_axis("A1").replace(**changes))
    T, random = machine.sampling_time, np.random.default_rng(0)
    places = ambkit.Sequence(times=0.01 * np.arange(40), values=random.uniform(-5e-5, 5e-5, 40))
    record = ambkit.simulate(
        plant, ambkit.Scenario(duration=n * T, reference=places, seed=1)
    ).record
    start = starting_model(machine, "A1")
    parameters = named([name for name in usual(start) if name not in OFFSETS])
    described = SimpleNamespace(start=start, model=start, parameters=parameters, settling=0.05)
    assert examine(described, [start.record(record)]).suspect == name


def test_play_follows_its_input_by_half_its_width():
    i = np.array([0.0, 1.0, 0.9, 0.2, -1.0, -0.5])
    np.testing.assert_allclose(play(i, 0.3), [0.0, 0.7, 0.7, 0.5, -0.7, -0.7])


@pytest.mark.parametrize(("least", "words"), [(3.79, "coils: "), (0.3, "coils below 30 %: ")])
def test_what_only_more_than_all_of_it_would_show_is_not_shown_at_all(least, words):
    (note,) = Structure([], [], tested=True, detectable={"unequal coils": least}).notes
    assert note.startswith(f"These records cannot show unequal {words}")
