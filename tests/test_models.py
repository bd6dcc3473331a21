"""Composed models: of a pattern that the kind of machine alone decides."""

import math
import pickle
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np
import pytest
from filter_cases import BEARING
from model_cases import Axis, machine
from model_oracles import random_model, random_settings

from ambkit.models import NUMBER, ONE, ZERO, compose, machine_model
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.model import compressed_rows
from ambkit.models.parts import PARTS, ColouredNoise, Delay, Disturbance, MagnetForce, Rotor, Sensor
from ambkit.models.sampling import Sampling

# ---- patterns ----


def test_the_pattern_is_of_the_kind_not_of_the_numbers():
    keys = {Axis(m=m, K_sen=K, lag=lag).model().pattern_key()
            for m, K, lag in ((0.5, 1.0, 1e-4), (30.0, -2.0, 1e-9), (1.0, 1.0, 1e3))}  # fmt: skip
    assert len(keys) == 1
    still, turning = compose(machine(speed=0.0), 1e-4), compose(machine(), 1e-4)
    assert still.pattern_key() == turning.pattern_key()
    one, whole = Axis(delay=0.3e-4).model(), Axis(delay=1e-4).model()
    assert one.pattern_key() == whole.pattern_key()
    assert (whole.d[0, 0], whole.pattern["d"][0, 0]) == (pytest.approx(0, abs=1e-15), NUMBER)
    kinds = [Axis(), Axis(lag=None), Axis(bandwidth=1e3), Axis(delay=1e-4), Axis(delay=1.1e-4)]
    assert len({case.model().pattern_key() for case in kinds}) == len(kinds)


def test_the_paper_s_axis_has_the_paper_s_pattern():
    pattern = machine_model(BEARING).pattern
    known = {
        "L": [[1, 2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [2, 2, 0, 2]],
        "b": [[2], [2], [0], [2]], "B_u": [[0]] * 4, "h": [[1, 2, 0, 0]], "e": [[0] * 4],
        "d": [[1]], "r": [[0, 0, 1, 0]], "c": [[0, 0, 0, 1]],
        "rest": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [2, 0, 0, 0]],
    }  # fmt: skip
    assert (ZERO, ONE, NUMBER) == (0, 1, 2)
    for name, kinds in known.items():
        np.testing.assert_array_equal(pattern[name], kinds, name)


def test_compressed_rows_hold_the_whole_pattern():
    for model in (machine_model(BEARING), random_model(3, 12, 2, 3)):
        for name in ("L", "b", "h", "c", "d"):
            start, column, value = compressed_rows(
                getattr(model, name), model.pattern[name] != ZERO
            )
            dense, kinds = np.zeros_like(getattr(model, name)), np.zeros(getattr(model, name).shape)
            for i in range(len(dense)):
                at = slice(start[i], start[i + 1])
                assert column[at] == sorted(set(column[at]))
                dense[i, column[at]], kinds[i, column[at]] = value[at], 1
            np.testing.assert_array_equal(dense, getattr(model, name))
            np.testing.assert_array_equal(kinds, model.pattern[name] != ZERO)


def test_what_a_pattern_says_the_numbers_hold_to():
    model = machine_model(BEARING)
    with pytest.raises(ValueError, match="r has other numbers where its pattern says 0 or 1"):
        replace(model, r=2 * model.r)
    with pytest.raises(ValueError, match=r"b must be of shape \(4, 1\), is of \(3, 1\)"):
        replace(model, b=model.b[:3])
    with pytest.raises(ValueError, match="L must be finite"):
        replace(model, L=model.L * np.where(model.pattern["L"] == NUMBER, np.nan, 1))
    with pytest.raises(ValueError, match="read-only"):
        model.L[0, 0] = 2.0
    with pytest.raises(KeyError, match="no state q; there are x, v, f_d, x_m"):
        model.index("q")


# ---- rest ----


@pytest.mark.parametrize("case", [
    Axis(), Axis(bandwidth=2000.0), Axis(delay=2.7e-4), Axis(delay=1.5e-4, bandwidth=500.0),
], ids=repr)  # fmt: skip
def test_at_rest_nothing_moves(case):
    """The same current demanded for long, forces in balance, the rotor somewhere."""
    model = case.model()
    free = {"x": 3e-4, "f_d": 2.0} | {"u_1": 0.7} | ({"i": 0.7} if not case.delay else {})
    X = model.rest @ [free.get(at.name, 0.0) for at in model.states]
    assert X[model.index("x_m")] == pytest.approx(0.8 * 3e-4)
    got = model.L @ X + model.B_u[:, 0] * 0.7  # forces: the magnet's is -2 N
    size = [at.size for at in model.states]
    np.testing.assert_allclose(got / size, X / size, rtol=0, atol=1e-14)
    assert model.e[0] @ X + model.d[0, 0] * 0.7 == pytest.approx(0.7)
    np.testing.assert_array_equal(model.rest @ model.rest, model.rest)


# ---- from a bearing ----


def test_a_bearing_s_keys_bring_their_parts():
    lines = [{"frequency": at, "amplitude": 5e-6, "bandwidth": 0.5} for at in (50.0, 150.0)]
    model = machine_model(BEARING.replace(
        delay=1.5e-4, amplifier__bandwidth=2000.0, sensor__lag=2e-4, sensor__hum=lines,
        sensor__coloured_noise={"variance": 1e-12, "bandwidth": 200.0},
    ))  # fmt: skip
    assert [at.name for at in model.states] == [
        "x", "v", "f_d", "x_m", "i", "u_1", "u_2", "n_y", "hum_c", "hum_s", "hum2_c", "hum2_s",
    ]  # fmt: skip
    known = Axis(K_sen=1.0, bandwidth=2000.0, delay=1.5e-4, coloured=200.0, hum=(50.0, 0.5)).model()
    np.testing.assert_allclose(model.L[:10, :10], known.L, rtol=1e-9, atol=1e-25)
    assert [at.size for at in model.noises][1:] == pytest.approx([1e-6, *[5e-6 / 2**0.5] * 2])


@dataclass(frozen=True)
class Mount:
    """A part that ambkit does not have: the sensor's holder creeps."""

    rate: float

    @classmethod
    def of(cls, machine, sizes):
        return [cls(3.0)]

    def declare(self, plan):
        plan.state("creep", "m", 1e-6, "noise")
        plan.rate("creep", "creep", -self.rate)
        plan.add_to_reading("y", {"creep": UNIT})


def test_a_new_part_is_one_class_and_its_registration(monkeypatch):
    # The package has a function of the module's name.
    parts = import_module("ambkit.models.machine_parts")
    monkeypatch.setattr(parts, "PARTS", (*PARTS, Mount))
    model = machine_model(BEARING)
    assert [at.name for at in model.states] == ["x", "v", "f_d", "x_m", "creep"]
    assert model.L[4, 4] == pytest.approx(math.exp(-3.0 * model.T))
    np.testing.assert_array_equal(model.c, [[0, 0, 0, 1, 1]])


@pytest.mark.parametrize(("parts", "message"), [
    ([Rotor(1.0, 1.0, 1.0), Rotor(1.0, 1.0, 1.0)], "two of the name x"),
    ([MagnetForce(1.0)], "f pushes at x, which is no position"),
    ([Rotor(1.0, 1.0, 1.0), MagnetForce(1.0, place="v")], "f pushes at v, which is no position"),
    ([Rotor(1.0, 1.0, 1.0), Disturbance(1.0, 1.0)], "f_d is collocated with f, not a magnet"),
    ([ColouredNoise(1.0, 1.0)], "no measurement y"),
    ([Sensor(1.0, 1.0, 1.0)], "no part declares x; there are x_m"),
    ([Rotor(1.0, 1.0, 1.0), Delay(1.0, 1.0)], "no amplifier has the demanded current u"),
    ([Rotor({(0, 0): 0.0}, 1.0, 1.0)], "mass must be symmetric and positive definite"),
])  # fmt: skip
def test_parts_that_do_not_fit_are_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        compose(parts, 1e-3)


def test_a_model_that_was_composed_before_is_kept_and_no_other_one():
    one = [Rotor(1.0, 1.0, 1.0), MagnetForce(1.0), Sensor(1.0, 1.0, 1e-4)]
    assert compose(one, 1e-3) is compose([replace(part) for part in one], 1e-3)
    assert compose(one, 1e-3, name="other").name == "other"
    heavier = compose([Rotor(math.nextafter(1.0, 2.0), 1.0, 1.0), *one[1:]], 1e-3)
    assert (heavier.b != compose(one, 1e-3).b).any()
    assert Sampling(pickle.loads(pickle.dumps(_plan(one)))).model("model").pattern_key() == (
        Sampling(_plan(one)).model("model").pattern_key()
    ), "a one by structure is still one"


def _plan(parts):
    plan = Plan(1e-3)
    for part in parts:
        plan.add(part)
    return plan


# ---- random models ----


@pytest.mark.parametrize(("n", "p", "m"), [(2, 1, 1), (5, 1, 2), (16, 4, 4), (40, 8, 10)])
def test_random_models_are_stable_and_of_all_kinds(n, p, m):
    seen = {}
    for seed in range(20):
        model = random_model(seed, n, p, m)
        s = random_settings(model, seed)
        assert np.abs(np.linalg.eigvals(model.jacobian(s.k_i, s.k_s))).max() < 1
        assert np.linalg.eigvalsh(model.N).min() > -1e-12
        for name, kinds in model.pattern.items():
            seen.setdefault(name, set()).update(np.unique(kinds).tolist())
        assert random_model(seed, n, p, m).pattern_key() == model.pattern_key()
    assert seen["L"] == {ZERO, ONE, NUMBER}
    assert seen["B_u"] >= {ZERO, ONE}
    for name in "hcdr"[: 2 if n < 5 else 4]:
        assert seen[name] == {ZERO, ONE, NUMBER}, name
