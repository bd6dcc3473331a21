"""The whole machine: the composition that a rotor, its bearings and its sensors give."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.models.compose import compose
from ambkit.models.model import Model
from ambkit.models.parts import (
    Amplifier,
    ColouredNoise,
    Delay,
    Disturbance,
    Hum,
    MagnetPlace,
    Rotor,
    Sensor,
)
from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Part, Place, Plan
from ambkit.models.sampling import Sampling

VELOCITIES = {"x": "v_x", "y": "v_y", "z": "v_z", "th_x": "w_x", "th_y": "w_y"}
"""What the derivative of each coordinate is called."""


class OpenLoop(NamedTuple):
    """Poles of the uncontrolled rotor at a speed."""

    speed: float
    """Of rotation [rad/s]."""
    poles: NDArray[np.complex128]
    """All of them (2 q,) [1/s]."""

    @property
    def unstable(self) -> NDArray[np.complex128]:
        """Those that grow [1/s], by their real parts, the slower first."""
        poles = self.poles
        greatest = float(np.abs(poles).max())
        found = poles[poles.real > 1e-6 * greatest]
        return found[np.lexsort((found.imag, np.round(found.real, 6)))]


def machine_parts(machine: Any, *, noise: bool = True, delay: bool = True) -> list[Part]:
    """Return the parts of a machine, as its keys give them.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    noise : bool, optional
        Without: sensor noise that has states of its own is left out.
    delay : bool, optional
        Without: the demanded currents act at once.
    """
    axes, sizes = machine.axes, [_typical(machine, axis.name) for axis in machine.axes]
    parts: list[Part] = [rotor_part(machine, sizes)]
    each = list(zip(axes, sizes, strict=True))
    parts += [MagnetPlace(s.force, f"f_{a.name}", place(a.line.form)) for a, s in each]
    parts += [Disturbance(s.force, 1e-3 * s.force, f"f_d_{a.name}", f"f_{a.name}") for a, s in each]
    for r in machine.readings:
        size = abs(r.sensor.gain) * max(s.displacement for s in sizes)
        lag, form = r.sensor.lag or None, place(r.line.form)
        parts.append(Sensor(r.sensor.gain, lag, size, f"y_{r.name}", f"x_m_{r.name}", form))
    parts += [
        Amplifier(s.current, a.bearing.amplifier.bandwidth, f"u_{a.name}", f"i_{a.name}",
                  f"f_{a.name}") for a, s in each
    ]  # fmt: skip
    if machine.delay and delay:
        parts += [Delay(machine.delay, s.current, f"u_{a.name}") for a, s in each]
    return parts + (_noises(machine) if noise else [])


def rotor_part(machine: Any, sizes: list[Typical]) -> Rotor:
    """Return the rigid rotor, with its gyroscopics at the machine's speed."""
    positions, rotor = machine.positions, machine.rotor
    reach = max(abs(a.line.place) for a in machine.axes if not a.line.axial)
    way, fast = max(s.displacement for s in sizes), max(s.velocity for s in sizes)
    turns = tuple(q.startswith("th") for q in positions)
    inertia = [rotor.transverse_inertia if turn else rotor.mass for turn in turns]
    at = {q: k for k, q in enumerate(positions)}
    return Rotor(
        {(k, k): value for k, value in enumerate(inertia)}, way, fast, positions,
        tuple(VELOCITIES[q] for q in positions), speed=machine.speed,
        gyroscopic={
            (at["th_x"], at["th_y"]): rotor.polar_inertia,
            (at["th_y"], at["th_x"]): -rotor.polar_inertia,
        },
        turns=turns, lever=reach,
    )  # fmt: skip


def place(form: dict[str, float]) -> Place:
    """Return a linear form of the coordinates, with ones by structure where it is along one."""
    return {q: UNIT if q in "xyz" and value == 1 else value for q, value in form.items()}


def _typical(machine: Any, axis: str) -> Typical:
    return Typical.of(machine.alone(axis))


def _noises(machine: Any) -> list[Part]:
    parts: list[Part] = []
    for r in machine.readings:
        coloured = r.sensor.coloured_noise
        if coloured:
            parts.append(
                ColouredNoise(coloured.variance, coloured.bandwidth, f"n_y_{r.name}", f"y_{r.name}")
            )
        for k, line in enumerate(r.sensor.hum, 1):
            name = f"hum{k if k > 1 else ''}_{r.name}"
            parts.append(Hum(line.frequency, line.amplitude, line.bandwidth, name, f"y_{r.name}"))
    return parts


def machine_model(machine: Any, *, T: float | None = None, noise: bool = True) -> Model:
    """Return the sampled model of a whole machine.

    Parameters
    ----------
    machine, noise
        See `machine_parts`.
    T : float, optional
        Sampling time [s]; the machine's own by default.
    """
    parts = machine_parts(machine, noise=noise)
    return compose(parts, machine.sampling_time if T is None else T, name="machine")


def open_loop(machine: Any, k_s: Any, speed: float | None = None) -> OpenLoop:
    """Return the poles of the rotor in its magnets, without control.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    k_s : sequence of float (p,)
        Position stiffnesses of its axes [N/m].
    speed : float, optional
        Of rotation [rad/s]; the machine's own by default.
    """
    at = machine if speed is None else machine.model_copy(update={"speed": speed})
    plan = Plan(machine.sampling_time)
    for part in machine_parts(at, noise=False, delay=False):
        plan.add(part)
    sampling = Sampling(plan)
    q = 2 * len(machine.positions)
    n = sampling.sizes[0]
    A = sampling.generator(0.0)
    H = np.zeros((len(plan.forces), q))
    for k, force in enumerate(plan.forces):
        for position, value in plan.places[force.name].items():
            H[k, sampling.at(position)] = value
    pull = A[:q, n : n + len(plan.forces)]
    poles = np.linalg.eigvals(A[:q, :q] + pull @ (np.asarray(k_s)[:, None] * H))
    return OpenLoop(at.speed, poles.astype(complex))
