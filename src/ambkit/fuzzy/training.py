"""Training of the expert system: steepest gradient as in the paper, and least squares.

Targets of the training, at samples over the complete box:

- the force, ``k_i iu + k_s x``;
- k_i and k_s of the LSM machine. The force alone does not determine both: they can compensate each
other, and are then useless for a Kalman filter.

The paper trains on the second, each output separately. Least squares here trains on both.
"""

import pickle
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, rms
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.fuzzy.expert import Expert, Method, Training
from ambkit.fuzzy.network import Scaling, network
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.machine.stiffness import StiffnessMap, stiffness_map


class Outputs(NamedTuple):
    """Outputs of a network at n samples; the first axis is k_i [N/A] or k_s [N/m]."""

    value: Array  #: (2, n) k_i and k_s.
    #: (2, n, rules) Their derivatives with respect to ln(width) and weight of each rule.
    by_log_width: Array
    by_weight: Array


class TrainingSet:
    """Samples over the range of a stiffness map, and a network's outputs there."""

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
        offset = self.inputs[:, :, np.newaxis] - start.centres[:, np.newaxis, :]
        scale = np.array([start.per_ampere, start.per_metre])
        self._square_distance = np.einsum("inr,i->nr", offset**2, scale**2)

    def outputs(self, log_widths: Array, weights: Array) -> Outputs:
        """Evaluate eq. 32-33 with ln(width) and weights (2, rules)."""
        start = self.start
        net = network(core_module(), start, np.exp(log_widths), weights)
        u = np.stack([net.basis(of_k_s, *self.inputs) for of_k_s in (False, True)])
        value = np.einsum("onr,or->on", u, weights)
        # d u / d ln(sigma) = u d^2 / sigma^2; the denominator's sum subtracts the mean of w.
        mean = value[:, :, np.newaxis] if start.normalised else 0.0
        squares = self._square_distance * np.exp(-2 * log_widths)[:, np.newaxis, :]
        return Outputs(value, u * squares * (weights[:, np.newaxis, :] - mean), u)

    def errors(self, value: Array) -> tuple[float, float, float]:
        """RMS errors of outputs (2, n): of the force [N], of k_i [N/A], of k_s [N/m]."""
        k_i, k_s = value - self.stiffness
        return rms(np.sum(value * self.inputs, axis=0) - self.force), rms(k_i), rms(k_s)


# Weight of an error of k_i or k_s, relative to an equal error of the force: both stay close to
# those of the LSM, and the force remains the objective.
STIFFNESS_SHARE = 0.3
# Cost of an e-fold change of a width, or of a weight by the largest weight, relative to an error of
# the complete force. Without it the minimum is a flat valley in which widths tend to zero and
# weights to hundreds of times the stiffness, with cancellation, which single precision cannot
# represent.
WIDTH_COST, WEIGHT_COST = 1e-3, 3e-3


def train(
    source: StiffnessMap | Machine,
    *,
    method: Method = "least-squares",
    weights: bool = False,
    normalised: bool = True,
    scaling: Scaling = "grid",
    widths: ArrayLike | None = None,
    epochs: int | None = None,
    learning_rate: float = 1.0,
    samples: int = 21,
) -> Expert:
    """Train a network with one rule at each node of a stiffness map (paper, section D)."""
    # The result is deterministic: all rules start equal.
    of_type(Machine, StiffnessMap, source=source)
    if method not in ("least-squares", "steepest-gradient"):
        raise AmbkitError(f'method must be "least-squares" or "steepest-gradient", is {method!r}')
    if weights and method == "steepest-gradient":
        raise AmbkitError("weights = True needs the method least-squares")
    if epochs is None:
        epochs = 200 if method == "least-squares" else 1000
    for name, count, least in (("epochs", epochs, 1), ("samples", samples, 2)):
        if count < least:
            raise AmbkitError(f"{name} must be {least} or more, is {count}")
    if not (np.isfinite(learning_rate) and learning_rate > 0):
        raise AmbkitError(f"learning_rate must be greater than 0, is {learning_rate!r}")
    stiff = source if isinstance(source, StiffnessMap) else stiffness_map(source)
    start = Expert.from_map(stiff, widths=widths, normalised=normalised, scaling=scaling)
    data = TrainingSet(stiff, start, samples)
    if method == "least-squares":
        result = _least_squares(pickle.dumps((data, weights, epochs)))
    else:
        result = _steepest_gradient(data, epochs, learning_rate)
    force_rms, k_i_rms, k_s_rms = np.array(result.curve).T.tolist()
    return Expert.from_map(
        stiff,
        widths=np.exp(result.log_widths),
        weights=result.weights,
        normalised=normalised,
        scaling=scaling,
        training=Training(
            method=method, weights=weights, force_rms=force_rms, k_i_rms=k_i_rms, k_s_rms=k_s_rms
        ),
    )


class _Trained(NamedTuple):
    """Parameters (2, rules), and RMS errors of force, k_i and k_s over the steps."""

    log_widths: Array
    weights: Array
    curve: list[tuple[float, float, float]]


class LeastSquares:
    """Residuals of a network and their Jacobian, as functions of a vector of changes."""

    # The vector contains the changes of ln(width) and, if they are trained, of the weights, in
    # units of the output's largest; each (2, rules). The residuals are relative to the RMS of the
    # force, independent of units and the size of the machine.

    def __init__(self, data: TrainingSet, weights: bool) -> None:
        self.data = data
        self.log_widths, self.weights = np.log(data.start.widths), data.start.weights
        self.curve: list[tuple[float, float, float]] = []
        largest = np.max(np.abs(self.weights), axis=1, keepdims=True)
        self._weight_unit = np.where(largest > 0, largest, 1.0)
        costs = (WIDTH_COST, WEIGHT_COST) if weights else (WIDTH_COST,)
        self._cost = np.repeat(costs, self.weights.size)
        self._per_newton = 1 / (rms(data.force) * np.sqrt(data.force.size))
        # An error of k_i or k_s in newtons: times the RMS current or displacement.
        self._own = STIFFNESS_SHARE * np.sqrt(np.mean(data.inputs**2, axis=1))
        self._latest: tuple[bytes, Outputs] | None = None

    def start(self) -> Array:
        """Return the zero vector."""
        return np.zeros(self._cost.size)

    def parameters(self, change: Array) -> tuple[Array, Array]:
        """Return ln(width) and weights, each (2, rules)."""
        log_widths, *weights = change.reshape(-1, *self.weights.shape)
        return self.log_widths + log_widths, self.weights + sum(weights) * self._weight_unit

    def residuals(self, change: Array) -> Array:
        """Errors of force, k_i and k_s at the n samples, and the cost of change: (3 n + size,)."""
        data, value = self.data, self._outputs(change).value
        force = np.sum(value * data.inputs, axis=0) - data.force
        own = self._own[:, np.newaxis] * (value - data.stiffness)
        return np.concatenate([self._per_newton * np.r_[force, own.ravel()], self._cost * change])

    def jacobian(self, change: Array) -> Array:
        """Return the derivatives of the residuals (3 n + size, size); records the errors."""
        outputs, inputs = self._outputs(change), self.data.inputs
        self.curve.append(self.data.errors(outputs.value))
        # Axes: kind of parameter, output o, sample n, rule r.
        slopes = np.stack(
            [outputs.by_log_width, outputs.by_weight * self._weight_unit[:, np.newaxis]]
        )[: change.size // self.weights.size]
        force = np.einsum("konr,on->nkor", slopes, inputs)
        own = np.einsum("konr,o,po->pnkor", slopes, self._own, np.eye(2))
        samples = np.concatenate([force.reshape(-1, change.size), own.reshape(-1, change.size)])
        return np.concatenate([self._per_newton * samples, np.diag(self._cost)])

    def _outputs(self, change: Array) -> Outputs:
        """Evaluate the network once for residuals and Jacobian at a point."""
        key = change.tobytes()
        if self._latest is None or self._latest[0] != key:
            self._latest = key, self.data.outputs(*self.parameters(change))
        return self._latest[1]


@lru_cache(maxsize=64)
def _least_squares(task: bytes) -> _Trained:
    """Minimise by Levenberg and Marquardt's method (Moré 1978) until convergence."""
    # Cached: a network is compared with others and then trained.
    from scipy.optimize import least_squares

    data, weights, epochs = pickle.loads(task)
    problem = LeastSquares(data, weights)
    # MINPACK's own QR: for 100 parameters the threads of a BLAS do not pay.
    solution = least_squares(
        problem.residuals,
        problem.start(),
        jac=problem.jacobian,
        method="lm",
        max_nfev=epochs,
        ftol=1e-6,
        xtol=1e-8,
    )
    result = problem.parameters(solution.x)
    for array in result:
        array.setflags(write=False)
    return _Trained(*result, [*problem.curve, data.errors(data.outputs(*result).value)])


def _steepest_gradient(data: TrainingSet, epochs: int, learning_rate: float) -> _Trained:
    """Widths by gradient descent of each output's mean square error (paper, after eq. 33)."""
    log_widths, weights = np.log(data.start.widths), data.start.weights
    mean_square = np.mean(data.stiffness**2, axis=1)
    value = data.outputs(log_widths, weights).value
    rate = np.full(2, learning_rate)
    least = np.full(2, np.inf)
    descent = np.zeros_like(log_widths)
    curve = []
    for _ in range(epochs + 1):
        trial = log_widths + rate[:, np.newaxis] * descent
        outputs = data.outputs(trial, weights)
        error = outputs.value - data.stiffness
        square = np.mean(error**2, axis=1) / mean_square
        gradient = 2 * np.einsum("on,onr->or", error, outputs.by_log_width) / error.shape[1]
        # The outputs are trained in parallel, each with its own step size.
        helped = square < least
        log_widths[helped], least[helped] = trial[helped], square[helped]
        descent[helped] = -(gradient / mean_square[:, np.newaxis])[helped]
        rate *= np.where(helped, 1.05, 0.5)
        value[helped] = outputs.value[helped]
        curve.append(data.errors(value))
    return _Trained(log_widths, weights, curve)
