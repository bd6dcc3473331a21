"""Many logs at once: cut, pooled with a scatter between them, each predicted by the others."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from quick import quick

import ambkit
from ambkit import Machine, Record, Scenario, Sine, simulate
from ambkit.base.errors import AmbkitError
from ambkit.data import recordings
from ambkit.estimate.constant_velocity import tune
from ambkit.estimate.errors import rms
from ambkit.identification.corpus.corpus import identify_corpus, in_the_mean
from ambkit.identification.corpus.pooling import deviation, pool
from ambkit.identification.corpus.segmentation import cut, flights
from ambkit.identification.maximum_likelihood.baselines import AHEAD, Baselines, Layout, _parts
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named
from ambkit.identification.maximum_likelihood.validation import Validation, Whiteness, validate
from ambkit.workflow.identify import starting_model

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "closed_loop"
BALL = Machine.preset("inteco_ml").replace(sensor__position_noise=-90.0)
FREE = ("magnet_constant", "air_gap", "current_offset", "measurement_noise", "position_noise",
        "disturbance_noise")  # fmt: skip
Array = NDArray[np.float64]


def simulated(seed, k=1.0, duration=3.0):
    plant = BALL.replace(magnet__magnet_constant=k * BALL.magnet.magnet_constant)
    reference = Sine(amplitude=1.5e-3, frequency=0.6 + 0.3 * seed)
    return simulate(plant, Scenario(duration=duration, seed=seed, reference=reference)).record


def smoothed(record):
    kernel = np.ones(41) / 41
    padded = np.pad(record["y"], 20, mode="edge")
    return Record(record.t, {"y": np.convolve(padded, kernel, "valid"), "u": record["u"]})


@pytest.fixture(scope="module")
def corpus():
    logs = {f"log {seed}": simulated(seed) for seed in range(3)} | {"quiet": smoothed(simulated(5))}
    level = BALL.replace(
        sensor__position_noise=0.0, magnet__magnet_constant=0.8 * BALL.magnet.magnet_constant
    )
    return identify_corpus(logs, LoopModel(level, disturbance_noise=1e-4), FREE)


def test_a_magnet_that_is_not_as_described_is_reported_beside_the_amplitude(corpus):
    told = corpus.strength_loss
    assert list(told.flights) == list(corpus.by_log)
    assert abs(np.log(told.factor / 0.8)) < 3 * told.factor_error
    assert told.factor_error < 0.1
    assert abs(told.slope) < 3 * told.slope_error  # there is no hysteresis
    assert all(1e-3 < one.amplitude < 0.2 for one in told.flights.values())
    assert "divided by 0." in told.text
    assert corpus.to_dict()["levitated"]["factor"] == told.factor


def test_logs_say_what_is_true_and_a_smoothed_one_is_named(corpus):
    assert list(corpus.by_log) == ["log 0", "log 1", "log 2"]
    assert "smoothed before it was logged" in corpus.left_out["quiet"]
    for name, true in (
        ("magnet_constant", BALL.magnet.magnet_constant), ("air_gap", BALL.magnet.air_gap),
        ("measurement_noise", BALL.sensor.noise_variance), ("position_noise", -90.0),
    ):  # fmt: skip
        at = [p.name for p in corpus.pooled.parameters].index(name)
        positive = corpus.pooled.parameters[at].positive
        off = np.log(corpus.pooled[name] / true) if positive else corpus.pooled[name] - true
        assert abs(off) < 3.5 * corpus.pooled.errors[at], name


def test_each_is_foretold_by_the_others(corpus):
    for each in corpus.predictions:
        error = each.errors["error"]
        assert error[10] < each.errors["without_a_magnet"][10]
        assert error[10] < each.errors["held"][10]
        assert each.nis == pytest.approx(1.0, abs=0.12)
        assert error[1] > each.floor
        assert each.left < 0.05
    data = json.loads(corpus.to_json())
    for each in corpus.predictions:
        told = data["predictions"][each.name]
        assert told["arx"] == {str(k): error for k, error in each.errors["arx"].items()}
        assert (told["nis"], told["predictable_share"]) == (each.nis, each.left)
    pooled = corpus.pooled
    for k, one in enumerate(pooled.parameters):
        told = data["parameters"][one.name.replace("_", " ")]
        assert told["value"] == pooled.values[k]
        assert told["scatter_between_logs"] == pooled.scatter[k]
        assert [data["alone"][log][one.name] for log in corpus.by_log] == [
            None if np.isnan(value) else value for value in pooled.by_log[:, k]
        ]


def test_a_model_is_good_though_a_black_box_predicts_better():
    errors = {
        "error": {1: 18e-6, 10: 21e-6}, "without_later_controls": {1: 18e-6, 10: 23e-6},
        "held": {1: 24e-6, 10: 30e-6}, "without_a_magnet": {1: 19e-6, 10: 28e-6},
        "arx": {1: 19e-6, 10: 27e-6}, "subspace": {1: 19e-6, 10: 26e-6},
    }  # fmt: skip
    white = Whiteness(np.array([0.5, 0.0]), 0.1)
    well = Validation(
        "log", 10_000, errors, {1: 1e-3, 10: 1e-3}, white, white, nis=1.05, left=0.01, floor=17e-6
    )
    assert well.good  # whiteness alone does not count: in a long log little shows
    assert "The residuals are not white" in well.verdict
    assert well.best == "without_later_controls"
    for worse in ({"nis": 1.4}, {"nis": 0.7}, {"left": 0.2}, {"gain": -0.1}, {"suspect": "lag"}):
        assert not replace(well, **worse).good
    for kind in ("arx", "subspace"):
        beaten = replace(well, errors=errors | {kind: {1: 19e-6, 10: 20e-6}})
        assert beaten.good
        assert "predicted better: with more parameters" in beaten.verdict
    assert not replace(well, errors=errors | {"held": {1: 17e-6, 10: 30e-6}}).good


def test_a_filter_that_knows_the_truth_loses_to_no_model_that_knows_as_much():
    """Given later controls it does: as they answer to the motion, they lead it astray."""
    quiet = {str(n): simulated(n, duration=4.0).between(0.5, None) for n in range(4)}
    others = Baselines.joint(Baselines.of([[quiet[name]] for name in "123"]))
    naive = in_the_mean([tune(quiet[name]["y"], BALL.sampling_time) for name in "123"])
    truth = LoopModel(BALL, disturbance_noise=1e-8, substeps=1)

    def predicted(model):
        return validate(
            model, quiet["0"], horizons=AHEAD, settling=0.25, naive=naive, baselines=others
        )

    found = predicted(truth)
    past, arx, known = (found.errors[of] for of in ("without_later_controls", "arx", "error"))
    assert past[1] == pytest.approx(known[1], rel=1e-3)
    assert found.best == "without_later_controls"
    assert arx[10] < 1.05 * past[10]  # with 270 weights, hardly worse
    assert past[10] < known[10]
    late = predicted(truth.replace(delay=-0.4e-3, line=True)).errors["without_later_controls"]
    assert late[10] == pytest.approx(past[10], rel=0.15)


def test_a_log_is_cut_where_it_does_not_fly():
    record = simulated(0, duration=5.0)
    y, u = record["y"].copy(), record["u"].copy()
    lies = record.t < 1.0
    y[lies] = -9.0e-3 + 1e-6 * np.random.default_rng(0).standard_normal(lies.sum())
    u[lies] = 0.05
    ends = record.t > 4.6
    u[ends] = 1.7
    made = Record(record.t, {"y": y, "u": u})
    stretches = cut(made, LoopModel(BALL))
    assert stretches[0].begin == 0
    assert {s.kind for s in stretches if s.end <= 1.0} <= {"landed", "fetched", "rest"}
    assert "landed" in {s.kind for s in stretches}
    assert stretches[-1].kind == "saturated"
    (flight,) = flights(made, stretches, BALL)
    assert 1.9 < flight.t[0] < 2.2  # fetched first
    assert 4.4 < flight.t[-1] < 4.6
    assert all(a.end == b.begin for a, b in pairwise(stretches))


def test_logs_that_agree_halve_the_error_of_each_when_four_are_pooled():
    """Of a logarithm, and of what is counted in milliseconds."""
    logs = [SimpleNamespace(
        parameters=named(["magnet_constant", "delay"]), values=np.array([2.0, 1.5e-3]),
        errors=np.array([0.05, 1e-4]), covariance=np.diag([0.05**2, 1e-8]),
    )] * 4  # fmt: skip
    pooled = pool(logs)
    np.testing.assert_allclose(pooled.values, [2.0, 1.5e-3], rtol=1e-9)
    np.testing.assert_allclose(pooled.errors, [0.025, 0.5e-4], rtol=0.01)


def test_the_log_that_is_off_is_named_and_no_other():
    """Truth: logs scatter by 0.1, each is known to 0.05; the last has 2.5 times the magnet."""
    parameters, rng = named(["magnet_constant", "delay"]), np.random.default_rng(2)
    logs = [SimpleNamespace(
        parameters=parameters, errors=np.array([0.05, 1e-4]), covariance=np.diag([0.05**2, 1e-8]),
        values=np.array([k * np.exp(0.11 * rng.standard_normal()),
                         1e-3 + 1e-4 * rng.standard_normal()]),
    ) for k in (1, 1, 1, 1, 2.5)]  # fmt: skip
    off = [deviation(one, pool([x for x in logs if x is not one]), len(logs)) for one in logs]
    assert [one.far for one in off] == [False] * 4 + [True]
    assert off[-1].parameter.name == "magnet_constant"
    assert np.exp(off[-1].difference) == pytest.approx(2.5, rel=0.25)
    assert deviation(logs[-1], pool(logs[:2]), 3) is None  # the scatter is not known


@pytest.mark.long
def test_pooling_finds_the_scatter_between_logs_and_its_error():
    """Truth: logs scatter by 0.2 about 1, each known to 0.05; 200 times 8 logs."""
    parameters = named(["magnet_constant", "delay"])
    rng = np.random.default_rng(1)
    off, scatter, error = [], [], []
    for _ in range(200):
        found = []
        for _ in range(8):
            k = np.exp(0.2 * rng.standard_normal() + 0.05 * rng.standard_normal())
            delay = 1e-3 + 1e-4 * rng.standard_normal()
            found.append(SimpleNamespace(
                parameters=parameters, values=np.array([k, delay]),
                errors=np.array([0.05, 1e-4]), covariance=np.diag([0.05**2, 1e-8]),
            ))  # fmt: skip
        pooled = pool(found)
        off.append(np.log(pooled["magnet_constant"]))
        scatter.append(pooled.scatter)
        error.append(pooled.errors[0])
    assert np.mean(np.array(scatter)[:, 0] ** 2) ** 0.5 == pytest.approx(0.2, rel=0.1)
    assert np.median(np.array(scatter)[:, 1]) < 0.5e-4
    assert np.std(off) == pytest.approx(np.mean(error), rel=0.15)
    assert abs(np.mean(off)) < 3 * np.std(off) / 200**0.5


def test_an_arx_model_finds_one_and_knows_only_the_past():
    rng = np.random.default_rng(0)
    n = 3000
    u, e = rng.standard_normal(n), 0.1 * rng.standard_normal(n)
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = 1.6 * y[k - 1] - 0.7 * y[k - 2] + 0.5 * u[k - 1] + e[k]
    record = Record(1e-3 * np.arange(n), {"y": y, "u": u})
    others = Baselines.joint(Baselines.of([[part] for part in _parts(record)]))
    later = Record(record.t, {"y": y, "u": np.where(np.arange(n) > 2000, 9.0, u)})
    model = LoopModel(BALL)
    for kind in ("arx", "subspace"):
        miss, known = (others.predictions(model, one)[kind][1] for one in (record, later))
        assert np.isnan(miss[: others.layout.lags - 1]).all()
        assert np.nanstd(y[1:] - miss) == pytest.approx(0.1, rel=0.04)
        assert known[2000] == miss[2000]  # from 2000 to 2001


def test_where_offsets_differ_between_logs_the_baselines_are_of_changes():
    """Else those of the other logs would be off wherever a converter has another zero."""
    logs = [simulated(seed) for seed in range(3)]
    moved = [with_changed(log, u=log["u"] + 0.2 * k) for k, log in enumerate(logs)]
    same, off = (Baselines.joint(Baselines.of([[log] for log in of])) for of in (logs, moved))
    assert not any(choice.levels for by in off.chosen.values() for choice in by.values())
    model = LoopModel(BALL)
    for one, other in zip(
        *(
            of.predictions(model, log)["arx"].values()
            for of, log in ((same, logs[2]), (off, moved[2]))
        ),
        strict=True,
    ):
        assert rms(other - one) < 5e-6


def test_what_is_no_corpus_is_refused():
    still = Record(1e-3 * np.arange(3000), {"y": np.full(3000, -9e-3), "u": np.full(3000, -0.9)})
    with pytest.raises(AmbkitError, match="no levitation that is long enough"):
        identify_corpus({"a": still, "b": still}, LoopModel(BALL))


def test_three_logs_on_the_command_line_are_a_corpus(call):
    for seed in range(3):
        simulated(seed, duration=3.0).save(f"{seed}.csv")
    code, out, err = call(
        "identify", "corpus", "inteco_ml", "0.csv", "1.csv", "2.csv", "--free", "magnet_constant",
        "--free", "measurement_noise", "--free", "position_noise", "--free", "disturbance_noise",
        "--out", "found.toml", "--out", "all.html", "--out", "filter=kf.toml",
    )  # fmt: skip
    assert code == 0, err
    assert "Cross-validation: each log predicted by a model of the others" in out
    assert "scatter between logs" in out
    found = Machine.load("found.toml")
    assert found.sensor.position_noise == pytest.approx(-90, abs=25)
    assert (
        "Cross-validation: each log predicted by a model of the others"
        in Path("all.html").read_text()
    )
    assert ambkit.Estimator.load("kf.toml").run(simulated(7)).nis[300:].mean() < 1.3


def moved_along_an_axis(machine, seed, duration):
    random, count = np.random.default_rng(seed), round(100 * duration) + 1
    places = ambkit.Sequence(
        times=0.01 * np.arange(count), values=random.uniform(-5e-5, 5e-5, count)
    )
    return simulate(machine, Scenario(duration=duration, reference=places, seed=seed)).record


def test_an_axis_among_others_is_cut_and_foretold_with_their_forces():
    machine = Machine.preset("ufu_rig")
    start = starting_model(machine, "A2").replace(substeps=1)
    record = start.record(moved_along_an_axis(machine, 1, 0.3))
    assert {s.kind for s in cut(record, start)} == {"flight"}
    assert "flight" not in {s.kind for s in cut(record, LoopModel(start.isolated))}
    past, ahead = 30, 10
    controls = np.lib.stride_tricks.sliding_window_view(record["u"], past + ahead)
    end = past + len(controls) - 1
    seen = start.predict_with(record.between(None, record.t[end]), ahead, controls, past)
    np.testing.assert_allclose(
        seen[:-ahead], start.predict(record, ahead)[past - 1 : end - ahead], atol=1e-9
    )


@pytest.mark.parametrize(
    ("name", "axis"), quick([("tum_mlps", "B2"), ("ufu_rig", "A1")], [], [("ufu_rig", "A1")])
)
def test_three_logs_of_an_axis_among_others_are_a_corpus(name, axis, call):
    machine, logs = Machine.preset(name), ("21.csv", "22.csv", "23.csv")
    for log in logs:
        moved_along_an_axis(machine, int(Path(log).stem), 0.3).save(log)
    code, out, err = call(
        "identify", "corpus", name, *logs, "--axis", axis, "--free", "magnet_constant",
        "--free", "measurement_noise", "--free", "disturbance_noise",
        "--out", "found.toml", "--out", "found.json", "--out", "filter=kf.toml",
    )  # fmt: skip
    assert code == 0, err
    assert f"3 of 3 logs of {axis} are predicted well" in " ".join(out.split())
    k = json.loads(Path("found.json").read_text())["parameters"]["magnet constant"]
    true = machine.isolated_axis(axis).magnet.magnet_constant
    assert k["standard_error"] < 0.05 * true
    assert 0 < abs(k["value"] - true) < 3 * k["standard_error"]
    found = Machine.load("found.toml").isolated_axis(axis).magnet
    assert found.magnet_constant == pytest.approx(k["value"])
    assert np.nanmean(ambkit.Estimator.load("kf.toml").run(ambkit.load("21.csv")).nis[300:]) < 1.3


@pytest.mark.parametrize(
    ("axis", "why"), [((), "name one of them"), (("--axis", "X"), "no axis X")]
)
def test_an_axis_of_a_corpus_is_one_of_the_machine(axis, why, call):
    code, _, err = call("identify", "corpus", "tum_mlps", "a.csv", "b.csv", "c.csv", *axis)
    assert code == 2
    assert "tum_mlps has the axes A1, A2, B1, B2: " in err
    assert why in err


@pytest.mark.skipif(not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)")
@pytest.mark.long
def test_four_logs_of_a_rig_foretell_another_and_the_smoothed_one_is_named():
    channels = recordings.folder() / "closed_loop.toml"
    names = ("sinusoidal_slow-MPC-KF", "step-PID_anti_windup-KF", "sinusoidal_fast-LQI-KF")
    logs = {name: ambkit.load(RIG / f"{name}.mat", channels) for name in names}
    found = identify_corpus(logs, LoopModel(Machine.preset("inteco_ml"), disturbance_noise=1e-4))
    assert "smoothed" in found.left_out["step-PID_anti_windup-KF"]
    for each in found.predictions:
        assert each.good
        assert each.errors["error"][10] < 24.5e-6
        assert 0.9 < each.nis < 1.15
    (hum,) = found.model.isolated.sensor.hum
    assert hum.frequency == pytest.approx(50, abs=0.2)


def with_changed(record, **changes):
    return Record(
        record.t, {name: record[name] for name in record} | changes, record.units, record.meta
    )


@pytest.mark.long
def test_spikes_and_missing_samples_of_logs_spoil_nothing():
    logs = {name: simulated(seed) for seed, name in enumerate("abc", start=1)}
    spiked, lost, cut_off = (logs[name]["y" if name != "c" else "u"].copy() for name in "abc")
    spiked[[1500, 2100]] += 3e-3
    lost[1200:1210] = np.nan
    cut_off[1300:1304] = np.nan
    spoiled = {
        "a": with_changed(logs["a"], y=spiked),
        "b": with_changed(logs["b"], y=lost),
        "c": with_changed(logs["c"], u=cut_off),
    }
    sound, found = (identify_corpus(each, LoopModel(BALL), FREE) for each in (logs, spoiled))
    assert sound.spikes == {}
    assert set(found.spikes) == {"a"}
    assert found.spikes["a"].startswith("2 isolated outliers of the position")
    assert found.to_dict()["spikes"] == dict(found.spikes)
    for one, other in zip(sound.predictions, found.predictions, strict=True):
        for kind in ("error", "without_later_controls", "held", "arx"):
            for ahead, value in one.errors[kind].items():
                assert other.errors[kind][ahead] == pytest.approx(value, rel=0.1), (kind, ahead)
    off = (found.pooled.values - sound.pooled.values) / sound.pooled.values / sound.pooled.errors
    assert np.abs(off).max() < 1.0


def test_a_missing_position_is_the_one_before_and_no_target():
    record = simulated(1, duration=0.5)
    y, layout = record["y"].copy(), Layout(("y", "u"), 30)
    y[200:203] = np.nan
    products = layout.products(with_changed(record, y=y))
    count = layout.past - 1
    whole = layout.products(record)
    lost = whole[count, count] - products[count, count]
    assert lost == 3 * (1 + len(AHEAD)) - 2  # samples 199 to 202, 190 to 192, and 200 to 202 again
