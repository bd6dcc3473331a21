"""The PID as the simulation runs it, on measurements that no controller would meet twice.

The C functions by themselves, with bad input, are tested in tests/c/test_controller.c.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_axis import fly

from ambkit.machine.magnets import core_module

T = 1e-4
GAINS = {"kp": 3000.0, "ki": 2e4, "kd": 12.0, "T_f": 2e-4, "T_t": 25e-3}


def run_pid(r: np.ndarray, y: np.ndarray, integral: float = 0.0, **changes: float) -> np.ndarray:
    """Output of the controller [A] for references and measurements: the rotor itself is nailed."""
    zero = np.zeros(len(r))
    loop: dict[str, Any] = {
        "T": T, "m": 1e9, "f_0": 0.0, "K_sen": 1.0, "T_sen": 1e-3, "travel": 1e-3, "substeps": 1,
        "k_ui": 1.0, "iu_min": -1.5, "iu_max": 1.5,
        "integral": integral, "r": r, "f_d": zero, "noise_u": zero, "noise_y": y,
    }  # fmt: skip
    loop |= GAINS | changes
    nothing = core_module().Constant(0.0, 0.0)
    return np.asarray(fly(nothing, **loop)["u"])


gain = st.sampled_from([0.0, 0.3, 1.0, 4.0])


@settings(max_examples=100)
@given(
    p=gain,
    i=gain,
    d=gain,
    T_f=st.sampled_from([0.0, 1e-5, 2e-4, 1e-2]),
    T_t=st.sampled_from([0.0, 1e-3, 0.1]),
    integral=st.floats(-1, 1),
    seed=st.integers(0, 999),
)
def test_the_output_is_that_of_the_plain_pid(
    p: float, i: float, d: float, T_f: float, T_t: float, integral: float, seed: int
) -> None:
    """With and without each part, derivative filter and anti-windup, in and out of the limits."""
    rng = np.random.default_rng(seed)
    n = 300
    r = np.repeat(rng.uniform(-5e-4, 5e-4, n // 30), 30)
    y = np.cumsum(rng.normal(0, 1e-5, n))
    g = {"kp": 3000 * p, "ki": 2e4 * i, "kd": 12 * d, "T_f": T_f, "T_t": T_t}
    plain = oracles.Pid(T, **g, limits=(-1.5, 1.5), integral=integral)
    expected = [plain.step(*at) for at in zip(r, y, strict=True)]
    np.testing.assert_allclose(run_pid(r, y, integral, **g), expected, rtol=1e-10, atol=1e-10)


def test_a_step_of_the_reference_does_not_kick() -> None:
    """The derivative is taken of the measurement: the output jumps by kp r and no more."""
    r = np.where(np.arange(50) < 20, 0, 1e-4)
    u = run_pid(r, np.zeros(50), ki=0.0)
    assert u[19] == 0
    assert u[20:] == pytest.approx(3000 * 1e-4)


def test_the_derivative_of_a_ramp_settles_at_its_slope_with_the_filters_time_constant() -> None:
    n, speed = 200, 0.02
    u = run_pid(np.zeros(n), speed * T * np.arange(n), kp=0.0, ki=0.0)
    share = u / (-12 * speed)
    assert share[0] == 0
    assert share[-1] == pytest.approx(1, rel=1e-9)
    missing = 1 - share[:20]
    np.testing.assert_allclose(missing[1:] / missing[:-1], 2e-4 / (2e-4 + T), rtol=1e-9)


def test_without_filter_the_derivative_is_the_last_difference() -> None:
    y = np.array([0, 0, 1e-6, 1e-6, -1e-6])
    u = run_pid(np.zeros(5), y, kp=0.0, ki=0.0, T_f=0.0)
    np.testing.assert_allclose(u, [0, 0, -0.12, 0, 0.24], atol=1e-12)


def released(T_t: float) -> int:
    """How many samples the output stays at its limit after a long demand that nothing can meet."""
    r = np.where(np.arange(12_000) < 10_000, 1e-3, -1e-5)
    u = run_pid(r, np.zeros(12_000), kd=0.0, T_t=T_t, kp=1000.0)
    assert u[9_999] == 1.5
    return int(np.argmax(u[10_000:] < 1.5))


def test_anti_windup_lets_go_of_the_limit_at_once() -> None:
    """Without it the integral would be at 1000 * 1e-3 + 20 A, and take 50 s to come back."""
    assert released(T_t=25e-3) == 0
    assert released(T_t=0.0) == 0


def test_at_the_limit_the_tracking_time_decides_where_the_integral_settles() -> None:
    """Where ki e equals what leaks: (demanded - limit) / T_t."""
    n, e = 20_000, 1e-3
    u = run_pid(np.full(n, e), np.zeros(n), kd=0.0)
    assert (u[1:] == 1.5).all()
    # Turned off, the demand is what the integral holds.
    r = np.append(np.full(n, e), 0.0)
    last = run_pid(r, np.zeros(n + 1), kd=0.0, iu_max=1.5)[-1]
    assert last == pytest.approx(1.5 + 2e4 * e * 25e-3 - 3000 * e, rel=1e-6)
