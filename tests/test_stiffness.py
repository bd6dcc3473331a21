"""The LSM machine (paper, eq. 26-31) and force tables."""

import numpy as np
import pytest
from force_table import force_table
from hypothesis import given
from hypothesis import strategies as st

from ambkit import _core, _core_f32
from ambkit.base.errors import AmbkitError
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ClosedLaw
from ambkit.machine.stiffness import local_stiffness, stiffness_map

ZITTAU = Machine.preset("zittau_axial")
ONE_SIDED = ZITTAU.replace(magnet__type="one-sided")

currents = st.floats(-1.5, 1.5)
displacements = st.floats(-0.5e-3, 0.5e-3)


def law(iu, x):
    """Eq. 1, as printed up to its second equality."""
    k, i0, s0 = 6.7e-6, 1.5, 2e-3
    return k * (((i0 + iu) / (s0 - x)) ** 2 - ((i0 - iu) / (s0 + x)) ** 2)


def normal_equations(iu, x):
    """Eq. 27-31 word for word, in the paper's amperes and millimetres."""
    rows, forces = [], []
    for di in (-0.01, 0.0, 0.01):
        for dx in (-0.01, 0.0, 0.01):
            rows.append([iu + di, 1e3 * x + dx])
            forces.append(law(iu + di, x + 1e-3 * dx))
    a, y = np.array(rows), np.array(forces)
    k_i, k_s = np.linalg.inv(a.T @ a) @ a.T @ y
    return k_i, 1e3 * k_s


@given(currents, displacements)
def test_agrees_with_the_normal_equations_of_the_paper(iu, x):
    k_i, k_s, _ = local_stiffness(law, iu, x)
    expected = normal_equations(iu, x)
    # Eq. 31 squares the condition number: it is the less accurate one.
    np.testing.assert_allclose((k_i, k_s), expected, rtol=1e-8)


def test_the_map_is_the_point_by_point_fit():
    stiff = stiffness_map(ZITTAU)
    for row, x in enumerate(stiff.displacement):
        for column, iu in enumerate(stiff.current):
            expected = normal_equations(float(iu), float(x))
            found = stiff.k_i[row, column], stiff.k_s[row, column]
            np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_a_linear_force_is_found_exactly():
    stiff = stiffness_map(ZITTAU, force=lambda iu, x: 3.0 * iu - 40.0 * x + 7.0)
    np.testing.assert_allclose(stiff.k_i, 3.0, rtol=1e-10)
    np.testing.assert_allclose(stiff.k_s, -40.0, rtol=1e-8)
    assert stiff.force_bias == 7.0
    assert np.max(stiff.residual) < 1e-12


def test_a_one_sided_magnet_is_described_relative_to_what_it_carries():
    stiff = stiffness_map(ONE_SIDED)
    assert stiff.current[0] == ONE_SIDED.current_min
    assert stiff.force_bias == pytest.approx(6.7e-6 * (1.5 / 2e-3) ** 2, rel=1e-12)
    iu, x = np.meshgrid(stiff.current, stiff.displacement)
    whole = stiff.force_bias + stiff.k_i * iu + stiff.k_s * x
    np.testing.assert_allclose(whole, ClosedLaw(ONE_SIDED).force(iu, x), atol=0.02)


def test_force_rms_is_the_mean_over_the_area():
    stiff = stiffness_map(ZITTAU)
    a, w = np.polynomial.legendre.leggauss(40)
    iu, x = np.meshgrid(1.5 * a, 0.5e-3 * a)
    exact = np.sqrt(np.sum(np.outer(w, w) / 4 * law(iu, x) ** 2))
    assert stiff.force_rms() == pytest.approx(exact, rel=1e-4)
    assert stiff.force_rms(stiff.force) == 0
    assert stiff.force_rms(lambda iu, x: law(iu, x) + 2.0) == pytest.approx(2.0)


@pytest.mark.parametrize("core", [_core, _core_f32])
def test_the_c_table_gives_the_nodes_back(core):
    stiff = stiffness_map(ZITTAU)
    dtype = np.float64 if core is _core else np.float32
    iu, x = (grid.ravel().astype(dtype) for grid in np.meshgrid(stiff.current, stiff.displacement))
    k_i, k_s = stiff.in_core(core).through_origin(iu, x)
    tolerance = 1e-12 if core is _core else 1e-5
    np.testing.assert_allclose(k_i, stiff.k_i.ravel(), rtol=tolerance)
    np.testing.assert_allclose(k_s, stiff.k_s.ravel(), rtol=tolerance)


def test_the_c_table_refuses_uneven_nodes():
    stiff = stiffness_map(ZITTAU, currents=[-1.5, 0.0, 0.5, 1.5])
    with pytest.raises(AmbkitError, match=r"nodes of current are 0\.5 to 1\.5 apart"):
        stiff.in_core(_core)


def test_the_fingerprint_changes_with_the_bearing_only():
    stiffer = ZITTAU.replace(magnet__magnet_constant="6.8 N mm^2/A^2")
    assert stiffness_map(ZITTAU).fingerprint == stiffness_map(ZITTAU).fingerprint
    assert stiffness_map(ZITTAU).fingerprint != stiffness_map(stiffer).fingerprint


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"currents": [0.0]}, "currents must be a list of at least 2 nodes"),
        ({"currents": [0.0, 1.0, 1.0]}, "currents must ascend, has 1 A before 1 A"),
        ({"displacements": [0.0, np.nan]}, "displacements must be finite, has nan m"),
        ({"displacements": [-2e-3, 2e-3]}, "within the air gap, 0.002 m; .* reach 0.00201 m"),
        ({"delta_current": 0.0}, "delta_current must be greater than 0 A, is 0.0"),
        ({"delta_displacement": -1e-5}, "delta_displacement must be greater than 0 m"),
        ({"force": lambda iu, x: iu[0]}, "force must return an array of shape"),
        ({"force": lambda iu, x: iu / (x * 0)}, "force must be finite, is"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
def test_what_cannot_be_used_is_named(options, message):
    with pytest.raises(AmbkitError, match=message):
        stiffness_map(ZITTAU, **options)


def test_a_force_table_of_scipy_stands_for_the_law():
    current, displacement = np.linspace(-1.6, 1.6, 17), np.linspace(-0.6e-3, 0.6e-3, 25)
    table = force_table(current, displacement, law(*np.meshgrid(current, displacement)))
    ours, exact = stiffness_map(ZITTAU, force=table), stiffness_map(ZITTAU)
    np.testing.assert_allclose(ours.k_i, exact.k_i, rtol=1e-3)
    np.testing.assert_allclose(ours.k_s, exact.k_s, rtol=1e-3)


def test_a_map_is_read_only():
    stiff = stiffness_map(ZITTAU)
    with pytest.raises(ValueError, match="read-only"):
        stiff.k_i[0, 0] = 1.0


def test_the_steps_follow_the_bearing():
    """A bearing twice as large in gap and current has the same stiffnesses, relatively."""
    small = Machine.preset("zittau_axial")
    large = small.replace(
        magnet__air_gap=2 * small.magnet.air_gap,
        magnet__bias_current=2 * small.magnet.bias_current,
        amplifier__current_limit=2 * small.amplifier.current_limit,
        rotor__clearance=2 * small.clearance,
    )
    one, two = stiffness_map(small), stiffness_map(large)
    assert one.delta_current == 0.01  # the paper's, eq. 27
    assert one.delta_displacement == 1e-5
    np.testing.assert_allclose(two.k_i / two.k_i[2, 2], one.k_i / one.k_i[2, 2], rtol=1e-9)
    np.testing.assert_allclose(two.k_s / two.k_s[2, 2], one.k_s / one.k_s[2, 2], rtol=1e-9)
