"""Logs in disguise: rows shuffled, turned, scaled, moved, cut, nameless; and other rigs."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

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
    bearing = ambkit.Bearing.preset("inteco_ml" if name == "one magnet" else "zittau_axial")
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
    record = ambkit.simulate(bearing, scenario)
    estimate = ambkit.ExtendedKalmanFilter(bearing).run(record)
    return {
        "t": record.t, "y": record["y"], "u": record["u"], "r": record["r"],
        "x_estimated": estimate.x, "v_estimated": estimate.v,
    }  # fmt: skip


OTHERS = ("of the paper", "slow poles, 1 kHz", "one magnet", "quiet sensor", "heavy rotor")
