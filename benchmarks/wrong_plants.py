"""Are structurally wrong plants named by `identify`, and right ones left in peace?

``python -m benchmarks.wrong_plants [seeds] [right] [first]`` simulates closed loops of several
machines, sensors and sampling times, side by side and the textbook's way, identifies each with a
description that lacks the structure, and prints how often it is named, of all and of those that
Fisher's information lets show: of which half would pass the limit. The search begins at that
description, and no lines are looked for, which saves two thirds of the time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambkit import Machine, Record
from ambkit.base.errors import ConfigError
from ambkit.identification.maximum_likelihood.load_steps import fit_between_load_steps
from ambkit.identification.maximum_likelihood.parameters import usual
from ambkit.machine.magnets import ConstantStiffness, own_time
from ambkit.workflow.identify import starting_model

Array = NDArray[np.float64]

BALL = Machine.preset("inteco_ml")
AXIS = Machine.preset("zittau_axial")
SPINDLE = Machine.load(Path(__file__).parents[1] / "examples" / "spindle.toml").replace(
    sampling_time="0.1 ms"
)

MACHINES: dict[str, tuple[Machine, int, float]] = {
    "axis": (AXIS, 12_000, 40e-6),
    "sharp axis": (AXIS.replace(sensor__noise_variance="1 µm^2", sensor__lag="0.5 ms"),
                   12_000, 40e-6),
    "slow axis": (AXIS.replace(sampling_time="0.25 ms", sensor__noise_variance="9 µm^2"),
                  8_000, 70e-6),
    "spindle": (SPINDLE, 12_000, 40e-6),
    "coarse spindle": (SPINDLE.replace(sensor__noise_variance="9 µm^2"), 12_000, 40e-6),
    "ball": (BALL, 8_000, 0.6e-3),
}  # fmt: skip
"""Description, samples of a record, amplitude of the reference [m]."""

WRONG = (
    "hysteresis", "lag", "saturation", "drift", "payload", "sensor curve", "sensor jump",
    "resonance", "friction", "unequal coils",
)  # fmt: skip
"""Structures that a description lacks."""

NAMES = {
    "saturation": {"saturation", "force law"}, "drift": {"drift", "change"}, "payload": {"change"},
    "sensor curve": {"sensor quadratic", "sensor cubic"},
}  # fmt: skip
"""What counts as named, where it is not called the same."""

RIGHT = 100  #: By which the seeds of right plants are beyond the others.
STEPS = 5  #: Of the integration in a sample.


@dataclass(frozen=True)
class Case:
    """A machine, what is wrong with it, and a seed."""

    machine: str
    wrong: str  #: Empty where nothing is.
    seed: int


def simulate(cases: list[Case], n: int | None = None) -> list[Record]:
    """Return a record of each case, all of one sampling time and of n samples."""
    described = [MACHINES[case.machine][0] for case in cases]
    n, T = n or MACHINES[cases[0].machine][1], described[0].sampling_time
    streams = [np.random.default_rng([case.seed, 17, len(case.machine)]) for case in cases]

    def of(get: Callable[[Machine], float]) -> Array:
        return np.array([get(machine) for machine in described])

    def where(wrong: str, value: Array | float, usual: Array | float = 0.0) -> Array:
        is_wrong = np.array([case.wrong == wrong for case in cases])
        return np.where(is_wrong, value, usual)

    k, s0, i0 = (of(lambda m, p=p: getattr(m.magnet, p))
                 for p in ("magnet_constant", "air_gap", "bias_current"))  # fmt: skip
    both_sides = of(lambda m: float(m.magnet.type == "two-sided"))
    m, weight = of(lambda m: m.rotor.mass), of(lambda m: m.weight)
    gain, lag = of(lambda m: m.amplifier.gain), of(lambda m: m.sensor.lag)
    low, high = of(lambda m: m.current_min), of(lambda m: m.current_max)
    k_i, k_s = (of(lambda m, p=p: getattr(ConstantStiffness.of(m), p)) for p in ("k_i", "k_s"))
    own, moves = of(own_time), np.array([MACHINES[case.machine][2] for case in cases])

    def scaled(low: float, high: float) -> Array:
        return np.exp([s.uniform(math.log(low), math.log(high)) for s in streams])

    # What the description has wrong in numbers, which identification finds.
    k, s0 = k * scaled(0.85, 1.15), s0 * scaled(0.95, 1.05)
    late = scaled(0.3, 2.5)  # samples
    intensity = (scaled(0.01, 0.1) * k_i * i0) ** 2
    std_y = of(lambda m: m.sensor.noise_variance**0.5) * scaled(0.8, 1.25)
    std_u = of(lambda m: m.amplifier.noise_variance**0.5)
    noise = np.array([s.normal(size=(3, n)) for s in streams])
    noise_y, noise_u = std_y * noise[:, 0].T, std_u * noise[:, 1].T
    load = np.sqrt(intensity * T) * np.cumsum(noise[:, 2].T, axis=0)

    def binary(amplitude: Array, holds: Array) -> Array:
        return np.array([
            a * np.repeat(2.0 * s.integers(0, 2, -(-n // hold)) - 1, hold)[:n]
            for a, hold, s in zip(amplitude, holds, streams, strict=True)
        ]).T  # fmt: skip

    reference = binary(moves, np.round(1.8 * own / T).astype(int))
    dither = binary(0.06 * i0 / gain, np.maximum(1, np.round(0.08 * own / T)).astype(int))

    # The structures.
    play = where("hysteresis", 0.04 * i0)
    behind = where("lag", np.minimum(2e-3, 0.24 * own), 1e-9)
    knee = where("saturation", 1.52 * i0 / s0, 1e9 * i0 / s0)  # half the force at twice the flux
    drift, payload = where("drift", -0.03), where("payload", 0.25)
    curve = where("sensor curve", -0.1 / (3 * moves) ** 2)
    jump = where("sensor jump", 0.2 * moves)
    added = where("resonance", 0.1) * m
    omega = 5 / own
    stick = where("friction", 0.02 * k_i * i0)
    unequal = where("unequal coils", 0.2) * both_sides

    def pull(i: Array, s: Array) -> Array:
        b = i / s
        return np.asarray(k * b**2 / np.sqrt(1 + (b / knee) ** 4))

    def magnet_force(i: Array, x: Array) -> Array:
        toward, away = pull(i0 + i, s0 - x), pull(i0 - i, s0 + x)
        return (1 + unequal / 2) * toward - both_sides * (1 - unequal / 2) * away

    def slopes(
        state: Array, i: Array, f_d: Array, factor: Array, mass: Array, own_weight: Array
    ) -> Array:
        x, v, x_m, z, w = state
        force = factor * magnet_force(i, x)
        between = added * omega**2 * (z - x) + 0.04 * added * omega * (w - v)
        total = force + f_d + own_weight + between - stick * np.tanh(v / (0.05 * moves / own))
        seen = x * (1 + curve * x**2)
        at_mass = np.where(added > 0, -between / np.maximum(added, 1e-12), 0.0)
        return np.array([v, total / (mass - added), (seen - x_m) / lag, w, at_mass])

    wn = 1.5 / own
    kp, kd, ki = (k_s + m * wn**2) / k_i, 1.6 * wn * m / k_i, 0.1 * (k_s + m * wn**2) / k_i * wn
    # The mean force carries the weight: the current of equilibrium.
    rest = np.zeros(len(cases))
    for _ in range(50):
        rest = rest - (magnet_force(rest, 0 * s0) + weight) / k_i
    state, current, z = np.zeros((5, len(cases))), rest.copy(), rest.copy()
    integral, filtered = rest.copy(), np.zeros(len(cases))
    T_f, h, past = np.maximum(0.06 * own, 0.5 * T), T / STEPS, [rest / gain] * 4
    y, u = np.empty((n, len(cases))), np.empty((n, len(cases)))
    whole, part = np.floor(late).astype(int), late - np.floor(late)
    columns = np.arange(len(cases))
    for at in range(n):
        half = at >= n // 2
        y[at] = state[2] + noise_y[at] + jump * half
        e = reference[at] - y[at]
        integral = integral + ki * T * e
        rate = (y[at] - filtered) / (T_f + T)
        filtered = filtered + T * rate
        iu = kp * e + integral - kd * rate + gain * dither[at]
        u[at] = np.clip(iu, low, high) / gain
        past = [u[at], *past][:5]
        recent = np.array(past)
        factor, mass = 1 + drift * T * at, m * (1 + payload * half)
        heavy = weight * (1 + payload * half)
        for step in range(STEPS):
            # A delay with a fraction: the switch lies within the sample.
            before = np.clip(part - step / STEPS, 0.0, 1 / STEPS) * STEPS
            acting = before * recent[whole + 1, columns] + (1 - before) * recent[whole, columns]
            i = np.clip(gain * (acting + noise_u[at]), low, high)
            keep = np.exp(-h / behind)
            current = i + (current - i) * keep
            z = np.clip(z, current - play, current + play)
            i = np.where(play > 0, z, current)
            args = (i, load[at], factor, mass, heavy)
            k1 = slopes(state, *args)
            k2 = slopes(state + h / 2 * k1, *args)
            k3 = slopes(state + h / 2 * k2, *args)
            k4 = slopes(state + h * k3, *args)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    t = T * np.arange(n)
    return [Record(t, {"y": y[:, j].copy(), "u": u[:, j].copy()}) for j in range(len(cases))]


def planted(case: Case) -> tuple[str, float]:
    """Return the kind of structure that a case has, and its size in the unit of the kind [SI]."""
    machine, _, moves = MACHINES[case.machine]
    i0, own = machine.magnet.bias_current, own_time(machine)
    return {
        "hysteresis": ("hysteresis", 0.08 * i0),
        "lag": ("lag", min(2e-3, 0.24 * own)),
        "saturation": ("saturation", 0.5 / 1.52**4),
        "drift": ("drift", 0.03),
        "payload": ("change", 1 - 1 / 1.25),
        "sensor curve": ("sensor cubic", 0.1 / (3 * moves) ** 2),
        "sensor jump": ("sensor jump", 0.2 * moves),
        "resonance": ("resonance", 0.1),
        "friction": ("friction", 0.02 * ConstantStiffness.of(machine).k_i * i0),
        "unequal coils": ("unequal coils", 0.2),
    }[case.wrong]


@dataclass(frozen=True)
class Outcome:
    """What the structure's tests say of a case."""

    case: Case
    names: list[str]
    share: float = 0.0  #: Planted size over the one that half of such records would show.

    @property
    def named(self) -> bool:
        """Whether the structure is named that is wrong, or any where nothing is."""
        wrong = self.case.wrong
        return bool(set(self.names) & NAMES.get(wrong, {wrong})) if wrong else bool(self.names)


def judged(case: Case, record: Record) -> Outcome:
    """Identify a record by its description, and test its structure."""
    start = starting_model(MACHINES[case.machine][0])
    try:
        _, _, structure = fit_between_load_steps(
            [record], start, usual(start), improve_start=False, profile=False
        )
    except ConfigError:
        return Outcome(case, ["refused"])
    names = structure.suspect.split(", ") if structure.suspect else []
    if not case.wrong:
        return Outcome(case, names)
    kind, size = planted(case)
    return Outcome(case, names, size / structure.detectable.get(kind, math.inf))


def study(seeds: int = 2, right: int = 17, first: int = 0) -> list[Outcome]:
    """Return what is said of each case."""
    results: list[Outcome] = []
    for machine in MACHINES:
        cases = [Case(machine, wrong, first + s) for wrong in WRONG for s in range(seeds)]
        cases += [Case(machine, "", first + RIGHT + s) for s in range(right)]
        with ProcessPoolExecutor(2) as pool:
            results += pool.map(judged, cases, simulate(cases))
    return results


def main() -> None:
    """Print the study as a table, and all cases."""
    results = study(*(int(argument) for argument in sys.argv[1:]))
    last = ("named", "of those shown", "only suspected")
    print(f"{'':15}" + "".join(f"{name:>16}" for name in (*MACHINES, *last)))
    for wrong in (*WRONG, ""):
        of = [one for one in results if one.case.wrong == wrong]
        rest = sum(bool(one.names) and not one.named for one in of)
        parts = [[one for one in of if one.case.machine == machine] for machine in MACHINES]
        parts += [of, [one for one in of if one.share >= 1]]
        cells = [f"{sum(one.named for one in part)} of {len(part)}" for part in parts] + [str(rest)]
        print(f"{wrong or 'right: accused':15}" + "".join(f"{cell:>16}" for cell in cells))
    for one in results:
        case = one.case
        print(case.machine, case.wrong or "right", case.seed, f"{one.share:.2f}", *one.names,
              sep=", ")  # fmt: skip


if __name__ == "__main__":
    main()
