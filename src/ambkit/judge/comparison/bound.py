"""The posterior Cramer-Rao bound: the least error of any estimator.

The recursion of Tichavsky, Muravchik and Nehorai (1998) needs the inverse of the process noise,
which is singular here. The density is therefore written in the initial state and the unit noises,
and the inequality of van Trees (1968) holds for any estimate of x_k from y_0 ... y_k::

    E[(x^ - x)(x^ - x)'] >= E[D_k] J_k^-1 E[D_k]',    J_k = J_0 + sum_j E[D_j' H' R^-1 H D_j]

with the derivative D_j of x_j with respect to initial state and noises along a true run, their
prior information J_0, and the mean E over simulated runs. J_k is not computed explicitly: the runs
form one linear system, driven by the same noises, each measured with the variance `runs` R. The
Kalman filter of the stacked derivatives has the information J_k, and the covariance of their mean
is the bound.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.threads import one_thread
from ambkit.data.record import Record
from ambkit.data.signals import displacement, signal
from ambkit.estimate.machine_model import View, several
from ambkit.estimate.noise_model import Variances
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.models import machine_model
from ambkit.models.model import Model


def posterior_bound(
    transition: ArrayLike,
    noise_input: ArrayLike,
    output: ArrayLike,
    measurement: ArrayLike,
    prior: ArrayLike,
) -> Array:
    """Bound on the covariance of any estimate after each measurement."""
    # transition (runs, samples - 1, n, n); noise_input (runs, samples - 1, n, q); output (m, n);
    # measurement (m,), variances; prior (n, n); returns (samples, n, n)
    F, G = np.asarray(transition, dtype=float), np.asarray(noise_input, dtype=float)
    runs, steps, n, _ = F.shape
    H = np.atleast_2d(np.asarray(output, dtype=float))
    # A factor L of the stacked covariance P = L L': runs differ where P is zero at first and the
    # plant unstable, and a rounded P with a slightly negative eigenvalue grows without limit.
    start = np.linalg.cholesky(np.asarray(prior, dtype=float))
    L = np.tile(start, (runs, 1, 1))
    R = np.broadcast_to(np.asarray(measurement, dtype=float), len(H))
    noise = np.diag(np.tile(np.sqrt(runs * R), runs))
    read = len(noise)
    bound = np.empty((steps + 1, n, n))
    for k in range(steps + 1):
        if k > 0:
            L = np.concatenate([F[:, k - 1] @ L, G[:, k - 1]], axis=2)
        # Array form of prediction and measurement (Kailath, Sayed and Hassibi 2000, section 12.1).
        wide = np.zeros((read + L.shape[2], read + runs * n))
        wide[:read, :read] = noise
        wide[read:, :read] = np.einsum("mi,aij->jam", H, L).reshape(-1, read)
        wide[read:, read:] = L.reshape(runs * n, -1).T
        left = np.asarray(np.linalg.qr(wide, mode="r"))[read:, read:]
        L = left.T.reshape(runs, n, -1)
        mean = L.mean(axis=0)
        bound[k] = mean @ mean.T
    return bound


@one_thread()
def bearing_bound(
    machine: Machine,
    records: Sequence[Record],
    variances: Variances,
    std: Sequence[float],
    rows: Array | None = None,
) -> Array:
    """Bound for a machine whose truth follows the filters' model."""
    # That is: the magnets' force laws, white noise on control signals and measurements, and
    # disturbance forces that are random walks, all with the given variances, and further states of
    # the model, such as coloured noise, as the machine defines them. rows (quantities, n), of the
    # states; by default each state returns (samples, quantities)
    model, unit = machine_model(machine), np.asarray(std)
    F, G = zip(*(_along(model, machine, record, variances) for record in records), strict=True)
    # Scaled, so that no entry is 1e12 times another.
    scaled_F = np.asarray(F) * (unit / unit[:, None])
    scaled_G = np.asarray(G) / unit[:, None]
    scaled_C = model.c * unit
    size = np.abs(scaled_C).max(axis=1)
    scaled_R = np.array(several(variances.measurement)) / size**2
    result = posterior_bound(
        scaled_F, scaled_G, scaled_C / size[:, None], scaled_R, np.eye(unit.size)
    )
    W = np.diag(unit) if rows is None else rows * unit
    return np.asarray(np.sqrt(np.einsum("qi,kij,qj->kq", W, result, W)))


def _along(
    model: Model, machine: Machine, record: Record, variances: Variances
) -> tuple[Array, Array]:
    """F (samples - 1, n, n) and G (samples - 1, n, p + n) of one run, forces held over a sample."""
    view, names = View(machine), machine.axis_names
    F = np.tile(model.L, (len(record) - 1, 1, 1))
    doors = []
    controls = several(variances.control)
    for k, (of, name) in enumerate(zip(view.isolated, names, strict=True)):
        iu, s = record[signal("iu", name)], record[displacement(name)]
        k_i, k_s = (item[:, None] for item in magnet_of(of).tangent(iu[:-1], s[:-1]))
        rows = k_s * model.h[k] + k_i * model.e[k] + model.r[k]
        F = F + model.b[:, k][:, None] * rows[:, None, :]
        scale = of.amplifier.gain * np.sqrt(controls[k])
        doors.append(scale * (model.B_u[:, k] + k_i * model.d[k, k] * model.b[:, k]))
    intensities = view.growth(variances, model.noises)
    walked = _root(np.tensordot(intensities, model.N, 1))
    G = np.concatenate([np.stack(doors, axis=2), np.tile(walked, (len(F), 1, 1))], axis=2)
    return F, G


def _root(Q: Array) -> Array:
    """A factor of a covariance that may be singular (n, n), Q = R R'."""
    std = np.sqrt(np.diag(Q))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(Q / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
