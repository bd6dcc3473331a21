"""A real rig, from its logs to a judged model: law from lift-off, noise from rest, one closed loop.

The logs are not part of ambkit. Give their folder; without it, the script says so and ends.
Writes rig_fit.png, rig_residuals.png, rig_noise.png and rig_late.png into the folder in which it is
started.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.optimize import least_squares
from scipy.signal import lfilter, savgol_filter

import ambkit
from ambkit.estimate.constant_velocity import tune
from ambkit.estimate.errors import prediction_error
from ambkit.identification.forces.lift_off import find_lift_off, fit_lift_off
from ambkit.identification.maximum_likelihood import figures as figures
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel, delayed
from ambkit.identification.maximum_likelihood.validation import validate
from ambkit.identification.noise import measurement_noise
from ambkit.result.report import Axis, Bars, Figure, Line, Panel, Rule

HERE = Path(__file__).parent
LOGS = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1] / "shared" / "data" / "inteco"
FROM = 2.0  # s: before, the ball is fetched
USED = "KF"  # the log that is identified from; all others judge
NAMES = {
    name: f"sinusoidal_slow_linear-LQR_tracking-{name}"
    for name in ("no_filter", "low_pass", "LO", "KF", "EKF")
} | {"step": "step-LQI-KF"}
LOOKS = {"no_filter": "series 1", "LO": "series 2", "EKF": "series 3", "step": "series 4"}
SMOOTH = 61  # ms: the window of the smooth curve that stands for the truth

if not LOGS.is_dir():
    print(f"there are no logs in {LOGS}: nothing is shown")
    raise SystemExit(0)


def closed_loop(name: str) -> ambkit.Record:
    """Read a log, and leave out its beginning."""
    path = LOGS / "closed_loop" / f"{NAMES[name]}.mat"
    return ambkit.load(path, HERE / "recordings" / "closed_loop.toml").between(FROM, None)


# The law from lift-off, and what the sensors show at rest.
lift_off = HERE / "recordings" / "lift_off.toml"
points = [
    find_lift_off(ambkit.load(path, lift_off), int(path.stem))
    for path in sorted((LOGS / "force").glob("*.mat"))
]
preset = ambkit.preset("inteco_ml")
law = fit_lift_off(points, preset.rotor.mass, gap_range=(0.004, 0.016))
gap, bias = law.operating_point(0.010)
rest = measurement_noise(ambkit.load(LOGS / "noises.mat", lift_off), "i")
moving = [p.noise_variance for p in points if 0.008 <= p.gap <= 0.012]
machine = preset.replace(
    magnet__magnet_constant=law.magnet_constant,
    magnet__air_gap=gap,
    sensor__noise_variance=float(np.mean(moving)),
    amplifier__noise_variance=rest.variance,
)
print(
    f"lift-off: k {1e6 * law.magnet_constant:.1f} N mm²/A², gap {1e3 * gap:.2f} mm; at rest: "
    f"position {1e6 * np.mean(moving) ** 0.5:.1f} µm, current {1e3 * rest.variance**0.5:.1f} mA"
)

# One closed loop for the rest. The map counts the current from the preset's bias.
start = LoopModel(machine, current_offset=preset.magnet.bias_current - machine.magnet.bias_current)
logs = {name: closed_loop(name) for name in NAMES}
noise = ("measurement_noise", "control_noise", "disturbance_noise", "current_offset")
by_lift_off = maximum_likelihood(logs[USED], start, noise)
by_loop = maximum_likelihood(logs[USED], start, (*noise, "magnet_constant", "air_gap"))
for what, found in (("law from lift-off", by_lift_off), ("law from the loop", by_loop)):
    said = ", ".join(
        f"{p.name} {found[p.name]:.4g} ± {found.standard_error(p.name):.2g} {p.unit}"
        f" (robust {found.standard_error(p.name, robust=True):.2g})"
        for p in found.parameters
    )
    print(f"{what}: {said}; held {dict(found.held)}; log likelihood {found.log_likelihood:.1f}")

# With the offset of the current where it was, each loop tells a law of its own.
law_of_loop = (*noise[:3], "magnet_constant", "air_gap")
for name, record in logs.items():
    found = maximum_likelihood(record, start, law_of_loop)
    said = ", ".join(f"{p.name} {found[p.name]:.4g} ± {found.standard_error(p.name):.2g} {p.unit}"
                     for p in found.parameters[:2])  # fmt: skip
    at_origin = ", ".join(f"{n} {v:.3g} ± {e:.2g}" for n, (v, e) in found.stiffness().items())
    print(f"{name}: {said}; at x = 0 {at_origin}")

# The filter that knows no magnet, tuned on the same log: what does the model buy?
naive = tune(logs[USED]["y"], preset.sampling_time)
checks = {}
for name, record in logs.items():
    y, first = record["y"], round(0.2 / preset.sampling_time)
    unmodelled = {
        ahead: prediction_error(naive.predict(y, ahead), record, ahead, first) for ahead in (1, 10)
    }
    print(f"{name:12} without a magnet: 1 ms {1e6 * unmodelled[1]:.1f} µm, "
          f"10 ms {1e6 * unmodelled[10]:.1f} µm")  # fmt: skip
    for what, found in (("lift-off", by_lift_off), ("loop", by_loop)):
        check = validate(found.model, record, start=start, horizons=(1, 2, 5, 10, 20, 50, 100),
                         settling=0.2, name=name)  # fmt: skip
        checks[what, name] = check
        print(
            f"{name:12} {what:8} 1 ms: {1e6 * check.errors['error'][1]:.1f} µm, "
            f"10 ms: {1e6 * check.errors['error'][10]:.1f} µm, fit {check.fit()[10]:.2f} %"
            f" (held {check.fit('held')[10]:.2f} %), "
            f"white {100 * check.residual.share_within:.0f} %,"
            f" free of control {100 * check.cross.share_within:.0f} %, NIS {check.nis:.2f}"
        )

# The start is no match: it would squeeze the others together.
others = [
    replace(check, errors={kind: by for kind, by in check.errors.items() if kind != "of_start"})
    for (what, name), check in checks.items()
    if what == "lift-off" and name in ("no_filter", "LO", "EKF", "step")
]
figures.fit_figure(others).save("rig_fit.png")
figures.residual_figure(others).save("rig_residuals.png")

# How quiet is the position after filtering? The truth is not known; a smooth curve stands for it.
rows = {}
for name in ("KF", "EKF", "LO"):
    record = logs[name]
    smooth = savgol_filter(record["y"], SMOOTH, 3)
    model = by_lift_off.model
    kalman = ambkit.ExtendedKalmanFilter(
        model.isolated, noise=ambkit.FilterNoise(disturbance=model.disturbance_noise)
    )
    ours = kalman.run(model.corrected(record)).x
    inner = slice(500, -500)
    errors = {"measured": record["y"], "logged": record["x_logged"], "ours": ours}
    rows[name] = {
        what: ((x - smooth)[inner].mean(), (x - smooth)[inner].std()) for what, x in errors.items()
    }
    said = ", ".join(f"{what} {1e6 * s:.1f} µm (bias {1e6 * m:+.1f})"
                     for what, (m, s) in rows[name].items())  # fmt: skip
    print(f"{name}: scatter of the position about a smooth curve: {said}")
bars = [
    Bars(tuple(rows), np.array([rows[name][what][1] for name in rows]), signal=signal, label=label)
    for what, signal, label in (
        ("measured", "constant", "measured"),
        ("logged", "series 4", "logged by the rig's filter"),
        ("ours", "estimate", "ambkit's extended Kalman filter"),
    )
]
scatter = Panel(Axis("log with this filter in the loop"), Axis("scatter", "µm", 1e6), bars)
Figure("rig_noise", "Scatter of the position about a smooth curve", "", [scatter]).save(
    "rig_noise.png"
)

# Is the logged current late? Shift it, and ask the likelihood.
shifts = np.arange(-1, 6)
gains = {}
for name, record in logs.items():
    values = []
    for early in shifts:
        moved = ambkit.Record(record.t, {"y": record["y"], "u": delayed(record["u"], -early)})
        found = maximum_likelihood(moved, by_lift_off.model, noise[:3], improve_start=False)
        values.append(found.log_likelihood)
    gains[name] = np.array(values) - values[1]
    print(f"{name}: current taken earlier by {shifts[0]} .. {shifts[-1]} ms: log likelihood "
          + ", ".join(f"{gain:+.0f}" for gain in gains[name]))  # fmt: skip
late = [
    Line(1e-3 * shifts, gain, signal=LOOKS[name], label=name)
    for name, gain in gains.items()
    if name in LOOKS  # the others are as EKF
]
axes = Axis("taken earlier by", "ms", 1e3), Axis("gain", limits=(-110.0, 110.0))
panel = Panel(*axes, [*late, Rule(0.0, signal="bound", label="")])
Figure("rig_late", "Log likelihood, with the logged current taken earlier", "", [panel]).save(
    "rig_late.png"
)


# The coil: what the control does to the measured current. Output error, dead time in whole samples.
def coil(control: np.ndarray, current: np.ndarray, dead: int) -> tuple[float, np.ndarray]:
    """Fit gain, time constant and offset; return the RMS error [A] and these."""

    def miss(theta: np.ndarray) -> np.ndarray:
        keep, gain, offset = theta
        target = gain * np.roll(control, dead) + offset
        follow, _ = lfilter([1 - keep], [1, -keep], target, zi=[keep * current[0]])
        return (follow - current)[200:]

    result = least_squares(miss, [0.97, 2.7, -0.1])
    keep, gain, offset = result.x
    return float(np.sqrt(np.mean(result.fun**2))), np.array(
        [-1e-3 / np.log(abs(keep)), gain, offset]
    )


for name in ("KF", "step"):
    rows_of = loadmat(LOGS / "closed_loop" / f"{NAMES[name]}.mat")["logouts"][:, 2000:]
    fits = {dead: coil(rows_of[6], rows_of[4], dead) for dead in range(6)}
    best = min(fits, key=lambda dead: fits[dead][0])
    error, (lag, gain, _) = fits[best]
    print(
        f"{name}: from the control to the measured current {best} ms of dead time and a lag of "
        f"{1e3 * lag:.0f} ms, {gain:.2f} A at full control, {1e3 * error:.1f} mA left"
    )
