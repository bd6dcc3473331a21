"""Identification of an axis among others: with all readings and controls, others do not bias it."""

import numpy as np
import pytest

import ambkit
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.record import Record
from ambkit.fuzzy.expert import Expert
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.machine.axes import with_axis
from ambkit.machine.machine import Machine
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.identified import identified_filter
from ambkit.workflow.identify import identify, starting_model

MACHINE = Machine.preset("tum_mlps")  # rotates; each bearing has a sensor to either side
AXIS = "A1"
SAMPLES = 2000


@pytest.fixture(scope="module")
def record():
    """A run in which the reference of one axis is shaken."""
    T = MACHINE.sampling_time
    t = T * np.arange(SAMPLES + 1)
    references = np.zeros((t.size, len(MACHINE.axes)))
    tones = (11.0, 37.0, 83.0, 141.0)
    references[:, 0] = sum(2.5e-5 * np.sin(2 * np.pi * f * t + f) for f in tones)
    run = simulate_run(
        MACHINE,
        Scenario(duration=SAMPLES * T, seed=3, controller={"feedback": "measurement"}),
        external_inputs=ExternalInputs(references=references),
    )
    return run.record.select(*(s for s in run.record if s.startswith(("y_", "u_"))))


def test_the_other_axes_bias_nothing(record):
    true = MACHINE.isolated_axis(AXIS)
    wrong = true.replace(**true.magnet.with_constant(0.8 * true.magnet.magnet_constant))
    described = with_axis(MACHINE, AXIS, wrong)
    found = identify(described, record, AXIS, free=["magnet_constant"])
    k, error = (
        found.likelihood["magnet_constant"],
        found.likelihood.standard_error("magnet_constant"),
    )
    assert error < 0.04 * k
    assert abs(k - true.magnet.magnet_constant) < 3 * error
    assert found.isolated.name == AXIS
    assert any("errors in the description of the other bearings" in note for note in found.notes)
    assert [axis.name for axis in found.machine.axes] == [axis.name for axis in MACHINE.axes]
    assert found.machine.isolated_axis(AXIS).magnet.magnet_constant == pytest.approx(k, rel=1e-12)
    assert identified_filter(found).machine.isolated_axis(
        AXIS
    ).magnet.magnet_constant == pytest.approx(k)

    # Alone, it takes what the others do for something of its own.
    y, u = record["y_La1"], record["u_A1"]
    alone = maximum_likelihood(Record(record.t, {"y": y, "u": u}), wrong, ["magnet_constant"])
    off = alone["magnet_constant"] - true.magnet.magnet_constant
    assert abs(off) > 5 * alone.standard_error("magnet_constant")


def test_the_mass_of_an_axis_is_not_looked_for(record):
    with pytest.raises(AmbkitError, match="no parameter is free; mass: all axes move one rotor"):
        identify(MACHINE, record, AXIS, free=["mass"])


def test_what_cannot_be_is_said(record):
    with pytest.raises(AmbkitError, match="has the axes A1, A2, B1, B2: name one of them"):
        identify(MACHINE, record)
    with pytest.raises(AmbkitError, match="there is no axis C"):
        identify(MACHINE, record, "C")
    with pytest.raises(RecordError, match="the record has no u_B2"):
        identify(MACHINE, record.select(*(s for s in record if s != "u_B2")), AXIS)


def test_the_command(record, call, tmp_path):
    record.save("log.csv")
    MACHINE.save("machine.toml")
    line = ("identify", "machine.toml", "log.csv", "--free", "magnet_constant")
    assert call(*line, "--axis", "A1", "--out", "found.toml").code == 0
    assert "# Of the axis A1: magnet_constant = " in (tmp_path / "found.toml").read_text()
    found = Machine.load("found.toml").isolated_axis("A1").magnet.magnet_constant
    assert found == pytest.approx(MACHINE.isolated_axis("A1").magnet.magnet_constant, rel=0.05)


def test_the_control_noise_of_other_bearings_is_that_of_a_step_too():
    """Their noise was a quarter: in each of four steps of a sample that of the sample."""
    noisy = MACHINE.isolated_axis("B1").replace(amplifier__noise_variance=0.01)
    machine = with_axis(MACHINE, "B1", noisy)
    run = ambkit.simulate(machine, Scenario(duration=0.03, seed=1)).record
    start = starting_model(machine, AXIS)
    models = [start.replace(substeps=steps) for steps in (1, 4)]
    coarse, fine = (one.innovations(start.record(run))[1][-1] for one in models)
    assert fine == pytest.approx(coarse, rel=1e-3)


def test_an_axis_is_a_machine_of_its_own():
    one = MACHINE["A2"]
    assert one.single
    assert one.isolated_axis("") is MACHINE.isolated_axis("A2")


def test_an_expert_is_of_an_axis(call):
    words = ("--axis", "B1", "--rules", "3x3", "--out", "one.json")
    assert call("train", "tum_mlps", *words).code == 0
    assert call("train", "tum_mlps").code == 2
    assert Expert.load("one.json").source.startswith("B1")
    with pytest.raises(AmbkitError, match="name one of them"):
        ambkit.train(MACHINE, rules=(3, 3))
    same = ambkit.train(MACHINE, rules=(3, 3), axis="B1")
    assert same.expert.rules == Expert.load("one.json").rules
