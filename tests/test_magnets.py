"""The closed law and the table of the core against the plain force law, and differences."""

import iron
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from machine_cases import BEARINGS
from magnet_at import differences, force, tangent, through_origin
from oracles import least_squares_stiffness, magnet_force

from ambkit import Machine
from ambkit.machine.magnets import (
    ClosedLaw,
    ConstantStiffness,
    core_module,
    magnet_of,
    symmetric_current_limit,
)

TWO_SIDED = Machine.preset("zittau_axial")
ONE_SIDED = Machine.preset("inteco_ml")
CLOSED = {"two-sided": TWO_SIDED, "one-sided": ONE_SIDED}
LAWS = CLOSED | {"iron, two-sided": iron.TWO_SIDED, "iron, one-sided": iron.ONE_SIDED}
CORE = core_module()

laws = pytest.mark.parametrize("bearing", LAWS.values(), ids=LAWS)


share = st.floats(-1, 1)


@st.composite
def places(draw, of=tuple(LAWS)):
    """A bearing, a current within its limits and a displacement within its travel."""
    b = LAWS[draw(st.sampled_from(of))]
    low, high = b.current_min, b.current_max
    iu = low + (high - low) * 0.5 * (1 + draw(share))
    return b, iu, b.clearance * draw(share)


# ---- the laws ----


@given(places(tuple(CLOSED)))
def test_the_closed_law_is_eq_1(place):
    b, iu, x = place
    plain = magnet_force(b, iu, x) - magnet_force(b, 0, 0)
    scale = b.magnet.magnet_constant * (2 * b.magnet.bias_current / b.magnet.air_gap) ** 2
    room = {"rel": 1e-13, "abs": 1e-14 * scale}
    assert force(ClosedLaw(b).in_core(CORE), iu, x) == pytest.approx(plain, **room)
    assert ClosedLaw(b).force(iu, x) == pytest.approx(magnet_force(b, iu, x), **room)


@laws
def test_the_law_does_not_cancel_near_the_origin(bearing):
    """Where eq. 1 as printed subtracts equal squares, the force still has all its digits."""
    magnet = magnet_of(bearing).in_core(CORE)
    k_i, k_s = tangent(magnet, 0.0, 0.0)
    for small in (1e-9, 1e-12, 1e-15):
        assert force(magnet, small, 0.0) == pytest.approx(k_i * small, rel=10 * small + 1e-15)
        assert force(magnet, 0.0, 1e-3 * small) == pytest.approx(
            k_s * 1e-3 * small, rel=10 * small + 1e-15
        )


@given(places())
def test_the_tangent_is_the_slope_of_the_force(place):
    b, iu, x = place
    magnet = magnet_of(b).in_core(CORE)
    k_i, k_s = tangent(magnet, iu, x)
    d_i, d_s = differences(magnet, iu, x, 1e-5 * b.magnet.bias_current, 1e-6 * b.magnet.air_gap)
    scale_i, scale_s = tangent(magnet, 0, 0)
    assert k_i == pytest.approx(d_i, rel=1e-8, abs=1e-8 * scale_i)
    assert k_s == pytest.approx(d_s, rel=1e-8, abs=1e-8 * scale_s)


def test_at_the_origin_both_forms_are_the_corrected_eq_4_and_5():
    k, i0, s0 = 6.7e-6, 1.5, 2e-3
    magnet = ClosedLaw(TWO_SIDED).in_core(CORE)
    expected = pytest.approx((4 * k * i0 / s0**2, 4 * k * i0**2 / s0**3), rel=1e-14)
    assert tangent(magnet, 0, 0) == expected
    assert through_origin(magnet, 0, 0) == expected
    assert expected == (10.05, 7537.5)
    constant = ConstantStiffness.of(TWO_SIDED)
    assert (constant.k_i, constant.k_s) == expected


@given(places())
def test_through_the_origin_gives_the_force_exactly(place):
    b, iu, x = place
    magnet = magnet_of(b).in_core(CORE)
    k_i, k_s = through_origin(magnet, iu, x)
    room = 1e-14 * (abs(k_i * iu) + abs(k_s * x))
    assert k_i * iu + k_s * x == pytest.approx(force(magnet, iu, x), rel=1e-13, abs=room + 1e-300)


@pytest.mark.parametrize("bearing", CLOSED.values(), ids=CLOSED)
@pytest.mark.parametrize(
    ("a", "b"), [(0.8, 0.3), (-0.5, 0.5), (0.0, 0.4), (0.6, 0.0), (-0.7, -0.9)]
)
def test_through_the_origin_is_the_limit_of_the_papers_least_squares(bearing, a, b):
    """The nine points of eq. 27 shrink; what is left falls with the square of their distance."""
    iu, x = a * bearing.current_max * 0.5, b * 0.5 * bearing.clearance
    limit = np.array(through_origin(ClosedLaw(bearing).in_core(CORE), iu, x))

    ampere, metre = symmetric_current_limit(bearing)

    def left(step):
        found = least_squares_stiffness(
            lambda i, d: magnet_force(bearing, i, d), iu, x, step * ampere, step * metre
        )
        return np.abs(np.array(found) - limit) / np.abs(limit)

    coarse, fine = left(0.01), left(0.0025)
    assert coarse.max() < 5e-3
    noticed = coarse > 1e-7  # some entries are met at once; the others fall 16-fold
    np.testing.assert_allclose(coarse[noticed] / fine[noticed], 16, rtol=0.05)


def test_constant_stiffness_is_a_straight_force():
    magnet = ConstantStiffness(10.0, 7e3).in_core(CORE)
    assert force(magnet, 0.5, -1e-4) == pytest.approx(10 * 0.5 - 7e3 * 1e-4, rel=1e-15)
    assert through_origin(magnet, 0.5, 1e-4) == tangent(magnet, -1.0, 0) == (10.0, 7e3)


@pytest.mark.parametrize(
    ("k_i", "k_s", "message"), [(np.nan, 1, "k_i must be finite"), (1, np.inf, "k_s")]
)
def test_a_stiffness_that_is_no_number_is_refused(k_i, k_s, message):
    with pytest.raises(ValueError, match=message):
        ConstantStiffness(k_i, k_s)


# ---- the table ----

TABLE_IU, TABLE_X = np.linspace(-1.5, 1.5, 7), np.linspace(-5e-4, 5e-4, 5)


def table(of_k_i, of_k_s):
    iu, x = np.meshgrid(TABLE_IU, TABLE_X)
    return CORE.Table(TABLE_X[0], TABLE_X[1] - TABLE_X[0], TABLE_IU[0], TABLE_IU[1] - TABLE_IU[0],
                      of_k_i(iu, x), of_k_s(iu, x))  # fmt: skip


def k_i_surface(iu, x):
    return 10 + 2 * iu - 3e3 * x + 4e3 * iu * x


def k_s_surface(iu, x):
    return 7e3 - 500 * iu + 1e6 * x - 2e6 * iu * x


@given(st.floats(-3, 3), st.floats(-1e-3, 1e-3))
def test_a_bilinear_surface_comes_back_from_a_table_and_its_edge_is_held(iu, x):
    magnet = table(k_i_surface, k_s_surface)
    at = (np.clip(iu, -1.5, 1.5), np.clip(x, -5e-4, 5e-4))
    k_i, k_s = through_origin(magnet, iu, x)
    assert k_i == pytest.approx(k_i_surface(*at), rel=1e-12)
    assert k_s == pytest.approx(k_s_surface(*at), rel=1e-12)
    assert force(magnet, iu, x) == pytest.approx(k_i * iu + k_s * x, rel=1e-14, abs=1e-300)


@given(st.floats(-2, 2), st.floats(-8e-4, 8e-4))
def test_the_tables_tangent_is_the_slope_of_its_force(iu, x):
    # Not across a node, where the slope jumps.
    assume(np.min(np.abs(TABLE_IU - iu)) > 1e-3)
    assume(np.min(np.abs(TABLE_X - x)) > 1e-6)
    magnet = table(
        lambda i, d: 10 + np.sin(3 * i) + 2e3 * d, lambda i, d: 7e3 * np.cos(i) + 5e6 * d
    )
    assert tangent(magnet, iu, x) == pytest.approx(
        differences(magnet, iu, x, 1e-4, 1e-7), rel=1e-6, abs=1e-6
    )


@pytest.mark.parametrize("x", np.linspace(-5, 5, 11) * 2.0**-12)
@pytest.mark.parametrize("iu", np.linspace(-2, 2, 9))
def test_the_tables_tangent_holds_at_each_node_edge_and_beyond(iu, x):
    """Where both sides have one slope; an edge belongs to the table, beyond it nothing changes."""
    columns, rows = np.linspace(-1.5, 1.5, 7), np.linspace(-4, 4, 5) * 2.0**-12
    grid = np.meshgrid(columns, rows)
    magnet = CORE.Table(rows[0], rows[1] - rows[0], columns[0], columns[1] - columns[0],
                        k_i_surface(*grid), k_s_surface(*grid))  # fmt: skip
    i, d = np.clip(iu, -1.5, 1.5), np.clip(x, rows[0], rows[-1])
    by_iu = ((2 + 4e3 * d) * iu + (-500 - 2e6 * d) * x) * (i == iu)
    by_x = ((-3e3 + 4e3 * i) * iu + (1e6 - 2e6 * i) * x) * (d == x)
    expected = k_i_surface(i, d) + by_iu, k_s_surface(i, d) + by_x
    assert tangent(magnet, iu, x) == pytest.approx(expected, rel=1e-12)


def test_a_table_asked_at_no_number_answers_with_none():
    magnet = table(k_i_surface, k_s_surface)
    for iu, x in ((np.nan, 0.0), (0.0, np.nan), (np.nan, np.nan)):
        assert np.isnan(through_origin(magnet, iu, x)).all()
    assert np.isfinite(through_origin(magnet, np.inf, -np.inf)).all()


def test_a_table_needs_two_by_two_nodes_of_one_shape():
    with pytest.raises(ValueError, match="at least 2 x 2"):
        CORE.Table(0, 1, 0, 1, np.ones((1, 3)), np.ones((1, 3)))
    with pytest.raises(ValueError, match="differ in shape"):
        CORE.Table(0, 1, 0, 1, np.ones((2, 3)), np.ones((3, 2)))


# ---- single precision ----


@laws
def test_in_single_precision_the_law_is_the_same_to_its_digits(bearing):
    rng = np.random.default_rng(2)
    iu = rng.uniform(bearing.current_min, bearing.current_max, 1000).astype(np.float32)
    x = (0.5 * bearing.clearance * rng.uniform(-1, 1, 1000)).astype(np.float32)
    law = magnet_of(bearing)
    single, double = law.in_core(core_module("float32")), law.in_core(CORE)
    wide = iu.astype(float), x.astype(float)
    scale = float(np.abs(double.force(*wide)).max())
    np.testing.assert_allclose(
        single.force(iu, x), double.force(*wide), rtol=1e-6, atol=1e-6 * scale
    )
    for form in ("tangent", "through_origin"):
        for low, high in zip(
            getattr(single, form)(iu, x), getattr(double, form)(*wide), strict=True
        ):
            np.testing.assert_allclose(low, high, rtol=2e-5, atol=2e-6 * np.abs(high).max())


def test_both_builds_live_side_by_side():
    """Each has types of its own, and none takes the other's."""
    single, double = core_module("float32"), core_module()
    assert single.Kalman is not double.Kalman
    assert ConstantStiffness(1, 2).in_core(single).force(np.ones(1), np.ones(1)).dtype == np.float32
    with pytest.raises(ValueError, match="'float64' or 'float32', got 'float16'"):
        core_module("float16")


@pytest.mark.parametrize("name", BEARINGS)
def test_a_current_carries_what_needs_no_more(name):
    bearing = Machine.preset(name)
    law = magnet_of(bearing)
    for pull in (-bearing.weight, 3.0, -0.01):
        needed = law.current_for(pull)
        if not np.isfinite(needed):  # a one-sided magnet does not push
            continue
        for size in (0.999 * abs(needed), 1.001 * abs(needed)):
            one_sided = bearing.magnet.type == "one-sided"
            low = -min(size, bearing.magnet.bias_current) if one_sided else -size
            assert law.carries(pull, low, size) == (size >= abs(needed))
