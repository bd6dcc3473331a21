"""The fuzzy basis function network of the core against eq. 32-33 written plainly."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from magnet_at import differences, tangent, through_origin
from oracles import network_output

from ambkit.machine.magnets import core_module

CORE = core_module()


class Network:
    """A random network, as the core has it and as the oracle has it."""

    def __init__(self, rules, seed, *, normalised, narrow=1.0,
                 precision="float64"):  # fmt: skip
        rng = np.random.default_rng(seed)
        self.normalised = normalised
        self.scale = np.array([1.0, 1e3])
        self.box = np.array([[-1.5, 1.5], [-5e-4, 5e-4]])
        self.centres = rng.uniform(self.box[:, 0], self.box[:, 1], (rules, 2)) * self.scale
        self.widths = narrow * rng.uniform(0.2, 0.6, (2, rules))
        self.weights = np.stack([rng.uniform(7, 12, rules), rng.uniform(6e3, 3e4, rules)])
        sharp = 0.5 / self.widths**2
        columns = np.ascontiguousarray(self.centres.T)
        self.core = core_module(precision).Fuzzy(
            columns[0], columns[1], sharp[0], self.weights[0], sharp[1], self.weights[1],
            *self.scale, *self.box.ravel(), self.normalised,
        )  # fmt: skip

    def expected(self, iu, x):
        held = np.clip([iu, x], self.box[:, 0], self.box[:, 1]) * self.scale
        return tuple(
            network_output(held, self.centres, s, w, normalised=self.normalised)
            for s, w in zip(self.widths, self.weights, strict=True)
        )


inputs = (st.floats(-2, 2), st.floats(-8e-4, 8e-4))
networks = st.builds(
    Network, st.sampled_from([1, 2, 3, 25, 63, 64]), st.integers(0, 999), normalised=st.booleans()
)


@given(networks, *inputs)
def test_the_network_is_eq_32_and_33(net, iu, x):
    """Inside its box, and outside as at the nearest point of it."""
    assert through_origin(net.core, iu, x) == pytest.approx(net.expected(iu, x), rel=1e-12)


@given(networks, *inputs)
def test_the_networks_tangent_is_the_slope_of_its_force(net, iu, x):
    assume(np.min(np.abs(net.box[0] - iu)) > 1e-4)
    assume(np.min(np.abs(net.box[1] - x)) > 1e-7)
    scale = np.abs(net.weights).max(axis=1)
    slopes = np.array(differences(net.core, iu, x, 1e-5, 1e-8)) / scale
    assert np.array(tangent(net.core, iu, x)) / scale == pytest.approx(slopes, rel=1e-6, abs=1e-7)


@given(networks, *inputs)
def test_the_basis_functions_make_the_output(net, iu, x):
    at = np.array([iu]), np.array([x])
    for of_k_s, weights in enumerate(net.weights):
        basis = net.core.basis(bool(of_k_s), *at)
        assert basis.shape == (1, len(weights))
        assert (basis >= 0).all()
        if net.normalised:
            assert basis.sum() == pytest.approx(1, rel=1e-13)
        made = float(basis[0] @ weights)
        assert made == pytest.approx(through_origin(net.core, iu, x)[of_k_s], rel=1e-12)


@settings(max_examples=30)
@given(st.integers(0, 999), *inputs)
def test_far_from_every_rule_the_nearest_one_decides(seed, iu, x):
    """Rules as narrow as Table 6 prints some: every membership vanishes in between."""
    net = Network(25, seed, normalised=True, narrow=1e-4)
    held = np.clip([iu, x], net.box[:, 0], net.box[:, 1]) * net.scale
    exponents = np.sum((net.centres - held) ** 2, axis=1) / (2 * net.widths**2)
    for found, weights, e in zip(
        through_origin(net.core, iu, x), net.weights, exponents, strict=True
    ):
        nearest, next_one = np.argsort(e)[:2]
        assume(e[next_one] - e[nearest] > 40)
        assert found == pytest.approx(weights[nearest], rel=1e-12)
    plain = Network(25, seed, normalised=False, narrow=1e-4)
    assert through_origin(plain.core, iu, x) == pytest.approx(
        plain.expected(iu, x), rel=1e-9, abs=1e-290
    )


@pytest.mark.parametrize("normalised", [True, False])
def test_the_tangent_is_finite_far_from_every_rule(normalised):
    net = Network(25, 0, normalised=normalised, narrow=1e-4)
    grid = np.meshgrid(np.linspace(-1.5, 1.5, 31), np.linspace(-5e-4, 5e-4, 31))
    for part in net.core.tangent(*(g.ravel() for g in grid)):
        assert np.isfinite(part).all()


def test_a_network_has_1_to_64_rules_and_arrays_of_one_length():
    with pytest.raises(ValueError, match="1 to 64 rules, got 65"):
        Network(65, 0, normalised=True)
    with pytest.raises(ValueError, match="1 to 64 rules, got 0"):
        Network(0, 0, normalised=True)
    two, three = np.ones(2), np.ones(3)
    with pytest.raises(ValueError, match="has 3 samples, expected 2"):
        CORE.Fuzzy(two, two, two, three, two, two, 1, 1, -1, 1, -1, 1, True)


@pytest.mark.parametrize("normalised", [True, False])
def test_in_single_precision_the_network_is_the_same_to_its_digits(normalised):
    rng = np.random.default_rng(3)
    iu = rng.uniform(-1.8, 1.8, 1000).astype(np.float32)
    x = rng.uniform(-6e-4, 6e-4, 1000).astype(np.float32)
    single = Network(25, 5, normalised=normalised, precision="float32").core
    double = Network(25, 5, normalised=normalised).core
    wide = double.through_origin(iu.astype(float), x.astype(float))
    for low, high in zip(single.through_origin(iu, x), wide, strict=True):
        np.testing.assert_allclose(low, high, rtol=5e-5)
