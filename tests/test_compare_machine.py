"""Estimators of machines compared in a case, beside the bound and the raw sensors."""

import numpy as np
import pytest

from ambkit import AmbkitError, Bearing, KalmanFilter, Machine, compare
from ambkit.cli.main import main
from ambkit.judge.comparison.bound import bearing_bound
from ambkit.judge.comparison.cases import CASES, trials
from ambkit.machine.machine import as_machine

MACHINE = Machine.preset("tum_mlps")


def test_a_machine_has_its_bound_and_its_raw_sensors_beside_the_filters():
    found = compare(MACHINE, "model", ["linear", "extended"], runs=4).bench
    for signal in ("x", "v", "f_d"):
        assert 0.95 < found.efficiency("extended", signal) < 1.05
    # It takes what the magnets' law bends for a force.
    assert found.efficiency("linear", "f_d") < 0.9
    assert found.best["extended"].mean("nees") == pytest.approx(0.95, abs=0.03)
    assert found.raw > 2 * found.limit["x"]
    # What feeds the controllers is in the loop, which knows no overshoot of several axes.
    assert found.best["linear"].mean("tracking") > 0
    assert np.isnan(found.best["linear"].mean("overshoot"))


def test_each_axis_gets_what_happens_to_it_alone():
    record = trials(CASES["unbalance"], MACHINE, 1, 0)[0].record
    for axis in MACHINE.axes:
        alone = CASES["unbalance"].scenario(MACHINE.alone(axis.name), 0.6)
        assert record[f"f_d_{axis.name}"] == pytest.approx(alone.disturbance.sample(record.t))
        assert record[f"r_{axis.name}"] == pytest.approx(alone.reference.sample(record.t))


def test_an_axis_as_a_machine_has_the_same_bound():
    bearing = Bearing.preset("zittau_axial").replace(amplifier__bandwidth="1 kHz")
    records = [trial.record.between(None, 0.02) for trial in trials(CASES["model"], bearing, 2, 0)]
    of = KalmanFilter(bearing)
    same = [bearing_bound(each, records, of.variances, of.default_std())
            for each in (bearing, as_machine(bearing))]  # fmt: skip
    assert (same[0] == same[1]).all()
    position = np.eye(len(of.states))[:1]
    alone = bearing_bound(bearing, records, of.variances, of.default_std(), position)
    assert alone[:, 0] == pytest.approx(same[0][:, 0])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--case", "wrong-k"), "can be simulated for a machine with one axis only"),
        (("--estimators", "low-pass"), "takes one axis"),
        (("--report", "out.html"), "leave it out"),
    ],
)
def test_what_a_machine_cannot_be_compared_in_is_one_sentence(
    options, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    chosen = () if "--estimators" in options else ("--estimators", "linear")
    with pytest.raises(SystemExit, match="2"):
        main(["compare", "tum_mlps", "--runs", "1", *chosen, *options])
    assert said in capsys.readouterr().err


def test_all_kinds_are_those_that_take_several_axes():
    from ambkit.estimate.registry import KINDS
    from ambkit.judge.comparison.contenders import suited

    kinds = suited(list(KINDS), MACHINE)
    assert "linear" in kinds
    assert "low-pass" not in kinds
    assert suited(["low-pass"], MACHINE) == ["low-pass"]  # who names it is told why not
    with pytest.raises(AmbkitError, match="takes one axis"):
        compare(MACHINE, "model", ["low-pass"], runs=1)
