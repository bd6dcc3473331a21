"""What happens in a run: the signals over time, and a scenario's TOML."""

import copy
import doctest
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import BEARINGS

from ambkit.base.errors import ConfigError
from ambkit.control.pid import PID
from ambkit.data.record import Record
from ambkit.machine.machine import Machine
from ambkit.simulation import scenario as scenario_module
from ambkit.simulation.run import simulate
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import (
    Constant,
    HalfSine,
    Impulse,
    Ramp,
    Recorded,
    Sequence,
    Sine,
    Step,
    Sum,
)

T = 1e-3
t = T * np.arange(101)


def refused(text):
    with pytest.raises(ConfigError) as caught:
        Scenario.from_toml(text, "s.toml")
    return list(caught.value.problems)


def test_the_defaults_are_a_noisy_hover():
    assert Scenario.from_toml("") == Scenario()
    quiet = Scenario().reference.sample(t)
    assert quiet.shape == t.shape
    assert not quiet.any()


@pytest.mark.parametrize("at", [0, 1, 7, 29, 57, 100])
@pytest.mark.parametrize("sampling_time", [1e-3, 1e-4, 1 / 3e3])
def test_a_step_falls_on_its_sample_whatever_the_rounding(at, sampling_time):
    time = sampling_time * np.arange(101)
    step = Step(amplitude=2.0, time=float(f"{at * sampling_time:.15g}")).sample(time)
    assert np.array_equal(step, np.where(np.arange(101) >= at, 2.0, 0.0))


def test_ramp_rises_between_start_and_end():
    ramp = Ramp(slope=2.0, start=0.02, end=0.05).sample(t)
    assert np.allclose(ramp, np.interp(t, [0.02, 0.05], [0, 0.06]), rtol=1e-14, atol=0)
    assert Ramp(slope=2.0).sample(t)[-1] == pytest.approx(0.2, rel=1e-14)


def test_sine_has_its_frequency_phase_and_mean():
    sine = Sine(amplitude=2.0, frequency=50.0, phase=math.pi / 2, offset=1.0).sample(t)
    assert sine[0] == 3.0
    assert sine[10] == pytest.approx(-1.0)
    assert sine[20] == pytest.approx(3.0)


@given(
    area=st.floats(-10, 10),
    time=st.floats(0, 0.05),
    duration=st.floats(1e-9, 0.05),
    sampling_time=st.sampled_from([1e-4, 1e-3, 7e-3]),
)
def test_an_impulse_keeps_its_area_however_short(area, time, duration, sampling_time):
    grid = sampling_time * np.arange(math.ceil(0.1 / sampling_time) + 2)
    force = Impulse(area=area, time=time, duration=duration).sample(grid)
    assert force.sum() * sampling_time == pytest.approx(area, rel=1e-9, abs=1e-12)
    assert np.count_nonzero(force) <= duration / sampling_time + 2


def test_a_sequence_holds_each_value_until_the_next():
    values = Sequence(times=np.array([0.01, 0.02]), values=np.array([1, -1])).sample(t)
    assert [values[0], values[9], values[10], values[19], values[20], values[-1]] == [
        *(0, 0, 1, 1, -1, -1)
    ]


def test_signals_add():
    both = Step(amplitude=1.0, time=0.01) + Constant(value=2.0)
    assert isinstance(both, Sum)
    assert [both.sample(t)[0], both.sample(t)[-1]] == [2.0, 3.0]


def test_a_recorded_signal_is_interpolated_and_held_outside():
    recorded = Recorded(times=[0.01, 0.02], values=[1.0, 3.0])
    assert recorded.sample([0.0, 0.015, 0.1]) == pytest.approx([1.0, 2.0, 3.0])


def test_a_recording_is_found_beside_the_scenario(tmp_path):
    force = np.sin(40 * t)
    Record(t, {"f_d": force}, {"f_d": "N"}).save(tmp_path / "load.csv")
    path = tmp_path / "run.toml"
    path.write_text('[disturbance]\ntype = "recorded"\nfile = "load.csv"\nsignal = "f_d"\n')
    scenario = Scenario.load(path)
    assert np.array_equal(scenario.disturbance.sample(t), force)
    assert Scenario.from_toml(scenario.to_toml()) == scenario


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('file = "none.csv"\nsignal = "f_d"', "4: disturbance.file: "),
        ('file = "load.csv"\nsignal = "f"', "4: disturbance.file: the record has no signal f"),
        ('file = "load.csv"\nsignal = "y"', "5: disturbance.signal: must be in N; y of "),
        ('file = "load.csv"\nsignal = "holes"', "5: disturbance.signal: must be finite throughout"),
        ('file = "load.csv"', "2: disturbance.signal: missing"),
        ('signal = "f_d"', "2: disturbance.file: missing"),
        ("", "2: disturbance.file: missing: give file and signal, or times and values"),
        ('file = "load.csv"\nvalues = ["1 N"]', "4: disturbance.file: give either"),
    ],
)
def test_a_recording_that_does_not_serve_is_refused(tmp_path, table, message):
    y, holes = np.zeros_like(t), np.where(t > 0.05, np.nan, 0.0)
    units = {"y": "m", "f_d": "N", "holes": "N"}
    Record(t, {"y": y, "f_d": y, "holes": holes}, units).save(tmp_path / "load.csv")
    path = tmp_path / "run.toml"
    path.write_text(f'seed = 1\n[disturbance]\ntype = "recorded"\n{table}\n')
    with pytest.raises(ConfigError) as caught:
        Scenario.load(path)
    assert len(caught.value.problems) == 1
    assert f"run.toml:{message}" in str(caught.value)


def test_a_signal_has_the_unit_of_its_place():
    step = 'type = "step"\namplitude = "0.5 mm"\ntime = "20 ms"\n'
    scenario = Scenario.from_toml(f"[reference]\n{step}")
    assert scenario.reference == Step(amplitude=0.5e-3, time=0.02)
    assert refused(f"[disturbance]\n{step}") == [
        's.toml:3: disturbance.amplitude: "0.5 mm": mm cannot be converted to N, '
        'write it like "3 N"'
    ]
    alone = Step(amplitude="0.5 mm", time="20 ms")
    assert alone == scenario.reference
    assert Scenario(reference=alone) == scenario
    with pytest.raises(ConfigError) as caught:
        Scenario(disturbance=Constant(value="3 N") + alone)
    assert str(caught.value) == 'Scenario.disturbance: "0.5 mm": mm cannot be converted to N'
    assert Scenario(reference=Ramp(slope="2 mm/ms")).reference.slope == 2.0
    assert Sequence(times=["1 ms"], values=["3 µm"]).values == (3e-6,)
    assert copy.deepcopy(alone) == pickle.loads(pickle.dumps(alone)) == alone
    for wrong, told in (("50", "has no unit"), ("5 foo", "is not a known unit"), ("x", "number")):
        with pytest.raises(ConfigError, match=told):
            Step(amplitude=wrong)
    assert Scenario(reference={"type": "step", "amplitude": "0.5 mm"}).reference.amplitude == 0.5e-3


def test_many_mistakes_are_reported_at_once_in_order():
    text = """\
duration = "0.2 m"
nois = true
seed = -1
start = "levtated"
[reference]
type = "sequence"
times = ["0 s", "20 ms", "10 ms"]
values = ["0 mm", "3 N"]
[disturbance]
type = "stp"
[controller]
kp = "3000 A"
seed = 3
"""
    assert refused(text) == [
        's.toml:1: duration: "0.2 m": m cannot be converted to s, write it like "0.5 s"',
        "s.toml:2: nois: unknown key, did you mean noise?",
        "s.toml:3: seed: must be greater than or equal to 0, is -1",
        's.toml:4: start: must be one of "levitated", "landed", "released", is "levtated"; '
        'did you mean "levitated"?',
        "s.toml:7: reference.times: must increase, but 0.01 s follows 0.02 s",
        's.toml:8: reference.values[1]: "3 N": N cannot be converted to m, write it like "0.5 mm"',
        's.toml:10: disturbance.type: must be one of "constant", "step", "ramp", "sine", '
        '"impulse", "half-sine", "sequence", "recorded", "sum", is "stp"; did you mean "step"?',
        's.toml:12: controller.kp: "3000 A": A cannot be converted to A/m, '
        'write it like "3000 A/m"',
        "s.toml:13: controller.seed: unknown key here, it belongs above the first [table]",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[reference]\namplitude = "1 mm"', "1: reference.type: missing: one of"),
        ("reference = 3", "1: reference: must be a table, is 3"),
        ('[[reference.parts]]\ntype="step"', "reference.type: missing: one of"),
        ('[reference]\ntype="sum"\nparts=[{type="step"}]', "3: reference.parts[0].amplitude: miss"),
        ('[reference]\ntype="sequence"\ntimes=[]\nvalues=[]', "3: reference.times: must not be em"),
        ('[reference]\ntype="sequence"\ntimes=["1 s"]\nvalues=[]', "4: reference.values: must be"),
        ('[reference]\ntype="ramp"\nslope="1 m/s"\nstart="2 s"\nend="1 s"', "5: reference.end: "),
        ('[reference]\ntype="sine"\namplitude="1 mm"\nfrequency="50 rad/s"', "4: reference.freq"),
        ("noise = 1", "1: noise: must be a valid boolean, is 1"),
        ("substeps = 0", "1: substeps: must be greater than or equal to 1, is 0"),
        ('[controller]\nanti_windup = "0 s"', "2: controller.anti_windup: must be greater than 0"),
    ],
)
def test_one_mistake_gives_one_line(text, message):
    found = refused(text)
    assert len(found) == 1
    assert message in found[0]


number = st.floats(-1e6, 1e6)
moment = st.floats(0, 1e6)


def increasing(draw):
    return sorted(draw(st.lists(moment, min_size=1, max_size=5, unique=True)))


@st.composite
def series(draw, kind):
    times = increasing(draw)
    return kind(times=times, values=[draw(number) for _ in times])


simple = (
    st.builds(Constant, value=number)
    | st.builds(Step, amplitude=number, time=moment)
    | st.builds(Ramp, slope=number, start=moment, end=st.none() | st.floats(1.1e6, 2e6))
    | st.builds(Sine, amplitude=number, frequency=st.floats(1e-3, 1e6), phase=number, offset=number)
    | st.builds(Impulse, area=number, time=moment, duration=st.floats(1e-9, 1e3))
    | series(Sequence)
    | series(Recorded)
)
waveforms = st.recursive(
    simple, lambda s: st.builds(Sum, parts=st.lists(s, min_size=1, max_size=3))
)
scenarios = st.builds(
    Scenario,
    duration=st.floats(1e-9, 1e6),
    start=st.sampled_from(["levitated", "landed", "released"]),
    noise=st.booleans(),
    seed=st.integers(0, 2**63 - 1),
    substeps=st.integers(1, 1000),
    reference=waveforms,
    disturbance=waveforms,
    controller=st.builds(PID, kp=moment, ki=moment, kd=moment, derivative_filter=moment),
)


@given(scenarios)
def test_toml_round_trip_is_the_identity(scenario):
    again = Scenario.from_toml(scenario.to_toml())
    assert again == scenario
    assert hash(again) == hash(scenario)


@given(waveforms, st.integers(1, 50))
def test_every_signal_is_finite_and_as_long_as_its_time(signal, n):
    values = signal.sample(1e-3 * np.arange(n))
    assert values.shape == (n,)
    assert values.dtype == np.float64
    assert np.isfinite(values).all()


def test_gains_for_the_papers_bearing_are_the_defaults():
    gains = PID.for_bearing(Machine.preset("zittau_axial"))
    default = PID()
    assert (gains.kp, gains.kd) == (default.kp, default.kd)
    assert gains.ki == pytest.approx(default.ki, rel=0.05)
    assert gains.derivative_filter == pytest.approx(default.derivative_filter, rel=0.05)
    assert gains.anti_windup == pytest.approx(default.anti_windup, rel=0.05)


@pytest.mark.parametrize("name", BEARINGS)
def test_gains_for_a_bearing_hold_it(name):
    bearing = Machine.preset(name)
    gap = bearing.magnet.air_gap
    scenario = Scenario(
        duration=2.0,
        reference=Step(amplitude=gap / 10, time=0.1),
        noise=False,
        controller=PID.for_bearing(bearing),
    )
    x = simulate(bearing, scenario)["x"]
    assert np.abs(x).max() < gap / 4
    assert x[-1] == pytest.approx(gap / 10, rel=0.02)


def test_the_json_schema_gives_defaults_as_a_file_would():
    definitions = Scenario.json_schema()["$defs"]
    assert definitions["PID"]["properties"]["kp"]["default"] == "1700 A/m"
    assert definitions["Step"]["required"] == ["amplitude"]


def test_docstring_examples():
    assert doctest.testmod(scenario_module).failed == 0


def test_half_sine_is_half_a_period():
    shock = HalfSine(amplitude=3.0, time=0.01, duration=0.02)
    t = np.linspace(0, 0.05, 5001)
    value = shock.sample(t)
    assert value.max() == pytest.approx(3.0, rel=1e-6)
    assert not value[(t < 0.01) | (t > 0.03)].any()
    assert np.trapezoid(value, t) == pytest.approx(3.0 * 0.02 * 2 / np.pi, rel=1e-5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"on": 0.2}, "on: needs off"), ({"off": 0.3, "on": 0.2}, "on: must be after off, 0.3 s"),
        ({"off": 0.3, "plant": "mine.py:Plant"}, "off: acts on the machine's own plant"),
    ],
)  # fmt: skip
def test_a_power_failure_that_contradicts_the_rest_is_refused(keys, message):
    with pytest.raises(ConfigError, match=message):
        Scenario(**keys)
