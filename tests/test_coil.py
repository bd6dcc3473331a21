"""A coil from steps of its control signal: found where the truth is known, and on a real one."""

from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit import Machine, Record, RecordError
from ambkit.data import recordings
from ambkit.identification.coil import NAMES, Coil, fit_coil

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "inductance"
TRUE = Coil(2.7, 0.05, 26e-3, 8e-3, 6e-3, 1.7e-3, 0.02)
T = 5e-3
UNITS = {"z": "m", "i": "A", "u": "V"}


def stepped(z, seed, noise=6e-3):
    """Integrated in steps of 10 us by Euler, with the diode; the textbook's way."""
    u = np.repeat(np.ravel(np.column_stack([[0.0] * 5, [0.2, 0.4, 0.6, 0.8, 1.0]])), 100)
    fine, late = 500, round(TRUE.delay / 1e-5)
    target = TRUE.gain * (np.repeat(u, fine) - TRUE.dead_zone)
    target = np.r_[np.full(late, target[0]), target[: target.size - late]]
    share, i, current = 1e-5 / float(TRUE.time_constant(z)), 0.0, np.empty(u.size)
    for k, asked in enumerate(target.tolist()):
        if k % fine == 0:
            current[k // fine] = i
        i = max(i + share * (asked - i), 0.0)
    rng = np.random.default_rng([seed, 16])
    t = T * np.arange(u.size)
    i_measured = current + TRUE.zero + noise * rng.standard_normal(u.size)
    return Record(t, {"z": np.full(u.size, z), "i": i_measured, "u": u}, UNITS)


@pytest.fixture(scope="module")
def logs():
    return [stepped(z, seed) for seed, z in enumerate((1e-3, 4e-3, 9e-3, 18e-3))]


def test_its_current_is_that_of_a_fine_integration():
    record = stepped(5e-3, 0, noise=0.0)
    np.testing.assert_allclose(TRUE.current(record), record["i"], atol=4e-4)


def test_it_is_found_within_its_errors(logs):
    fit = fit_coil(logs, ["a", "b", "c", "d"])
    for name in NAMES:
        off = (getattr(fit.coil, name) - getattr(TRUE, name)) / fit.standard_errors[name]
        assert abs(off) < 4, name
    assert fit.residual_rms == pytest.approx(6e-3, rel=0.05)
    assert fit.noise == pytest.approx(6e-3, rel=0.1)
    assert max(fit.left_out.values()) < 8e-3
    assert fit.distance["c"] == pytest.approx(9e-3)


def test_a_bearing_is_driven_through_it(logs):
    fit = fit_coil(logs[:2])
    known = Machine.preset("inteco_ml")
    driven = fit.machine(known, 10e-3)
    assert driven.amplifier.gain == fit.coil.gain
    tau = 26e-3 + 8e-3 * np.exp(-10 / 6)
    assert 1 / (2 * np.pi * driven.amplifier.bandwidth) == pytest.approx(tau, rel=0.1)
    assert driven.delay == pytest.approx(1.7e-3, rel=0.2)
    assert driven.amplifier.noise_variance == pytest.approx((6e-3 / fit.coil.gain) ** 2, rel=0.2)
    hover = (known.magnet.bias_current + 0.0) / 2.7 + 0.05  # control that gives the bias current
    assert -fit.offset(known) == pytest.approx(hover, rel=0.01)
    states = [state.name for state in ambkit.ExtendedKalmanFilter(driven).states]
    assert "i" in states


def test_what_tells_nothing_of_a_coil_is_refused(logs):
    def other(**signals):
        given = {name: logs[0][name] for name in ("z", "i", "u")} | signals
        return Record(logs[0].t, given, UNITS)

    noise = np.random.default_rng(0).normal(size=len(logs[0]))
    for bad, told in (
        ([], "no log"),
        ([logs[0].select("i", "u")], "lacks z"),
        ([other(u=0 * noise)], "never changes"),
        ([other(i=noise)], "too constant"),
        ([other(z=np.where(noise > 2, np.nan, noise))], "samples of z are missing"),
    ):
        with pytest.raises(RecordError, match=told):
            fit_coil(bad)


@pytest.mark.skipif(not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)")
@pytest.mark.long
def test_a_real_coil_to_the_noise_of_its_current():
    channels = recordings.folder() / "coil.toml"
    paths = sorted(RIG.glob("*.mat"))
    fit = fit_coil([ambkit.load(path, channels) for path in paths], [p.stem for p in paths])
    assert fit.residual_rms < 9e-3
    beyond = [fit.left_out[name] for name, z in fit.distance.items() if z > 6e-3]
    assert max(beyond) < 12e-3
    assert fit.coil.gain == pytest.approx(2.764, abs=0.01)
