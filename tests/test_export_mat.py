"""MAT-files: what SciPy, and Octave where it is there, read back."""

import shutil
import subprocess

import fe_map
import iron
import numpy as np
import oracles
import pytest
from exporting import export_mat
from scipy.io import loadmat

import ambkit
from ambkit import KalmanFilter, Machine
from ambkit.machine.magnets import evaluate_force, evaluate_stiffness
from ambkit.machine.parts import FILES
from ambkit.machine.stiffness import stiffness_map

BEARINGS = [Machine.preset("zittau_axial"), Machine.preset("inteco_ml")]
both = pytest.mark.parametrize("bearing", BEARINGS, ids=lambda b: b.name)
LATE = iron.TWO_SIDED.replace(
    name="late",
    delay="0.15 ms",
    amplifier__bandwidth="500 Hz",
    sensor__coloured_noise={"variance": "4 um^2", "bandwidth": "200 Hz"},
    sensor__hum=[{"frequency": f, "amplitude": "10 um"} for f in ("50 Hz", "150 Hz")],
)


def read_back(bearing, expert, folder):
    path = folder / "bearing.mat"
    export_mat(bearing, expert, path)
    return loadmat(path, simplify_cells=True)


def predicted(m, kf, state, u, rtol):
    """Mean and covariance by the matrices of a file, which are the filter's."""
    kf.reset(state, np.sqrt(np.diag(m["P0"])))
    mean = m["A"] @ state + np.dot(m["B"], u) + np.dot(m["E"], m["f_0"])
    np.testing.assert_allclose(kf.predict(u), mean, rtol=rtol)
    covariance = m["A"] @ m["P0"] @ m["A"].T + m["Q"]
    scale = np.sqrt(np.diag(covariance))
    away = (kf.core.covariance - covariance) / np.outer(scale, scale)
    np.testing.assert_allclose(away, 0, atol=1e-12)
    return mean, covariance


@pytest.mark.parametrize("bearing", [*BEARINGS, iron.TWO_SIDED, LATE], ids=lambda b: b.name)
def test_the_model_predicts_as_the_core_does(bearing, tmp_path):
    m = read_back(bearing, None, tmp_path)
    kf = KalmanFilter(bearing)
    assert list(m["states"]) == [state.name for state in kf.states]
    others = [0.1 * state.size for state in kf.states[4:]]
    u, y = 0.2, 2e-5
    mean, covariance = predicted(m, kf, np.array([1e-5, 2e-3, 0.3, 1.1e-5, *others]), u, 1e-12)
    kf.update(y)
    np.testing.assert_allclose(kf.innovation_variance, m["C"] @ covariance @ m["C"] + m["R"])
    np.testing.assert_allclose(kf.innovation, y - m["C"] @ mean - m["D"] * u)


def test_a_machine_is_exported_with_all_its_axes(tmp_path):
    machine = ambkit.Machine.preset("tum_mlps")
    m, kf = read_back(machine, None, tmp_path), KalmanFilter(machine)
    start = np.arange(1.0, 21.0) * [state.size for state in kf.states]
    predicted(m, kf, start, 0.1 * np.arange(4), 1e-9)
    assert list(m["tables"]) == [axis.name for axis in machine.axes]
    expected = stiffness_map(machine["B2"]).k_s
    np.testing.assert_array_equal(m["tables"]["B2"]["k_s"], expected)
    assert [bearing["name"] for bearing in m["machine"]["bearing"]] == ["A", "B"]


@both
def test_the_model_is_exact_between_samples(bearing, tmp_path):
    m = read_back(bearing, None, tmp_path)
    s, k = oracles.settings_of(bearing), ambkit.ConstantStiffness.of(bearing)
    A, B, _ = oracles.system_matrices(s, k.k_i, k.k_s)
    np.testing.assert_allclose(m["A"], A, rtol=1e-12)
    np.testing.assert_allclose(m["B"], B, rtol=1e-12)
    np.testing.assert_allclose(m["E"], oracles.held_force(s)[1], rtol=1e-12)


@both
def test_tables_and_bearing_come_back(bearing, tmp_path):
    m = read_back(bearing, None, tmp_path)
    stiff, tables = stiffness_map(bearing), m["tables"]
    for name in ("current", "displacement", "k_i", "k_s"):
        np.testing.assert_array_equal(tables[name], getattr(stiff, name), name)
    iu, x = np.meshgrid(tables["current"], tables["displacement"])
    law = ambkit.ClosedLaw(bearing)
    np.testing.assert_allclose(tables["force"] + law.bias_force, law.force(iu, x), atol=0.01)
    assert m["bearing"]["magnet"]["air_gap"] == bearing.magnet.air_gap
    assert m["bearing"]["rotor"]["gravity"] == "-x"
    assert m["T"] == bearing.sampling_time
    assert list(m["states"]) == ["x", "v", "f_d", "x_m"]


def test_iron_that_saturates_is_in_the_tables_and_in_the_model(tmp_path):
    """The figures of the issue, by Froehlich in closed form."""
    m = read_back(iron.TWO_SIDED, None, tmp_path)
    T, mass = m["T"], 5.0
    assert m["B"][1] == pytest.approx(49.660 * T / mass, rel=1e-5)
    assert m["A"][1, 0] == pytest.approx(146764 * T / mass, rel=1e-5)
    at = list(m["tables"]["displacement"]).index(0.0)
    assert m["tables"]["current"][-1] == 2.5
    assert m["tables"]["force"][at, -1] == pytest.approx(119.216, rel=1e-4)
    assert m["tables"]["k_i"][at, at] == pytest.approx(49.660, rel=1e-4)
    assert m["bearing"]["magnet"]["saturation"] == 1.6


def test_a_force_map_is_in_the_tables_and_its_file_is_named(tmp_path):
    bearing = Machine.load(fe_map.written(tmp_path))
    m = read_back(bearing, None, tmp_path)
    tables = m["tables"]
    iu, x = np.meshgrid(tables["current"], tables["displacement"])
    known = fe_map.fe_force(iu, x)
    # The fit goes through nine points around each: to what the force bends between them.
    np.testing.assert_allclose(tables["force"], known, atol=2e-3 * np.abs(known).max())
    assert [m["bearing"]["magnet"][key] for key in FILES] == ["fe.csv", "channels.toml"]


def test_what_there_are_several_of_is_an_array_of_structs(tmp_path):
    sensor = read_back(LATE, None, tmp_path)["bearing"]["sensor"]
    assert [line["frequency"] for line in sensor["hum"]] == [50.0, 150.0]
    assert sensor["coloured_noise"]["bandwidth"] == 200.0
    assert "runout" not in sensor


@both
def test_the_expert_s_rules_give_its_stiffnesses(bearing, tmp_path):
    expert = ambkit.train(bearing).expert
    m = read_back(bearing, expert, tmp_path)
    net, tables = m["expert"], m["tables"]
    iu, x = 0.3 * net["current_range"][1], 0.4 * net["displacement_range"][0]
    for name, expected in zip(("k_i", "k_s"), evaluate_stiffness(expert, iu, x), strict=True):
        far = (net["per_ampere"] * (iu - net["centre_current"])) ** 2
        far += (net["per_metre"] * (x - net["centre_displacement"])) ** 2
        u = np.exp(-far / (2 * net[f"width_{name}"] ** 2))
        assert net["normalised"]
        np.testing.assert_allclose(u @ net[f"weight_{name}"] / u.sum(), expected, rtol=1e-9)
    grid = np.meshgrid(tables["current"], tables["displacement"])
    np.testing.assert_allclose(
        tables["force"], evaluate_force(expert, *grid), rtol=0, atol=tables["force_bound"]
    )


def test_the_same_input_gives_the_same_bytes(tmp_path):
    a, b = tmp_path / "a.mat", tmp_path / "b.mat"
    export_mat(BEARINGS[0], None, a)
    export_mat(BEARINGS[0], None, b)
    assert a.read_bytes() == b.read_bytes()
    assert b"Created on" not in a.read_bytes()
    assert a.read_bytes()[124:128] == b"\x00\x01IM"  # version and byte order stand as they must


@pytest.mark.skipif(shutil.which("octave") is None, reason="Octave is not installed")
def test_octave_reads_it(tmp_path):
    path = tmp_path / "bearing.mat"
    m = export_mat(BEARINGS[0], None, path)
    code = f"load('{path}'); printf('%.17g ', A, tables.k_s, bearing.magnet.air_gap);"
    done = subprocess.run(
        ["octave", "--quiet", "--no-init-file", "--eval", code],
        capture_output=True,
        text=True,
        check=True,
    )
    expected = [*m["A"].ravel("F"), *m["tables"]["k_s"].ravel("F"), 2e-3]
    assert [float(word) for word in done.stdout.split()] == expected


def test_command(call):
    for _ in range(2):  # the second replaces the file of the first
        told = call("export", "mat", "zittau_axial", "--out", "bearing.mat")
        assert (told.code, told.err) == (0, "wrote bearing.mat\n")
    assert "A" in loadmat("bearing.mat")
