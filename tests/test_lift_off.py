"""Lift-off points, the law through them, and noise at rest: on made data and on the rig's."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ambkit
from ambkit import Machine
from ambkit.base import files
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data import recordings
from ambkit.data.channel_map import ChannelMap
from ambkit.data.record import Record
from ambkit.identification.forces.lift_off import (
    LiftOff,
    find_lift_off,
    fit_lift_off,
    load_points,
    save_points,
)
from ambkit.identification.noise import measurement_noise
from ambkit.machine.parts import GRAVITY

MASS, CONSTANT, OFFSET = 0.06054, 1.0e-4, 2.1e-3
RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco"
needs_rig = pytest.mark.skipif(not RIG.is_dir(), reason="../shared/data/inteco is not here")


def lift_off_recording(gap, seed=0, noise=15e-6, T=5e-3, rate=0.5):
    """A rotor at rest under a rising current, until it hits the magnet; integrated finely."""
    balance = math.sqrt(MASS * GRAVITY / CONSTANT) * (gap + OFFSET)
    t = T * np.arange(round((balance / rate + 1.0) / T))
    h, z, v, path = T / 10, gap, 0.0, []
    for time in t:
        path.append(z)
        for step in range(10):
            current = rate * (time + step * h)
            v += h * (GRAVITY - CONSTANT / MASS * (current / (z + OFFSET)) ** 2)
            v = max(v, 0.0) if z <= 0 else min(v, 0.0) if z >= gap else v
            z = min(max(z + h * v, 0.0), gap)
    rng = np.random.default_rng(seed)
    measured = np.array(path) + rng.normal(0.0, noise, len(t))
    current = rate * t + rng.normal(0.0, 6e-3, len(t))
    return Record(t, {"z": measured, "i": current}, {"z": "m", "i": "A"})


@pytest.fixture(scope="module")
def made_points():
    gaps = np.linspace(4e-3, 14e-3, 8)
    return [find_lift_off(lift_off_recording(gap, seed), seed) for seed, gap in enumerate(gaps)]


def exact_points(gaps, **changes):
    current = np.sqrt(MASS * GRAVITY / CONSTANT) * (np.asarray(gaps) + OFFSET)
    return [
        LiftOff(run, gap, i, 0.0, gap, 1e-10, **changes)
        for run, (gap, i) in enumerate(zip(gaps, current.tolist(), strict=True))
    ]


def test_the_law_is_found_again_from_noisy_flights(made_points):
    assert all(point.problem == "" for point in made_points)
    fit = fit_lift_off(made_points, MASS)
    assert fit.magnet_constant == pytest.approx(CONSTANT, rel=0.03)
    assert fit.gap_offset == pytest.approx(OFFSET, abs=0.15e-3)
    assert np.abs(fit.residuals).max() < 0.02 * fit.current(14e-3)
    assert [p.noise_variance for p in made_points] == pytest.approx([225e-12] * 8, rel=0.2)


def test_recordings_of_flights_give_a_bearing_on_the_command_line(call):
    names = []
    for seed, gap in enumerate(np.linspace(5e-3, 13e-3, 5)):
        lift_off_recording(gap, seed).save(f"{seed}.csv")
        names.append(f"{seed}.csv")
    still = lift_off_recording(9e-3, 9).between(None, 0.4)
    still.save("still.csv")
    Path("map.toml").write_text(
        "".join(f'[signals.{name}]\ncolumn = "{name}"\nunit = "{unit}"\n'
                for name, unit in (("t", "s"), ("z", "m"), ("i", "A")))
    )  # fmt: skip
    words = ["identify", "lift-off", "inteco_ml", *names, "still.csv", "--operating-point",
             "10 mm", "--out", "law.toml", "--plot", "law.png"]  # fmt: skip
    refused = call(*words)
    assert refused.code == 2
    assert "recordings need a channel map" in refused.err
    told = call(*words, "--channels", "map.toml")
    assert told.code == 0
    assert "points left out" in told.out
    assert "still.csv: it does not fly up" in told.out
    found = Machine.load("law.toml").magnet
    assert found.magnet_constant == pytest.approx(CONSTANT, rel=0.1)
    assert found.air_gap == pytest.approx(10e-3 + OFFSET, rel=0.05)
    assert Path("law.png").is_file()


def test_exact_points_give_the_exact_law():
    fit = fit_lift_off(exact_points([0.002, 0.005, 0.011, 0.017]), MASS)
    assert fit.magnet_constant == pytest.approx(CONSTANT, rel=1e-12)
    assert fit.gap_offset == pytest.approx(OFFSET, rel=1e-12)
    assert fit.operating_point(0.01) == pytest.approx(
        (0.01 + OFFSET, math.sqrt(MASS * GRAVITY / CONSTANT) * (0.01 + OFFSET))
    )


@given(st.floats(1e-3, 1e3))
def test_the_unit_of_length_does_not_matter(scale):
    gaps = [0.002, 0.005, 0.0072, 0.011, 0.017]
    points = [
        replace(p, current=p.current * w)
        for p, w in zip(exact_points(gaps), (1, 1.02, 0.99, 1.01, 1.2), strict=True)
    ]
    here = fit_lift_off(points, MASS)
    there = fit_lift_off([replace(p, gap=p.gap * scale) for p in points], MASS)
    assert there.gap_offset == pytest.approx(here.gap_offset * scale, rel=1e-9)
    assert there.magnet_constant == pytest.approx(here.magnet_constant * scale**2, rel=1e-9)
    np.testing.assert_allclose(there.weights, here.weights, rtol=1e-6)


def test_an_outlier_hardly_moves_the_law():
    points = exact_points(np.linspace(0.004, 0.016, 12).tolist())
    rng = np.random.default_rng(1)
    points = [replace(p, current=p.current * (1 + rng.normal(0, 0.002))) for p in points]
    spoilt = [*points[:10], replace(points[10], current=1.5 * points[10].current), points[11]]
    fit = fit_lift_off(spoilt, MASS)
    assert fit.magnet_constant == pytest.approx(CONSTANT, rel=0.02)
    assert fit.weights[10] < 0.05
    gaps = np.array([p.gap for p in spoilt])
    slope, _ = np.polyfit(gaps, [p.current for p in spoilt], 1)
    assert abs(MASS * GRAVITY / slope**2 / CONSTANT - 1) > 0.05  # what plain least squares gives


def test_standard_errors_cover_the_truth():
    rng = np.random.default_rng(2)
    points = exact_points(np.linspace(0.004, 0.016, 15).tolist())
    scores = []
    for _ in range(200):
        noisy = [replace(p, current=p.current + rng.normal(0, 0.01)) for p in points]
        fit = fit_lift_off(noisy, MASS)
        scores.append((fit.gap_offset - OFFSET) / fit.standard_errors["gap_offset"])
    assert 0.8 < np.std(scores) < 1.4
    assert abs(np.mean(scores)) < 0.3


def test_what_cannot_be_used_is_left_out_and_named():
    points = exact_points([0.002, 0.005, 0.008, 0.011, 0.017])
    points[1] = replace(points[1], problem="because", current=math.nan)
    fit = fit_lift_off(points, MASS, gap_range=(0.001, 0.012))
    assert fit.left_out == {1: "because", 4: "outside of 1 to 12 mm"}
    assert len(fit.points) == len(fit.residuals) == 3
    with pytest.raises(RecordError, match="2 lift-off points are left, at least 3"):
        fit_lift_off(points, MASS, gap_range=(0.001, 0.009))
    falling = [replace(p, current=1 / p.gap) for p in exact_points([0.002, 0.005, 0.008])]
    with pytest.raises(RecordError, match="does not grow"):
        fit_lift_off(falling, MASS)


def test_recordings_without_a_lift_off():
    whole = lift_off_recording(8e-3)
    still = whole.between(stop=1.0)
    assert find_lift_off(still, 3).problem == "it does not fly up"
    flight = float(whole.t[np.argmax(whole["z"] < 4e-3)])
    late = whole.between(flight - 0.05)
    assert find_lift_off(late).problem in (
        "the recording does not show it at rest",
        "it does not fly up",
    )
    z = np.minimum(whole["z"], 7.9e-3)
    beyond = Record(whole.t, {"z": z, "i": whole["i"]}, whole.units)
    assert find_lift_off(beyond).problem == "it rests beyond the range of the sensor"
    z = whole["z"].copy()
    z[3] = np.nan
    gap = Record(whole.t, {"z": z, "i": whole["i"]}, whole.units)
    assert find_lift_off(gap).problem == "samples are missing"
    assert math.isnan(find_lift_off(gap).gap)


def test_a_lift_off_of_which_the_samples_are_lost():
    whole = lift_off_recording(8e-3, noise=2e-6)
    z, lost = whole["z"].copy(), np.argmax(whole["z"] < 7.98e-3)
    hit = np.argmax(z < 1e-3)
    z[lost:hit] = 1e-3
    assert find_lift_off(Record(whole.t, {"z": z, "i": whole["i"]}, whole.units)).problem == (
        "samples are missing where it takes off"
    )


def test_points_round_trip(tmp_path, made_points):
    points = [*made_points, replace(made_points[0], run=12, problem="lost, or so")]
    for ending in (".csv", ".parquet"):
        save_points(tmp_path / f"points{ending}", points)
        assert load_points(tmp_path / f"points{ending}") == points
    (tmp_path / "other.csv").write_text("run [1],z [mm]\n1,2\n")
    with pytest.raises(RecordError, match="has no column i; it has run, z"):
        load_points(tmp_path / "other.csv")


def noise_record(values, T=1e-3):
    return Record(T * np.arange(len(values)), {"y": values})


def white(n=20_000, seed=0):
    return np.random.default_rng(seed).normal(0.0, 1e-5, n)


def test_noise_of_white_noise():
    noise = measurement_noise(noise_record(white()))
    assert noise.variance == pytest.approx(1e-10, abs=4 * noise.standard_error)
    assert noise.standard_error == pytest.approx(1e-12, rel=0.1)
    assert noise.standard_deviation == pytest.approx(1e-5, rel=0.02)
    assert (noise.signal, noise.unit, noise.samples) == ("y", "m", 20_000)
    assert noise.quantisation_step is None
    assert sum(noise.dropped.values()) == 0


def test_noise_leaves_out_what_is_not_noise():
    y = white()
    y[10:20] = np.nan
    y[2000:6000] = 0.02  # saturated
    y[6000:9000] += 1e-3 * np.sin(np.arange(3000) / 50)
    y[[12_345, 17_000]] = 5e-3  # outliers
    y += np.linspace(0, 1e-4, y.size)  # drift
    y[2000:6000] = 0.02
    noise = measurement_noise(noise_record(y))
    assert noise.variance == pytest.approx(1e-10, rel=0.06)
    assert noise.dropped["missing"] == 10
    assert noise.dropped["frozen"] == 4000
    assert noise.dropped["in motion"] == 3000
    assert noise.dropped["outliers"] == 2 * 500
    assert noise.samples + sum(noise.dropped.values()) == y.size


def test_noise_quantisation():
    step = 4e-6
    noise = measurement_noise(noise_record(step * np.round(white() / step)))
    assert noise.quantisation_step == pytest.approx(step)
    assert noise.variance == pytest.approx(1e-10 + step**2 / 12, rel=0.05)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full(1000, 0.02), "of 1000 samples 1000 frozen at 20 mm"),
        (1e-3 * np.sin(np.arange(1000) / 40), "of 1000 samples 1000 in motion"),
        (np.full(1000, np.nan), "of 1000 samples 1000 missing"),
        (white(15), "for 500 samples"),
        (white(2000) + np.where(np.arange(2000) % 250 == 9, 1e-4, 0.0), "2000 outliers"),
    ],
)
def test_noise_that_cannot_be_seen(values, message):
    with pytest.raises(RecordError, match=message):
        measurement_noise(noise_record(values))


@given(st.floats(1e-9, 1e9), st.integers(0, 5))
def test_noise_scales_with_the_square(scale, seed):
    y = white(3000, seed)
    here = measurement_noise(noise_record(y)).variance
    assert measurement_noise(noise_record(y * scale)).variance == pytest.approx(here * scale**2)


def test_the_shipped_recordings():
    folder = recordings.folder()
    fit = fit_lift_off(load_points(folder / "lift_off_points.csv"), MASS, gap_range=(4e-3, 16e-3))
    assert len(fit.points) == 11
    assert fit.magnet_constant == pytest.approx(1.0e-4, rel=0.01)
    assert fit.gap_offset == pytest.approx(2.15e-3, rel=0.01)
    assert np.abs(fit.residuals).max() < 0.02

    # The operating point of the maps is that of the law.
    loop = ChannelMap.load(folder / "closed_loop.toml").signals
    assert loop["u"].offset == f"{-fit.operating_point(0.01)[1]:.4f} V"
    assert loop["iu_logged"].offset == loop["u"].offset.replace("V", "A")

    rest = Record.load(folder / "rest.csv")
    noise = measurement_noise(rest, "i")
    assert noise.variance == pytest.approx(4.2e-5, rel=0.1)  # as the rig's authors found
    assert noise.quantisation_step == pytest.approx(2.53e-3, rel=0.01)
    with pytest.raises(RecordError, match=r"z is nowhere at rest .* 2000 frozen at 20 mm"):
        measurement_noise(rest, "z")

    for name in ("sinus_no_filter.csv", "sinus_kalman.csv"):
        record = Record.load(folder / name)
        assert len(record) == 4000
        assert record.sampling_time == pytest.approx(1e-3)
        assert not record.has_truth
        assert np.abs(record["y"] - record["r"]).max() < 0.5e-3
    assert sum(file.stat().st_size for file in folder.iterdir()) < 600_000


def test_recordings_that_were_not_installed(monkeypatch):
    monkeypatch.setattr(files, "_PACKAGE", Path("/nowhere/src/ambkit"))
    with pytest.raises(AmbkitError, match="not there: /nowhere"):
        recordings.folder()


@needs_rig
def test_the_shipped_recordings_are_what_the_script_makes(tmp_path):
    here = recordings.folder()
    spec = importlib.util.spec_from_file_location("convert", here / "convert.py")
    convert = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(convert)
    convert.convert(RIG, tmp_path)
    made = sorted(file.name for file in tmp_path.iterdir())
    assert made == sorted(file.name for file in here.glob("*.csv"))
    for name in set(made) - {"lift_off_points.csv"}:
        assert (tmp_path / name).read_bytes() == (here / name).read_bytes()
    for made_point, shipped in zip(
        load_points(tmp_path / "lift_off_points.csv"),
        load_points(here / "lift_off_points.csv"),
        strict=True,
    ):  # computed, and so the same to rounding alone
        assert made_point.problem == shipped.problem
        assert made_point.gap == pytest.approx(shipped.gap, rel=1e-9)
        assert made_point.current == pytest.approx(shipped.current, rel=1e-9)
        assert made_point.noise_variance == pytest.approx(shipped.noise_variance, rel=1e-9)


@needs_rig
def test_the_noise_file_of_the_rig_shows_the_current_alone():
    channel_map = ChannelMap.load(recordings.folder() / "lift_off.toml")
    record = ambkit.load(RIG / "noises.mat", channel_map)
    assert measurement_noise(record, "i").variance == pytest.approx(4.0e-5, rel=0.03)
    with pytest.raises(RecordError, match=r"9\d\d\d frozen, \d+ in motion at 20 mm"):
        measurement_noise(record, "z")
