"""The paper's four-state model of one axial bearing (eq. 15-21), stated once.

State ``X = [x, v, f_d, x_m]``: displacement, velocity, disturbance force F_St, lagged (measured)
position. The core's constants follow from the equations below, in closed form; its steps are those
of the model that ``ambkit.models`` composes of an axis' parts, and the tests hold both together.

With the force held over the sample they are exact, whatever the sensor: the lag follows the
parabola on which the rotor moves. Eq. 19 as printed holds the *position* over the sample instead,
and so puts every estimate ahead of the rotor by ``T/(1 - exp(-T/T_sen)) - T_sen``; it is the same
model with three constants at zero, and there to reproduce the paper.
"""

import sympy as sp

from models.model import Model

# Physical parameters.
T, m, K_sen, T_sen, k_ui = sp.symbols("T m K_sen T_sen k_ui", positive=True)
# State, control signal, force of the magnet (with what else is known to pull, e.g. the weight), and
# all force on the rotor.
x, v, f_d, x_m, u, f, f_all = sp.symbols("x v f_d x_m u f f_all")
# Stiffnesses at the operating point.
k_i, k_s = sp.symbols("k_i k_s")
# Variances: control signal, growth of the disturbance force in one sample, measurement.
var_u, var_d, var_y = sp.symbols("var_u var_d var_y", nonnegative=True)

# What a lag makes of a constant, of a ramp and of a parabola: core/include/ambkit/phi.h.
phi1, phi2, phi3 = (sp.Function(f"phi{k}") for k in (1, 2, 3))


# How far a force of 1 N moves v, x and (but for what phi3 makes of it) x_m within a sample. Its
# effects are formed from these and their squares: T^6 alone is less than single precision holds.
T_m, T2_2m, T3_m = sp.symbols("T_m T2_2m T3_m")
factors = {T_m: T / m, T2_2m: T**2 / (2 * m), T3_m: K_sen * T**3 / (m * T_sen)}


def pushed(s: sp.Expr) -> list[sp.Expr]:
    """Return how far a force of 1 N moves the state within the share s of a sample."""
    return [T2_2m * s**2, T_m * s, sp.Integer(0), T3_m * s**3 * phi3(s * T / T_sen)]


# What eq. 15-19 ask of the parameters, computed once per model and not once per sample.
T_2, a_sen, b_sen, c_sen, d_sen = sp.symbols("T_2 a_sen b_sen c_sen d_sen")
constants = {
    T_2: T / 2,
    T_m: T_m,
    T2_2m: T2_2m,
    a_sen: sp.exp(-T / T_sen),
    b_sen: K_sen * phi1(T / T_sen) * T / T_sen,
    c_sen: K_sen * phi2(T / T_sen) * T**2 / T_sen,
    d_sen: pushed(sp.Integer(1))[3],
}

transition = [
    x + T * v + T2_2m * f_all,  # eq. 15
    v + T_m * f_all,  # eq. 16
    f_d,  # eq. 20, third row: the disturbance is a random walk
    b_sen * x + a_sen * x_m + c_sen * v + d_sen * f_all,  # eq. 19, with v and f_all exact
]
displacement = x + T_2 * v  # at which the magnet pulls: the mean over the sample
total_force = f + f_d  # eq. 15, 16
linear_force = k_i * k_ui * u + k_s * displacement  # eq. 17
measurement = x_m  # eq. 21

axial = Model(
    name="axial",
    about="One axial bearing, four states (paper, eq. 15-21)",
    state=[x, v, f_d, x_m],
    parameters=[T, m, K_sen, T_sen],
    kept=[T, K_sen],
    factors=factors,
    constants=constants,
    force=f,
    control=u,
    stiffness=[k_i, k_s],
    gain=k_ui,
    transition=transition,
    driving=f_all,
    displacement=displacement,
    total_force=total_force,
    linear_force=linear_force,
    measurement=measurement,
    control_variance=var_u,
    # Q = B var B' (paper, below eq. 21), plus the growth of the disturbance force, which moves the
    # rotor within the sample already.
    growth=f_d,
    growth_variance=var_d,
    pushed=pushed,
    measurement_variance=var_y,
    printed=[T_2, c_sen, d_sen],
)
