"""ADALINE, least squares and the Kalman filter with k beside each other: who is right, and when."""

import json
import math
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import ambkit
from ambkit import Constant, Machine, Scenario, Sine, Step
from ambkit.base.errors import AmbkitError
from ambkit.identification.online.adaline import OnlineResult, mean_error
from ambkit.identification.online.comparison import OnlineComparison, compare_online, online_figure
from ambkit.identification.online.magnet_constant import AugmentedIdentifier, AugmentedResult
from ambkit.result.report import Band, Line, Rule, Span
from ambkit.simulation.external_inputs import ExternalInputs

BEARING = Machine.preset("zittau_axial")
K = BEARING.magnet.magnet_constant
START = K / 1.3
PID = ambkit.PID.textbook(BEARING)  # the rotor moves


def moved(seed=0, *, load=0.0, colour=0.0, step=6e-4):
    """Steps to and fro about the centre, for a second; sensor noise correlated over `colour`."""
    reference = Constant(value=0.0) + Step(amplitude=step / 2, time=0.02)
    for place, time in enumerate(np.arange(0.1, 0.95, 0.15)):
        reference = reference + Step(amplitude=(-1) ** (place + 1) * step, time=float(time))
    scenario = Scenario(
        duration=1.0, seed=seed, reference=reference, disturbance=Constant(value=load),
        controller=PID.model_copy(update={"feedback": "measurement"}),
    )  # fmt: skip
    external_inputs = None
    if colour:
        pole = math.exp(-1 / colour)
        white = np.random.default_rng(seed).normal(0, BEARING.sensor.noise_variance**0.5, 10_001)
        external_inputs = ExternalInputs(
            sensor_noise=lfilter([(1 - pole**2) ** 0.5], [1, -pole], white)
        )
    return ambkit.simulate(BEARING, scenario, external_inputs=external_inputs).record


def errors(records):
    """Error of each k over the truth, and its standard error, a row a record."""
    all_of = [compare_online(record, BEARING, start=START).results for record in records]
    return {
        name: np.array([(r[name].magnet_constant / K - 1, r[name].standard_error / K)
                        for r in all_of])
        for name in all_of[0]
    }  # fmt: skip


def test_all_find_k_where_the_rotor_moves():
    """The filter within what it says; the others but for their own bias.

    Over 96 seeds ADALINE is 0.09 % too high and least squares 0.64 ± 0.28 % too low, 1.4 % at most.
    """
    found = errors([moved(seed) for seed in range(8)])
    assert np.abs(found["adaline"][:, 0]).max() < 0.005
    assert np.abs(found["rls"][:, 0]).max() < 0.015
    assert found["rls"][:, 0].mean() == pytest.approx(-0.0064, abs=0.003)
    filtered = found["augmented"]
    assert np.abs(filtered[:, 0]).max() < 0.06
    assert (np.abs(filtered[:, 0]) < 1.96 * filtered[:, 1]).mean() >= 7 / 8
    assert filtered[:, 1].max() < 0.06  # from 0.2: that is learned, not only wide


@pytest.mark.parametrize("load", [0.0, 2.0])
def test_at_rest_who_needs_motion_says_so_and_does_not_drift(load):
    """ADALINE learns from the weight instead, and takes a load for the magnet."""
    still = Scenario(duration=0.5, disturbance=Constant(value=load))
    learned = compare_online(ambkit.simulate(BEARING, still).record, BEARING, start=START)
    for name in ("rls", "augmented"):
        result = learned.results[name]
        assert result.held.all()
        assert np.abs(result.k / START - 1).max() < 1e-12
    adaline = learned.results["adaline"].magnet_constant / K - 1
    assert abs(adaline) < 0.005 if load == 0.0 else abs(adaline) > 0.3
    assert learned.agreement == (
        "Only ADALINE learned; least squares and the Kalman filter with k never learned: too "
        "little excitation, their k is the start."
    )


def test_without_a_weight_nobody_learns_at_rest():
    level = BEARING.replace(rotor__gravity="none")
    learned = compare_online(
        ambkit.simulate(level, Scenario(duration=0.3)).record, level, start=START
    )
    assert all(result.held.all() for result in learned.results.values())
    assert all((result.k == START).all() for result in learned.results.values())
    assert all(math.isnan(result.standard_error) for result in learned.results.values())
    assert learned.results["adaline"].excitation.max() < 0.01
    assert learned.agreement.startswith("Nobody learned: too little excitation")
    with pytest.raises(AmbkitError, match="nowhere distinguishable from a load: excite the rotor"):
        ambkit.identify_online(
            level, ambkit.simulate(level, Scenario(duration=0.3)).record, method="augmented"
        )


def test_a_load_that_is_not_told_leads_only_adaline_astray():
    learned = compare_online(moved(load=3.0), BEARING, start=START)
    assert learned.agree("rls", "augmented")
    assert learned.results["rls"].magnet_constant == pytest.approx(K, rel=0.015)
    assert learned.results["rls"].load[-1000:].mean() == pytest.approx(3.0, abs=0.2)
    assert "the k of ADALINE is" in learned.agreement
    assert any("one of 3 N: state a known force by --disturbance" in n for n in learned.notes)
    told = compare_online(moved(load=3.0), BEARING, start=START, disturbance=3.0)
    assert told.agreement == "All three agree within their errors."
    for name in ("rls", "augmented"):
        assert abs(told.to_dict()["learners"][name]["load"]) < 0.2


def test_colour_is_reported_and_white_noise_is_not():
    """The filter bends k to it; ADALINE and least squares look at slow motion only."""
    white = [compare_online(moved(seed), BEARING) for seed in range(4)]
    assert not any(one.coloured for one in white)
    assert max(abs(one.colour) for one in white) < 0.05
    coloured = [compare_online(moved(seed, colour=10.0), BEARING) for seed in range(4)]
    assert all(one.coloured for one in coloured)
    assert all("the innovations are not white" in " ".join(one.notes) for one in coloured)
    bias = {
        name: np.mean([one.results[name].magnet_constant / K - 1 for one in coloured])
        for name in coloured[0].results
    }
    assert bias["augmented"] > 0.05
    assert abs(bias["adaline"]) < 0.005
    assert abs(bias["rls"]) < 0.02


def test_the_filter_is_that_of_the_registry():
    record = moved(1)
    result = AugmentedIdentifier(BEARING, start=START).run(record, disturbance=1.0)
    plain = ambkit.AugmentedKalmanFilter(BEARING.replace(magnet__magnet_constant=START)).run(record)
    assert plain.scale is not None
    assert (result.k == START * plain.scale).all()
    assert (result.load == plain.f_d - 1.0).all()
    told = (plain.status & np.uint16(ambkit.Status.UNEXCITED)) != 0
    assert (result.held == told).all()
    found = ambkit.identify_online(BEARING, record, method="augmented", initial=START)
    assert found.machine.magnet.magnet_constant == result.k[-1]


@pytest.mark.parametrize("windows", [0.5, 5.0, 40.0])
def test_the_error_of_a_mean_is_how_means_scatter(windows):
    """A first-order process drawn anew many times, against what one draw says of its own mean."""
    memory = 60.0
    n, pole = round(windows * memory), math.exp(-1 / memory)
    white = np.random.default_rng(0).normal(size=(3000, n))
    white[:, 1:] *= (1 - pole**2) ** 0.5
    drawn = lfilter([1.0], [1.0, -pole], white, axis=1)
    scatter = drawn.mean(axis=1).std()
    told = np.sqrt(np.mean([mean_error(one, memory) ** 2 for one in drawn]))
    assert told == pytest.approx(scatter, rel=0.06)
    assert math.isnan(mean_error(np.ones(1), memory))


class Said(OnlineResult):
    """A result with a given k and error."""

    def __init__(self, k, error, learned=True):
        super().__init__(np.arange(8.0), np.full(8, k), np.full(8, not learned))
        object.__setattr__(self, "_error", error)

    @property
    def standard_error(self):
        return float(vars(self)["_error"])


@pytest.mark.parametrize(
    ("k", "sentence"),
    [
        ((1.0, 1.02, 0.98), "All three agree within their errors."),
        ((1.0, 1.2, 1.02), "ADALINE and the Kalman filter with k agree within their errors, the k "
                           "of least squares is 18.8 % higher."),
        ((1.0, 1.05, 1.1), "The k of least squares agrees with those of ADALINE and the Kalman "
                           "filter with k, which differ from each other."),
        ((1.0, 2.0, 3.0), "No two of them agree."),
    ],
)  # fmt: skip
def test_who_agrees_with_whom_is_one_sentence(k, sentence):
    results = dict(
        zip(("adaline", "rls", "augmented"), (Said(one, 0.02) for one in k), strict=True)
    )
    assert OnlineComparison(BEARING, 1.0, None, results).agreement == sentence
    # The same constants, nearly: discretisation alone moves them by more than their errors.
    near = {name: Said(1.0 + 0.002 * i, 1e-6) for i, name in enumerate(results)}
    assert (
        OnlineComparison(BEARING, 1.0, None, near).agreement
        == "All three agree within their errors."
    )


def test_the_picture_shows_truth_bands_and_what_was_held():
    learned = compare_online(moved(), BEARING, start=START)
    constants, *monitors = online_figure(learned).panels
    assert len(monitors) == 3
    filtered = learned.results["augmented"]
    assert isinstance(filtered, AugmentedResult)
    (band,) = (item for item in constants.items if isinstance(item, Band))
    first = int(np.argmin(filtered.held))
    assert np.isnan(band.low[:first]).all()
    np.testing.assert_allclose(band.high[first:], (filtered.k + 1.96 * filtered.error)[first:])
    rules = [item.value for item in constants.items if isinstance(item, Rule)]
    assert rules == [START, K]
    spans = [item for item in monitors[2].items if isinstance(item, Span)]
    shaded = sum(span.stop - span.start for span in spans)
    assert shaded == pytest.approx(float(filtered.held.mean()), abs=0.05)
    assert all(any(isinstance(item, Line) for item in panel.items) for panel in monitors)


@pytest.fixture
def call(call):
    """Identify from a run, with further arguments."""
    swing = Scenario(duration=0.4, reference=Sine(amplitude=3e-4, frequency=20.0), controller=PID)
    ambkit.simulate(BEARING, swing).record.save("run.csv")
    return partial(call, "identify", "online", "zittau_axial", "run.csv")


def test_the_command_shows_all_three(call):
    code, out, err = call("--initial", "5 N mm^2/A^2", "--plot", "on.png")
    assert code == 0, err
    for words in ("adaline", "rls", "augmented", "against the true 6.7 N mm^2"):
        assert words in out
    # Drift and errors are printed in the unit of the constant.
    assert set(re.findall(r"N (\S+)/A\^2", out)) == {"mm^2"}
    assert Path("on.png").is_file()
    code, out, _ = call("--json")
    told = json.loads(out)
    assert code == 0
    assert set(told["learners"]) == {"adaline", "rls", "augmented"}
    assert told["truth"] == pytest.approx(K)
    assert told["agreement"].endswith(".")
    assert "magnet_constant" not in told
    code, out, _ = call("--method", "augmented", "--json", "--out", "found.toml")
    k = json.loads(out)["magnet_constant"]
    assert k == json.loads(out)["learners"]["augmented"]["magnet_constant"]
    assert Machine.load("found.toml").magnet.magnet_constant == pytest.approx(k)


def test_without_a_preferred_method_there_is_no_bearing_to_write(call):
    code, out, err = call("--out", "found.toml")
    assert code == 2
    assert "a machine is of one method: method=adaline, rls, augmented" in err
    assert out == ""
    assert not Path("found.toml").exists()


def test_an_axis_among_others_is_learned_with_their_forces(tmp_path):
    """Without weight and coupling ADALINE takes the weight for the magnet, and learns 0.001 k."""
    machine, n = ambkit.preset("ufu_rig"), 3000
    random, T = np.random.default_rng(1), machine.sampling_time
    places = ambkit.Sequence(times=0.01 * np.arange(31), values=random.uniform(-5e-5, 5e-5, 31))
    record = ambkit.simulate(
        machine, ambkit.Scenario(duration=n * T, reference=places, seed=1)
    ).record
    true = machine.isolated_axis("A1").magnet.magnet_constant
    online = ambkit.identify_online(
        machine, record, axis="A1", method="adaline", initial=1.2 * true
    )  # fmt: skip
    assert online.results["adaline"].magnet_constant == pytest.approx(true, rel=0.01)
    assert online.results["rls"].magnet_constant == pytest.approx(true, rel=0.03)
    learned = online.machine
    assert [axis.name for axis in learned.axes] == [axis.name for axis in machine.axes]
    assert learned.isolated_axis("A1").magnet.magnet_constant == pytest.approx(true, rel=0.01)
    with pytest.raises(ambkit.AmbkitError, match="axes A1, A2, B1, B2: name one of them"):
        ambkit.identify_online(machine, record)
