"""The PID as the simulation runs it, on measurements that no controller would meet twice.

The C functions by themselves, with bad input, are tested in tests/c/test_controller.c.
"""

import numpy as np
import oracles
from hypothesis import given, settings
from hypothesis import strategies as st
from one_axis import fly

from ambkit.machine.magnets import core_module

T = 1e-4
GAINS = {"kp": 3000.0, "ki": 2e4, "kd": 12.0, "T_f": 2e-4, "T_t": 25e-3}


def run_pid(r, y, integral=0.0, **changes):
    """Output of the controller [A] for references and measurements: the rotor itself is nailed."""
    zero = np.zeros(len(r))
    loop = {
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
def test_the_output_is_that_of_the_plain_pid(p, i, d, T_f, T_t, integral, seed):
    """With and without each part, derivative filter and anti-windup, in and out of the limits."""
    rng = np.random.default_rng(seed)
    n = 300
    r = np.repeat(rng.uniform(-5e-4, 5e-4, n // 30), 30)
    y = np.cumsum(rng.normal(0, 1e-5, n))
    g = {"kp": 3000 * p, "ki": 2e4 * i, "kd": 12 * d, "T_f": T_f, "T_t": T_t}
    plain = oracles.Pid(T, **g, limits=(-1.5, 1.5), integral=integral)
    expected = [plain.step(*at) for at in zip(r, y, strict=True)]
    np.testing.assert_allclose(run_pid(r, y, integral, **g), expected, rtol=1e-10, atol=1e-10)
