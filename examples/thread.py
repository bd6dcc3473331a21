"""From the log to the controller.

One rig, and the whole way: from a log as the rig wrote it (German, turned around, late, off its
zero) over the bearing that it tells to a filter in C, whose output on the rig's own numbers is
Python's to the last bit. The rig is simulated here, so that the truth is known in the end; with a
real one the cells that make it fall away, and the rest stays.

All files go into the folder `thread`, beside where this is started. `thread.ipynb` is the same as a
notebook.
"""

# %%
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit.judge.evaluation import evaluate, filter_figure

place = Path("thread")
place.mkdir(exist_ok=True)

# %% [markdown]
# ## What the engineer has
#
# The bearing as drawn. Its magnet is the force that finite elements gave, in a file with the
# columns, units and decimal commas of another program.

# %%
BEARING = """
name = "grinder"
description = "Thrust bearing of a grinding spindle, as drawn"
sampling_time = "0.1 ms"

[magnet]
type = "two-sided"
turns = 120
pole_area = "500 mm^2"
air_gap = "0.4 mm"
bias_current = "2.5 A"
force_map = "fe.csv"
force_channels = "fe.toml"

[rotor]
mass = "3.2 kg"
gravity = "-x"
clearance = "0.15 mm"

[amplifier]
gain = "0.5 A/V"
current_limit = "2.5 A"
noise_variance = "1e-5 V^2"

[sensor]
gain = 1
lag = "0.1 ms"
noise_variance = "0.4 µm^2"
"""

FORCE_CHANNELS = """
[signals.iu]
column = "Strom"
unit = "A"

[signals.x]                     # x = 0.4 mm - gap
column = "Spalt"
unit = "mm"
sign = -1
offset = "0.4 mm"

[signals.f_mag]
column = "Kraft"
unit = "kN"
"""

# What is what in the logs. The zeros were measured: that of the position midway between the stops,
# that of the current with the amplifier off.
CHANNELS = """
[signals.t]
column = "Zeit"
unit = "s"

[signals.y]                     # distance from the sensor's face, which shrinks as x grows
column = "Abstand"
unit = "mm"
sign = -1
offset = "9.988 mm"

[signals.u]                     # current of one coil, at 0.5 A/V, with 2.5 A of bias
column = "Strom"
unit = "A"
scale = "2 V/A"
offset = "-5.04 V"
"""


def german(path: Path, head: str, *columns: NDArray[np.float64]) -> None:
    """Write columns as the programs here do: semicolons, decimal commas, seven digits."""
    rows = (";".join(f"{value:.7g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([head, *rows]).replace(".", ",") + "\n", encoding="utf-8")


for name, text in (("my", BEARING), ("fe", FORCE_CHANNELS), ("rig", CHANNELS)):
    (place / f"{name}.toml").write_text(text.lstrip(), encoding="utf-8")

# Finite elements are another program's; here iron that saturates, and fringes, are in their place.
iron = ambkit.Machine.from_toml(
    BEARING.replace('force_map = "fe.csv"', 'iron_length = "0.2 m"\nrelative_permeability = 2000')
    .replace('force_channels = "fe.toml"', 'saturation = "1.2 T"')
)  # fmt: skip
iu, x = (a.ravel() for a in np.meshgrid(np.linspace(-2.5, 2.5, 21), np.linspace(-0.15, 0.15, 15)))
fringes = 1 + 0.03 * np.tanh(5 * x) ** 2 + 0.01 * np.cos(iu)
force = ambkit.magnet_of(iron).force(iu, 1e-3 * x) * fringes
german(place / "fe.csv", "Strom;Spalt;Kraft", iu, 0.4 - x, 1e-3 * force)

my = ambkit.Machine.load(place / "my.toml")
linear = ambkit.ConstantStiffness.of(my)
print(f"{my.name}: k_i {linear.k_i:.0f} N/A, k_s {linear.k_s / 1e6:.2f} N/µm at the centre")

# %% [markdown]
# ## The rig
#
# It is not what was drawn: the magnet is 6 % weaker than computed, the current follows 0.15 ms
# late, the sensor is a quarter noisier than its data sheet has it. Nobody is told. It is moved
# about by a controller of its own, under a load that wanders, and logs.

# %%
GROWTH = 300.0  # N^2/s: the load is a random walk, whose variance grows so fast
rig = my.replace(
    name="the rig",
    delay="0.15 ms",
    sensor__noise_variance="0.5 µm^2",
    **my.magnet.with_constant(0.94 * my.magnet.magnet_constant),
)


def flown(seed: int) -> ambkit.Record:
    """Fly the rig for 1.2 s; the record has the truth beside what is logged."""
    random = np.random.default_rng(seed)
    places = ambkit.Sequence(times=0.03 * np.arange(40), values=random.uniform(-4e-5, 4e-5, 40))
    walk = np.cumsum(random.normal(0, np.sqrt(1e-3 * GROWTH), 1200))
    load = ambkit.Sequence(times=1e-3 * np.arange(1200), values=walk)
    scenario = ambkit.Scenario(duration=1.2, reference=places, disturbance=load, seed=seed)
    pid = ambkit.PID.textbook(rig).model_copy(update={"feedback": "measurement"})
    return ambkit.simulate(rig, scenario.replace(controller=pid)).record


def numbers(run: ambkit.Record) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what the rig's converters show: distance [mm] and current of the coil [A]."""
    return 9.988 - 1e3 * run["y"], 2.52 + 0.5 * run["u"]


for name, seed in (("log", 1), ("other", 2), ("third", 3)):
    run = flown(seed)
    german(place / f"{name}.csv", "Zeit;Abstand;Strom", run.t, *numbers(run))
print((place / "log.csv").read_text(encoding="utf-8")[:100])

# %% [markdown]
# ## From the log to the filter to fly
#
# Is the log what it should be?

# %%
reading = ambkit.read(place / "log.csv", place / "rig.toml")
print(*reading.account(), sep="\n")

# %% [markdown]
# Then all of it in one call: the bearing is identified, an expert trained, filters are tuned on the
# log and judged on the other one, the best is exported. `free` says what the log is asked for. The
# zeros are not among it: under an unknown load a log tells them to some 10 µm only, and they were
# measured better.
#
# The rig's controller is fed by its sensor, and this filter only watches: `max_sensitivity` and
# `force` say that its margin in the loop does not count. Without them a filter for the loop comes
# out, which keeps the peak of the sensitivity in zone A and follows the load less fast.
#
# ```sh
# ambkit design my.toml log.csv --channels rig.toml --validate other.csv \
#   --free magnet_constant --free delay --free measurement_noise --free disturbance_noise \
#   --max-sensitivity inf --force --prefix grinder --out design/
# ```

# %%
design = ambkit.design(
    my,
    [place / "log.csv"],
    out=place / "design",
    channels=place / "rig.toml",
    validate=[place / "other.csv"],
    free=["magnet_constant", "delay", "measurement_noise", "disturbance_noise"],
    max_sensitivity=np.inf,
    force=True,
    prefix="grinder",
)
found = ambkit.Machine.load(place / "design" / "machine.toml")
weaker = 1 - found.magnet.magnet_constant / my.magnet.magnet_constant
print(
    f"The magnet is {100 * weaker:.1f} % weaker than drawn, the delay {1e3 * found.delay:.4f} ms."
)
print(design.finding)
print(*(f"{name}: {what}" for name, what in design.made.items()), sep="\n")

# %% [markdown]
# ## In the controller
#
# `design/c` is the filter, in single precision, for any compiler of C99. It takes the rig's numbers
# as they are. A task of the controller would call `grinder_step` at each sample; here a program
# goes along the third log, which nobody has seen yet.

# %%
MAIN = """
#include <stdio.h>
#include "grinder.h"

int main(void)
{
  static grinder_state state;
  grinder_estimates now;
  float distance, current, u_previous = 0.0F;
  grinder_init(&state);
  while (scanf("%f %f", &distance, &current) == 2) {
    (void)grinder_step(&state, distance, u_previous, &now); /* the current that acted until now */
    u_previous = current;
    printf("%.9g %.9g %.9g\\n", now.x, now.v, now.f_d);
  }
  return 0;
}
"""
c = place / "design" / "c"
(place / "main.c").write_text(MAIN.lstrip())
lines = (place / "third.csv").read_text(encoding="utf-8").replace(",", ".").splitlines()
raw = np.loadtxt(lines, delimiter=";", skiprows=1)[:, 1:]
compiler = next(filter(shutil.which, ("cc", "gcc", "clang")), None)
flying = ambkit.Estimator.load(place / "design" / "filter.toml", precision="float32")
python = flying.run_raw(*raw.T)
if compiler is None:
    print("There is no C compiler here.")
else:
    sources = [file for file in c.rglob("*.c") if "selftest" not in file.parts]
    folders = [f"-I{c / folder}" for folder in (".", "core/include", "core")]
    command = [compiler, "-std=c99", "-O2", "-ffp-contract=off", *folders, place / "main.c",
               *sources, "-o", place / "main"]  # fmt: skip
    subprocess.run(command, check=True)
    given = "\n".join(f"{y!r} {u!r}" for y, u in raw.tolist())
    said = subprocess.run([place / "main"], input=given, capture_output=True, text=True, check=True)
    in_c = np.array([line.split() for line in said.stdout.splitlines()], dtype=np.float32)
    differ = np.count_nonzero(in_c != python.mean[:, :3])
    print(f"{len(in_c)} samples of the rig's numbers in C: {differ} states differ from Python's.")

# %% [markdown]
# ## Against the truth
#
# In 20 runs that nobody was shown, beside an extended Kalman filter that was told everything: the
# rig as it is, its noise, its process noise. The errors count after 50 ms.

# %%
told = ambkit.ExtendedKalmanFilter(rig, noise=ambkit.FilterNoise(disturbance=GROWTH))
UNITS = {"x": (1e6, "µm"), "v": (1e3, "mm/s"), "f_d": (1.0, "N")}


def errors(estimate: ambkit.Estimate, run: ambkit.Record) -> list[float]:
    """Return the root mean square errors of x, v and f_d."""
    return [float(np.sqrt(np.mean((estimate[name] - run[name])[500:] ** 2))) for name in UNITS]


runs = [flown(seed) for seed in range(100, 120)]
ours = np.array([errors(flying.run_raw(*numbers(run)), run) for run in runs])
best = np.array([errors(told.run(run), run) for run in runs])
for (name, (scale, unit)), rms, more in zip(UNITS.items(), ours.T, (ours / best).T, strict=True):
    worse = 100 * (more - 1)
    print(
        f"{name}: {scale * rms.mean():.3g} {unit} rms, {worse.mean():.2f} ± {worse.std(ddof=1):.2f}"
        f" % more than of the filter that was told everything, {worse.max():.2f} % at worst"
    )

# %% [markdown]
# And in a picture:

# %%
evaluated = {"the filter to fly": evaluate(flying, runs[0])}
filter_figure(runs[0], evaluated).save(place / "flying.png")

# %% [markdown]
# ![Position, velocity and load of a run, with the estimates](thread/flying.png)
