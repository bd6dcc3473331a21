"""Experiments: signals that excite what they say, limits that hold, errors that follow."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import quick
from scipy.stats import chi2

import ambkit
from ambkit import Machine, Record, Scenario
from ambkit.assessment.injection_experiment import design_injection
from ambkit.base.errors import AmbkitError
from ambkit.control.pid import PID
from ambkit.identification.excitation import Limits, design
from ambkit.identification.excitation.signals import KINDS, multisine, prbs, stepped_sine
from ambkit.identification.maximum_likelihood.likelihood import Data, Likelihood
from ambkit.identification.maximum_likelihood.parameters import Coordinates, named
from ambkit.machine.magnets import own_time

BEARING = Machine.preset("zittau_axial")
LOOP = Scenario(duration=1.0, controller=PID.textbook(BEARING))
FREE = ("magnet_constant", "air_gap", "sensor_lag", "position_offset")
BAND = (8.0, 80.0)


def designed(**options):
    return design(BEARING, LOOP, **({"free": FREE, "band": BAND} | options))


# ---- signals ----


@settings(deadline=None, max_examples=25)
@given(st.sampled_from(sorted(KINDS)), st.integers(800, 5000), st.floats(4, 40), st.floats(2.5, 10))
def test_signals_excite_their_band_with_amplitude_one(kind, n, periods, ratio):
    T = 1e-3
    low = periods / (n * T)
    high = min(ratio * low, 0.4 / T)
    signal = KINDS[kind](n, T, (low, high))
    assert signal.values.shape == (n,)
    # Between the samples of a fast sine its peaks may go by.
    assert 0.9 < np.max(np.abs(signal.values)) <= 1
    power = np.abs(np.fft.rfft(signal.values)) ** 2
    frequency = np.fft.rfftfreq(n, T)
    inside = (frequency >= low / 1.5) & (frequency <= 1.5 * high)
    # A binary signal has a tail above its band, and lines below its lower end; a sine of few
    # periods has no sharp line.
    least = {"prbs": 0.4, "stepped-sine": 0.7, "multisine": 0.999}[kind]
    assert power[inside].sum() > least * power.sum()
    assert [part.start for part in signal.parts] == [0, *(part.stop for part in signal.parts[:-1])]
    assert signal.parts[-1].stop == n


@pytest.mark.parametrize("band", [(2.0, 300.0), (20.0, 100.0), (2.5, 20.0)])
def test_a_multisine_has_a_low_crest_factor(band):
    """Random phases give 3 to 4; a lone sine has 1.41."""
    signal = multisine(20_001, 1e-4, band)
    assert signal.crest_factor < 1.6
    assert abs(signal.values[0]) < 0.05  # no jump where it begins
    amplitude = np.abs(np.fft.rfft(signal.values))
    lines = np.round(signal.frequencies * 20_001 * 1e-4).astype(int)
    # The same power an octave, and nothing between or beside the lines.
    shape = amplitude[lines] * np.sqrt(lines)
    assert np.ptp(shape) < 1e-9 * shape[0]
    others = np.delete(amplitude, lines)
    assert others.max() < 1e-9 * amplitude.max()


def test_a_binary_signal_is_of_maximum_length():
    """White within its period: the autocorrelation is 1, and -1/(2^n - 1) at every other shift."""
    signal = prbs(20_000, 1e-3, (8.1, 100.0))
    assert set(signal.values) == {-1.0, 1.0}
    hold = 4
    period = signal.values[: hold * 31 : hold]
    correlation = np.array([period @ np.roll(period, k) for k in range(31)])
    assert correlation[0] == 31
    assert (correlation[1:] == -1).all()
    assert signal.frequencies == pytest.approx([1 / (31 * hold * 1e-3), 100.0])


def test_a_stepped_sine_goes_through_zero_where_it_changes():
    signal = stepped_sine(10_000, 1e-3, (2.0, 50.0))
    assert len(signal.parts) == 12
    assert np.abs(signal.values[[part.start for part in signal.parts]]).max() < 1e-9
    assert (np.diff(signal.frequencies) > -0.01).all()
    assert len(stepped_sine(1000, 1e-3, (3.0, 50.0)).parts) == 3  # a period of the lowest in each


# ---- limits ----

LIMITS = ((1.2, 1e-4), (0.8, 5e-4))


@pytest.mark.parametrize(
    ("kind", "current", "displacement"),
    quick(
        [(kind, *limits) for kind in sorted(KINDS) for limits in LIMITS],
        [(kind, *LIMITS[k % 2]) for k, kind in enumerate(sorted(KINDS))],
    ),
)
def test_one_limit_is_filled_and_none_exceeded(kind, current, displacement):
    found = designed(kind=kind, limits=Limits(current, displacement))
    iu, x = (np.max(np.abs(found.record[name])) for name in ("iu", "x"))
    assert iu <= current
    assert x <= displacement
    assert max(iu / current, x / displacement) > 0.85
    # Whoever runs it finds the same, but for other peaks of other noise.
    again = ambkit.Recorded(times=found.record.t, values=found.reference)
    record = ambkit.simulate(BEARING, LOOP.replace(seed=50, reference=again)).record
    assert np.max(np.abs(record["iu"])) < 1.05 * current
    assert np.max(np.abs(record["x"])) < 1.05 * displacement


def test_wider_limits_tell_more_and_so_does_more_time():
    narrow = designed(limits=Limits(0.8, 1e-4)).expectation.errors
    wide = designed(limits=Limits(1.2, 3e-4)).expectation.errors
    assert (wide < narrow).all()
    longer = design(BEARING, LOOP.replace(duration=3.0), free=FREE, band=BAND)
    assert (longer.expectation.errors[:3] < 0.75 * designed().expectation.errors[:3]).all()


def test_the_band_that_is_chosen_is_the_best_of_those_tried():
    found = designed(band=None)
    certainty = dict(found.candidates)
    assert certainty[found.band] == max(certainty.values())
    assert len(certainty) > 8
    own = np.sqrt(7537.5 / 0.518) / (2 * np.pi)
    assert found.band[0] < 2 * own < 2 * found.band[1]


@pytest.mark.study
def test_estimates_scatter_as_predicted():
    """40 repetitions of the experiment; one step of Gauss and Newton from the truth in each."""
    found = designed(kind="multisine", load=0.05)
    model, parameters = found.expectation.model, named(FREE)
    assert model.disturbance_noise == pytest.approx(0.05**2)
    coordinates = Coordinates(model, parameters)
    rng = np.random.default_rng(7)
    t, T = found.record.t, BEARING.sampling_time
    reference = ambkit.Recorded.model_construct(times=tuple(t), values=tuple(found.reference))
    steps = []
    for seed in range(40):
        walk = np.cumsum(0.05 * np.sqrt(T) * rng.normal(size=t.size))
        load = ambkit.Recorded.model_construct(times=tuple(t), values=tuple(walk))
        scenario = LOOP.model_copy(
            update={"seed": seed, "reference": reference, "disturbance": load}
        )
        record = ambkit.simulate(BEARING, scenario).record
        local = Likelihood(Data([record], own_time(BEARING)), coordinates).local(np.zeros(4))
        steps.append(np.linalg.solve(local.information, local.score))
    unit = [p.of(model) if p.positive else p.coarse(model) for p in parameters]
    ratio = (np.array(steps) * unit).std(axis=0, ddof=1) / found.expectation.errors
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], 39) / 39)
    assert ((low < ratio) & (ratio < high)).all(), dict(zip(FREE, ratio, strict=True))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"kind": "chirp"}, 'no excitation "chirp"; known: multisine, prbs, stepped-sine'),
        ({"free": ["gap"]}, "there is no parameter gap"),
        ({"band": (50.0, 20.0)}, "the band must rise, from 0.9999 Hz"),
        ({"band": (5.0, 6000.0)}, "to 4000 Hz, two fifths of the sampling rate"),
        ({"limits": Limits(0.4, 1e-4)}, "even without excitation the loop reaches"),
        ({"load": 0.0}, "random_walk must be greater than 0 N"),
    ],
)
def test_what_cannot_be_designed_is_told(options, told):
    with pytest.raises(AmbkitError, match=told):
        designed(**options)
    with pytest.raises(AmbkitError, match=r"limit of the current must be .* at most 1\.5 A"):
        Limits.of(BEARING, current=2.0)
    with pytest.raises(AmbkitError, match="too short"):
        design(BEARING, LOOP.replace(duration=0.005), free=FREE)


# ---- the command ----


def test_excite_then_simulate(call, tmp_path):
    found = call("excite", "zittau_axial", "--duration", "0.6 s", "--band", "8 Hz,80 Hz", "--free",
                 "magnet_constant", "--free", "mass", "--limit", "0.2 mm", "--out",
                 "excitation.csv", "--plot", "excitation.svg", "--json").json  # fmt: skip
    assert found["kind"] == "stepped-sine"
    assert found["maximum_displacement"] <= 2e-4
    assert set(found["expected"]["parameters"]) <= {"magnet_constant", "mass"}
    assert (tmp_path / "excitation.svg").is_file()
    excitation = Record.load("excitation.csv")
    assert list(excitation) == ["r"]
    told = call("simulate", "zittau_axial", "--signal", "excitation.csv", "--out", "run.csv")
    assert "wrote run.csv" in told.err
    record = Record.load("run.csv")
    assert (record["r"] == excitation["r"]).all()
    assert np.max(np.abs(record["x"])) < 2.05e-4


def test_the_current_s_lag_is_foretold_where_the_amplifier_has_one(call):
    BEARING.replace(amplifier__bandwidth="200 Hz").save("late.toml")
    words = ("--duration", "0.3 s", "--band", "15 Hz,150 Hz", "--json")
    for bearing, looked_for in (("late.toml", True), ("zittau_axial", False)):
        expected = call("excite", bearing, *words).json["expected"]
        assert ("current_lag" in expected["parameters"] | expected["held"]) == looked_for


def test_an_axis_keeps_its_limits_beside_the_others(call):
    """They move, too, and the unbalance acts: designed without them, the current was 8 % above."""
    words = ("tum_mlps", "--axis", "A1", "--duration", "0.3 s", "--band", "16 Hz,500 Hz")
    assert call("excite", *words, "--out", "e.csv").code == 0
    call("simulate", "tum_mlps", "--signal", "e.csv", "--out", "run.csv")
    record = Record.load("run.csv")
    limits = Limits.of(Machine.preset("tum_mlps").isolated_axis("A1"))
    used = np.abs(record["iu_A1"]).max() / limits.current
    used = max(used, np.abs(record["s_A1"]).max() / limits.displacement)
    assert 0.8 < used <= 1


def test_an_unbalance_that_breaks_a_limit_is_an_error_and_a_smaller_one_leaves_the_rest(call):
    tum, words = Machine.preset("tum_mlps"), ("--duration", "60 ms", "--band", "70 Hz,500 Hz")
    limits = Limits.of(tum.isolated_axis("A1"))
    (plane,) = tum.unbalance
    tum.replace(unbalance=[plane.model_copy(update={"amount": 100 * plane.amount})]).save("u.toml")
    refused = call("excite", "u.toml", "--axis", "A1", *words)
    assert refused.code == 2
    assert "even without excitation the loop reaches" in refused.err
    assert "the limits, 2 A and 0.175 mm, leave no room" in " ".join(refused.err.split())
    tum.replace(unbalance=[plane.model_copy(update={"amount": 50 * plane.amount})]).save("u.toml")
    assert call("excite", "u.toml", "--axis", "A1", *words, "--out", "e.csv").code == 0
    call("simulate", "u.toml", "--signal", "e.csv", "--out", "run.csv")
    record = Record.load("run.csv")
    used = np.abs(record["iu_A1"]).max() / limits.current
    assert 0.9 < max(used, np.abs(record["s_A1"]).max() / limits.displacement) <= 1


def test_step_and_reference_exclude_each_other(call):
    ambkit.simulate(BEARING, duration="10 ms").record.save("r.csv")
    told = call("simulate", "zittau_axial", "--step", "0.1 mm", "--signal", "r.csv")
    assert told.code == 2
    assert "the reference is either a step or a record's" in told.err


TUM = Machine.preset("tum_mlps").replace(unbalance=[], speed="0 rpm")


@pytest.fixture(scope="module")
def injection():
    return design_injection(
        TUM,
        Scenario(duration=1.0, controller={"feedback": "measurement"}),
        axis="B1",
        band=(20.0, 1500.0),
    )


def test_it_keeps_within_the_limits_of_all_axes(injection):
    gap, travel = TUM.bearings[1].magnet.air_gap, TUM.bearings[1].clearance
    assert injection.name == "tum_mlps B1"
    assert injection.limits.displacement == pytest.approx(min(0.05 * gap, 0.5 * travel))
    assert np.abs(injection.record["x"]).max() <= injection.limits.displacement
    assert np.abs(injection.record["x"]).max() > 0.9 * injection.limits.displacement
    assert np.abs(injection.record["iu"]).max() <= injection.limits.current


def test_what_it_tells_is_the_models(injection):
    found = injection.expected
    S = np.abs(ambkit.assess(TUM, "none").loops["measurement"].loop.of_axis(2, found.frequency))
    distance = np.abs(np.abs(found.sensitivity) - S) / S
    assert np.median(distance) < 0.02  # noise, and what the amplitude adds
    assert distance.max() < 0.08
    assert injection.file()["injected_B1"].max() == pytest.approx(injection.added.max())


def test_commands_design_play_and_assess_it(injection, call):
    injection.file().save("injection.csv")
    TUM.save("still.toml")
    assert call("simulate", "still.toml", "--signal", "injection.csv", "--out", "l.csv").code == 0
    told = call("assess", "log", "l.csv", "--machine", "still.toml", "--filter", "none")
    assert told.code == 0
    assert "tum_mlps B1" in told.out
    told = call("simulate", "ufu_rig", "--signal", "l.csv")
    assert told.code == 0  # its axes have these names as well
    injection.record.save("other.csv")
    told = call("simulate", "still.toml", "--signal", "other.csv")
    assert told.code == 2
    assert "it has none of the signals injected_A1" in " ".join(told.err.split())
    for arguments, said in (
        (["tum_mlps"], "has the axes A1, A2, B1, B2: name one of them"),
        (["sensitivity", "tum_mlps", "--random-walk", "1 N"], "there is no option --random-walk"),
        (["zittau_axial", "--axis", "A1"], "zittau_axial has one axis: there is no axis A1"),
    ):
        told = call("excite", *arguments)
        assert told.code == 2
        assert said in " ".join(told.err.split())


def test_what_cannot_be_is_refused():
    with pytest.raises(AmbkitError, match="the axes A1, A2, B1, B2: there is no axis Q"):
        design_injection(TUM, Scenario(duration=1.0), axis="Q")
    with pytest.raises(AmbkitError, match="the limit of the current"):
        design_injection(TUM, Scenario(duration=1.0), current="99 A")
