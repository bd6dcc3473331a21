"""One word, one meaning: functions of ambkit do what the commands of the same name do."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit import Estimator, Expert, Machine, Record
from ambkit.base.errors import AmbkitError
from ambkit.result.result import plain
from ambkit.workflow.comparison import tuned_filters

BEARING = Machine.preset("zittau_axial")


def force_map(path):
    """Points of a force that is 10 % above the bearing's law, in the usual columns."""
    iu, x = (a.ravel() for a in np.meshgrid(np.linspace(-1.5, 1.5, 7), np.linspace(-5e-4, 5e-4, 7)))
    force = 1.1 * np.asarray(ambkit.ClosedLaw(BEARING).force(iu, x))
    rows = (f"{a:.6g},{1e3 * b:.6g},{c:.9g}" for a, b, c in zip(iu, x, force, strict=True))
    path.write_text("\n".join(["iu [A],x [mm],f_mag [N]", *rows]) + "\n")
    return path


def same(a, b):
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])


ONE, TWO, LAW = ["linear"], ["linear", "closed-law"], "--filter linear --filter closed-law"
FREE = ["magnet_constant", "measurement_noise"]
COMMANDS = {
    "simulate zittau_axial --step 0.2mm --disturbance 3N --seed 4": lambda: ambkit.simulate(
        BEARING, step="0.2 mm", disturbance="3 N", seed=4
    ),
    f"filter run.csv --machine zittau_axial --smooth {LAW}": lambda: ambkit.filter(
        "run.csv", TWO, machine=BEARING, smooth=True
    ),
    f"filter log.csv --machine zittau_axial {LAW} --filter paper.json": lambda: ambkit.filter(
        "log.csv", [*TWO, "paper.json"], machine=BEARING
    ),
    "filter log.csv --machine zittau_axial --filter linear --disturbance-noise 1N^2/s --window "
    "20ms,80ms --settling 10ms": lambda: ambkit.filter(
        "log.csv", ONE, machine=BEARING, disturbance_noise=1.0, window=(0.02, 0.08), settling=0.01
    ),
    "identify zittau_axial log.csv --validate other.csv --free magnet_constant --free "
    "measurement_noise --nodes 6x4 --out force-map=map.csv": lambda: ambkit.identify(
        BEARING, "log.csv", validate=["other.csv"], free=FREE, nodes=(6, 4)
    ),
    "compare zittau_axial --case step --filter linear --filter extended --seeds 3 --spread 5%":
    lambda: ambkit.compare(BEARING, ["linear", "extended"], case="step", seeds=3, spread=0.05),
    f"compare steps zittau_axial {LAW} --seeds 5:2 --duration 0.1s --disturbance 3N": lambda: (
        ambkit.compare_steps(BEARING, TWO, seeds="5:2", duration=0.1, disturbance=3.0)
    ),
    "compare steps zittau_axial --steps 0.1mm --steps 0.3mm --disturbance 2N --seeds 2 --plant "
    "force.csv --filter linear": lambda: ambkit.compare_steps(
        BEARING, ONE, steps=["0.1 mm", 3e-4], disturbance="2 N", seeds=2, plant="force.csv"
    ),
    "compare steps zittau_axial --scenario s.toml --seeds 1 --filter linear": lambda: (
        ambkit.compare_steps(BEARING, ONE, scenario="s.toml", seeds=1)
    ),
    "train zittau_axial --rules 4x3": lambda: ambkit.train(BEARING, rules=(4, 3)),
    "train zittau_axial --rules 2x2 --method steepest-gradient --plain --scaling unit": lambda: (
        ambkit.train(
            BEARING, rules=(2, 2), method="steepest-gradient", plain=True, scaling="unit"
        )
    ),
    "train map zittau_axial force.csv --rules 2x2 --law-error 2N --plain --scaling unit": lambda: (
        ambkit.train_map(
            BEARING, "force.csv", rules=(2, 2), law_error="2 N", plain=True, scaling="unit"
        )
    ),
}  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_writes_what_its_function_returns(call, words):
    force_map(Path("force.csv"))
    Expert.paper().save("paper.json")
    Path("s.toml").write_text('duration = "0.1 s"\nseed = 4\n')
    for seed, name in enumerate(("log.csv", "other.csv")):
        run = ambkit.simulate(BEARING, step=3e-4, disturbance=3.0, duration=0.1, seed=seed).record
        run.save("run.csv")
        Record(run.t, {n: run[n] for n in "yu"}, {"y": "m", "u": "V"}).save(name)
    told = comparable(call, words)
    assert told == comparable_data(COMMANDS[words]().to_dict())
    for option in OPTION.findall(words):  # none is ignored
        assert comparable(call, words.replace(option, "", 1)) != told, option


OPTION = re.compile(r" --(?:(?!filter|machine|out|validate|free|nodes|rules)[\w-]+)(?: [^-]\S*)?")


def comparable(call, words):
    """Return what a command prints as JSON, without what is of files or of the processor's time."""
    done = call(*words.split(), "--json")
    assert done.code == 0, done.err
    return comparable_data(done.json)


def comparable_data(data):
    kept = {k: v for k, v in data.items() if k not in ("files", "notes", "adequacy", "record")}
    for one in kept.get("default", {}).values():
        del one["cost"], one["cost_half_width"]
    return json.loads(json.dumps(plain(kept)))


@pytest.mark.parametrize(("options", "arguments"), [
    ({"step": "0.3 mm", "disturbance": "2 N", "seed": 3}, "--step 0.3mm --disturbance 2N --seed 3"),
    ({"filter": "extended", "step": 2e-4}, "--filter extended --step 0.2mm"),
    ({"filter": "none", "duration": "0.2 s"}, "--filter none --duration 0.2s"),
    ({"step": "0.3 mm", "plant": "force.csv"}, "--step 0.3mm --plant force.csv"),
    ({"scenario": "s.toml"}, "--scenario s.toml"),
])  # fmt: skip
def test_simulate_makes_the_record_that_the_command_writes(call, options, arguments):
    force_map(Path("force.csv"))
    Path("s.toml").write_text('duration = "0.1 s"\nseed = 4\n')
    done = call("simulate", "zittau_axial", *arguments.split(), "--out", "run.csv")
    assert done.code == 0, done.err
    same(Record.load("run.csv"), ambkit.simulate(BEARING, **options).record)


def test_a_loop_has_one_estimator_or_none_and_one_magnet(call):
    with pytest.raises(AmbkitError, match="one filter: name one of them, not all"):
        ambkit.simulate(BEARING, filter="all")
    done = call("simulate", "zittau_axial", "--filter", "linear", "--filter", "adaptive")
    assert "--filter is given more than once" in done.err
    fed = ambkit.Scenario(controller=ambkit.Control(feedback="estimate"))
    with pytest.raises(AmbkitError, match="so the estimator cannot be none"):
        ambkit.simulate(BEARING, fed, filter="none")


@pytest.mark.parametrize(("options", "arguments"), [
    ({}, ""),
    ({"rules": (3, 4), "method": "widths", "reach": "0.8 mm"},
     "--rules 3x4 --method widths --reach 0.8mm"),
])  # fmt: skip
def test_train_makes_the_expert_that_the_command_writes(call, options, arguments):
    assert call("train", "zittau_axial", *arguments.split(), "--out", "e.json").code == 0
    assert Expert.load("e.json") == ambkit.train(BEARING, **options).expert


def test_an_expert_reaches_as_far_as_it_is_reported(call):
    assert ambkit.train(BEARING, reach="0.8 mm").expert.displacement_range == (-0.8e-3, 0.8e-3)
    with pytest.raises(AmbkitError, match="reach must be above 0 m and at most the travel, 1 mm"):
        ambkit.train(BEARING, reach=1.2e-3)
    done = call("train", "zittau_axial", "--reach", "1.2 mm")
    assert (done.code, done.out) == (2, "")
    assert "reach must be above 0 m and at most the travel, 1 mm, is 1.2 mm" in done.err


@pytest.mark.parametrize("out", ["e.json", "points.csv", "refitted.toml", None])
def test_train_saves_the_filter_of_what_it_wrote(call, out):
    force_map(Path("force.csv"))
    written = [] if out is None else ["--out", out]
    model = {"points.csv": "surface", "refitted.toml": "law"}.get(out or "", "network")
    written += ["--model", model]  # the law would be better
    done = call("train", "map", "zittau_axial", *written, "force.csv", "--rules", "3x3", "--out",
                "filter=f.toml")  # fmt: skip
    assert done.code == 0, done.err
    kalman = Estimator.load("f.toml")
    asked = type(kalman.magnet).__name__
    assert asked == {"points.csv": "ForceSurface", "refitted.toml": "ClosedLaw"}.get(
        out or "", "Expert"
    )
    if out == "refitted.toml":  # k of the law is refitted, and the bearing has it
        assert kalman.machine.magnet.magnet_constant == pytest.approx(
            1.1 * BEARING.magnet.magnet_constant, rel=1e-3
        )
    elif out is None:
        assert Path("f.expert.json").exists()
    (said,) = kalman.origin.values()
    assert "; ambkit train " in said
    assert call("check", "f.toml").code == 0


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ([], "ClosedLaw"),
        (["--model", "surface"], "ForceSurface"),
        (["--out", "e.json"], "ClosedLaw"),
    ],
)
def test_a_filter_knows_what_points_left_out_prefer(call, options, asked):
    force_map(Path("force.csv"))
    words = ("train", "map", "zittau_axial", *options, "force.csv", "--rules", "3x3")
    done = call(*words, "--out", "filter=f.toml")
    assert done.code == 0, done.err
    assert type(Estimator.load("f.toml").magnet).__name__ == asked
    better = "the law, refitted is better at points left out and is used: --out"
    assert (better in done.out) == ("--model" not in options)


@pytest.fixture(scope="module")
def tuned():
    return ambkit.compare(BEARING, ["linear", "adaptive", "table", "observer"], case="step",
                          seeds=2, budget=6)  # fmt: skip


def test_compare_in_a_case_is_the_command_s(call, tuned):
    done = call("compare", "zittau_axial", "--case", "step", "--seeds", "2", "--budget", "6",
                "--filter", "linear", "--filter", "adaptive", "--filter", "table", "--filter",
                "observer", "--out", "filters=filters", "--json")  # fmt: skip
    assert done.code == 0, done.err

    def errors(data):
        return {k: {s: each[s] for s in ("x", "v", "f_d")} for k, each in data["tuned"].items()}

    assert errors(done.json) == errors(tuned.to_dict())
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


def test_tuned_filters_of_a_bearing_without_a_file_share_one(tmp_path):
    own = BEARING.replace(name="mine", rotor__mass=0.6)
    study = ambkit.compare(own, ["linear", "extended"], case="step", seeds=1, budget=3)
    study.save_product("filters", tmp_path, {})
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {"bearing.toml", "linear.toml", "extended.toml"}
    assert Estimator.load(tmp_path / "extended.toml").machine == own


def test_filters_of_a_mapping_have_each_run_to_themselves():
    options = {"steps": ["0.3 mm"], "disturbance": "2 N", "seeds": 6}
    named = ambkit.compare_steps(BEARING, ["linear", "closed-law"], **options)
    law = ambkit.AdaptiveKalmanFilter(BEARING, ambkit.ClosedLaw(BEARING))
    objects = {"a, b": ambkit.KalmanFilter(BEARING), "law": law}
    functions = {"a, b": lambda: ambkit.KalmanFilter(BEARING), "law": lambda: law}
    (wanted,) = named.scores.values()
    for filters in (objects, functions):
        (scores,) = ambkit.compare_steps(BEARING, filters, **options).scores.values()
        assert list(scores) == ["a, b", "law"]
        for one, other in zip(scores.values(), wanted.values(), strict=True):
            for signal in ("x", "v", "f_d"):
                np.testing.assert_array_equal(one.figures[signal], other.figures[signal])


def test_what_is_not_there_is_not_saved(tmp_path):
    with pytest.raises(AmbkitError, match="robustness needs one case"):
        ambkit.compare(BEARING, ["linear"], case="all", robustness=True)
    study = ambkit.compare(BEARING, ["linear"], case="step", seeds=1)
    with pytest.raises(AmbkitError, match="nothing was tuned"):
        study.save_product("filters", tmp_path, {})
