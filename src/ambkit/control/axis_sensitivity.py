"""Sensitivity peaks of a machine's axes, for many controllers of the same plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine import geometry
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time
from ambkit.models.linear import LinearSystem

TOP = 2000.0  #: Maximum frequency [Hz], or half the sampling rate.

POINTS, NEAR, WITHIN = 200, 21, 0.06
"""Points of the frequency grid, around each oscillatory mode, and the range of its shift."""

UNDAMPED = 1e-9
"""Damping ratio of a mode below which its own frequency is left out: S is zero there."""


class Sensitivities:
    """Loops of a machine, each axis with its own PID and all others closed."""

    def __init__(self, machine: Machine, *, estimated: bool) -> None:
        point = OperatingPoint.of_machine(machine)
        P = plant(machine, point)
        p, m = len(machine.axes), len(machine.readings)
        f = _frequencies(machine, P)
        self.T, self.z = machine.sampling_time, np.exp(2j * np.pi * f * machine.sampling_time)
        self.volts = np.array([1 / b.amplifier.gain for b in isolated_axes(machine)])
        self.shown = shown_along_axes(machine)
        self.added = np.linalg.pinv(self.shown)
        self.plant = P.response(f)[:, :m, :p]
        self.seen = self.shown @ self.plant
        self.estimator: tuple[Complex, Complex] | None = None
        if estimated:
            E = estimator_at(KalmanFilter(machine), point).response(f)
            self.estimator = E[:, :, :m], E[:, :, m:]

    def peaks(self, pids: Sequence[Any]) -> Array:
        """Return the peak of abs(S) of each axis (p,) [1], for stable and unstable loops."""
        # The controllers' response is evaluated directly, not in states as in `controller`, because
        # there are hundreds of them.
        gains = [(pid.kp, pid.ki, pid.kd, pid.derivative_filter) for pid in pids]
        kp, ki, kd, T_f = np.array(gains).T
        z, T, p = self.z[:, None], self.T, len(pids)
        x, v = self.volts * (kp + ki * T / (z - 1)), self.volts * kd
        if self.estimator is None:
            share = 1 / (T_f + T)
            slope = share * (1 - 1 / z) / (1 - (1 - T * share) / z)
            L = self.seen * (x + v * slope)[:, None, :]
            S = np.linalg.inv(np.eye(p) + L)
        else:
            of_y, of_u = self.estimator
            by_u, by_y = (x[:, :, None] * E[:, :p] + v[:, None] * E[:, p:] for E in (of_u, of_y))
            fed = np.linalg.solve(np.eye(p) + by_u, by_y)
            m = self.plant.shape[1]
            S = self.shown @ np.linalg.inv(np.eye(m) + self.plant @ fed) @ self.added
        return np.asarray(np.abs(np.einsum("kii->ki", S)).max(axis=0))


def sensitivities(machine: Machine, *, estimated: bool) -> Sensitivities | None:
    """Loops of a machine; None if nothing holds it at the centre, or no filter is possible."""
    try:
        return Sensitivities(machine, estimated=estimated)
    except (AmbkitError, ValueError):
        return None


def shown_along_axes(machine: Machine) -> Array:
    """Return the displacements along the axes (p, m), by the readings."""
    # From the rigid-body motion that fits all readings best.
    positions = machine.rigid_coordinates
    H = geometry.matrix([axis.line for axis in machine.axes], positions)
    C = geometry.matrix([r.line for r in machine.readings], positions)
    gains = np.array([r.sensor.gain for r in machine.readings])
    return np.asarray(H @ np.linalg.pinv(gains[:, None] * C))


def _frequencies(machine: Machine, P: LinearSystem) -> Array:
    top = min(TOP, 0.5 / machine.sampling_time)
    min_frequency = 1 / (40 * math.pi * max(own_time(b) for b in isolated_axes(machine)))
    swings = np.log(P.poles()[np.abs(P.poles()) > 1e-6]) / machine.sampling_time
    swings = swings[np.abs(swings.real) < WITHIN * swings.imag]
    near = np.linspace(-1, 1, NEAR)
    about = [one.imag * (1 + WITHIN * near) for one in swings]
    about += [one.imag + 3 * abs(one.real) * near for one in swings]
    f = np.concatenate([
        np.geomspace(min(min_frequency, top / 2), top, POINTS),
        np.concatenate([np.zeros(0), *about]) / (2 * math.pi),
    ])  # fmt: skip
    undamped = swings.imag[np.abs(swings.real) < UNDAMPED * swings.imag] / (2 * math.pi)
    apart = (np.abs(f[:, None] - undamped) > UNDAMPED * f[:, None]).all(axis=1)
    return np.unique(f[(f > 0) & (f <= top) & apart])
