"""An estimator of the user's, in Python, wherever one of ours is taken."""

from typing import Any

import numpy as np
import pytest

import ambkit
from ambkit import AmbkitError, Machine, Scenario
from ambkit.estimate.user_filter import OwnEstimator
from ambkit.simulation.plans import Planned

AXIS, MACHINE = Machine.preset("zittau_axial"), Machine.preset("tum_mlps")


class Mine:
    """One of ours behind the smallest interface."""

    def __init__(self, machine):
        self.kf: Any = ambkit.KalmanFilter(machine)
        if machine == AXIS:
            self.kf = ambkit.SteadyStateKalmanFilter(machine)
        self.started = False

    def reset(self, mean, std):
        self.kf.reset(mean, std)
        self.started = False

    def step(self, y, u):
        started, self.started = self.started, True
        return np.asarray(self.kf.step(y, u) if started else self.kf.update(y))


@pytest.mark.parametrize("feedback", ["estimate", "measurement"])
def test_it_flies_as_ours_does_to_the_last_bit(feedback):
    assert isinstance(Mine(AXIS), ambkit.EstimatorProtocol)
    happens = Scenario(duration=0.1, controller=ambkit.Control(feedback=feedback))
    runs = [
        ambkit.simulate(AXIS, happens, filter=estimator, disturbance="2 N")
        for estimator in (Mine, ambkit.SteadyStateKalmanFilter(AXIS))
    ]
    own, ours = runs
    assert own.estimate.estimator == "Mine"
    np.testing.assert_array_equal(own.record["x"], ours.record["x"])
    np.testing.assert_array_equal(own.estimate.mean, ours.estimate.mean)
    again = OwnEstimator(AXIS, Mine).run(own.record)
    assert np.abs(again.mean - own.estimate.mean)[500:, 0].max() < 1e-8


def test_it_flies_on_machines():
    flight = Scenario(duration=0.03, controller={"feedback": "estimate"})
    runs = [
        ambkit.simulate(MACHINE, flight, filter=estimator)
        for estimator in (OwnEstimator(MACHINE, Mine), ambkit.KalmanFilter(MACHINE))
    ]
    for axis in runs[0].axes:
        np.testing.assert_array_equal(runs[0].record[f"s_{axis}"], runs[1].record[f"s_{axis}"])


@pytest.mark.parametrize("plant", [AXIS, MACHINE], ids=lambda plant: plant.name)
def test_its_margins_follow_from_its_answers(plant):
    kind = "steady-state" if plant is AXIS else "linear"
    own, ours = (
        next(iter(reversed(ambkit.assess(plant, of).loops.values())))
        for of in ({"own": Mine}, kind)
    )
    assert own.peak == pytest.approx(ours.peak, rel=1e-6)


def test_from_a_file_in_all_verbs(tmp_path):
    (tmp_path / "my.py").write_text(
        "class Raw:\n    def step(self, y, u):\n        return y, 0, 0, y\n"
        "class Late:\n    n = 0\n    def step(self, y, u):\n        self.n += 1\n"
        "        return 1 / (7 - self.n), 0, 0, y\n"
    )
    raw = f"{tmp_path}/my.py:Raw"
    still = Scenario(duration=0.05, controller=ambkit.Control(feedback="measurement"))
    run = ambkit.simulate(AXIS, still, filter=raw)
    np.testing.assert_array_equal(run.estimate.x, run.record["y"])
    assert list(ambkit.filter(run.record, [raw], machine=AXIS).estimators) == [raw]
    out = ambkit.inject_faults(AXIS, [raw], faults=["outage-10ms"], samples=0)
    assert any(each.estimator == raw for each in out.outcomes)
    late = f"{tmp_path}/my.py:Late"
    with pytest.raises(AmbkitError, match=r"Late: step\(y, u\) at sample 6: ZeroDivisionError"):
        ambkit.simulate(AXIS, still, filter=late)
    with pytest.raises(AmbkitError, match=r"Late: step\(y, u\) at sample 6: ZeroDivisionError"):
        ambkit.filter(run.record, [late], machine=AXIS)
    with pytest.raises(AmbkitError, match="there is no class or function Nobody; it has Raw, Late"):
        ambkit.simulate(AXIS, still, filter=f"{tmp_path}/my.py:Nobody")


class Broken:
    """Fails at its third sample."""

    samples = 0

    def step(self, y, u):
        self.samples += 1
        return [y / (self.samples < 3), 0.0, 0.0, y]


@pytest.mark.parametrize("machine", [AXIS, MACHINE])
def test_many_runs_of_it_are_those_of_ours(machine):
    scenario = Scenario(duration=0.01, controller={"feedback": "estimate"})
    own, ours = OwnEstimator(machine, Mine), Mine(machine).kf
    runs = [Planned(machine, scenario, of, number=k) for of in (own, ours) for k in range(2)]
    figures = ambkit.simulate_many(runs, threads=2).figures
    for name in set(figures) - {"nis"}:  # which asks for a variance
        np.testing.assert_array_equal(figures[name][:2], figures[name][2:])
    with pytest.raises(AmbkitError, match=r"Broken: step\(y, u\) at sample 2: ZeroDivisionError"):
        ambkit.simulate_many([Planned(AXIS, scenario, OwnEstimator(AXIS, Broken))])
