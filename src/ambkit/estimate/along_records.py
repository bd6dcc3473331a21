"""An estimator along a complete record: forwards, smoothed, and predictions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import real
from ambkit.base.errors import RecordError
from ambkit.base.quantity_arguments import of_type
from ambkit.data.record import Record
from ambkit.estimate.angle import AngleEstimate, readings_of
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.stepping import Stepping
from ambkit.machine.machine import Machine


class AlongRecords(Stepping):
    """An estimator along a whole record."""

    inputs: Any
    can_smooth: bool

    def run(self, record: Record, *, covariance: bool = False) -> Estimate:
        """Run along a complete record, starting at its first measurement within the clearance.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V]; u[k] acts from sample k to k + 1. For a machine with
            several axes ``y_NAME`` of each reading and ``u_NAME`` of each axis, and the ``speed``
            of rotation [rad/s] unless it is the machine's; with ``[angle]`` the readings of that
            sensor, see ``estimate_angle``. `ContactKalmanFilter` also uses ``on``, which is 0
            where the magnets have no current until the next sample.
        covariance : bool
            Keep the covariances, 10 numbers a sample.

        Raises
        ------
        RecordError
            The record's sampling time is not that of the machine.
        """
        y, u = self._start(record)
        speed, measured = self._rotation(record)
        how = {"covariance": covariance} | self._supply(record)
        if speed is None:
            history = self.core.run(y, u, **how)
        else:
            turn, of = self.engine.core.run_turning, self.engine.model_of_core
            history = turn(self.core, y, u, speed, of, **how, measured=measured)
        return self._estimated(record.t, self._with_law_error(history, u), self.name)

    def run_raw(self, y: ArrayLike, u: ArrayLike, *, covariance: bool = False) -> Estimate:
        """Run along a rig's own numbers with the bits of the exported C, including the start.

        Parameters
        ----------
        y, u : array_like (n,)
            The controller's inputs, in the units of `inputs`; u[k] acts from sample k to k + 1.
        covariance : bool
            As in `run`.

        Returns
        -------
        Estimate
            In SI, from t = 0.

        Raises
        ------
        ValueError
            The lengths differ.
        """
        position, control = self.in_si(y, u)
        if position.ndim != 1 or position.shape != control.shape:
            raise ValueError(
                f"y and u must be as long as each other, have shapes {position.shape} and "
                f"{control.shape}"
            )
        t = self.machine.sampling_time * np.arange(position.size, dtype=float)
        signals = {"y": position, "u": control}
        return self.run(Record(t, signals, {"y": "m", "u": "V"}), covariance=covariance)

    def in_si(self, y: ArrayLike, u: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
        """Convert the controller's inputs to SI with the bits of the exported C.

        Parameters
        ----------
        y : array_like (n,)
            Positions, in the unit of `inputs`, by default [m].
        u : array_like (n,)
            Control signals, by default [V].

        Returns
        -------
        tuple of ndarray (n,)
            Position [m] and control signal [V], in the precision of the estimator.
        """
        number = np.float32 if self.precision == "float32" else np.float64
        return self.inputs.y.value(y, number), self.inputs.u.value(u, number)

    def smooth(self, record: Record) -> Estimate:
        """Estimate each sample of a record from the complete record.

        Fixed-interval smoother of Rauch, Tung and Striebel (1965), in the form of Bryson and
        Frazier modified by Bierman (1973), which inverts no covariance. Samples that the filter did
        not use are bridged. Where the filter was held or restarted, the recursion restarts.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V]; u[k] acts from sample k to k + 1.

        Returns
        -------
        Estimate
            With covariances. Innovations, stiffnesses and status are the filter's.

        Raises
        ------
        ValueError
            This kind has no covariance for the smoother.
        RecordError
            The record's sampling time is not that of the machine.
        """
        if not self.can_smooth:
            raise ValueError(
                f"{self.name}: cannot be smoothed; the linear, adaptive, extended and UD "
                "Kalman filters can"
            )
        y, u = self._start(record)
        history = self._with_law_error(self.core.smooth(y, u), u, carried=False)
        return self._estimated(record.t, history, f"{self.name}, smoothed")

    def forecast(self, estimate: Estimate, record: Record, ahead: int) -> NDArray[np.float64]:
        """Predict the measurement ``ahead`` samples after each estimate.

        Parameters
        ----------
        estimate : Estimate
            Of this filter along the record, n samples.
        record : Record
            With ``u`` [V].
        ahead : int
            Number of samples ahead.

        Returns
        -------
        ndarray (n - ahead,)
            Element k is the prediction of ``record["y"][k + ahead]`` [m], made from the estimate
            at k and the control signals that acted since.
        """
        mean = np.ascontiguousarray(real("estimate.mean", estimate.mean))
        _, u = self.view.signals(record)
        return self.view.column(np.asarray(self.core.forecast(mean, u, ahead, estimate.scale)))

    def _supply(self, record: Record) -> dict[str, Any]:
        """Return the argument of the core that states where the magnets have current."""
        return {}

    def _start(self, record: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Reset to the first measurement of a record within the clearance; return its y and u."""
        of_type(Record, record=record)
        check_sampling(self.machine, record)
        y, u = self.view.signals(record)
        self.reset(self.initial_state(y))
        return y, u

    def _estimated(
        self, t: NDArray[np.float64], history: dict[str, Any], name: str | None = None
    ) -> Estimate:
        """Wrap the core's results of a record, arrays by name."""
        known: dict[str, Any] = dict(self.view.columns)
        for key in ("mean", "innovation", "k_i", "k_s"):
            known[key] = np.asarray(history[key], float)
        for key in ("covariance", "scale", "scale_variance"):
            known[key] = history.get(key)
        return Estimate(
            t=t, innovation_variance=np.asarray(history["variance"], float),
            status=history["status"], estimator=name or self.name, states=self.states,
            **known,
        )  # fmt: skip

    def _with_law_error(
        self, history: dict[str, Any], u: NDArray[Any], *, carried: bool = True
    ) -> dict[str, Any]:
        """Add the square of the bias by the force law to the covariances of a record."""
        if "covariance" in history and self.law_error.size:
            mean, upper = history["mean"], history["covariance"]
            health = np.asarray(history.get("health", history["status"])).reshape(len(mean), -1)
            acted = np.concatenate([np.zeros_like(u[:1]), u[:-1]])
            bias = self._law_bias(mean, upper, acted, health, carried=carried)
            rows, columns = np.triu_indices(bias.shape[1])
            upper += bias[:, rows] * bias[:, columns]
            self._last_bias, self._steps = (mean[-1], bias[-1]), 0
        return history

    def _rotation(self, record: Record) -> tuple[NDArray[Any] | None, bool]:
        """Return the rotation along a record (None if constant), and whether a sensor gave it."""
        if self.machine.angle is not None and self.view.speed is not None:
            return self.follow_angle(readings_of(self.machine, record)), True
        return self.follow_speed(dict(record.signals).get("speed"), len(record)), False

    def follow_angle(self, readings: ArrayLike) -> NDArray[Any]:
        """Let the model of a machine follow the readings of its angle sensor.

        Parameters
        ----------
        readings : array_like (n,)
            Time since a pulse [s], angle of an encoder [rad], or speed [rad/s], as in
            ``AngleEstimate.of``.

        Returns
        -------
        ndarray (n, 8)
            Information on the rotation at each sample, the fields of ``amb_rotation``
            (``core/include/ambkit/angle.h``) [their SI units].
        """
        angle = AngleEstimate.of(self.machine, readings, precision=self.precision)
        assert self.machine.angle is not None  # else there is no estimate
        self.engine.stand(self.core)  # back to the nominal speed
        self.engine.schedule_speeds(*self.machine.angle.range(self.machine.speed))
        if (synchronous := self.engine.synchronous_states()) is not None:
            std = [float(item) for item in self.default_std()]
            self.engine.model_of_core.synchronous(synchronous | {"std": std})
        self.engine.model_of_core.turn(float(angle.rotation[0, 0]), 0.0)
        return angle.rotation

    def follow_speed(self, speed: NDArray[np.float64] | None, n: int) -> NDArray[Any] | None:
        """Let the model of a machine follow the speed of its rotor.

        Parameters
        ----------
        speed : ndarray (n,), optional
            Speed of rotation at the samples [rad/s]; by default the machine's.
        n : int
            Samples.

        Returns
        -------
        ndarray (n,) or None
            The speed used [rad/s]; None if it is the machine's.
        """
        own = self.view.speed
        if own is None:
            return None
        speeds = np.full(n, own) if speed is None else np.asarray(speed, float)
        self.engine.stand(self.core)  # back to the nominal speed
        if bool((speeds == own).all()):
            return None
        self.engine.schedule_speeds(float(speeds.min()), float(speeds.max()))
        self.engine.model_of_core.turn(float(speeds[0]), 0.0)
        return np.ascontiguousarray(speeds, self.precision)


def check_sampling(machine: Machine, record: Record) -> None:
    """Reject a record with a sampling time other than the machine's."""
    if len(record.t) < 2:
        return
    T = float(record.t[-1] - record.t[0]) / (len(record.t) - 1)
    if abs(T - machine.sampling_time) > 1e-3 * machine.sampling_time:
        raise RecordError(
            f"the record is sampled every {T:.6g} s, but {machine.name!r} has "
            f"sampling_time = {machine.sampling_time:.6g} s"
        )
