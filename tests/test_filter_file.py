"""A filter as a file, of an axis and of a machine: what is read is what was written, and commands
take it; mistakes are told by their line.
"""

import numpy as np
import pytest

import ambkit
from ambkit import Estimator, FilterNoise, Machine
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.estimate.filter_file import filter_file_for
from ambkit.estimate.registry import KINDS, kind_of, learned_magnet
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

BEARING, TUM = Machine.preset("zittau_axial"), Machine.preset("tum_mlps")
OPTIONS = {
    "low-pass": {"position": 900.0, "force": 50.0},
    "observer": {"bandwidth": 700.0, "damping": 0.6},
    "augmented": {"wander": 0.02, "scale_std": 0.3},
    "multiple-model": {"scales": (0.8, 1.0, 1.3), "sojourn": 0.5},
    "unscented": {"alpha": 0.9},
    "extended-adaptive-noise": {"memory": 0.25, "most": 50.0},
}
NOISE = {
    "zittau_axial": FilterNoise(measurement=3e-11, disturbance=41.7),
    "tum_mlps": FilterNoise(measurement=3e-13, disturbance=[41.7, 42.0, 300.0, 43.0]),
}
CASES = [(BEARING, name) for name in KINDS] + [
    (TUM, name) for name, kind in KINDS.items() if kind.estimator.several_axes
]


@pytest.fixture(scope="module")
def record():
    return ambkit.simulate(BEARING, ambkit.scenario_for(BEARING, step=0.3e-3, load=2.0)).record


@pytest.fixture(scope="module")
def of_machine():
    return simulate_run(TUM, Scenario(duration=0.05)).record


@pytest.fixture(scope="module")
def expert():
    return ambkit.train(BEARING).expert


def same(one, other, record):
    """Both leave the same bits along a record."""
    a, b = one.run(record, covariance=True), other.run(record, covariance=True)
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    np.testing.assert_array_equal(a.status, b.status)


def learned(of, name, expert):
    """The magnet that a kind of filter knows; experts of a machine's bearings differ."""
    if name != "adaptive":
        return learned_magnet(name, of)
    if of is BEARING:
        return expert
    one = ambkit.train(TUM.isolated_axis("A1")).expert
    other = one.scaled(1.1)  # as if its magnet were stronger
    return [one, one, other, other]


@pytest.mark.parametrize(("of", "name"), CASES, ids=lambda value: getattr(value, "name", value))
def test_what_is_read_is_what_was_written(of, name, tmp_path, record, of_machine, expert):
    turns = of is TUM and name != "constant-velocity"
    options = OPTIONS.get(name, {}) | ({"synchronous": ["unbalance"]} if turns else {})
    made = KINDS[name].make(of, learned(of, name, expert), noise=NOISE[of.name], gate=6.5,
                            outlier_limit=4, **options)  # fmt: skip
    made.origin = {"noise.disturbance": "by hand"}
    if of is TUM:
        made.start_std = {made.states[0].name: 2e-6}
    made.save(tmp_path / "filter.toml")
    read = Estimator.load(tmp_path / "filter.toml")
    assert (kind_of(made), kind_of(read)) == (name, name)
    assert type(read) is type(made)
    assert read.view.machine == of
    assert read.variances == made.variances
    assert read.origin == {"noise.disturbance": "by hand"}
    same(made, read, record if of is BEARING else of_machine)
    experts = sorted(path.name for path in tmp_path.glob("*.json"))
    bearings = [""] if of is BEARING else [".A", ".B"]
    assert experts == [f"filter{each}.expert.json" for each in bearings] * (name == "adaptive")
    if len(experts) < 2:
        again = tmp_path / "again.toml"
        read.save(again, magnet=tmp_path / experts[0] if experts else None)
        assert again.read_text() == (tmp_path / "filter.toml").read_text()


def test_a_machine_of_ones_own_goes_along(tmp_path):
    (tmp_path / "a").mkdir()
    machine = TUM.replace(name="mine", speed="6000 rpm")
    ambkit.KalmanFilter(machine, synchronous=["runout"]).save(tmp_path / "a" / "f.toml")
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"f.toml", "f.machine.toml"}
    (tmp_path / "a").rename(tmp_path / "b")
    read = Estimator.load(tmp_path / "b" / "f.toml")
    assert read.view.machine == machine
    assert read.options["synchronous"] == ("runout",)
    text = (tmp_path / "b" / "f.machine.toml").read_text()
    (tmp_path / "b" / "f.machine.toml").write_text(text.replace("mine", "yours"))
    with pytest.raises(ConfigError, match="is not what it was when this filter was made"):
        Estimator.load(tmp_path / "b" / "f.toml")


def test_files_that_a_filter_needs_are_written_beside_it_and_may_move_with_it(tmp_path, expert):
    (tmp_path / "a").mkdir()
    other = BEARING.replace(name="another", magnet__air_gap="2.1 mm")
    ambkit.AdaptiveKalmanFilter(other, expert).save(tmp_path / "a" / "f.toml")
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {"f.toml", "f.machine.toml", "f.expert.json"}
    (tmp_path / "a").rename(tmp_path / "b")
    read = Estimator.load(tmp_path / "b" / "f.toml")
    assert read.machine == other
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
OF_TUM = f'{HEAD}machine.preset = "tum_mlps"\n'
OF_CONTACT = f"{OF_TUM}[options]\n".replace("extended", "contact")


@pytest.mark.parametrize(("text", "message"), [
    ('kind = "extnded"\nsampling_time = "0.25 ms"\nmachine.preset = "zittau_axial"\n',
     '1: kind: there is no filter "extnded"; known: low-pass'),
    (HEAD, "1: machine: missing"),
    (HEAD + '[machine]\npreset = "zitau"\n', '4: machine.preset: there is no preset'),
    (HEAD + '[machine]\nfile = "gone.toml"\n', "4: machine.file: "),
    (HEAD + '[machine]\npreset = "zittau_axial"\nfile = "x.toml"\n', "give either file or preset"),
    (HEAD + 'machine.preset = "zittau_axial"\n[options]\nmemory = "1 s"\n',
     "5: options.memory: unknown key, known here: none, of the extended"),
    ('kind = "augmented"\nsampling_time = "0.25 ms"\nmachine.preset = "zittau_axial"\n[options]\n'
     "wander = 0.02\n", "5: options.wander: 0.02 has no unit, write it like"),
    (OF_CONTACT + "scatter = -0.1\n", "5: options.scatter: must be 0 or more, got -0.1"),
    (OF_CONTACT + "scatter = nan\n", "5: options.scatter: must be 0 or more, got nan"),
    (OF_CONTACT + "scatter = [0.1, 0.2]\n", "5: options.scatter: must be one number"),
    (OF_CONTACT.replace("contact", "multiple-model") + "scales = 0.8\n",
     "5: options.scales: must be a list of numbers"),
    (HEAD + 'machine.preset = "zittau_axial"\n[inputs.y]\nunit = "N"\n',
     "inputs.y.unit: makes y a quantity in N, it is one in m"),
    ('kind = "extended"\nsampling_time = "1 ms"\nmachine.preset = "zittau_axial"\n',
     "2: sampling_time: must be the machine's, "),
    ('kind = "observer"\nsampling_time = "0.1 ms"\nmachine.preset = "tum_mlps"\n',
     "1: kind: the observer takes one axis"),
    (OF_TUM.replace("0.1", "0.2"), "2: sampling_time: must be the machine's, 0.1 ms, is 0.2 ms"),
    (OF_TUM + 'bearing.preset = "zittau_axial"\n', "bearing: unknown key"),
    (OF_TUM + '[noise]\ncontrol = ["1 V^2", "2 V^2"]\n',
     "5: noise.control: must be one number or 4, is 2"),
    (OF_TUM + '[noise]\ncontrol = ["1 V^2", "2 V", "1 V^2", "1 V^2"]\n', "5: noise.control"),
    (OF_TUM + "[noise]\ndisturbance = []\n", "5: noise.disturbance: must not be empty"),
    (OF_TUM + 'synchronous = ["balance"]\n', 'must be "unbalance" or "runout", is "balance"'),
    (OF_TUM + '[inputs.y]\nunit = "mm"\n', "inputs: are of one axis"),
    (OF_TUM + '[magnet]\nfile = "f.toml"\n', "[magnets.NAME] for each bearing"),
    (OF_TUM + '[magnets.A]\nfile = "f.toml"\n', "magnets: must be of A, B, is of A"),
    ('kind = "extended"\nsampling_time = "0.25 ms"\nmachine.preset = "zittau_axial"\n'
     'synchronous = ["unbalance"]\n', "4: synchronous: unbalance is of a rigid or"),
    ('kind = "extended"\nsampling_time = "0.25 ms"\nmachine.preset = "zittau_axial"\n[noise]\n'
     'control = ["1 V^2", "1 V^2"]\n', "5: noise.control: must be one number, is 2"),
])  # fmt: skip
def test_what_is_wrong_is_reported_with_its_line(text, message, tmp_path):
    assert any(message in problem for problem in wrong(text, tmp_path)), wrong(text, tmp_path)


def test_a_file_that_changed_since_is_refused(tmp_path, expert):
    ambkit.AdaptiveKalmanFilter(BEARING, expert).save(tmp_path / "f.toml")
    expert.scaled(1.1).save(tmp_path / "f.expert.json")
    told = wrong((tmp_path / "f.toml").read_text(), tmp_path)
    assert any("is not what it was when this filter was made" in problem for problem in told)


def test_a_start_that_cannot_be(tmp_path):
    text = HEAD + 'machine.preset = "zittau_axial"\n[start]\nq = "1 m"\n'
    (tmp_path / "f.toml").write_text(text)
    with pytest.raises(AmbkitError, match=r"start\.q: unknown key, known here: x, v"):
        Estimator.load(tmp_path / "f.toml")


def test_a_table_of_one_s_own_has_no_file(tmp_path):
    other = ambkit.stiffness_map(BEARING.replace(magnet__air_gap="2.2 mm"))
    with pytest.raises(AmbkitError, match="knows its magnet by a StiffnessMap"):
        ambkit.AdaptiveKalmanFilter(BEARING, other).save(tmp_path / "f.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_filter_runs_on_what_it_is_of(tmp_path):
    ambkit.KalmanFilter(TUM).save(tmp_path / "f.toml")
    assert filter_file_for(tmp_path / "f.toml", TUM).plant == TUM
    with pytest.raises(AmbkitError, match="this filter is of tum_mlps, a machine with axes A1, A2"):
        filter_file_for(tmp_path / "f.toml", ambkit.preset("zittau_axial"))
    with pytest.raises(AmbkitError, match="not of compressor, a machine with axes"):
        filter_file_for(tmp_path / "f.toml", Machine.preset("compressor"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("machine")
    noise = FilterNoise(disturbance=20.0)
    ambkit.KalmanFilter(TUM, noise=noise, synchronous=["unbalance"]).save(place / "f.toml")
    (place / "scenario.toml").write_text(
        'duration = "0.1 s"\n[controller]\nfeedback = "estimate"\nunbalance = "force-free"\n'
    )
    simulate_run(TUM, Scenario(duration=0.1)).record.save(place / "run.csv")
    return place


@pytest.mark.parametrize("arguments", [
    ["assess", "f.toml"],
    pytest.param(["assess", "tum_mlps", "--filter", "f.toml"], marks=pytest.mark.long),
])  # fmt: skip
def test_assess_takes_it(arguments, folder, call, monkeypatch):
    monkeypatch.chdir(folder)
    told = call(*arguments, "--json").json["loops"]["f.toml"]
    own = Estimator.load("f.toml")
    loop = ambkit.assess(TUM, own).loops[own.name]
    assert told["peak"] == pytest.approx(loop.peak, rel=1e-9)
    assert told["peak"] != pytest.approx(
        ambkit.assess(TUM, "linear").loops["linear"].peak, rel=0.01
    )


@pytest.mark.parametrize(("arguments", "code", "message"), [
    (["check", "f.toml"], 0, "ok, filter: linear, for tum_mlps"),
    (["assess", "tum_mlps", "--filter", "f.toml", "--controller", "scenario.toml"], 0,
     "margin, up"),
    (["assess", "zittau_axial", "--filter", "f.toml"], 2, "this filter is of tum_mlps, a machine"),
    (["simulate", "tum_mlps", "--scenario", "scenario.toml", "--filter", "f.toml"], 0, "rms"),
    (["filter", "run.csv", "--filter", "f.toml"], 0, "mean NIS"),
    (["filter", "run.csv", "--machine", "tum_mlps", "--filter", "linear", "--filter", "f.toml"], 0,
     "f.toml"),
    (["export", "c", "f.toml", "--out", "c", "--controller", "scenario.toml"], 0, "wrote c"),
    (["export", "mat", "f.toml", "--out", "f.mat"], 0, "15 variables"),
    (["export", "fmu", "f.toml", "--out", "f.fmu"], 0, "wrote f.fmu"),
    (["tune", "tum_mlps", "--filter", "linear", "--budget", "2", "--seeds", "1",
      "--out", "g.toml"], 0, "wrote g.toml"),
])  # fmt: skip
def test_commands_take_it(arguments, code, message, folder, call, monkeypatch):
    monkeypatch.chdir(folder)
    told = call(*arguments)
    assert told.code == code, told.err
    assert message in " ".join((told.out + told.err).split())
