"""Unbalance control: the synchronous motion that the controllers do not react to, over speed.

The synchronous motion for an unbalance U is Re(Z U exp(j W t)), with the rotor's dynamics at that
speed: masses, gyroscopics, bending with its damping. The compensation uses the estimated unbalance,
which does not depend on the currents, so the poles of the loop are unchanged at any speed. Near
critical speeds of the uncontrolled rotor, and where the unbalance takes much of a clearance or a
current limit, the compensation is faded out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.units import rpm
from ambkit.control.linear.linear_controller import ControlLaw
from ambkit.estimate.estimator import Estimator
from ambkit.machine import geometry
from ambkit.machine.accessories import SLOWEST
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.parts.synchronous import described_unbalance, unbalance_planes
from ambkit.models.plant import Plant

NODES, RIGID = 129, 33  #: Number of speeds in the table, for a flexible and a rigid rotor.
LEAST, MOST = 1.5, 3.0  #: Ratio of the orbits up to which it acts fully, and from which it is off.
NEIGHBOURHOOD = 0.02  #: Relative error of a critical speed of the model.
FULL, NONE = 0.3, 0.5
"""Limits as shares of the clearance and of the current limit: if the estimated unbalance takes more
than the first, the share of unbalance control decreases, from the second on it is off. Zones A
and C of ISO 14839-2 end there. Also in the core (``AMB_UNBALANCE_FULL``).
"""


@dataclass(frozen=True, eq=False)
class UnbalanceControl:
    """Tables of ``amb_unbalance_control``."""

    first: float  #: First speed, below which it is off, and the step [rad/s].
    step: float
    start: int  #: Index of the first unbalance state.
    motion: Array  #: (nodes, moved, w) Positions and velocities [m/(kg m)], angles in rad.
    current: Array  #: (nodes, p, w) Currents for it [A/(kg m)].
    share: Array  #: (nodes,) Share of the free or compensated motion [1].
    #: (p, moved / 2) Share of an axis's clearance per unit of a position [1/m], [1/rad].
    reach: Array
    ampere: Array  #: (p,) Share of an axis's current limit per ampere [1/A].

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of nodes and states, by their names in C."""
        nodes, moved, width = self.motion.shape
        return {"nodes": nodes, "from": self.start, "width": width, "moved": moved}

    def at(self, speed: float) -> tuple[Array, Array]:
        """Return motion (moved, w) [m], [m/s] and currents (p, w) [A] for 1 kg m, as in C."""
        return self._between(self.motion, speed), self._between(self.current, speed)

    def share_at(self, speed: float) -> float:
        """Return the share of unbalance control at a speed [rad/s], for small unbalance."""
        return float(self._between(self.share, speed))

    def limited(self, speed: float, unbalance: Array) -> float:
        """Return the factor on that share for a large unbalance, as in C."""
        # unbalance (w,) [kg m]
        motion, current = self.at(speed)
        across = np.stack([-unbalance[1::2], unbalance[::2]], axis=1).ravel()
        positions = self.reach @ motion[: self.reach.shape[1]]
        rows = np.vstack([positions, self.ampere[:, None] * current])
        squared_share = float(((rows @ unbalance) ** 2 + (rows @ across) ** 2).max())
        return float(np.clip((NONE**2 - squared_share) / (NONE**2 - FULL**2), 0.0, 1.0))

    def for_unbalance_of(self, machine: Machine) -> UnbalanceControl:
        """Return the same with the limit that the core applies for a machine's unbalance."""
        sizes = np.zeros(self.motion.shape[2])
        planes = unbalance_planes(machine)
        for z, amount, angle in machine.unbalances() if machine.speed else []:
            if z in planes:
                at = 2 * planes.index(z)
                sizes[at : at + 2] += amount * np.array([math.cos(angle), math.sin(angle)])
        share = self.limited(machine.speed, sizes)
        return replace(
            self, motion=share * self.motion, current=share * self.current, share=share * self.share
        )

    def sentence(self, name: str, low: float, high: float) -> str | None:
        """Return where it is off between two speeds [rad/s], in words; None if nowhere."""
        speeds = np.abs(self.first + self.step * np.arange(len(self.share)))
        inner = speeds[(speeds > abs(low)) & (speeds < abs(high))]
        speed_grid = np.array(sorted({abs(low), *map(float, inner), abs(high)}))
        way = math.copysign(1.0, self.step)
        nothing = np.array([self.share_at(way * float(item)) <= 0 for item in speed_grid])
        starts = np.flatnonzero(nothing & ~np.r_[False, nothing[:-1]])
        ends = np.flatnonzero(nothing & ~np.r_[nothing[1:], False])
        if not len(starts):
            return None
        where = ", ".join(
            f"at {rpm(speed_grid[a])}"
            if a == b
            else f"from {rpm(speed_grid[a])} to {rpm(speed_grid[b])}"
            for a, b in zip(starts, ends, strict=True)
        )
        return (
            f'unbalance = "{name}" is plain control {where}, where the orbit would otherwise be '
            f"{MOST:g} times as large or more, or a limit is near"
        )

    def _between(self, table: Array, speed: float) -> Array:
        at = float(np.clip((speed - self.first) / self.step, 0, len(table) - 1))
        node = min(int(at), len(table) - 2)
        return np.asarray(table[node] + (at - node) * (table[node + 1] - table[node]))


def unbalance_control_fields(turn: UnbalanceControl | None) -> dict[str, Any]:
    """Return the fields that the core's binding reads."""
    if turn is None:
        return {"unbalance_control_motion": None}
    return {f"unbalance_control_{key}": value for key, value in turn.counts.items()} | {
        "unbalance_control_first": turn.first,
        "unbalance_control_step": turn.step,
        "unbalance_control_motion": turn.motion.ravel().tolist(),
        "unbalance_control_current": turn.current.ravel().tolist(),
        "unbalance_control_reach": turn.reach.ravel().tolist(),
        "unbalance_control_ampere": turn.ampere.tolist(),
    }


def check_unbalance(estimator: Estimator) -> None:
    """Raise AmbkitError if an estimator has no unbalance states."""
    if not any(state.role == "unbalance" for state in estimator.states):
        raise AmbkitError(
            f"{estimator.name}: it has no unbalance among its states, which the controllers are "
            'to know: it needs synchronous = ["unbalance"]'
        )


def unbalance_control(
    plant: Plant,
    estimator: Estimator,
    control: ControlLaw,
    unbalance: Literal["force-free", "compensation"],
    start: float | None = None,
    max_speed: float | None = None,
) -> UnbalanceControl:
    """Return the tables of unbalance control over the speeds."""
    # It fades out where the orbit would be considerably larger than without it: where the magnets'
    # reaction is the source of damping, as near a critical speed of the free or the held rotor. The
    # ratio is independent of the amount of unbalance.
    check_unbalance(estimator)
    machine = plant.machine
    top = max(abs(machine.speed), abs(max_speed or 0.0))
    first = min(SLOWEST, top / 2) if start is None else start
    if not first < top:
        raise AmbkitError(
            f"unbalance_from: {first:.6g} rad/s is not below the greatest speed, {top:.6g} rad/s"
        )
    way = -1.0 if machine.speed < 0 else 1.0
    speeds = way * np.linspace(first, top, RIGID if machine.bending is None else NODES)
    states = [k for k, state in enumerate(estimator.states) if state.role == "unbalance"]
    usual = [estimator.states[k].size for k in states[::2]]
    amounts = described_unbalance(machine).values()
    sizes = np.array([amount or size for amount, size in zip(amounts, usual, strict=True)])
    rotor = _Rotor(plant, estimator)
    motion, current, larger = [], [], []
    for speed in map(float, speeds):
        moved, needed = rotor.left(speed, unbalance)
        motion.append(_real(np.vstack([moved, 1j * speed * moved])))
        current.append(_real(rotor.ahead(speed)[:, None] * needed))
        plain = rotor.plain(speed, control)
        larger.append((rotor.orbits(moved, sizes) / rotor.orbits(plain, sizes)).max())
    share = _shares(np.array(larger), speeds)
    share[0] = 0.0
    left = share[:, None, None]
    room = np.array(
        [min(isolated.current_max, -isolated.current_min) for isolated in plant.isolated]
    )
    return UnbalanceControl(
        float(speeds[0]), float(speeds[1] - speeds[0]), states[0], left * np.array(motion),
        left * np.array(current), share, plant.H / rotor.travel[:, None], 1 / room,
    )  # fmt: skip


def _shares(larger: Array, speeds: Array) -> Array:
    """Return the share at each speed, by the ratio of the orbits."""
    near = np.maximum(NEIGHBOURHOOD * np.abs(speeds), 1.01 * abs(speeds[1] - speeds[0]))
    worst = [
        larger[np.abs(speeds - speed) <= far].max() for speed, far in zip(speeds, near, strict=True)
    ]
    return np.clip((MOST - np.array(worst)) / (MOST - LEAST), 0.0, 1.0)


def _real(Z: Complex) -> Array:
    """Return the matrix on (x, y) of each plane: Re(Z (x + j y))."""
    return np.stack([Z.real, -Z.imag], axis=-1).reshape(len(Z), -1)


class _Rotor:
    """A rotor with unbalance of 1 kg m at a speed W: ``D(W) q = W^2 push U + give F``."""

    def __init__(self, plant: Plant, estimator: Estimator) -> None:
        machine, isolated, model = plant.machine, plant.isolated, plant.model
        q = len(machine.positions)
        k = [ConstantStiffness.of(item) for item in isolated]
        lines = [
            machine.line(z, turn) for z in unbalance_planes(machine) for turn in (0.0, math.pi / 2)
        ]
        rows = slice(q, 2 * q)
        self.T, self.delay = machine.sampling_time, machine.delay or 0.0
        self.still, self.spin = model.A[rows, : 2 * q], model.spin[rows, : 2 * q]
        self.H, self.give, self.behind = plant.H, model.push[rows], plant.behind
        self.planes = geometry.matrix(lines, machine.positions)
        self.push = (self.planes[::2] - 1j * self.planes[1::2]).T / machine.masses[:, None]
        self.k_i, self.k_s = np.array([[e.k_i] for e in k]), np.array([[e.k_s] for e in k])
        self.travel = np.array([item.clearance for item in isolated])
        self.corners = [item.amplifier.bandwidth for item in isolated]
        self.names = [state.name for state in estimator.states]
        self.currents = [
            (at, estimator.view.axis_of(state), state)
            for at, state in enumerate(estimator.states)
            if state.role in ("current", "past control")
        ]

    def dynamics(self, speed: float) -> Complex:
        """Return D (q, q) of a rotor without magnets."""
        A, q = self.still + speed * self.spin, len(self.still)
        return np.asarray(-(speed**2) * np.eye(q) - A[:, :q] - 1j * speed * A[:, q:])

    def force_response(self, speed: float) -> Complex:
        """Return the accelerations (q, p) per newton of each magnet, rotating at a speed."""
        return np.asarray(self.give * np.array([item.at(speed)[1] for item in self.behind]))

    def left(self, speed: float, unbalance: str) -> tuple[Complex, Complex]:
        """Return the positions (q, planes) of a free or compensated rotor, and its currents."""
        D = self.dynamics(speed)
        moved = np.asarray(np.linalg.solve(D, speed**2 * self.push), complex)
        if unbalance == "force-free":
            return moved, -(self.k_s / self.k_i) * (self.H @ moved)
        give = np.linalg.solve(D, self.force_response(speed))
        held = -np.linalg.lstsq(self.H @ give, self.H @ moved, rcond=None)[0]
        return np.asarray(moved + give @ held, complex), held / self.k_i

    def plain(self, speed: float, control: ControlLaw) -> Complex:
        """Return the positions (q, planes) without unbalance control."""
        # The estimator has unbalance states, so that its mean follows the synchronous motion.
        T, q = self.T, len(self.still)
        kp, ki, kd = np.array([pid[:3] for pid in control.pids_at(speed)]).T[:, :, None]
        of, z = control.feedback, np.exp(1j * speed * T)
        rows = (kp + ki * T / (z - 1)) * of["position"] + kd * of["velocity"]
        rows = -control.spread @ rows
        for power, name in enumerate(("fed_back", "fed_back_by_speed")):
            rows = rows + speed**power * of.get(name, 0.0)
        late, own = 1 / self.ahead(speed), np.eye(len(rows), dtype=complex)
        for at, axis, state in self.currents:  # response to the currents themselves
            past = state.role == "past control"
            own[:, axis] -= rows[:, at] * (
                z ** -int(state.name.rsplit("_", 1)[1]) if past else late[axis]
            )
        seen = rows[:, :q] + 1j * speed * rows[:, q : 2 * q]
        for axis, behind in enumerate(self.behind):
            for name, share in zip(behind.states, behind.at(speed)[0], strict=True):
                by_force = rows[:, self.names.index(name)] * share
                own[:, axis] -= by_force * (self.k_i[axis] * late[axis])
                seen = seen + np.outer(by_force, self.k_s[axis] * self.H[axis])
        demanded = np.linalg.solve(own, seen)
        pull = self.k_s * self.H + self.k_i * late[:, None] * demanded
        D = self.dynamics(speed) - self.force_response(speed) @ pull
        return np.asarray(np.linalg.solve(D, speed**2 * self.push), complex)

    def orbits(self, moved: Complex, sizes: Array) -> Array:
        """Return the orbit: maximum share of a clearance [1], and in the unbalance planes [m]."""
        at_axes, at_planes = (np.abs(rows @ moved) @ sizes for rows in (self.H, self.planes))
        return np.array([(at_axes / self.travel).max(), at_planes.max()])

    def ahead(self, speed: float) -> Complex:
        """Return the lead of the commanded current (p,): lag, dead time, hold."""
        late = np.exp(1j * speed * (self.delay + self.T / 2)) / np.sinc(
            speed * self.T / (2 * math.pi)
        )
        lags = [1.0 if c is None else 1 + 1j * speed / (2 * math.pi * c) for c in self.corners]
        return np.asarray(late * np.array(lags))
