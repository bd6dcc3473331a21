"""A bearing of one's own: read from TOML, simulated with its own filter in the loop, drawn.

Writes spindle.csv and spindle.png into the folder in which it is started.
"""

from pathlib import Path

import ambkit
from ambkit.judge.comparison import rmse
from ambkit.simulation.run_figure import simulation_figure

machine = ambkit.Machine.load(Path(__file__).with_name("spindle.toml"))
linear = ambkit.ConstantStiffness.of(machine)
print(f"{machine.name}: k_i {linear.k_i:.0f} N/A, k_s {linear.k_s / 1e6:.2f} N/µm at the centre")

# The rules span where the rotor goes: a step of 50 µm overshoots to about twice that.
stiff = ambkit.stiffness_map(machine)
expert = ambkit.train(stiff).expert
print(
    f"force error over the box: {stiff.force_rms(expert.force):.2f} N rms "
    f"of {stiff.force_rms():.0f} N"
)

scenario = ambkit.Scenario(
    duration=0.2,
    reference=ambkit.Step(amplitude=50e-6, time=0.02),
    disturbance=ambkit.Step(amplitude=40.0, time=0.1),
    controller=ambkit.PID.for_bearing(machine),
)
kalman = ambkit.AdaptiveKalmanFilter(machine, expert)
run = ambkit.simulate(machine, scenario, filter=kalman)
print(
    f"estimates: position to {1e6 * rmse(run.estimate, run.record, 'x'):.2f} µm rms, "
    f"disturbance force to {rmse(run.estimate, run.record, 'f_d'):.1f} N rms"
)

run.record.save("spindle.csv")
simulation_figure(run).save("spindle.png")
