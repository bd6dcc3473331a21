"""Iron that saturates: the law against Froehlich's equation, and everywhere as a magnet."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from iron import IDEAL, ONE_SIDED, TOML, TWO_SIDED
from magnet_at import force, tangent

import ambkit
import ambkit.simulation.scenario
from ambkit import ClosedLaw, ConstantStiffness, Machine, SaturatingLaw, Scenario, magnet_of
from ambkit.base.errors import ConfigError
from ambkit.estimate.registry import KINDS
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.online.adaline import as_ideal
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import IRON, MU_0
from ambkit.simulation.run import simulate_run
from models.laws.law import Function, check
from models.laws.saturating import saturating

BEARINGS = pytest.mark.parametrize("b", [TWO_SIDED, ONE_SIDED], ids=lambda b: b.magnet.type)
CORE = core_module()
share = st.floats(-1, 1)


def pull(b, i, s):
    """Force of one side, the flux density found from the magnetomotive forces around the loop."""
    m = b.magnet
    mu0, Bs, N = mp.mpf(MU_0), mp.mpf(m.saturation), m.turns

    def left(B):
        H = B / (mu0 * m.relative_permeability) / (1 - B / Bs)
        return 2 * s * B / mu0 + m.iron_length * H - N * i

    B = mp.findroot(left, (mp.mpf(0), Bs * (1 - mp.mpf(10) ** -12)), solver="anderson")
    return B**2 * m.pole_area * mp.cos(m.pole_angle) / mu0


def oracle(b, iu, x):
    i0, s0 = mp.mpf(b.magnet.bias_current), mp.mpf(b.magnet.air_gap)
    own = pull(b, i0 + iu, s0 - x)
    return own if b.magnet.type == "one-sided" else own - pull(b, i0 - iu, s0 + x)


def test_the_figures_of_the_design():
    law = magnet_of(TWO_SIDED)
    assert isinstance(law, SaturatingLaw)
    assert tangent(law.in_core(CORE), 0, 0) == pytest.approx((49.660, 146_764), rel=1e-5)
    assert float(law.force(2.5, 0)) == pytest.approx(119.216, rel=2e-6)
    assert tangent(law.in_core(CORE), 2.5, 0)[0] == pytest.approx(43.579, rel=2e-6)


@BEARINGS
@settings(max_examples=30, deadline=None)
@given(a=share, d=share)
def test_the_law_is_froehlichs(b, a, d):
    iu, x = 2.4 * a, 0.25e-3 * d
    law = magnet_of(b)
    with mp.workdps(40):
        bias = oracle(b, 0, 0)
        expected = oracle(b, mp.mpf(iu), mp.mpf(x))
        h = mp.mpf(10) ** -12
        slopes = (
            (oracle(b, iu + h, mp.mpf(x)) - oracle(b, iu - h, mp.mpf(x))) / (2 * h),
            (oracle(b, mp.mpf(iu), x + h) - oracle(b, mp.mpf(iu), x - h)) / (2 * h),
        )
    assert float(law.force(iu, x)) == pytest.approx(float(expected), rel=1e-13, abs=1e-12)
    assert law.bias_force == pytest.approx(float(bias), rel=1e-14)
    assert tangent(law.in_core(CORE), iu, x) == pytest.approx(tuple(map(float, slopes)), rel=1e-12)


@BEARINGS
@given(
    a=share, d=share, more=st.floats(1e3, 1e9)
)  # times the permeability and the saturation of the bearing
def test_its_limit_is_the_ideal_law(b, a, d, more):
    ideal = b.replace(magnet__saturation=1.6 * more, magnet__relative_permeability=2000 * more)
    iu, x = 2.5 * a, 0.25e-3 * d
    magnet, closed = magnet_of(ideal).in_core(CORE), ClosedLaw(b).in_core(CORE)
    scale = force(closed, 2.5, 0)
    # The iron's share of the gap is 6 %, the flux reaches 1.6 T: both fall with `more`.
    near = 2 / more + 1e-13
    assert abs(force(magnet, iu, x) - force(closed, iu, x)) < near * 5 * scale
    for one, other in zip(tangent(magnet, iu, x), tangent(closed, iu, x), strict=True):
        assert one == pytest.approx(other, rel=5 * near)


def test_without_iron_it_is_the_ideal_law():
    assert isinstance(magnet_of(IDEAL), ClosedLaw)
    grid = np.meshgrid(np.linspace(-2.5, 2.5, 11), np.linspace(-2.5e-4, 2.5e-4, 11))
    here, there = SaturatingLaw(IDEAL), ClosedLaw(IDEAL)
    np.testing.assert_allclose(here.force(*grid), there.force(*grid), rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("change", [("r1", "m1", "g1"), ("k_s", "b * other", "a * other")])
def test_steps_that_are_not_the_law_are_refused(change):
    where, old, new = change
    good = saturating.functions[-1]
    steps = tuple((n, t.replace(old, new) if n == where else t) for n, t in good.steps)
    results = {
        n: (t.replace(old, new) if n == where else t, s) for n, (t, s) in good.results.items()
    }
    check(saturating, good)
    with pytest.raises(ValueError, match="is not that of the law"):
        check(saturating, Function(good.name, good.about, steps, results, good.more))


# ---- the bearing ----


@BEARINGS
def test_the_levitation_current_carries_the_rotor(b):
    left = magnet_of(b).force(b.levitation_current, 0.0) + b.weight
    assert abs(float(left)) < 1e-12 * b.rotor.mass * 9.81


def test_an_angle_takes_its_cosine():
    straight = TWO_SIDED.replace(magnet__pole_angle=None)
    ratio = TWO_SIDED.magnet.magnet_constant / straight.magnet.magnet_constant
    assert ratio == pytest.approx(np.cos(np.deg2rad(22.5)), rel=1e-14)
    assert Machine.from_toml(TWO_SIDED.to_toml()) == TWO_SIDED


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'saturation = "1.6 T"\n',
            "",
            "iron.toml:4: magnet.saturation: missing: iron is described",
        ),
        (
            "relative_permeability = 2000\n",
            "",
            "iron.toml:4: magnet.relative_permeability: missing",
        ),
        ('"22.5 deg"', '"90 deg"', "iron.toml:8: magnet.pole_angle: must be less than 90 deg"),
        ('"22.5 deg"', '"-1 deg"', "iron.toml:8: magnet.pole_angle: must be at least 0 rad"),
        (
            'turns = 208\npole_area = "290 mm^2"\npole_angle = "22.5 deg"\n',
            'magnet_constant = "3.6 N mm^2/A^2"\n',
            "iron.toml:9: magnet.iron_length: needs turns and pole_area instead of",
        ),
        (
            'turns = 208\npole_area = "290 mm^2"\n',
            'magnet_constant = "3.6 N mm^2/A^2"\n',
            "iron.toml:7: magnet.pole_angle: goes with turns and pole_area",
        ),
        ('"5 kg"', '"40 kg"', "carries the rotor at x = 0, which no current does"),
    ],
)
def test_what_does_not_go_together_is_reported_with_its_line(old, new, message):
    assert old in TOML
    with pytest.raises(ConfigError) as refused:
        Machine.from_toml(TOML.replace(old, new), name="iron.toml")
    assert message in str(refused.value)


def test_another_constant_keeps_the_iron():
    found = TWO_SIDED.replace(**TWO_SIDED.magnet.with_constant(4e-6))
    assert found.magnet.magnet_constant == pytest.approx(4e-6, rel=1e-14)
    assert found.magnet.turns == 208
    here, there = (SaturatingLaw(b).in_core(CORE).parameters for b in (found, TWO_SIDED))
    assert {k: v for k, v in here.items() if k != "k"} == {
        k: v for k, v in there.items() if k != "k"
    }


# ---- as plant, and as what estimators know ----

SHAKEN = Scenario.model_validate(
    {
        "duration": 0.5,
        "seed": 4,
        "reference": {"type": "sine", "amplitude": 0.1e-3, "frequency": 5.0},
        "controller": ambkit.PID.for_bearing(TWO_SIDED).model_dump(),
    }
)


REFERENCE = ambkit.simulation.scenario.Scenario.model_validate(
    {
        "reference": {
            "type": "sum",
            "parts": [
                {"type": "sine", "amplitude": 0.04e-3, "frequency": 40.0},
                {"type": "sine", "amplitude": 0.06e-3, "frequency": 7.0},
            ],
        }
    }
).reference


def test_the_plant_is_the_bearings_magnet():
    record = ambkit.simulate(TWO_SIDED, SHAKEN).record
    assert not record.meta["stop_touched"]
    at = record["iu"], record["x"]
    np.testing.assert_allclose(record["f_mag"], magnet_of(TWO_SIDED).force(*at), rtol=1e-12,
                               atol=1e-9)  # fmt: skip
    assert np.abs(record["f_mag"] - ClosedLaw(TWO_SIDED).force(*at)).max() > 3


@pytest.mark.parametrize("kind", ["extended", "unscented", "closed-law", "ud"])
def test_estimators_know_it(kind):
    """With the iron the disturbance force is found; without it, it takes what the iron lacks."""
    record = ambkit.simulate(TWO_SIDED, SHAKEN).record
    noise = ambkit.FilterNoise(disturbance=100.0)
    told = KINDS[kind].make(TWO_SIDED, noise=noise)
    ideal = KINDS[kind].make(TWO_SIDED, ClosedLaw(TWO_SIDED), noise=noise)
    late = record.t > 0.1
    off = [np.sqrt(np.mean(one.run(record).f_d[late] ** 2)) for one in (told, ideal)]
    assert off[0] < 0.4 * off[1]


def test_the_linear_filter_takes_its_tangent():
    linear = KINDS["linear"].make(TWO_SIDED)
    assert linear.magnet == ConstantStiffness.of(TWO_SIDED)
    k_i, k_s = magnet_of(TWO_SIDED).tangent(0.0, 0.0)
    assert linear.magnet == ConstantStiffness(float(k_i), float(k_s))


def test_many_runs_side_by_side_are_those_one_by_one():
    records = [
        ambkit.simulate(TWO_SIDED, SHAKEN.model_copy(update={"seed": seed})).record
        for seed in range(9)
    ]
    filter_ = KINDS["extended"].make(TWO_SIDED)
    together = ambkit.run_many(filter_, [r["y"] for r in records], [r["u"] for r in records])
    for mean, record in zip(together.mean, records, strict=True):
        np.testing.assert_array_equal(mean, filter_.run(record).mean)


def test_its_constant_is_identified():
    """A scale of the law: the turns and the iron stay, and the pole area is what is found."""
    k = 1.1 * TWO_SIDED.magnet.magnet_constant
    truth = TWO_SIDED.replace(**TWO_SIDED.magnet.with_constant(k))
    shaken = SHAKEN.model_copy(update={"duration": 1.0, "reference": REFERENCE})
    record = simulate_run(truth, shaken).record
    assert not record.meta["stop_touched"]
    free = ["magnet_constant", "air_gap", "disturbance_noise"]
    found = maximum_likelihood(record, TWO_SIDED, free=free)
    assert found.isolated.magnet.saturation == 1.6
    assert found.isolated.magnet.turns == 208
    for name, known in (("magnet_constant", k), ("air_gap", 0.78e-3)):
        low, high = found.interval(name)
        assert found[name] == pytest.approx(known, rel=5e-3)
        assert low < known < high
    ideal = maximum_likelihood(record, IDEAL, free=free)
    assert ideal["air_gap"] > 1.05 * 0.78e-3  # which then stands for the iron


@pytest.mark.parametrize("bearing", [TWO_SIDED, ONE_SIDED], ids=["two-sided", "one-sided"])
def test_ideal_iron_with_the_other_control_signal_pulls_the_same(bearing):
    iu, y = np.meshgrid(np.linspace(-2.4, 2.5, 15), np.linspace(-0.24e-3, 0.24e-3, 11))
    u = as_ideal(bearing, y, iu / bearing.amplifier.gain)
    assert not magnet_of(bearing).ideal
    ideal = bearing.replace(**dict.fromkeys(f"magnet__{key}" for key in IRON))
    assert magnet_of(ideal).ideal
    pulled, expected = (magnet_of(b).force(i, y) for b, i in ((ideal, u), (bearing, iu)))
    np.testing.assert_allclose(pulled, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(u - iu).max() > 0.05


@pytest.mark.parametrize("method", ["adaline", "rls"])
def test_who_learns_the_constant_online_knows_the_iron(method):
    stronger = TWO_SIDED.replace(
        **TWO_SIDED.magnet.with_constant(1.1 * TWO_SIDED.magnet.magnet_constant)
    )
    shaken = SHAKEN.model_copy(update={"duration": 1.0, "reference": REFERENCE})
    record = simulate_run(stronger, shaken).record
    found = ambkit.identify_online(TWO_SIDED, record, method=method).machine
    assert found.magnet.magnet_constant == pytest.approx(stronger.magnet.magnet_constant, rel=0.01)
