"""The Python surface: `load` takes any file, and every verb takes a filter in every form."""

import numpy as np
import pytest

import ambkit

AXIS, MLPS = ambkit.preset("zittau_axial"), ambkit.preset("tum_mlps")


class Reading:
    """A filter of a user: the reading is the position."""

    def __init__(self, machine):
        self.machine = machine

    def step(self, y, u):
        return [y, 0.0, 0.0, y]


FORMS = {
    "name": lambda kf, file: "extended",
    "file": lambda kf, file: str(file),
    "path": lambda kf, file: file,
    "object": lambda kf, file: kf,
    "class": lambda kf, file: Reading,
    "sequence": lambda kf, file: [kf, "linear", Reading, file],
    "mapping": lambda kf, file: {
        "mine": kf,
        "made": lambda: kf,
        "class": Reading,
        "kind": "linear",
    },
}
VERBS = {
    "filter": lambda log, form: ambkit.filter(log, form, machine=AXIS),
    "compare": lambda _, form: ambkit.compare(AXIS, form, seeds=2),
    "compare_steps": lambda _, form: ambkit.compare_steps(
        AXIS, form, steps=[1e-4], duration=0.05, seeds=1
    ),
    "assess": lambda _, form: ambkit.assess(AXIS, form),
    "inject_faults": lambda _, form: ambkit.inject_faults(
        AXIS, form, faults=["outage-1ms"], samples=20_000
    ),
}


@pytest.fixture(scope="module")
def log():
    scenario = ambkit.scenario_for(AXIS, step=1e-4, duration=0.05)
    return ambkit.simulate(AXIS, scenario).record


OF_ALL = ("object", "sequence", "mapping")  # with all others among them


@pytest.mark.parametrize(("verb", "form"), [
    *(("filter", form) for form in FORMS),
    *((verb, form) for verb in VERBS if verb != "filter" for form in OF_ALL),
])  # fmt: skip
def test_a_verb_takes_a_filter_in_every_form(verb, form, log, tmp_path):
    kf = ambkit.ExtendedKalmanFilter(AXIS)
    kf.save(tmp_path / "filter.toml")
    assert VERBS[verb](log, FORMS[form](kf, tmp_path / "filter.toml")).finding


@pytest.mark.parametrize(
    "kf",
    [
        ambkit.ExtendedKalmanFilter(AXIS, noise=ambkit.FilterNoise(disturbance=100.0)),
        ambkit.KalmanFilter(AXIS.replace(name="heavier", rotor__mass="0.6 kg"), gate=6.0),
        ambkit.ExtendedKalmanFilter(MLPS),
    ],
    ids=["noise", "machine without a file", "several axes"],
)
def test_a_filter_that_exists_is_exported_as_its_file_is(kf, tmp_path):
    kf.save(tmp_path / "filter.toml")
    export_file = ambkit.export_c(tmp_path / "filter.toml", out=tmp_path / "a", force=True)
    ambkit.export_c(kf.machine, kf, out=tmp_path / "b", force=True)
    assert export_file
    for name in ("a", "b"):
        assert (tmp_path / name).is_dir()
    data = [next((tmp_path / name).glob("*_data.c")).read_text() for name in ("a", "b")]
    assert data[0] == data[1]


def test_load_takes_any_file(log, tmp_path):
    AXIS.save(tmp_path / "axis.toml")
    MLPS.save(tmp_path / "machine.toml")
    log.save(tmp_path / "run.csv")
    kf = ambkit.KalmanFilter(AXIS)
    kf.save(tmp_path / "filter.toml")
    expert = ambkit.train(AXIS).expert
    expert.save(tmp_path / "expert.json")
    (tmp_path / "scenario.toml").write_text('duration = "0.1 s"\n')
    assert ambkit.load(tmp_path / "axis.toml") == AXIS
    assert ambkit.load(tmp_path / "machine.toml") == MLPS
    assert ambkit.load(tmp_path / "scenario.toml") == ambkit.Scenario(duration=0.1)
    np.testing.assert_array_equal(ambkit.load(tmp_path / "run.csv")["y"], log["y"])
    loaded = ambkit.load(tmp_path / "filter.toml")
    np.testing.assert_array_equal(loaded.run(log).x, kf.run(log).x)
    force = np.array([0.1, 0.2]), np.array([1e-4, 2e-4])
    np.testing.assert_array_equal(
        ambkit.load(tmp_path / "expert.json").force(*force), expert.force(*force)
    )
    (tmp_path / "notes.docx").write_text("?")
    with pytest.raises(ambkit.AmbkitError, match=r"cannot read \.docx"):
        ambkit.load(tmp_path / "notes.docx")


def test_what_was_identified_is_validated_later(log):
    scenario = ambkit.scenario_for(AXIS, step=2e-4, duration=0.05, seed=3)
    other = ambkit.simulate(AXIS, scenario).record
    free = ["magnet_constant", "measurement_noise"]
    at_once = ambkit.identify(AXIS, [log], validate=[other], free=free)
    later = ambkit.identify(AXIS, [log], free=free).validate(other)
    assert later.to_dict()["validation"] == at_once.to_dict()["validation"]
    assert later.on_others
    with pytest.raises(ambkit.AmbkitError, match="used for identification and validation"):
        later.validate(log)
