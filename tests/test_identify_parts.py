"""What a bearing has beside the paper's: identified with it, and not without it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import pytest

import ambkit
from ambkit import Machine, Scenario, Sine, simulate
from ambkit.identification.dead_time import acting, delayed, lagged
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.online.adaline import Adaline
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.workflow.identified_toml import annotated_toml, carried_over

BEARING = Machine.preset("zittau_axial")
SEEDS = (0, 1, 2)
LINES = {13: 200e-6, 29: 100e-6, 61: 60e-6, 97: 40e-6, 151: 30e-6, 223: 20e-6}
"""Amplitudes of the reference [m] by frequency [Hz]: a lag of 0.8 ms shows at the upper ones."""


@dataclass(frozen=True)
class Part:
    """A part with its values, what the search is told instead, and what it is to find of it."""

    true: dict = field(default_factory=dict)
    told: dict = field(default_factory=dict)
    free: tuple = ()


PARTS = {
    "amplifier": Part(
        {"amplifier__bandwidth": "200 Hz"}, {"amplifier__bandwidth": "260 Hz"}, ("current_lag",)
    ),
    "delay": Part({"delay": "0.15 ms"}, {"delay": "0.05 ms"}, ("delay",)),
    "coloured noise": Part(
        {"sensor__coloured_noise": {"variance": "25 um^2", "bandwidth": "200 Hz"}}
    ),
    "hum": Part(
        {"sensor__hum": [{"frequency": "50 Hz", "amplitude": "10 um", "bandwidth": "0.5 Hz"}]}
    ),
}


def record_of(bearing, seed):
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(LINES))
    one, *more = (
        Sine(amplitude=a, frequency=f, phase=float(phase))
        for (f, a), phase in zip(LINES.items(), phases, strict=True)
    )
    scenario = Scenario(duration=0.5, seed=seed, reference=sum(more, one),
                        controller=ambkit.PID.textbook(bearing))  # fmt: skip
    record = simulate(bearing, scenario).record
    assert not record.meta["stop_touched"]
    return record


def found_by(known, record, free):
    wrong = known.replace(**known.magnet.with_constant(1.1 * BEARING.magnet.magnet_constant))
    wrong = wrong.replace(sensor__noise_variance=1.5 * BEARING.sensor.noise_variance)
    start = LoopModel(wrong, disturbance_noise=1e-3, load_std=0.05)
    free = ("magnet_constant", "air_gap", "measurement_noise", *free)
    return maximum_likelihood(record, start, free, improve_start=False)


@pytest.mark.long
@pytest.mark.parametrize("name", PARTS)
def test_what_knows_the_part_finds_it_and_the_bearing_and_what_does_not_is_wrong(name):
    part = PARTS[name]
    plant = BEARING.replace(**part.true)
    truth = LoopModel(plant)

    def both(seed):
        record = record_of(plant, seed)
        right = found_by(plant.replace(**part.told), record, part.free)
        return right, found_by(BEARING, record, ())

    with ThreadPoolExecutor(2) as pool:
        for right, plain in pool.map(both, SEEDS):
            assert right.converged
            assert not right.held
            for p in right.parameters:
                off = (right[p.name] - p.of(truth)) / right.standard_error(p.name)
                assert abs(off) < 3, (p.name, off)
            assert right.log_likelihood > plain.log_likelihood + 50
            # In errors of the one that is right: those of a wrong one grow with what it misses.
            wrong = [
                abs(plain[p.name] - p.of(truth)) / right.standard_error(p.name)
                for p in plain.parameters
            ]
            assert max(wrong) > 5, wrong


def test_what_was_found_is_in_the_bearing_that_is_written():
    """So that a filter of it knows the delay and the lag, and the log's map need not."""
    plant = BEARING.replace(delay="0.15 ms", amplifier__bandwidth="200 Hz")
    told = BEARING.replace(delay="0.1 ms", amplifier__bandwidth="250 Hz")
    record = record_of(plant, 0)
    found = found_by(told, record, ("delay", "current_lag"))
    text = annotated_toml(found)
    written = Machine.from_toml(text)
    assert written == found.isolated
    assert written.delay == found["delay"]
    assert written.amplifier.bandwidth == pytest.approx(1 / (2 * np.pi * found["current_lag"]))
    assert 'bandwidth = "' in text
    assert 'Hz"  # found, standard error' in text
    assert not any("[signals" in line for line in carried_over(found.model, delay=False))
    nis = {
        bearing: ambkit.ExtendedKalmanFilter(bearing).run(record).nis[100:].mean()
        for bearing in (written, BEARING)
    }
    assert nis[written] == pytest.approx(1.0, abs=0.06)
    assert nis[BEARING] > nis[written]


def test_a_delay_that_cannot_be_told_from_none_is_left_out_of_the_bearing():
    record = record_of(BEARING, 3)
    found = found_by(BEARING, record, ("delay",))
    assert abs(found["delay"]) < 3 * found.standard_error("delay")
    assert found.isolated.delay is None
    known = found_by(BEARING.replace(delay="0.02 ms"), record, ())  # given, and not asked
    assert known.isolated.delay == 2e-5


def test_a_model_takes_delay_and_lag_of_its_bearing_and_its_filter_has_neither():
    b = BEARING.replace(
        delay="0.15 ms", amplifier__bandwidth="200 Hz", amplifier__voltage_limit="50 V",
        amplifier__resistance="2 ohm",
    )  # fmt: skip
    model = LoopModel(b)
    assert model.delay == 1.5e-4
    assert model.current_lag == pytest.approx(1 / (2 * np.pi * 200))
    assert [state.name for state in model.kalman().states] == ["x", "v", "f_d", "x_m"]
    assert model.delayed_machine() == b
    assert model.replace(delay=-1e-5, current_lag=0.0).delayed_machine() == model.undelayed_machine
    assert model.replace(delay=1.0).delayed_machine().delay is None  # longer than any bearing's
    plain = LoopModel(b.replace(delay=None), delay=3e-4, current_lag=1e-3)
    assert plain.delayed_machine().delay == 3e-4
    assert plain.delayed_machine().amplifier.bandwidth == pytest.approx(159.2, rel=1e-3)


def test_learning_online_takes_the_signal_as_it_acts():
    late = BEARING.replace(delay="0.3 ms", amplifier__bandwidth="100 Hz")
    record = record_of(late, 0)
    u = record["u"]
    np.testing.assert_array_equal(
        acting(late, u), delayed(lagged(u, 1e-4, 1 / (2 * np.pi * 100)), 3e-4 / 1e-4)
    )
    knows, plain = (Adaline(b).run(record).magnet_constant for b in (late, BEARING))
    k = BEARING.magnet.magnet_constant
    assert abs(knows / k - 1) < 0.05
    assert abs(plain / k - 1) > 2 * abs(knows / k - 1)


def test_of_a_force_map_the_scale_is_found(tmp_path):
    """Of the magnet that is the map, and the law beside it goes along."""
    iu, x = (
        a.ravel() for a in np.meshgrid(np.linspace(-1.5, 1.5, 13), np.linspace(-1e-3, 1e-3, 9))
    )
    force = ambkit.ClosedLaw(BEARING).force(iu, x) * (1 - 0.05 * (x / 1e-3) ** 2)
    ForcePoints(iu, x, force, None).save(tmp_path / "map.csv")
    known = BEARING.replace(magnet__force_map=str(tmp_path / "map.csv"))
    plant = known.replace(**known.magnet.with_constant(1.15 * known.magnet.magnet_constant))
    assert plant.magnet.force_scale == pytest.approx(1.15)
    record = record_of(plant, 0)
    start = LoopModel(known, disturbance_noise=1e-3, load_std=0.05)
    found = maximum_likelihood(
        record, start, ("magnet_constant", "measurement_noise"), improve_start=False
    )
    scale = found.standard_error("magnet_constant") / known.magnet.magnet_constant
    assert abs(found.isolated.magnet.force_scale - 1.15) < 3 * scale
    assert found.isolated.magnet.force_map == known.magnet.force_map
