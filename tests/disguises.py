"""Logs in disguise: rows shuffled, turned, scaled, moved, cut, nameless; and other rigs."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.signal import lfilter

import ambkit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Disguised:
    """A log whose rows are moved, and where they came from."""

    rows: Array
    order: NDArray[np.intp]
    signs: Array
    name: str

    def is_right(self, position: int, control: int, turned: bool, true: Array) -> bool:
        """Whether two rows hold the true position and current (2, n), and their signs agree.

        Current and position of the rig grow together in balance: its position is turned.
        """
        found = [self.order[position], self.order[control]]
        same = all(
            _same(row, wanted) for row, wanted in zip(self.original[found], true, strict=True)
        )
        flips = self.signs[position] * self.signs[control] < 0
        return same and turned != flips

    @property
    def original(self) -> Array:
        """The rows as they were, in the order that they had."""
        back = np.empty_like(self.rows)
        back[self.order] = self.rows
        return back


def _same(a: Array, b: Array) -> bool:
    def unit(v: Array) -> Array:
        return (v - v.mean()) / v.std()

    return bool(np.abs(abs(unit(a)) - abs(unit(b))).max() < 1e-6)


def disguise(rows: Array, rng: np.random.Generator, name: str = "", cut: int = 4000) -> Disguised:
    """Hide what the rows of a log are; the first, its time, keeps rising."""
    start = int(rng.integers(0, max(1, rows.shape[1] - cut)))
    part = rows[:, start : start + cut]
    order = rng.permutation(len(part))
    signs = rng.choice([-1.0, 1.0], len(part))
    signs[order == 0] = 1.0
    scales = 10 ** rng.uniform(-3, 3, len(part))
    scales[order == 0] = 1.0
    moved = signs[:, None] * scales[:, None] * part[order]
    offsets = rng.normal(size=len(part)) * np.ptp(moved, axis=1)
    return Disguised(moved + offsets[:, None], order, signs, f"{name} from sample {start}")


def without_steps(rows: Array, rng: np.random.Generator) -> Array:
    """Hide the steps of the converters under noise of their size; copies stay copies."""
    hidden = rows.astype(float)
    for k in range(1, len(rows)):
        twin = next((j for j in range(1, k) if np.array_equal(rows[j], rows[k])), None)
        values = np.unique(rows[k])
        if twin is not None:
            hidden[k] = hidden[twin]
        elif 2 <= values.size < 0.6 * rows.shape[1]:
            step = float(np.median(np.diff(values)))
            hidden[k] += rng.uniform(-0.5, 0.5, rows.shape[1]) * step
    return hidden


def of_the_rig(
    folder: Path, count: int, seed: int, *, steps: bool = True
) -> Iterator[tuple[Disguised, Array]]:
    """Yield disguises of the closed loops that were recorded, with their true y and u."""
    rng = np.random.default_rng(seed)
    paths = sorted(folder.glob("*.mat"))
    for k in range(count):
        path = paths[k % len(paths)]
        rows = loadmat(path)["logouts"]
        rows = rows if steps else without_steps(rows, rng)
        hidden = disguise(rows, rng, path.stem)
        yield hidden, hidden.original[[2, 4]]


MEASURED = ("y", "u", "r")


def simulated(name: str) -> dict[str, Array]:
    """Simulate a rig of another kind than the recorded one: time, y, u, r, and estimates of it."""
    bearing = ambkit.preset("inteco_ml" if name == "one magnet" else "zittau_axial")
    duration, size = 1.5, 0.2e-3
    match name:
        case "slow poles, 1 kHz":
            bearing = bearing.replace(
                sampling_time=1e-3, rotor__mass=bearing.rotor.mass * 8,
                magnet__air_gap=4e-3, sensor__lag=0.3e-3,
                rotor__gravity="none",
            )  # fmt: skip
            duration = 12.0
        case "one magnet":
            duration, size = 12.0, 1e-3
        case "quiet sensor":
            bearing = bearing.replace(sensor__noise_variance=(1e-6) ** 2)
        case "heavy rotor":
            bearing = bearing.replace(rotor__mass=1.0)
    period = duration / 6
    scenario = ambkit.Scenario(
        duration=duration, reference=ambkit.Sine(amplitude=size, frequency=1 / period)
    )
    record = ambkit.simulate(bearing, scenario).record
    estimate = ambkit.ExtendedKalmanFilter(bearing).run(record)
    return {
        "t": record.t, "y": record["y"], "u": record["u"], "r": record["r"],
        "x_estimated": estimate.x, "v_estimated": estimate.v,
    }  # fmt: skip


OTHERS = ("of the paper", "slow poles, 1 kHz", "one magnet", "quiet sensor", "heavy rotor")


def other_rig(seed: int) -> tuple[Disguised, list[str]]:
    """Simulate a rig unlike the recorded one, and hide its log; with what each row was.

    Mass, gap, sampling, sensor, gravity, reference, load and controller vary, and which of
    references, estimates, differences, filtered controls and noise are logged besides.
    """
    rng = np.random.default_rng(seed)
    while (flown := _flown(rng, seed)) is None:
        pass
    record, bearing = flown
    kind = ambkit.ExtendedKalmanFilter if rng.random() < 0.7 else ambkit.KalmanFilter
    estimate = kind(bearing).run(record)
    y, u, steps = record["y"].copy(), record["u"].copy(), rng.random()
    if steps < 0.4:
        step = np.sqrt(bearing.sensor.noise_variance) * 10 ** rng.uniform(-0.5, 0.8)
        y = np.round(y / step) * step
    if steps < 0.25:
        step = np.ptp(u) / rng.integers(200, 4000)
        u = np.round(u / step) * step
    rows = {"t": record.t, "y": y, "u": u}
    for name, share, values in (
        ("r", 0.8, record["r"]), ("x_e", 0.8, estimate.x), ("v_e", 0.8, estimate.v),
        ("difference", 0.3, np.gradient(y)), ("u_filtered", 0.3, lfilter([0.3], [1, -0.7], u)),
        ("noise", 0.3, rng.normal(size=y.size)),
    ):  # fmt: skip
        if rng.random() < share and np.ptp(values) > 0:
            rows[name] = values
    about = f"seed {seed}, {bearing.name}, {bearing.rotor.mass:.3g} kg, {bearing.sampling_time:g} s"
    hidden = disguise(np.array([*rows.values()]), rng, about, cut=y.size)
    return hidden, [list(rows)[k] for k in hidden.order]


def _flown(rng: np.random.Generator, seed: int) -> tuple[ambkit.Record, ambkit.Machine] | None:
    """Fly some bearing; None where that goes wrong."""
    one = rng.random() < 0.3
    bearing = ambkit.preset("inteco_ml" if one else "zittau_axial")
    values: dict[str, object] = {
        "sampling_time": float(rng.choice([5e-4, 1e-3, 2e-3] if one else [5e-5, 1e-4, 2e-4, 1e-3])),
        "sensor__noise_variance": (10 ** rng.uniform(-6 if one else -7, -4.5 if one else -5)) ** 2,
    }
    if not one:
        gap = bearing.magnet.air_gap * rng.uniform(0.6, 2)
        values |= {
            "rotor__mass": bearing.rotor.mass * 10 ** rng.uniform(-0.5, 1),
            "sensor__lag": bearing.sensor.lag * 10 ** rng.uniform(-1, 0),
            "magnet__air_gap": gap, "rotor__clearance": 0.5 * gap,
            "rotor__gravity": str(rng.choice(["-x", "none"])),
        }  # fmt: skip
    try:
        bearing = bearing.replace(**values)
        return _moved(rng, bearing, seed)
    except ambkit.AmbkitError:  # too weak for its weight, or not to be held
        return None


def _moved(
    rng: np.random.Generator, bearing: ambkit.Machine, seed: int
) -> tuple[ambkit.Record, ambkit.Machine] | None:
    """Move a bearing's rotor by a reference or a load; None where it touches its stop."""
    duration = float(rng.integers(6000, 15000)) * bearing.sampling_time
    size, often = bearing.clearance * rng.uniform(0.02, 0.4), rng.uniform(2, 12) / duration
    weight = 9.81 * bearing.rotor.mass
    moved = [
        {}, {"reference": ambkit.Sine(amplitude=size, frequency=often)},
        {"reference": ambkit.Step(amplitude=size, time=0.3 * duration)},
        {"reference": ambkit.Sine(amplitude=0.3 * size, frequency=10 * often)},
        {"disturbance": ambkit.Sine(amplitude=0.2 * weight, frequency=often)},
    ][rng.integers(5)]  # fmt: skip
    if rng.random() < 0.4:
        moved["controller"] = ambkit.PID.textbook(bearing)
    record = ambkit.simulate(bearing, ambkit.Scenario(duration=duration, seed=seed, **moved)).record
    return None if record.meta.get("stop_touched", 0) > 20 else (record, bearing)
