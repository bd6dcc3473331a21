"""One word, one meaning: functions of ambkit do what the commands of the same name do."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ambkit
from ambkit import Bearing, Estimator, Expert, Record
from ambkit.base.errors import AmbkitError
from ambkit.judge.comparison.study import Study
from ambkit.workflow.saved_filters import tuned_filters

BEARING = Bearing.preset("zittau_axial")


def force_map(path: Path) -> Path:
    """Points of a force that is 10 % above the bearing's law, in the usual columns."""
    iu, x = (a.ravel() for a in np.meshgrid(np.linspace(-1.5, 1.5, 7), np.linspace(-5e-4, 5e-4, 7)))
    force = 1.1 * np.asarray(ambkit.ClosedLaw(BEARING).force(iu, x))
    rows = (f"{a:.6g},{1e3 * b:.6g},{c:.9g}" for a, b, c in zip(iu, x, force, strict=True))
    path.write_text("\n".join(["iu [A],x [mm],f_mag [N]", *rows]) + "\n")
    return path


def same(a: Record, b: Record) -> None:
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])


@pytest.mark.parametrize(("options", "arguments"), [
    ({"step": "0.3 mm", "load": "2 N", "seed": 3}, "--step 0.3mm --load 2N --seed 3"),
    ({"estimator": "extended", "step": 2e-4}, "--estimator extended --step 0.2mm"),
    ({"estimator": "none", "duration": "0.2 s"}, "--estimator none --duration 0.2s"),
    ({"step": "0.3 mm", "force_map": "force.csv"}, "--step 0.3mm --force-map force.csv"),
    ({"scenario": "s.toml"}, "--scenario s.toml"),
])  # fmt: skip
def test_simulate_makes_the_record_that_the_command_writes(
    call: Any, options: dict[str, Any], arguments: str
) -> None:
    force_map(Path("force.csv"))
    Path("s.toml").write_text('duration = "0.1 s"\nseed = 4\n')
    done = call("simulate", "zittau_axial", *arguments.split(), "--out", "run.csv")
    assert done.code == 0, done.err
    same(Record.load("run.csv"), ambkit.simulate(BEARING, **options))


def test_a_loop_has_one_estimator_or_none_and_one_magnet(call: Any) -> None:
    with pytest.raises(AmbkitError, match="one estimator: name one of them, not all"):
        ambkit.simulate(BEARING, estimator="all")
    for name in ("all", "linear,adaptive"):
        done = call("simulate", "zittau_axial", "--estimator", name)
        assert done.code == 2
        assert f"a loop has one estimator, given are {name}" in done.err
    fed = ambkit.Scenario(controller=ambkit.Control(feedback="estimate"))
    with pytest.raises(AmbkitError, match="so the estimator cannot be none"):
        ambkit.simulate(BEARING, fed, estimator="none")
    points = force_map(Path("force.csv"))
    with pytest.raises(AmbkitError, match="either a model or a force map"):
        ambkit.simulate(BEARING, magnet=ambkit.ClosedLaw(BEARING), force_map=points)


@pytest.mark.parametrize(("options", "arguments"), [
    ({}, ""),
    ({"rules": (3, 4), "weights": False}, "--rules 3x4 --no-weights"),
    ({"method": "steepest-gradient", "scaling": "unit"},
     "--method steepest-gradient --scaling unit"),
    ({"reach": "0.8 mm"}, "--reach 0.8mm"),
    ({"force_map": "force.csv", "rules": (3, 3), "law_error": "2 N"},
     "--force-map force.csv --rules 3x3 --law-error 2N"),
])  # fmt: skip
def test_train_makes_the_expert_that_the_command_writes(
    call: Any, options: dict[str, Any], arguments: str
) -> None:
    force_map(Path("force.csv"))
    assert call("train", "zittau_axial", *arguments.split(), "--out", "e.json").code == 0
    if "force_map" not in options:
        assert Expert.load("e.json") == ambkit.train(BEARING, **options)
        return
    with pytest.warns(UserWarning, match="at points left out the law, refitted is off by"):
        assert Expert.load("e.json") == ambkit.train(BEARING, **options)


@pytest.mark.parametrize(("options", "told"), [
    ({"law_error": "2 N"}, "law_error is of points that were measured: give a force_map"),
    ({"channels": "c.toml"}, "channels is of points that were measured"),
    ({"rules": None}, "rules = None asks points that were measured"),
])  # fmt: skip
def test_what_is_of_measured_points_asks_for_them(options: dict[str, Any], told: str) -> None:
    with pytest.raises(AmbkitError, match=re.escape(told)):
        ambkit.train(BEARING, **options)


def test_an_expert_reaches_as_far_as_it_is_told(call: Any) -> None:
    assert ambkit.train(BEARING, reach="0.8 mm").displacement_range == (-0.8e-3, 0.8e-3)
    with pytest.raises(ValueError, match="reach must be above 0 m and at most the travel, 1 mm"):
        ambkit.train(BEARING, reach=1.2e-3)
    done = call("train", "zittau_axial", "--reach", "1.2 mm")
    assert (done.code, done.out) == (2, "")
    assert "--reach must be above 0 m and at most the travel, 1 mm, is 1.2 mm" in done.err
    force_map(Path("force.csv"))
    done = call("train", "zittau_axial", "--reach", "0.8 mm", "--force-map", "force.csv")
    assert "a force map reaches as far as it has points" in done.err
    for source, options in (
        (BEARING, {"reach": 1e-3, "force_map": "force.csv"}),
        (ambkit.stiffness_map(BEARING), {"reach": 1e-3}),
    ):
        given: Any = options
        with pytest.raises(AmbkitError, match="reach is of a"):
            ambkit.train(source, **given)


@pytest.mark.parametrize("out", ["e.json", "points.csv", "refitted.toml", None])
def test_train_saves_the_filter_of_what_it_wrote(call: Any, out: str | None) -> None:
    force_map(Path("force.csv"))
    written = [] if out is None else ["--out", out]
    written += ["--as", "network"] if out in ("e.json", None) else []  # the law would be better
    done = call("train", "zittau_axial", "--force-map", "force.csv", "--rules", "3x3", *written,
                "--save-filter", "f.toml")  # fmt: skip
    assert done.code == 0, done.err
    kalman = Estimator.load("f.toml")
    asked = type(kalman.magnet).__name__
    assert asked == {"points.csv": "ForceSurface", "refitted.toml": "ClosedLaw"}.get(
        out or "", "Expert"
    )
    if out == "refitted.toml":  # k of the law is refitted, and the bearing has it
        assert kalman.bearing.magnet.magnet_constant == pytest.approx(
            1.1 * BEARING.magnet.magnet_constant, rel=1e-3
        )
    elif out is None:
        assert Path("f.expert.json").exists()
    (said,) = kalman.origin.values()
    assert "; ambkit train " in said
    assert call("check", "f.toml").code == 0


@pytest.mark.parametrize(
    ("options", "asked"),
    [([], "ClosedLaw"), (["--as", "surface"], "ForceSurface"), (["--out", "e.json"], "ClosedLaw")],
)
def test_a_filter_knows_what_points_left_out_prefer(
    call: Any, options: list[str], asked: str
) -> None:
    force_map(Path("force.csv"))
    words = ("train", "zittau_axial", "--force-map", "force.csv", "--rules", "3x3", *options)
    done = call(*words, "--save-filter", "f.toml")
    assert done.code == 0, done.err
    assert type(Estimator.load("f.toml").magnet).__name__ == asked
    said = "e.json holds the network, but the law, refitted is better at points left out and f.toml"
    assert (said in done.err) == ("e.json" in options)


def test_what_is_asked_for_fits_the_file_that_it_goes_to(call: Any) -> None:
    force_map(Path("force.csv"))
    words = ("train", "zittau_axial", "--force-map", "force.csv", "--as", "surface")
    refused = call(*words, "--out", "b.toml")
    assert refused.code == 2
    assert "--as surface is written as .csv or .parquet, --out is b.toml" in refused.err


@pytest.fixture(scope="module")
def tuned() -> Study:
    return ambkit.compare(BEARING, "step", ["linear", "adaptive", "table", "observer"], runs=2,
                          tune=6)  # fmt: skip


def test_compare_in_a_case_is_the_command_s(call: Any, tuned: Study) -> None:
    done = call("compare", "zittau_axial", "--case", "step", "--runs", "2", "--tune", "6",
                "--estimators", "linear,adaptive,table,observer", "--save-filters", "filters",
                "--json")  # fmt: skip
    assert done.code == 0, done.err

    def errors(data: dict[str, Any]) -> dict[str, Any]:
        return {k: {s: each[s] for s in ("x", "v", "f_d")} for k, each in data["tuned"].items()}

    assert errors(done.json) == errors(tuned.bench.to_dict())
    assert "filters/table.toml: this filter knows its magnet by a StiffnessMap" in done.err
    made = {path.name for path in Path("filters").iterdir()}
    assert made == {"linear.toml", "adaptive.toml", "adaptive.expert.json", "observer.toml"}
    for name, built in tuned_filters(tuned).items():
        if name == "table":
            continue
        kalman = Estimator.load(f"filters/{name}.toml")
        assert kalman.variances == pytest.approx(built.variances, rel=1e-12)
        np.testing.assert_allclose(
            kalman.run(tuned.first.record).x, built.run(tuned.first.record).x, rtol=1e-9, atol=1e-12
        )
        assert kalman.origin == built.origin
        assert all(key.startswith(("noise.", "options.")) for key in kalman.origin)
        assert all("case step; ambkit compare " in said for said in kalman.origin.values())
    assert any(tuned_filters(tuned)[name].origin for name in ("linear", "observer"))


def test_tuned_filters_of_a_bearing_without_a_file_share_one(tmp_path: Path) -> None:
    own = BEARING.replace(name="mine", rotor__mass=0.6)
    ambkit.compare(own, "step", ["linear", "extended"], runs=1, tune=3, save_filters=tmp_path)
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {"bearing.toml", "linear.toml", "extended.toml"}
    assert Estimator.load(tmp_path / "extended.toml").bearing == own


def test_compare_in_loops_of_one_s_own_is_the_command_s(call: Any) -> None:
    force_map(Path("force.csv"))
    data = call("compare", "zittau_axial", "--steps", "0.1mm,0.3mm", "--load", "2N", "--runs", "2",
                "--force-map", "force.csv", "--json").json  # fmt: skip
    found = ambkit.compare(
        BEARING, steps=["0.1 mm", 3e-4], load="2 N", runs=2, force_map="force.csv"
    )
    for case, scores in found.scores.items():
        for name, score in scores.items():
            assert score.mean("x") == pytest.approx(data["cases"][case][name]["x"])
    Path("s.toml").write_text('duration = "0.1 s"\n')
    own = ambkit.compare(BEARING, scenario="s.toml", estimators=["linear"], runs=1)
    assert list(own.scores) == ["scenario"]


def test_what_is_of_a_case_does_not_go_with_loops_of_one_s_own() -> None:
    for options, told in (
        ({"case": "paper", "steps": [1e-4]}, "steps is in place of a case, and does not go with"),
        ({"tune": 3, "load": "1 N"}, "load is in place of a case, and does not go with tune"),
        ({"case": "all", "save_filters": "f"}, "save_filters and whole are of one case"),
    ):
        given: Any = options
        with pytest.raises(ValueError, match=told):
            ambkit.compare(BEARING, **given)
    with pytest.raises(AmbkitError, match="nothing was tuned"):
        ambkit.compare(BEARING, "step", ["linear"], runs=1, save_filters="f")
