"""An expert trained on a measured force, and why: iron saturates, the closed law does not.

A rig gives the force at points, on a grid or not, as a CSV,

    iu [A],x [mm],f_mag [N]

read with `ambkit.machine.forces.force_points.load_force_points`; a column f_std [N] would hold
their standard errors. Here a magnet whose iron saturates stands for the rig, with a load cell that
scatters by 0.1 N. Writes force.csv into the folder in which it is started.
"""

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit.judge.comparison import rmse
from ambkit.machine.forces.force_points import load_force_points
from ambkit.machine.forces.force_surface import ForceSurface

REACH = 0.8e-3  # m: how far the step overshoots
SATURATION = 1500.0  # A/m: the paper's rig has 750 A/m at rest

machine = ambkit.preset("zittau_axial")


def saturating(iu: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force of two magnets [N] whose flux, proportional to i/s, bends off towards saturation."""

    def flux(current: NDArray[np.float64], gap: NDArray[np.float64]) -> NDArray[np.float64]:
        ideal = current / gap
        return ideal / (1 + (ideal / SATURATION) ** 4) ** 0.25

    m = machine.magnet
    pull = flux(m.bias_current + iu, m.air_gap - x) ** 2
    return m.magnet_constant * (pull - flux(m.bias_current - iu, m.air_gap + x) ** 2)


# Measure: a row for each point, wherever the rig happened to be.
random = np.random.default_rng(1)
iu, x = random.uniform(-1.6, 1.6, 300), random.uniform(-1.1 * REACH, 1.1 * REACH, 300)
rows = np.column_stack([iu, x, saturating(iu, x) + random.normal(0, 0.1, 300)])
np.savetxt("force.csv", rows, delimiter=",", header="iu [A],x [m],f_mag [N]", comments="")

# Learn: the force from the points, the operating points from the force, the rules from those.
measured = ForceSurface(machine, load_force_points("force.csv"))
stiff = ambkit.stiffness_map(machine, displacements=np.linspace(-REACH, REACH, 5), force=measured)
expert = ambkit.train(stiff).expert
law = ambkit.ClosedLaw(machine)
truth = ambkit.stiffness_map(machine, displacements=stiff.displacement, force=saturating)
print(
    f"force error over the box: expert {truth.force_rms(expert.force):.2f} N rms, "
    f"closed law {truth.force_rms(law.force):.2f} N rms"
)

# And filter, beside a plant with the saturating magnet.
plant = ambkit.stiffness_map(
    machine,
    currents=np.linspace(machine.current_min, machine.current_max, 31),
    displacements=np.linspace(-REACH, REACH, 33),
    force=saturating,
)
scenario = ambkit.Scenario(
    reference=ambkit.Step(amplitude=0.5e-3, time=0.05),
    disturbance=ambkit.Step(amplitude=3.0, time=0.25),
    controller=ambkit.PID.textbook(machine),  # it overshoots: the rotor goes far out
)
for name, magnet in {"linear": None, "closed law": law, "expert": expert}.items():
    errors = []
    for seed in range(20):
        kalman = ambkit.KalmanFilter(machine, magnet)
        run = ambkit.simulate(machine, scenario.replace(seed=seed), filter=kalman, plant=plant)
        errors.append(rmse(run.estimate, run.record, "f_d"))
    print(
        f"{name:>10}: error of the disturbance force {np.mean(errors):.2f} ± "
        f"{np.std(errors, ddof=1):.2f} N rms, over 20 seeds"
    )
