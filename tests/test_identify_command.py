"""`ambkit identify` by maximum likelihood as a user meets it; how it judges what it found."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit.identification.dead_time import acting, delayed
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.maximum_likelihood.figures import estimates_figure
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named
from ambkit.identification.maximum_likelihood.validation import cross_correlation, validate
from ambkit.machine.forces.force_points import load_force_points
from ambkit.result.report import Intervals, Rule
from ambkit.workflow.identified_toml import carried_over
from benchmarks.identification import TRUTH, closed_loops


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two short records of one rig, and the bearing that a user would start from."""
    folder = tmp_path_factory.mktemp("made")
    for name, record in zip(("a.csv", "b.csv"), closed_loops(TRUTH, 2, 0.4, first=50), strict=True):
        record.save(folder / name)
    b = TRUTH.isolated
    b.replace(magnet__magnet_constant=1.2 * b.magnet.magnet_constant).save(folder / "start.toml")
    return folder


def test_a_log_becomes_a_bearing_with_errors_and_a_report(call, made, tmp_path):
    code, out, err = call(
        "identify", made / "start.toml", made / "a.csv", "--validate", made / "b.csv", "--free",
        "magnet_constant", "--free", "sensor_lag", "--free", "delay", "--free", "measurement_noise",
        "--free", "control_noise", "--free", "disturbance_noise", "--out", "found.toml", "--out",
        "found.html", "--plot", "found.png",
    )  # fmt: skip
    assert code == 0, err
    assert "95 % interval" in out
    assert "fit, 10 samples ahead" in " ".join(out.split())
    assert "b.csv: The model passes all checks." in out
    found = ambkit.Machine.load("found.toml")
    text = (tmp_path / "found.toml").read_text()
    assert re.search(r'magnet_constant = ".*"  # found, standard error 0\.\d+ N mm\^2/A\^2', text)
    assert "# Of the log: delay = " in text  # which beside a sensor's lag is not told from none
    assert found.delay is None
    k = TRUTH.isolated.magnet.magnet_constant
    assert abs(found.magnet.magnet_constant / k - 1) < 0.15
    page = (tmp_path / "found.html").read_text()
    for heading in ("k_s at operating points", "Validation",
                    "Correlation of the estimates"):  # fmt: skip
        assert heading in page
    assert (tmp_path / "found.png").is_file()


def test_what_is_of_the_log_goes_into_its_channel_map_and_its_delay_into_the_bearing(
    call, made, tmp_path
):
    run = ambkit.Record.load(made / "a.csv")  # with what TRUTH has of the log; here comes more
    late = {"y": run["y"] - TRUTH.position_offset, "u": np.roll(run["u"], -3) + 0.1}
    ambkit.Record(run.t, late).save("log.csv")
    code, out, err = call(
        "identify", made / "start.toml", "log.csv", "--out", "found.toml", "--free",
        "magnet_constant", "--free", "delay", "--free", "current_offset", "--free",
        "disturbance_noise", "--initial-disturbance", "0.05 N",
    )  # fmt: skip
    assert code == 0, err
    assert "the necessary changes of the channel map" in " ".join(out.split())
    text = (tmp_path / "found.toml").read_text()
    lines = [line.removeprefix("#   ") for line in text.splitlines() if line.startswith("#   ")]
    assert re.search(r'^delay = "0\.5\d* ms"  # found, standard error ', text, re.M)
    assert re.search(r"# The bearing has a delay of 0\.5\d* ms, which its filters know", text)
    channels = {"t": "s", "y": "m", "u": "V"}
    parts = []
    for column, unit in channels.items():
        parts += [f"[signals.{column}]", f'column = "{column}"', f'unit = "{unit}"']
        if column == "u":
            assert lines[0] == "[signals.u]"  # of y there is nothing
            parts += lines[1:]
    (tmp_path / "map.toml").write_text("\n".join(parts))
    read = ambkit.load("log.csv", "map.toml")
    right = TRUTH.corrected(run)
    inner = slice(10, -10)
    acts = acting(ambkit.Machine.load("found.toml"), read["u"])
    off, before = (u[inner] - right["u"][inner] for u in (acts, late["u"]))
    assert abs(off.mean()) < 0.02  # of 0.14 V, drawn towards none by what is known beforehand
    assert off.std() < 0.1 * before.std()
    np.testing.assert_allclose(read["y"], right["y"], atol=1e-12)
    option = re.search(r'--disturbance-noise "(.*)"', text)[1]
    code, _, err = call("filter", "log.csv", "--channels", "map.toml", "--machine", "found.toml",
                        "--disturbance-noise", option, "--filter", "closed-law")  # fmt: skip
    assert code == 0, err
    assert "tuned" not in err


def test_the_lines_for_the_map_do_what_the_model_does(tmp_path):
    b = TRUTH.isolated
    model = LoopModel(b, delay=2.3 * b.sampling_time, position_offset=7e-6, current_offset=-0.2)
    rng = np.random.default_rng(0)
    t = b.sampling_time * np.arange(200)
    log = ambkit.Record(t, {"y": rng.normal(0, 1e-5, 200), "u": rng.normal(0, 1, 200)})
    log.save(tmp_path / "log.parquet")
    lines = [line.removeprefix("  ") for line in carried_over(model) if line.startswith("  ")]
    text = "\n".join(['[signals.t]\ncolumn = "t"\nunit = "s"', *lines])
    for name, unit in (("y", "m"), ("u", "V")):
        place = f"[signals.{name}]"
        text = text.replace(place, f'{place}\ncolumn = "{name}"\nunit = "{unit}"')
    (tmp_path / "map.toml").write_text(text)
    read = ambkit.load(tmp_path / "log.parquet", tmp_path / "map.toml")
    expected = model.corrected(log)
    for name in ("y", "u"):
        np.testing.assert_allclose(read[name][5:], expected[name][5:], rtol=1e-5, atol=1e-10)


def test_a_force_map_goes_into_the_training(call, made, tmp_path):
    code, out, err = call(
        "identify", made / "start.toml", made / "a.csv", "--free", "magnet_constant", "--out",
        "found.toml", "--out", "force-map=force.csv", "--nodes", "6x4",
    )  # fmt: skip
    assert code == 0, err
    assert "Force map: 6x4 nodes, of which the records determine" in out
    code, out, err = call("train", "map", "found.toml", "force.csv", "--rules", "3x3")
    assert code == 0, err
    points = len(load_force_points("force.csv"))
    assert f"{points} points" in out


def test_json_has_all_figures_in_si(call, made):
    import json

    code, out, _ = call(
        "identify", made / "start.toml", made / "a.csv", made / "b.csv", "--free",
        "magnet_constant", "--free", "mass", "--free", "disturbance_noise", "--json",
    )  # fmt: skip
    assert code == 0
    found = json.loads(out)
    assert "cannot be told apart" in found["held"]["mass"]
    k = found["parameters"]["magnet_constant"]
    low, high = k["interval_95"]
    assert low < k["value"] == found["magnet_constant"] < high
    assert found["correlation"][0][0] == pytest.approx(1)
    both = [ambkit.Record.load(made / name) for name in ("a.csv", "b.csv")]
    start = ambkit.Machine.load(made / "start.toml")
    mean = np.mean([record["u"] for record in both]) * start.amplifier.gain
    assert found["stiffness"]["current"] == pytest.approx(mean)  # no offset, no delay is free
    points = found["operating_points"]
    k_i, error = np.array(points["k_i"]["value"]), np.array(points["k_i"]["standard_error"])
    assert k_i.shape == error.shape == (len(points["displacement"]), len(points["current"]))
    # Of the closed law, k_i is k times a function of the place: their relative errors are one.
    np.testing.assert_allclose(error / k_i, k["standard_error"] / k["value"], rtol=1e-4)
    assert not found["validated_on_other_records"]
    assert [check["record"] for check in found["validation"]] == ["a.csv", "b.csv"]


def test_noise_at_rest_is_the_start_and_its_colour_is_told(call, made):
    rng = np.random.default_rng(3)
    y = rng.normal(0, 3e-6, 20_000)
    y = np.convolve(y, [0.9, 0.436], mode="same")
    still = ambkit.Record(1e-4 * np.arange(20_000), {"y": y, "u": np.zeros(20_000)})
    still.save("rest.csv")
    code, out, err = call(
        "identify", made / "start.toml", made / "a.csv", "--rest", "rest.csv", "--free",
        "magnet_constant", "--free", "disturbance_noise",
    )  # fmt: skip
    assert code == 0, err
    assert re.search(r"y +[23][.0-9]* µm +coloured: 1 sample apart it correlates by \+0\.[34]", out)
    assert "u is nowhere at rest" in out
    # The bench has it under another name, in another unit, and the records need no map.
    rows = np.column_stack([np.arange(20_000) / 10, 1e6 * y])
    np.savetxt("bench.csv", rows, "%.6g", ",", header="ms,pos", comments="")
    Path("bench.toml").write_text(
        '[signals.t]\ncolumn = "ms"\nunit = "ms"\n[signals.y]\ncolumn = "pos"\nunit = "µm"\n'
    )
    code, mapped, err = call(
        "identify", made / "start.toml", made / "a.csv", "--rest", "bench.csv@bench.toml", "--free",
        "magnet_constant", "--free", "disturbance_noise",
    )  # fmt: skip
    assert code == 0, err
    of_y = re.compile(r"y .* +coloured")
    assert of_y.search(mapped)[0] == of_y.search(out)[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("identify B A --free k", "there is no parameter k; there are magnet_constant"),
        ("identify B A --validate A", "a model is judged on a record that it has not"),
        ("identify online B A --free k", "there is no option --free"),
        ("identify B A --disturbance 1N", "there is no option --disturbance"),
        ("identify online B A A --method adaline", "unrecognized arguments"),
        ("identify B A --out r.pdf", "must end with .toml or"),
        (
            "identify B A --out force-map=f.csv --nodes 3x9",
            "must be nodes along current and displacement such as 9x7, 4 to 33 each, is '3x9'",
        ),
        ("identify B A --window ,5ms", "samples"),
        ("identify inteco_ml A", "sampled every 0.0001 s"),
    ],
)
def test_what_the_user_did_wrong_is_one_message(call, made, tmp_path, arguments, message):
    words = [str(made / f"{dict(A='a.csv', B='start.toml')[w]}") if w in "AB" else w
             for w in arguments.split()]  # fmt: skip
    code, out, err = call(*words)
    assert code == 2
    assert message in err
    assert out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def record():
    return closed_loops(TRUTH, 1, 0.6, first=80)[0]


def test_the_truth_passes_and_what_is_wrong_is_named(record):
    good = validate(TRUTH, record, name="r", settling=0.01)
    assert good.good, good.verdict
    assert good.verdict == "The model passes all checks."
    assert good.fit()[10] > good.fit("held")[10]
    late = validate(replace(TRUTH, delay=8e-4), record, start=TRUTH, settling=0.01)
    assert not late.good
    assert late.gain < 0
    assert "The initial model was more likely" in late.verdict
    deaf = validate(
        TRUTH.replace(sensor__noise_variance=100 * TRUTH.isolated.sensor.noise_variance), record
    )
    assert not deaf.good
    assert "smaller than expected" in deaf.verdict


def test_prediction_is_that_of_the_plain_filter_with_single_steps(record):
    """Against the estimators' own forecast, on the model whose log has neither delay nor offset."""
    # Next to no control noise: else the model's force is its mean under the noise.
    b = TRUTH.isolated.replace(amplifier__noise_variance=1e-14)
    model = LoopModel(b, substeps=1, delay=b.sampling_time)
    kalman = ambkit.ExtendedKalmanFilter(
        b, noise=ambkit.FilterNoise(disturbance=model.disturbance_noise), outlier_limit=0
    )
    u = delayed(record["u"], 1.0)
    shifted = ambkit.Record(record.t, {"y": record["y"], "u": u})
    expected = kalman.forecast(kalman.run(shifted), shifted, 10)
    np.testing.assert_allclose(model.predict(record, 10)[50:], expected[50:], rtol=1e-9, atol=1e-12)


def test_cross_correlation_of_what_is_independent_stays_within_its_bound():
    """A control signal with much colour, residuals that know nothing of it; and ones that do."""
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(20):
        u = np.cumsum(rng.normal(size=4000)) * 0.01 + rng.normal(size=4000) * 0.01
        shares.append(cross_correlation(rng.normal(size=4000), u).share_within)
    assert 0.92 < np.mean(shares) < 0.98
    e = rng.normal(size=4000)
    e[3:] += 30 * np.diff(u, prepend=u[0])[:-3]
    found = cross_correlation(e, u)
    assert abs(found.correlation[2]) > 3 * found.bound


def test_the_picture_shows_intervals_beside_the_start(record):
    """Those of the table: of the logarithm for what is positive, so that none goes below zero."""
    found = maximum_likelihood(
        record, replace(TRUTH, delay=0.0), ("magnet_constant", "sensor_lag", "position_offset")
    )
    bearing, offsets = estimates_figure(found).panels
    rows = bearing.item(Intervals)
    for name, low, high in zip(("magnet_constant", "sensor_lag"), rows.low, rows.high, strict=True):
        start = named([name])[0].of(found.start)
        assert (low * start, high * start) == pytest.approx(found.interval(name))
        assert low > 0
    assert [item.value for item in bearing.items if isinstance(item, Rule)] == [1.0]
    assert [item.value for item in offsets.items if isinstance(item, Rule)] == [0.0]
    travel = found.isolated.clearance
    moved = found["position_offset"] - found.start.position_offset
    assert offsets.item(Intervals).values[0] * travel == pytest.approx(moved)
    assert "to" in rows.texts[0]
    assert "N\u00a0mm²/A²" in rows.texts[0]
