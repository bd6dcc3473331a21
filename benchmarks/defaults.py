"""Do defaults hold? Each kind as it comes, on random bearings and machines, judged by truth.

``python -m benchmarks.defaults [bearings] [machines] [first]``: the share of samples within the
95 % bound of the NEES, and the error of the position over the raw sensor's and over that of a
constant-velocity filter tuned by truth; last, of some, with their own process noise tuned alike.
The disturbance force is the random walk that filters assume. The kind of a machine for which none
is named, ``ambkit.estimate.DEFAULT``, is the one that fails least. Last, the default filter of
machines with unbalance and runout, which it estimates.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ambkit import Machine
from ambkit.base.errors import AmbkitError
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.default_study import CONSISTENT, DefaultScore, score_defaults
from ambkit.machine.accessories import Runout
from benchmarks.sensors import drawn

KINDS_JUDGED = tuple(name for name in KINDS if name not in ("table", "adaptive"))
"""Without those that learn their law first."""

TUNED = ("extended", "observer", "linear")  #: Judged with their process noise tuned, too.

PRESETS = ("heart_pump", "hindawi_2011", "tum_mlps", "ufu_rig")
"""Rigid rotors that random machines are made of."""


def random_machine(seed: int) -> Machine:
    """A machine like a preset, of other mass, gaps, currents, sensors and sampling time."""
    random = np.random.default_rng([seed, 31])
    preset = Machine.preset(PRESETS[seed % len(PRESETS)])
    size, gap, bias, noise, lag, T = 2 ** random.uniform(-1, 1, 6)
    tables = preset.model_dump()
    for key in ("mass", "transverse_inertia", "polar_inertia"):
        tables["rotor"][key] *= size
    for bearing in tables["bearing"]:
        bearing["clearance"] *= gap
        magnet, amplifier = bearing["magnet"], bearing["amplifier"]
        magnet["air_gap"] *= gap
        magnet["bias_current"] *= bias
        amplifier["current_limit"] *= bias
        # The same force at that gap and current, of the rotor's weight.
        constant = "magnet_constant" if "magnet_constant" in magnet else "pole_area"
        magnet[constant] *= size * (gap / bias) ** 2
    for sensor in tables["sensor"]:
        sensor["noise_variance"] *= noise**2
        sensor["lag"] *= lag
    tables |= {"name": f"random_{seed}", "sampling_time": tables["sampling_time"] * T}
    return Machine.model_validate(tables)


def rotating_machine(seed: int) -> Machine:
    """A random machine of another speed and unbalance; every third has runout too."""
    machine, random = random_machine(seed), np.random.default_rng([seed, 77])
    speed, amount = machine.speed * 2 ** random.uniform(-1, 1.5), 2 ** random.uniform(-2, 2)
    planes = [
        item.model_copy(
            update={"amount": amount * item.amount, "angle": float(random.uniform(0, 6.28))}
        )
        for item in machine.unbalance
    ]
    sensors = [
        item.model_copy(update={"runout": (Runout(
            order=1, amplitude=float(3e-6 * random.uniform(0.2, 1)),
            phase=float(random.uniform(0, 6)),
        ),) if seed % 3 == 0 else ()})
        for item in machine.sensors
    ]  # fmt: skip
    return machine.replace(speed=float(speed), unbalance=planes, sensor=sensors)


def scores(
    count: int, draw: Callable[[int], Machine], first: int, judged: Sequence[str] = KINDS_JUDGED
) -> Iterator[tuple[int, DefaultScore]]:
    """Judge so many machines whose loops hold them; without kinds their default filters."""
    seed = first
    while count > 0:
        try:
            machine = draw(seed)
            kinds = [kind for kind in judged if KINDS[kind].estimator.takes(machine)]
            yield (
                seed,
                score_defaults(
                    machine, kinds, seed=seed, tune=[kind for kind in TUNED if kind in kinds]
                ),
            )
            count -= 1
        except (AmbkitError, ValueError):
            pass  # it cannot carry its rotor
        seed += 1


def table(results: list[DefaultScore]) -> str:
    """Return a line a kind: its NEES, and its error over the baselines'."""
    low, high = CONSISTENT
    lines = [f"{len(results)} machines; NEES in {low:g} to {high:g} is consistent"]
    lines.append(f"{'kind':26}{'NEES':>20} {'below':>6} {'above':>6} {'/ raw':>12} "
                 f"{'worse':>6} {'/ naive':>12} {'worse':>6} {'tuned':>12}")  # fmt: skip
    for kind in dict.fromkeys(kind for item in results for kind in item.errors):
        own = [item for item in results if kind in item.errors]
        nees = np.array([item.nees[kind] for item in own])
        low_nees, median, high_nees = np.nanquantile(nees, [0, 0.5, 1])
        raw = np.array([item.errors[kind] / item.raw for item in own])
        naive = np.array([item.errors[kind] / item.naive for item in own])
        tuned = np.array([item.tuned[kind] / item.naive for item in own if kind in item.tuned])
        best = f"{np.median(tuned):6.2f}{tuned.max():6.2f}" if len(tuned) else ""
        lines.append(
            f"{kind:26}{low_nees:6.3f} {median:6.3f} {high_nees:6.3f} "
            f"{np.sum(nees < low):6d} {np.sum(nees > high):6d} "
            f"{np.median(raw):6.2f}{raw.max():6.2f} {np.sum(raw > 1):6d} "
            f"{np.median(naive):6.2f}{naive.max():6.2f} {np.sum(naive > 1):6d} {best:>12}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the tables of bearings, of machines, and of those with unbalance."""
    bearings, machines, first = (
        int(a) for a in [*sys.argv[1:], *("240", "60", "0")[len(sys.argv) - 1 :]]
    )
    for count, draw, judged in (
        (bearings, drawn, KINDS_JUDGED),
        (machines, random_machine, KINDS_JUDGED),
        (machines, rotating_machine, ()),
    ):
        results = []
        for seed, result in scores(count, draw, first, judged):
            results.append(result)
            print(f"{seed}: {result.row()}", file=sys.stderr)
        print(table(results) if results else "", flush=True)


if __name__ == "__main__":
    main()
