"""A filter as a file: what is read is what was written, and mistakes are told by their line."""

import numpy as np
import pytest

import ambkit
from ambkit import Bearing, Estimator, FilterNoise
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.estimate.registry import KINDS, kind_of, learned_magnet
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface

BEARING = Bearing.preset("zittau_axial")
OPTIONS = {
    "low-pass": {"position": 900.0, "force": 50.0},
    "observer": {"bandwidth": 700.0},
    "augmented": {"wander": 0.02, "scale_std": 0.3},
    "multiple-model": {"scales": (0.8, 1.0, 1.3), "sojourn": 0.5},
    "unscented": {"alpha": 0.9},
    "extended-adaptive-noise": {"memory": 0.25, "most": 50.0},
}


@pytest.fixture(scope="module")
def record():
    return ambkit.simulate(BEARING, ambkit.scenario_for(BEARING, step=0.3e-3, load=2.0)).record


@pytest.fixture(scope="module")
def expert():
    return ambkit.train(BEARING).expert


def same(one, other, record):
    """Both leave the same bits along a record."""
    a, b = one.run(record, covariance=True), other.run(record, covariance=True)
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    np.testing.assert_array_equal(a.status, b.status)


@pytest.mark.parametrize("name", KINDS)
def test_what_is_read_is_what_was_written(name, tmp_path, record, expert):
    magnet = expert if name == "adaptive" else learned_magnet(name, BEARING)
    noise = FilterNoise(measurement=3e-11, disturbance=41.7)
    made = KINDS[name].make(BEARING, magnet, noise=noise, gate=6.5, outlier_limit=4,
                            **OPTIONS.get(name, {}))  # fmt: skip
    made.origin = {"noise.disturbance": "by hand"}
    made.save(tmp_path / "filter.toml")
    read = Estimator.load(tmp_path / "filter.toml")
    assert (kind_of(made), kind_of(read)) == (name, name)
    assert type(read) is type(made)
    assert read.variances == made.variances
    assert read.origin == {"noise.disturbance": "by hand"}
    same(made, read, record)
    again = tmp_path / "again.toml"
    read.save(again, magnet=tmp_path / "filter.expert.json" if name == "adaptive" else None)
    assert again.read_text() == (tmp_path / "filter.toml").read_text()


def test_files_that_a_filter_needs_are_written_beside_it_and_may_move_with_it(tmp_path, expert):
    (tmp_path / "a").mkdir()
    other = BEARING.replace(name="another", magnet__air_gap="2.1 mm")
    ambkit.AdaptiveKalmanFilter(other, expert).save(tmp_path / "a" / "f.toml")
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {"f.toml", "f.bearing.toml", "f.expert.json"}
    (tmp_path / "a").rename(tmp_path / "b")
    read = Estimator.load(tmp_path / "b" / "f.toml")
    assert read.bearing == other
    assert read.magnet == expert


def test_a_force_map_of_its_own_goes_along(tmp_path, record):
    law = ambkit.magnet_of(BEARING)
    i, x = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1e-3, 1e-3, 9)))
    surface = ForceSurface(BEARING, ForcePoints(i, x, 0.9 * law.force(i, x)))
    made = ambkit.ExtendedKalmanFilter(BEARING, surface)
    made.save(tmp_path / "f.toml")
    read = Estimator.load(tmp_path / "f.toml")
    assert isinstance(read.magnet, ForceSurface)
    same(made, read, record)


def test_a_start_of_its_own(tmp_path, record):
    made = ambkit.KalmanFilter(BEARING)
    made.start_std = {"f_d": 0.25}
    made.save(tmp_path / "f.toml")
    read = Estimator.load(tmp_path / "f.toml")
    assert read.default_std()[2] == 0.25
    assert read.default_std()[:2] == ambkit.KalmanFilter(BEARING).default_std()[:2]
    assert read.covariance[2, 2] == pytest.approx(0.25**2)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_raw_inputs_are_scaled_in_the_filter_s_precision(precision):
    kf = ambkit.KalmanFilter(BEARING, precision=precision)
    kf.inputs = Inputs(
        y=Scaling(unit="mm", sign=-1, offset="10 mm"),
        u=Scaling(unit="A", scale="0.5 V/A", offset="-0.94 V"),
    )
    raw_y, raw_u = np.array([9.7, 10.3, 11.1]), np.array([1.9, 2.0, 2.1])
    y, u = kf.in_si(raw_y, raw_u)
    assert y.dtype == u.dtype == np.dtype(precision)
    assert y == pytest.approx([0.3e-3, -0.3e-3, -1.1e-3], rel=1e-3)
    assert u == pytest.approx([0.01, 0.06, 0.11], rel=1e-3)
    number = np.float32 if precision == "float32" else np.float64
    np.testing.assert_array_equal(y, number(-1e-3) * raw_y.astype(number) + number(0.01))
    estimate = kf.run_raw(raw_y, raw_u)
    assert estimate.t.tolist() == [0.0, BEARING.sampling_time, 2 * BEARING.sampling_time]
    assert estimate.x[0] == pytest.approx(0.3e-3, rel=1e-3)
    with pytest.raises(ValueError, match=r"as long as each other, have shapes \(3,\) and \(2,\)"):
        kf.run_raw(raw_y, raw_u[:2])


def wrong(text, folder):
    (folder / "f.toml").write_text(text)
    with pytest.raises(ConfigError) as told:
        Estimator.load(folder / "f.toml")
    return [problem.partition("f.toml:")[2] for problem in told.value.problems]


HEAD = 'kind = "extended"\nsampling_time = "0.1 ms"\n'


@pytest.mark.parametrize(("text", "told"), [
    ('kind = "extnded"\nsampling_time = "0.25 ms"\nbearing.preset = "zittau_axial"\n',
     '1: kind: there is no estimator "extnded"; known: low-pass'),
    (HEAD, "1: bearing: missing"),
    (HEAD + '[bearing]\npreset = "zitau"\n', '4: bearing.preset: there is no preset'),
    (HEAD + '[bearing]\nfile = "gone.toml"\n', "4: bearing.file: "),
    (HEAD + '[bearing]\npreset = "zittau_axial"\nfile = "x.toml"\n', "give either file or preset"),
    (HEAD + 'bearing.preset = "zittau_axial"\n[options]\nmemory = "1 s"\n',
     "5: options.memory: unknown key, known here: none, of the extended"),
    ('kind = "augmented"\nsampling_time = "0.25 ms"\nbearing.preset = "zittau_axial"\n[options]\n'
     "wander = 0.02\n", "5: options.wander: 0.02 has no unit, write it like"),
    (HEAD + 'bearing.preset = "zittau_axial"\n[inputs.y]\nunit = "N"\n',
     "inputs.y.unit: makes y a quantity in N, it is one in m"),
    ('kind = "extended"\nsampling_time = "1 ms"\nbearing.preset = "zittau_axial"\n',
     "2: sampling_time: must be the bearing's, "),
])  # fmt: skip
def test_what_is_wrong_is_told_with_its_line(text, told, tmp_path):
    assert any(told in problem for problem in wrong(text, tmp_path)), wrong(text, tmp_path)


def test_a_file_that_changed_since_is_refused(tmp_path, expert):
    ambkit.AdaptiveKalmanFilter(BEARING, expert).save(tmp_path / "f.toml")
    expert.scaled(1.1).save(tmp_path / "f.expert.json")
    told = wrong((tmp_path / "f.toml").read_text(), tmp_path)
    assert any("is not what it was when this filter was made" in problem for problem in told)


def test_a_start_that_cannot_be(tmp_path):
    text = HEAD + 'bearing.preset = "zittau_axial"\n[start]\nq = "1 m"\n'
    (tmp_path / "f.toml").write_text(text)
    with pytest.raises(AmbkitError, match=r"start\.q: unknown key, known here: x, v"):
        Estimator.load(tmp_path / "f.toml")


def test_a_table_of_one_s_own_has_no_file(tmp_path):
    other = ambkit.stiffness_map(BEARING.replace(magnet__air_gap="2.2 mm"))
    with pytest.raises(AmbkitError, match="knows its magnet by a StiffnessMap"):
        ambkit.AdaptiveKalmanFilter(BEARING, other).save(tmp_path / "f.toml")
    assert list(tmp_path.iterdir()) == []
