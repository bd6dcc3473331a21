"""Linear-quadratic regulator of a machine, by an estimator's states."""

from collections.abc import Sequence

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import LinearModel
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.linear import pulse_sizes
from ambkit.models.plant import Plant

REGULATED = (
    "position", "velocity", "bending", "bending velocity", "current", "past control",
    "lagged force",
)  # fmt: skip
"""Roles of the controllable states."""

SHARE = 0.2  #: Share of an axis's current for a deflection of a tenth of its clearance.
#: Candidates for the middle node of the gain schedule, over the machine's speed.
MIDDLES = (0.5, 0.6, 0.7)
#: Speeds between the nodes at which gains are evaluated, over the machine's speed.
BETWEEN = (0.15, 0.3, 0.45, 0.6, 0.8, 0.9)


def regulator(plant: Plant, estimator: Estimator) -> tuple[Array, Array]:
    """Return the feedback (p, n) of an estimator's states, and (p, p) of the axes' references."""
    # The currents are ``iu = -K x + F r`` [A]. Minimised is the mean of the squared deflections in
    # tenths of the clearance and of the currents in a share of their limits (Bryson and Ho 1975).
    # The static part of the estimated disturbances is cancelled, and references are tracked.
    from scipy.linalg import solve_discrete_are

    isolated, along = plant.isolated, estimator.view.along_axes(estimator.states)[0]
    model, own, A, B = _regulated(isolated, estimator)
    roles = [state.role for state in estimator.states]
    loads = [at for at, role in enumerate(roles) if role == "disturbance force"]
    n, p = len(own), len(isolated)
    C = along[:, own]
    travel = np.array([item.clearance for item in isolated])
    limit = np.array([min(abs(item.current_min), item.current_max) for item in isolated])
    weight = np.diag(1 / (SHARE * limit) ** 2)
    seen = C / (0.1 * travel)[:, None]
    # States are scaled by the response to the currents, otherwise digits are lost.
    size = pulse_sizes(A, B * limit)
    scaled, moved = A * size / size[:, None], B / size[:, None]
    try:
        P = solve_discrete_are(scaled, moved, (seen * size).T @ (seen * size), weight)
    except np.linalg.LinAlgError:
        raise AmbkitError(
            f"{estimator.machine.name}: there is no regulator of this machine"
        ) from None
    K_own = np.linalg.solve(weight + moved.T @ P @ moved, moved.T @ P @ scaled)
    # Static: x = A x + B u + E f with C x = r; minimum currents if there are more axes than
    # coordinates.
    E = model.A[np.ix_(own, loads)] / size[:, None]
    rest = np.block([[np.eye(n) - scaled, -moved], [C * size, np.zeros((p, p))]])
    targets = np.block([[E, np.zeros((n, p))], [np.zeros((p, len(loads))), np.eye(p)]])
    result = np.linalg.lstsq(rest, targets, rcond=1e-12)[0]
    ahead = K_own @ result[:n] + result[n:]
    K = np.zeros((p, len(roles)))
    K[:, own] = K_own / size
    K[:, loads] = -ahead[:, : len(loads)]
    return K, ahead[:, len(loads) :]


def scheduled(plant: Plant, estimator: Estimator) -> tuple[dict[str, Array], Array]:
    """Return feedback scheduled over the speed, and (p, p) of the references."""
    # At the speed W it is K_0 + W K_1 + W^2 K_2, equal to that of `regulator` at standstill, at the
    # machine's speed, and at the one of `MIDDLES` with the largest damping in between. Gyroscopic
    # terms are proportional to W; even powers act within a plane, odd ones across. The references'
    # gains are those at the machine's speed.
    machine, names = plant.machine, [state.name for state in estimator.states]
    filters = {
        share: KalmanFilter(machine.model_copy(update={"speed": share * machine.speed}))
        for share in {0.0, 1.0, *MIDDLES, *BETWEEN}
    }
    known = {share: regulator(plant, filters[share])[0] for share in (0.0, *MIDDLES, 1.0)}
    models = {share: _regulated(plant.isolated, filters[share]) for share in BETWEEN}

    def through(middle: float) -> Array:
        """Return the coefficients of the gains (3, p, n) through three nodes."""
        nodes = (0.0, middle, 1.0)
        powers = np.linalg.inv(np.vander(nodes, increasing=True))
        return np.tensordot(powers, [known[node] for node in nodes], axes=1)

    def radius(result: Array) -> float:
        """Return the largest spectral radius of the regulated model between the nodes."""
        parts = (
            A - B @ np.tensordot([1.0, share, share**2], result, axes=1)[:, own]
            for share, (_, own, A, B) in models.items()
        )
        return max(float(np.abs(np.linalg.eigvals(closed)).max()) for closed in parts)

    best = min(map(through, MIDDLES), key=radius)
    gains = np.zeros((3, best.shape[1], len(names)))
    gains[:, :, [names.index(state.name) for state in filters[1.0].states]] = best
    keys = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
    feedback = {key: -gains[k] / machine.speed**k for k, key in enumerate(keys)}
    return feedback, regulator(plant, estimator)[1]


def _regulated(
    isolated: Sequence[Machine], estimator: Estimator
) -> tuple[LinearModel, list[int], Array, Array]:
    """Return an estimator's model, which of its states are regulated, and A and B [A] of these."""
    k = [ConstantStiffness.of(item) for item in isolated]
    model = estimator.linear_model(np.array([e.k_i for e in k]), np.array([e.k_s for e in k]))
    own = [at for at, state in enumerate(estimator.states) if state.role in REGULATED]
    volts = np.array([item.amplifier.gain for item in isolated])
    return model, own, model.A[np.ix_(own, own)], model.B[own] / volts
