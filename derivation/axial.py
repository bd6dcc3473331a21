"""The paper's four-state model of one axial bearing (eq. 15-21), stated once.

State ``X = [x, v, f_d, x_m]``: displacement, velocity, disturbance force F_St, lagged (measured)
position. Everything else about the model, its constants, its Jacobian, the covariance step and
the measurement update, follows from the six equations below.
"""

import sympy as sp

from derivation.model import Model

# Physical parameters.
T, m, K_sen, T_sen, k_ui = sp.symbols("T m K_sen T_sen k_ui", positive=True)
# State, control signal, force of the magnet (with what else is known to pull, e.g. the weight), and
# all force on the rotor.
x, v, f_d, x_m, u, f, f_all = sp.symbols("x v f_d x_m u f f_all")
# Stiffnesses at the work point.
k_i, k_s = sp.symbols("k_i k_s")
# Variances: control signal, growth of the disturbance force in one sample, measurement.
var_u, var_d, var_y = sp.symbols("var_u var_d var_y", nonnegative=True)

# What eq. 15-19 ask of the parameters, computed once per model and not once per sample.
T_m, T2_2m, a_sen, b_sen = sp.symbols("T_m T2_2m a_sen b_sen")
constants = {
    T_m: T / m,
    T2_2m: T**2 / (2 * m),
    a_sen: sp.exp(-T / T_sen),
    b_sen: K_sen * (1 - sp.exp(-T / T_sen)),
}

transition = [
    x + T * v + T2_2m * f_all,  # eq. 15
    v + T_m * f_all,  # eq. 16
    f_d,  # eq. 20, third row: the disturbance is a random walk
    b_sen * x + a_sen * x_m,  # eq. 19
]
whole_force = f + f_d  # eq. 15, 16
linear_force = k_i * k_ui * u + k_s * x  # eq. 17
measurement = x_m  # eq. 21

axial = Model(
    name="axial",
    about="One axial bearing, four states (paper, eq. 15-21)",
    state=[x, v, f_d, x_m],
    parameters=[T, m, K_sen, T_sen],
    kept=[T],
    constants=constants,
    force=f,
    control=u,
    stiffness=[k_i, k_s],
    gain=k_ui,
    transition=transition,
    driving=f_all,
    whole_force=whole_force,
    linear_force=linear_force,
    measurement=measurement,
    control_variance=var_u,
    # Q = B var B' (paper, below eq. 21), plus the growth of the disturbance force.
    extra_noise={f_d: var_d},
    measurement_variance=var_y,
)
