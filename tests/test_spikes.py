"""Spikes are found where they are, and only there."""

import numpy as np
import pytest
from scipy.signal import max_len_seq

import ambkit
from ambkit import Record
from ambkit.data.channel_map import ChannelMap
from ambkit.data.reading import faults, read
from ambkit.data.reading.faults import spike_free, without_spikes
from ambkit.data.reading.reading_figure import reading_figure
from ambkit.identification.maximum_likelihood import maximum_likelihood
from tests import logs

N = 20_001
T = 1e-4 * np.arange(N)
SMOOTH = 1e-4 * np.sin(2 * np.pi * 3 * T)
MAP = """
[signals.t]
column = "time"
unit = "s"
[signals.y]
column = "pos"
unit = "mm"
[signals.u]
column = "u"
unit = "V"
"""


def noisy(seed=0, rms=1e-6):
    return SMOOTH + rms * np.random.default_rng(seed).normal(size=N)


def found(values, name="y"):
    return [
        (round(fault.start / 1e-4), fault.samples)
        for fault in faults.find(name, values, T[: values.size], "m")
        if fault.kind == "spike"
    ]


@pytest.mark.parametrize("lsb", [0.0, 1e-7, 2e-6])
@pytest.mark.parametrize("height", [9.999e-3, -6e-5])
def test_spikes_are_found_where_they_are(lsb, height):
    values = noisy()
    if lsb:
        values = np.round(values / lsb) * lsb
    at = [(0, 1), (777, 1), (4242, 3), (4250, 1), (9001, 2), (N - 1, 1)]
    for first, length in at:
        values[first : first + length] = values[first : first + length] + height
    assert found(values) == at


def test_a_missing_sample_beside_a_spike_does_not_hide_it():
    values = noisy()
    values[500], values[[497, 501, 502, 1000]] = 0.01, np.nan
    assert found(values) == [(500, 1)]


def test_what_moves_longer_is_no_spike():
    values = noisy()
    values[777:781] = 0.01
    assert found(values) == []


def signals():
    rng = np.random.default_rng(5)
    prbs = 1e-4 * (2.0 * max_len_seq(12, length=N)[0] - 1)
    slow = np.repeat(prbs, 3)[:N]
    steps = np.repeat(rng.integers(-3, 4, size=N // 400 + 1) * 1e-4, 400)[:N]
    pulses = np.zeros(N)
    pulses[::300] = 1e-3
    return {
        "white noise": rng.normal(size=N),
        "Laplace's": rng.laplace(size=N),
        "coarse": np.round(noisy() / 3e-5) * 3e-5,
        "coarse at rest": np.round(0.2 * rng.normal(size=N) + 0.1) * 1e-5,
        "smooth": SMOOTH,
        "binary": prbs,
        "slow binary": slow,
        "noisy binary": prbs + 1e-6 * rng.normal(size=N),
        "slow noisy binary": slow + 1e-6 * rng.normal(size=N),
        "binary on a wave": slow + noisy(),
        "reference": steps,
        "noisy steps": steps + 1e-6 * rng.normal(size=N),
        "rare pulses": pulses,
        "square": 1e-4 * np.sign(np.sin(2 * np.pi * 7 * T + 0.1)),
        "clipped": np.clip(noisy(), -5e-5, 5e-5),
    }


@pytest.mark.parametrize("name", signals())
def test_no_false_alarm(name):
    assert found(signals()[name]) == []


def test_a_control_signal_may_kick_where_its_reference_steps():
    kick = 0.01 * np.random.default_rng(0).normal(size=N)
    kick[5000] = 10.0
    assert found(kick, "u") == []


def test_spikes_are_reported_drawn_and_taken_as_missing(tmp_path):
    values = 1e3 * noisy()
    values[[777, 4242, 9001]] = 9.999
    path = tmp_path / "log.parquet"
    logs.parquet(path, {"time": T, "pos": values, "u": 1e3 * noisy(1)})
    channel_map = ChannelMap.from_toml(MAP)
    kept = read(path, channel_map)
    assert [fault.kind for fault in kept.faults] == ["spike"] * 3
    assert kept.faults[0].text.startswith("9.999 mm amid 98.4 µm")
    assert any("spike in 3 stretches, 3 samples" in line for line in kept.account())
    assert "spike" in [text for text, _ in reading_figure(kept).legend()]
    masked = read(path, channel_map, missing=["spike"])
    lost = np.flatnonzero(np.isnan(masked.record["y"]))
    assert lost.tolist() == [777, 4242, 9001]
    assert masked.faults[0].action == "taken as missing"
    assert "spike" not in [text for text, _ in reading_figure(masked).legend()]


def test_what_is_fitted_does_not_see_them():
    """A single one of 3 mm would make a hundred times the sensor's noise of 6,000 samples."""
    clean = Record(T, {"y": noisy(), "u": np.zeros(N), "x": SMOOTH})
    y = noisy()
    y[[500, 7000, 7001]] += 3e-3
    y[9000] = np.nan
    spiked = Record(T, {"y": y, "u": np.zeros(N), "x": SMOOTH}, meta={"seed": 1})
    cleaned, count = spike_free(spiked)
    assert count == 3
    assert np.flatnonzero(np.isnan(cleaned["y"])).tolist() == [500, 7000, 7001, 9000]
    assert cleaned.meta == spiked.meta
    assert np.isfinite(spiked["y"][500])  # the record itself stays
    assert spike_free(clean) == (clean, 0)
    assert without_spikes([clean]) == ([clean], "")
    _, said = without_spikes([clean, spiked])
    assert said.startswith("3 isolated outliers of the position")


def test_of_a_machine_they_are_taken_from_each_reading():
    a, b = noisy(1), noisy(2)
    b[3000] -= 1e-3
    units = {"y_ax": "m", "y_ay": "m", "u_ax": "V"}
    run = Record(T, {"y_ax": a, "y_ay": b, "u_ax": np.zeros(N)}, units)
    cleaned, count = spike_free(run)
    assert count == 1
    assert np.isnan(cleaned["y_ay"][3000])
    assert np.isfinite(cleaned["y_ax"]).all()


@pytest.mark.parametrize("height", [3e-3, 4e-4])
def test_a_spike_moves_neither_what_is_identified_nor_what_is_tuned(height):
    bearing = ambkit.preset("zittau_axial")
    run = ambkit.simulate(bearing, ambkit.Scenario(duration=0.5)).record
    y = run["y"].copy()
    y[[1234, 4000]] += height
    spiked = Record(run.t, {name: run[name] for name in run} | {"y": y}, run.units, run.meta)
    free = ("measurement_noise", "disturbance_noise")
    found = [maximum_likelihood(r, bearing, free, profile=False) for r in (run, spiked)]
    assert found[0].remarks == []
    assert found[1].remarks == ["2 isolated outliers of the position are omitted"]
    assert found[1].values == pytest.approx(found[0].values, rel=0.02)
    tuned = [ambkit.tune(bearing, [r], "extended", budget=12) for r in (run, spiked)]
    for name, value in tuned[0].values.items():
        assert tuned[1].values[name] == pytest.approx(value, rel=0.1), name
    assert any("isolated outliers" in warning for warning in tuned[1].warnings)
    assert not any("spike" in warning for warning in tuned[0].warnings)
