"""The filter of a machine as a file: read is what was written, and commands take it."""

import numpy as np
import pytest

import ambkit
from ambkit import Estimator, FilterFile, FilterNoise, Machine
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.estimate.registry import KINDS, kind_of, learned_magnet
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

TUM = Machine.preset("tum_mlps")
NOISE = FilterNoise(measurement=3e-13, disturbance=[41.7, 42.0, 300.0, 43.0])
OWN = {"augmented": {"wander": 0.02}, "extended-adaptive-noise": {"memory": 0.25}}
OF_MACHINES = [name for name, kind in KINDS.items() if kind.estimator.several_axes]


@pytest.fixture(scope="module")
def record():
    return simulate_run(TUM, Scenario(duration=0.05)).record


@pytest.mark.parametrize("name", OF_MACHINES)
def test_what_is_read_is_what_was_written(name, tmp_path, record):
    magnet = learned_magnet(name, TUM) if name != "adaptive" else _experts()
    turning = [] if name == "constant-velocity" else ["unbalance"]
    made = KINDS[name].make(TUM, magnet, noise=NOISE, gate=6.5, synchronous=turning,
                            **OWN.get(name, {}))  # fmt: skip
    made.start_std = {made.states[0].name: 2e-6}
    made.save(tmp_path / "filter.toml")
    read = Estimator.load(tmp_path / "filter.toml")
    assert (kind_of(made), kind_of(read)) == (name, name)
    assert read.view.machine == TUM
    assert read.variances == made.variances
    a, b = made.run(record, covariance=True), read.run(record, covariance=True)
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    if name == "adaptive":
        made = {"filter.toml", "filter.A.expert.json", "filter.B.expert.json"}
        assert {path.name for path in tmp_path.iterdir()} == made
    else:
        read.save(tmp_path / "again.toml")
        assert (tmp_path / "again.toml").read_text() == (tmp_path / "filter.toml").read_text()


def _experts():
    one = ambkit.train(TUM.isolated_axis("A1")).expert
    other = one.scaled(1.1)  # as if its magnet were stronger
    return [one, one, other, other]


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


HEAD = 'kind = "extended"\nsampling_time = "0.1 ms"\nmachine.preset = "tum_mlps"\n'


@pytest.mark.parametrize(("text", "told"), [
    ('kind = "observer"\nsampling_time = "0.1 ms"\nmachine.preset = "tum_mlps"\n',
     "1: kind: the observer takes one axis"),
    (HEAD.replace("0.1", "0.2"), "2: sampling_time: must be the machine's, 0.1 ms, is 0.2 ms"),
    (HEAD + 'bearing.preset = "zittau_axial"\n', "is of one [bearing] or of one [machine]"),
    (HEAD + '[noise]\ncontrol = ["1 V^2", "2 V^2"]\n',
     "5: noise.control: must be one number or 4, is 2"),
    (HEAD + '[noise]\ncontrol = ["1 V^2", "2 V", "1 V^2", "1 V^2"]\n', "5: noise.control"),
    (HEAD + "[noise]\ndisturbance = []\n", "5: noise.disturbance: must not be empty"),
    (HEAD + 'synchronous = ["balance"]\n', 'must be "unbalance" or "runout", is "balance"'),
    (HEAD + '[inputs.y]\nunit = "mm"\n', "inputs: are of one axis"),
    (HEAD + '[magnet]\nfile = "f.toml"\n', "[magnets.NAME] for each bearing"),
    (HEAD + '[magnets.A]\nfile = "f.toml"\n', "magnets: must be of A, B, is of A"),
    ('kind = "extended"\nsampling_time = "0.25 ms"\nbearing.preset = "zittau_axial"\n'
     'synchronous = ["unbalance"]\n', "4: synchronous: is of a rotor that turns"),
    ('kind = "extended"\nsampling_time = "0.25 ms"\nbearing.preset = "zittau_axial"\n[noise]\n'
     'control = ["1 V^2", "1 V^2"]\n', "5: noise.control: must be one number, is 2"),
])  # fmt: skip
def test_what_is_wrong_is_told_with_its_line(text, told, tmp_path):
    (tmp_path / "f.toml").write_text(text)
    with pytest.raises(ConfigError) as error:
        Estimator.load(tmp_path / "f.toml")
    assert any(told in problem for problem in error.value.problems), error.value.problems


def test_a_filter_runs_on_what_it_is_of(tmp_path):
    ambkit.KalmanFilter(TUM).save(tmp_path / "f.toml")
    assert FilterFile.load_for(tmp_path / "f.toml", TUM).plant == TUM
    with pytest.raises(AmbkitError, match="this filter is of tum_mlps, a machine with axes A1, A2"):
        FilterFile.load_for(tmp_path / "f.toml", ambkit.Bearing.preset("zittau_axial"))
    with pytest.raises(AmbkitError, match="not of compressor, a machine with axes"):
        FilterFile.load_for(tmp_path / "f.toml", Machine.preset("compressor"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("machine")
    noise = FilterNoise(disturbance=20.0)
    ambkit.KalmanFilter(TUM, noise=noise, synchronous=["unbalance"]).save(place / "f.toml")
    (place / "scenario.toml").write_text(
        'duration = "0.1 s"\nfeedback = "estimate"\n[control]\nunbalance = "force-free"\n'
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


@pytest.mark.parametrize(("arguments", "code", "said"), [
    (["check", "f.toml"], 0, "ok, filter: linear, for tum_mlps"),
    (["assess", "tum_mlps", "--filter", "f.toml", "--controller", "scenario.toml"], 0,
     "margin, up"),
    (["assess", "zittau_axial", "--filter", "f.toml"], 2, "this filter is of tum_mlps, a machine"),
    (["simulate", "tum_mlps", "--scenario", "scenario.toml", "--filter", "f.toml"], 0, "rms"),
    (["filter", "run.csv", "--filter", "f.toml"], 0, "mean NIS"),
    (["filter", "run.csv", "--machine", "tum_mlps", "--filter", "linear", "--filter", "f.toml"], 0,
     "f.toml"),
    (["export", "c", "f.toml", "--out", "c", "--controller", "scenario.toml"], 0, "wrote c"),
    (["export", "mat", "f.toml", "--out", "f.mat"], 2, "has several axes"),
    (["export", "fmu", "f.toml", "--out", "f.fmu"], 2, "linear+unbalance is exported as C only"),
    (["tune", "tum_mlps", "--filter", "linear", "--budget", "2", "--seeds", "1",
      "--out", "g.toml"], 0, "wrote g.toml"),
])  # fmt: skip
def test_commands_take_it(arguments, code, said, folder, call, monkeypatch):
    monkeypatch.chdir(folder)
    told = call(*arguments)
    assert told.code == code, told.err
    assert said in " ".join((told.out + told.err).split())
