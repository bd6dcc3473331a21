"""Recursive least squares: against batch least squares, a textbook version, and ADALINE."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from portability import lint

import ambkit
from ambkit import Adaline, Machine, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.identification.online.magnet_constant import RecursiveLeastSquares
from ambkit.machine.magnets import core_module

BEARING = Machine.preset("zittau_axial")
K = BEARING.magnet.magnet_constant
SWING = Scenario(duration=0.6, reference=ambkit.Sine(amplitude=3e-4, frequency=20.0))


def data(n, count, seed=0):
    """Regressors of very different size, the first constant, and noisy outputs."""
    rng = np.random.default_rng(seed)
    other = rng.normal(0.3, 1, (count, n - 1)) * 10.0 ** -np.arange(n - 1)
    phi = np.column_stack([np.ones(count), other])
    return phi, phi @ np.arange(1, n + 1) + 0.1 * rng.normal(size=count)


def run(phi, y, *, known=1e-3, forgetting=0.99,
        least_excitation=0.0, precision="float64"):  # fmt: skip
    core, n = core_module(precision), phi.shape[1]
    kind = {"float64": np.float64, "float32": np.float32}[precision]
    element = core.Rls(np.zeros(n, kind), np.full(n, known, kind), forgetting=forgetting,
                       least_excitation=least_excitation)  # fmt: skip
    return dict(element.run(np.ascontiguousarray(phi, kind), np.ascontiguousarray(y, kind)))


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_it_is_batch_weighted_least_squares(n):
    phi, y = data(n, 300)
    theta = run(phi, y)["theta"]
    for count in (1, 2, 10, 300):
        weight = np.sqrt(0.99 ** np.arange(count)[::-1])
        # What was known at the start is a sample in each direction, forgotten since.
        start = np.sqrt(1e-3 / (1 - 0.99) * 0.99**count) * np.eye(n)
        A = np.vstack([phi[:count] * weight[:, None], start])
        batch = np.linalg.lstsq(A, np.append(y[:count] * weight, np.zeros(n)), rcond=None)[0]
        assert theta[count - 1] == pytest.approx(batch, rel=1e-12, abs=1e-12)


def test_single_precision_comes_to_the_same():
    phi, y = data(3, 2000)
    double, single = run(phi, y)["theta"], run(phi, y, precision="float32")["theta"]
    spread = double[500:].std(axis=0)
    assert (np.abs(single - double)[500:] < 0.01 * spread).all()


@settings(deadline=None, max_examples=30)
@given(st.lists(st.floats(-9, 9), min_size=3, max_size=3), st.floats(-9, 9), st.integers(0, 10**6))
def test_no_unit_changes_the_answer(decades, of_output, seed):
    """Metres or micrometres: each parameter scales with its output over its regressor."""
    phi, y = data(3, 60, seed)
    by, out = 10.0 ** np.array(decades), 10.0**of_output
    own = run(phi, y, known=0.0)["theta"]
    other = run(phi * by, y * out, known=0.0)["theta"] * by / out
    assert other[10:] == pytest.approx(own[10:], rel=1e-9, abs=1e-9)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.floats(0.5, 0.9999), st.floats(1e-3, 0.1))
def test_without_excitation_nothing_grows(seed, forgetting, least):
    """Excited, then for long with nothing but a whisper: held, and alive when data come again."""
    phi, y = data(2, 400, seed)
    rng = np.random.default_rng(seed)
    quiet = np.column_stack([np.ones(20_000), 1e-6 * least * rng.normal(size=20_000)])
    out = run(np.vstack([phi, quiet, phi]), np.concatenate([y, rng.normal(size=20_000), y]),
              forgetting=forgetting, least_excitation=least)  # fmt: skip
    theta, held = out["theta"], out["status"] == 128
    assert np.isfinite(theta).all()
    deep = slice(400 + round(40 / (1 - forgetting)), 20_400)
    assert held[deep].all()
    assert np.ptp(theta[deep, 1]) == 0 if theta[deep].size else True
    assert not held[-1]


# ---- the magnet constant ----


def learned(scenario, load="unknown", start=1.5):
    record = ambkit.simulate(BEARING, scenario).record
    return RecursiveLeastSquares(BEARING, start=start * K, load=load).run(record)


@pytest.mark.parametrize("start", [0.5, 1.5])
@pytest.mark.parametrize("load", ["known", "unknown"])
def test_k_is_found(load, start):
    errors = [learned(SWING.replace(seed=n), load, start).magnet_constant / K - 1 for n in range(4)]
    assert np.abs(errors).max() < 0.012


@pytest.mark.parametrize("bandwidth", [20.0, 38.0, 150.0])
def test_no_low_pass_makes_the_force_larger_than_it_is(bandwidth):
    """Without noise k is right to 0.25 %; by eq. 24's row of x it would be 0.3 to 2.6 % off."""
    record = ambkit.simulate(BEARING, SWING.replace(noise=False, duration=1.0)).record
    learner = RecursiveLeastSquares(BEARING, start=1.3 * K, bandwidth=bandwidth)
    assert abs(learner.run(record).magnet_constant / K - 1) < 0.0025


def test_it_settles_in_a_fraction_of_adalines_time():
    """And with the same memory the same noise stays: 8 ms without learning, then it is there."""
    rest = Scenario(duration=0.5)
    record = ambkit.simulate(BEARING, rest).record
    adaline = Adaline(BEARING, start=1.5 * K).run(record)
    rls = RecursiveLeastSquares(BEARING, start=1.5 * K, load="known").run(record)

    def settled(k):
        return float(record.t[np.flatnonzero(np.abs(k / K - 1) > 0.03)[-1]])

    assert settled(rls.k) < 0.25 * settled(adaline.k)
    assert rls.spread == pytest.approx(adaline.spread, rel=0.3)


def test_a_load_that_jumps_leads_k_astray_until_it_is_forgotten():
    """The magnet's answer to the jump cancels it: as if k were nothing. Motion mends it."""
    jump = SWING.replace(
        duration=1.0, reference=ambkit.Sine(amplitude=3e-4, frequency=10.0),
        disturbance=ambkit.Step(amplitude=3.0, time=0.3),
    )  # fmt: skip
    result = learned(jump)
    assert result.k[2900] == pytest.approx(K, rel=0.03)
    assert result.k[3000:4000].min() < 0.7 * K
    assert result.k[-1] == pytest.approx(K, rel=0.02)


def test_units_of_length_do_not_matter():
    """The whole element in metres and in micrometres: k scales as N m^2, the load not at all."""
    core, b = core_module(), BEARING
    record = ambkit.simulate(b, SWING.replace(duration=0.1)).record
    results = []
    for by in (1.0, 1e6):
        # In the unit of length 1/by m, a newton is a kg by m/s^2: mass scales to keep the force.
        element = core.MagnetRls(
            s0=by * 2e-3, i0=1.5, two_sided=True, T=1e-4, m=0.518 / by, K_sen=1.0, a_sen=0.6,
            k_ui=1.0, iu_min=-1.5, iu_max=1.5, f_0=b.weight, bandwidth=240.0, rate_force=0.05,
            forgetting=0.998, least_excitation=0.02, settling=160, with_load=True, k=K * by**2,
        )  # fmt: skip
        out = element.run(by * record["y"], record["u"], np.zeros(len(record)))
        results.append((out["k"] / by**2, out["load"]))
    assert results[1][0] == pytest.approx(results[0][0], rel=1e-12)
    assert results[1][1] == pytest.approx(results[0][1], rel=1e-11, abs=1e-11)


def test_a_small_controller_can_run_it():
    """No library, no malloc, no variables of its own, no int beyond 16 bits, no double."""
    core = Path(__file__).resolve().parent.parent / "core"
    files = [f"src/{name}.c" for name in ("rls", "magnet_rls", "adaline", "magnet")]
    files += [f"include/ambkit/{name}.h" for name in ("rls", "magnet_rls", "adaline")]
    found = lint(core, files, ["-Iinclude", "-I.", "-DAMB_FLOAT"], real="float")
    assert [finding for finding in found if "rls" in finding.file] == []


def test_identify_takes_either_learner():
    scenario = SWING.replace(disturbance=ambkit.Constant(value=1.0))
    record = ambkit.simulate(BEARING, scenario).record
    found = ambkit.identify_online(BEARING, record, method="rls", initial=1.5 * K)
    assert found.results["rls"].magnet_constant == found.machine.magnet.magnet_constant
    assert found.machine.magnet.magnet_constant == pytest.approx(K, rel=0.02)
    with pytest.raises(AmbkitError, match='no method "lms"; known: all, adaline, rls, augmented'):
        ambkit.identify_online(BEARING, record, method="lms")
    still = ambkit.simulate(BEARING, Scenario(duration=0.1)).record
    with pytest.raises(AmbkitError, match="excite the rotor"):
        ambkit.identify_online(BEARING, still, method="rls")
