"""The machine, sampled: against integration, and against itself in other words."""

from itertools import pairwise

import numpy as np
import pytest
from machine_cases import OF_KILOGRAMS, bearing, directions, integrated, machine, sensor, slopes

from ambkit import Machine, magnet_of
from ambkit.machine.magnets import ConstantStiffness, core_module
from ambkit.models import machine_model
from ambkit.models.parts.magnet import TURN

UNITS = {"m": 1e-4, "rad": 1e-4, "m/s": 1e-1, "rad/s": 1e-1, "N": 10.0, "A": 1.0}


def sized(model):
    return np.array([UNITS[state.unit] for state in model.states])


def fast(name):
    """A preset without delay at 20,000 rpm, which is half a turn in 15 samples."""
    return Machine.preset(name).replace(speed=2094.4, delay=None)


class Truth:
    """The machine's states by name, and their rates, from the equations."""

    def __init__(self, one):
        self.one, self.H = one, directions(one, one.axes)
        self.C = directions(one, one.readings)
        self.gains = np.array([r.sensor.gain for r in one.readings])
        self.lags = np.array([r.sensor.lag for r in one.readings])
        corners = [axis.bearing.amplifier.bandwidth for axis in one.axes]
        self.corner = None if corners[0] is None else 2 * np.pi * np.array(corners)

    def rates(self, state, u, force):
        """State: q, q', lagged readings, currents where they lag."""
        m, n = self.C.shape
        q, w, y = state[:n], state[n : 2 * n], state[2 * n : 2 * n + m]
        current = state[2 * n + m :] if self.corner is not None else u
        a = slopes(self.one, q, w, force(current, self.H @ q))
        out = [w, a, (self.gains * (self.C @ q) - y) / self.lags]
        if self.corner is not None:
            out.append(self.corner * (u - current))
        return np.concatenate(out)


@pytest.mark.parametrize("name", OF_KILOGRAMS)
def test_a_sample_is_exact(name):
    one, rng = fast(name), np.random.default_rng(1)
    one = one.replace(rotor__gravity="none")
    model, truth = machine_model(one), Truth(one)
    size = sized(model)
    X = rng.uniform(-1, 1, len(size)) * size
    u, F = rng.uniform(-1, 1, 4), rng.uniform(-20, 20, 4)
    moving = [i for i, at in enumerate(model.states) if at.role != "disturbance force"]
    got = model.L @ X + model.B_u @ u + model.b @ (F + model.r @ X)
    # Where a mode is fast, a force varies with its current about the mean over the sample.
    fast_modes = one.bending is not None and max(one.bending.frequency) * one.sampling_time > TURN
    k_i = [fast_modes and ConstantStiffness.of(one.isolated_axis(a.name)).k_i for a in one.axes]
    whole, mean = F + model.r @ X, model.e @ X + model.d @ u
    after = integrated(
        lambda t, s: truth.rates(s, u, lambda i, d: whole + k_i * (i - mean)), X[moving],
        (0, one.sampling_time), size[moving],
    )  # fmt: skip
    np.testing.assert_allclose(got[moving] / size[moving], after / size[moving], atol=1e-9)
    # Mean displacement of the free rotor, and mean currents.
    n = len(moving)
    free = integrated(
        lambda t, s: np.r_[truth.rates(s[:n], u, lambda i, d: np.zeros(4)),
                           truth.H @ s[: truth.H.shape[1]],
                           s[n - 4 : n] if truth.corner is not None else u],
        np.r_[X[moving], np.zeros(8)], (0, one.sampling_time), np.r_[size[moving], np.ones(8)],
    )[n:] / one.sampling_time  # fmt: skip
    np.testing.assert_allclose(model.h @ X, free[:4], rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.e @ X + model.d @ u, free[4:], rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", OF_KILOGRAMS)
def test_the_nonlinear_machine_is_met_in_the_second_order(name):
    one = fast(name)
    laws = [magnet_of(one.isolated_axis(axis.name)) for axis in one.axes]
    cores = [law.in_core(core_module()) for law in laws]
    truth, end = Truth(one), 3.2e-3

    def force(i, s):
        return np.array([
            core.force(np.array([a]), np.array([b]))[0]
            for core, a, b in zip(cores, i, s, strict=True)
        ])  # fmt: skip

    rng = np.random.default_rng(2)
    q = np.r_[rng.uniform(-1, 1, 4) * 2e-5, np.zeros(len(one.positions) - 4)]
    start = np.r_[q, np.zeros(len(q)), truth.gains * (truth.C @ q)]
    u = rng.uniform(-0.2, 0.2, 4)
    if truth.corner is not None:
        start = np.r_[start, u / 2]
    exact = integrated(lambda t, s: truth.rates(s, u, force), start, (0, end), 1e-4)
    errors = []
    coarsest = 4e-4 if one.bending is None else 1e-4  # a bending is faster
    for T in (coarsest, coarsest / 2, coarsest / 4):
        model = machine_model(one, T=T)
        moving = [i for i, at in enumerate(model.states) if at.role != "disturbance force"]
        X = np.zeros(len(model.states))
        X[moving] = start
        steady = machine_model(one.replace(rotor__gravity="none"), T=T)
        weight = np.linalg.lstsq(truth.H.T[:4], [-one.rotor.mass * 9.81, 0, 0, 0], rcond=None)[0]
        for _ in range(round(end / T)):
            F = force(model.e @ X + model.d @ u, model.h @ X) + weight
            X = steady.L @ X + steady.B_u @ u + steady.b @ F
        errors.append(np.abs(X[moving][:4] - exact[:4]).max() / np.abs(exact[:4]).max())
    assert errors[-1] < 2e-4
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(4, rel=0.15)


# ---- the same machine in other words ----


def whole(**keys):
    amplifier = {"bandwidth": 2000.0}
    given = {
        "bearing": [
            bearing("A", 0.2, angle=0.5, amplifier=amplifier),
            bearing("B", -0.3, angle=0.5, amplifier=amplifier),
        ],
        "delay": 1.3e-4,
        "speed": 2000.0,
    }
    return machine(**given | keys)


def test_gyroscopics_turn_with_the_rotation():
    """A rotor without forces precesses by I_p W / I_t, the same way as it rotates."""
    one = machine(speed=3000.0)
    forth = machine_model(one)
    back = machine_model(one.replace(speed=-3000.0))
    i, j = forth.index("w_x"), forth.index("w_y")
    assert forth.L[i, j] < 0 < forth.L[j, i]
    assert back.L[i, j] == pytest.approx(-forth.L[i, j], rel=1e-12)
    rate = one.rotor.polar_inertia * 3000.0 / one.rotor.transverse_inertia
    assert forth.L[i, i] == pytest.approx(np.cos(rate * one.sampling_time), rel=1e-12)
    assert forth.L[i, j] == pytest.approx(-np.sin(rate * one.sampling_time), rel=1e-12)


def test_sensors_of_all_kinds_see_along_their_lines():
    one = machine(sensor=[
        sensor("A", 0.25, angle=0.3), sensor("B", -0.3), sensor("S", 0.1, type="single", angle=1.0),
    ])  # fmt: skip
    model, C = machine_model(one), directions(one, one.readings)
    assert [r.name for r in one.readings] == ["A1", "A2", "B1", "B2", "S"]
    at_rest = np.zeros(len(model.states))
    at_rest[:4] = [1e-5, -2e-5, 3e-5, 4e-5]
    np.testing.assert_allclose(model.c @ (model.rest @ at_rest), C @ at_rest[:4], rtol=1e-12)


def test_kinds_of_machines_have_one_pattern():
    keys = {machine_model(whole(speed=speed)).pattern_key() for speed in (0.0, 100.0, 3000.0)}
    assert len(keys) == 1
    assert machine_model(machine()).pattern_key() != machine_model(whole()).pattern_key()
