"""What a network is to learn: samples of force and stiffnesses, and its own answers there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.network import network
from ambkit.machine.magnets import core_module
from ambkit.machine.stiffness import StiffnessMap


class Outputs(NamedTuple):
    """Answers of a network at n samples; the first axis is the output, k_i [N/A] or k_s [N/m]."""

    value: Array  #: (2, n) k_i and k_s.
    #: (2, n, rules) Their derivatives with respect to ln(width) and weight of each rule.
    by_log_width: Array
    by_weight: Array


class Network:
    """A network asked at fixed points, with its derivatives; its widths and weights change."""

    # inputs (2, n) Control current [A] and displacement [m].

    def __init__(self, start: Expert, inputs: Array) -> None:
        self.start, self.inputs = start, inputs
        offset = inputs[:, :, np.newaxis] - start.centres[:, np.newaxis, :]
        scale = np.array([start.per_ampere, start.per_metre])
        self._square_distance = np.einsum("inr,i->nr", offset**2, scale**2)

    def outputs(self, log_widths: Array, weights: Array) -> Outputs:
        """Evaluate eq. 32-33 with ln(width) and weights (2, rules)."""
        start = self.start
        net = network(
            core_module(),
            centres=start.centres,
            widths=np.exp(log_widths),
            weights=weights,
            scale=(start.per_ampere, start.per_metre),
            box=(*start.current_range, *start.displacement_range),
            normalised=start.normalised,
        )
        u = np.stack([net.basis(of_k_s, *self.inputs) for of_k_s in (False, True)])
        value = np.einsum("onr,or->on", u, weights)
        # d u / d ln(sigma) = u d^2 / sigma^2; the sum in the denominator takes the mean off w.
        mean = value[:, :, np.newaxis] if start.normalised else 0.0
        squares = self._square_distance * np.exp(-2 * log_widths)[:, np.newaxis, :]
        return Outputs(value, u * squares * (weights[:, np.newaxis, :] - mean), u)


class TrainingSet:
    """Samples all over the box of a stiffness map, edges included."""

    # inputs (2, n) Control current [A] and displacement [m].
    # force (n,) Force relative to ``F(0, 0)`` [N].
    # stiffness (2, n) k_i [N/A] and k_s [N/m] of the LSM machine.

    def __init__(self, stiff: StiffnessMap, start: Expert, samples: int) -> None:
        iu, x = np.meshgrid(
            np.linspace(*start.current_range, samples),
            np.linspace(*start.displacement_range, samples),
        )
        self.start = start
        self.inputs = np.stack([iu.ravel(), x.ravel()])
        self.stiffness = np.stack(stiff.stiffness_at(*self.inputs))
        self.force = np.asarray(stiff.force(*self.inputs)) - stiff.force_bias
        if not np.any(self.force):
            raise AmbkitError(f"{stiff.name}: the force is the same all over the box")
        self.outputs = Network(start, self.inputs).outputs

    def errors(self, value: Array) -> tuple[float, float, float]:
        """RMS errors of answers (2, n): of the force [N], of k_i [N/A], of k_s [N/m]."""
        k_i, k_s = value - self.stiffness
        return rms(np.sum(value * self.inputs, axis=0) - self.force), rms(k_i), rms(k_s)


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
