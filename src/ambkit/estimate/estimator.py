"""What all estimators have in common."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base import late_binding
from ambkit.base.arrays import real
from ambkit.base.errors import RecordError
from ambkit.base.pickling import Copyable
from ambkit.base.quantity_arguments import of_type
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.data.record import Record
from ambkit.estimate.angle import AngleEstimate, readings_of
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimate import Estimate, Status, packed
from ambkit.estimate.law_error import law_errors
from ambkit.estimate.linear_model import LinearModel
from ambkit.estimate.machine_model import View
from ambkit.estimate.noise_model import FilterNoise
from ambkit.machine.force_laws import bank_of, constants_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision
from ambkit.models.declaration import Part
from ambkit.models.linear import LinearSystem
from ambkit.models.machine_parts import machine_parts
from ambkit.models.model import Descriptor, Model
from ambkit.result.showing import Described

if TYPE_CHECKING:
    from ambkit._core import Magnet
    from ambkit.result.card import Card


class Estimator(Described, Copyable):
    """An estimator of any kind: the same inputs, the same outputs, one interface in C.

    Each kind says in `_build` which of the core's it is (``core/include/ambkit/estimator.h``).

    Parameters
    ----------
    machine : Machine
        What is filtered: one axis, or a machine with all its axes and readings.
    magnet : optional
        What the filter knows of its magnet; by default the constant stiffnesses of the origin. Of a
        machine one for each axis.
    noise : FilterNoise, optional
        Variances; by default those of the bearing.
    gravity : {"known", "disturbance"}
        ``"known"``: the weight is part of the model, and ``f_d`` is the disturbance alone.
        ``"disturbance"``: as eq. 15-16 of the paper, where weight is left out and lands in F_St.
    precision : {"float64", "float32"}
        Which build of the C core computes; float32 is what flies on a Cortex-M4F.
    frozen_limit : int
        Least number of equal measurements in a row that can be a frozen sensor; they must also be
        improbable by the prediction and the sensor's quantisation. 0: never.
    gate : float
        Innovations beyond this many of their standard deviations are outliers.
    outlier_limit : int
        Outliers in a row that are left out; after them the estimate is wrong and not the
        measurement, from which the filter starts afresh. 0: none is, and it never does.
    as_printed : bool
        Predict by eq. 19 as the paper prints it, with the position held over the sample in the
        sensor's lag. That puts every estimate ahead of the rotor by
        ``T/(1 - exp(-T/T_sen)) - T_sen``: to reproduce the paper only.
    synchronous : sequence of str
        Of a machine, what turns with its rotor at its speed and is estimated too:
        ``"unbalance"``, forces in two planes, and ``"runout"`` of each sensor. At a constant speed
        the two cannot be told apart, and the stated errors of both are those at the start; the slow
        disturbance force is free of them.

    Raises
    ------
    ValueError
        Where a variance is negative or not finite, with its name, limit and value.
    """

    name = "estimator"
    description = ""
    """What it is for, as its file says."""
    start_std: Mapping[str, float] = MappingProxyType({})
    """Standard deviations at the start that are not the usual ones, by the names of states."""
    origin: Mapping[str, str] = MappingProxyType({})
    """Where a number came from, by its key in a filter's file."""
    _of_core: tuple[str, ...] = ("core", "engine", "_core_step", "_live_mean")
    estimates_noise = True  # whether sensor noise with a memory is among its states
    side_by_side = True  # whether runs side by side can share it
    several_axes = True  # whether it takes a machine
    by_model = True  # whether it predicts by the machine's model
    predicts = "force held, all else exact"  # from a sample to the next, for the export's README
    smooths = False  # whether mean and covariance follow the model that the smoother goes back by
    #: What its steady-state gain follows from: a Riccati equation with the stiffnesses through the
    #: origin, or with the tangents; or the gain is constant. None: it has no steady state.
    steady: Literal["through_origin", "tangent", "constant"] | None = None

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | Sequence[MagnetModel] | None = None,
        *,
        noise: FilterNoise | None = None,
        gravity: Literal["known", "disturbance"] = "known",
        precision: Precision = "float64",
        frozen_limit: int = 10,
        gate: float = 8.0,
        outlier_limit: int = 3,
        as_printed: bool = False,
        synchronous: Sequence[str] = (),
    ) -> None:
        of_type(Machine, machine=machine)
        if not self.takes(machine):
            names = ", ".join(axis.name for axis in machine.axes)
            raise ValueError(f"{self.name} takes one axis; {machine.name} has the axes {names}")
        if gravity not in ("known", "disturbance"):
            raise ValueError(f"gravity must be 'known' or 'disturbance', got {gravity!r}")
        for limit, value in (("frozen_limit", frozen_limit), ("outlier_limit", outlier_limit)):
            if value < 0:
                raise ValueError(f"{limit} must be 0 or more, got {value}")
        if not (math.isfinite(gate) and gate > 0):
            raise ValueError(f"gate must be greater than 0 standard deviations, got {gate!r}")
        noise = noise or FilterNoise()
        of_type(FilterNoise, noise=noise)
        self.machine: Any = machine
        self.view = View(machine)
        self.magnet = constants_of(machine) if magnet is None else bank_of(magnet, machine)
        self.precision = precision
        self.engine = Engine(
            machine, precision, as_printed=as_printed, noise=self.estimates_noise,
            synchronous=synchronous, parts=self._parts,
        )  # fmt: skip
        self.variances: Any = self.view.variances(noise)
        forces = self.view.known_forces(self.magnet, weight=gravity == "known")
        noise_settings = self.view.settings(self.variances, self.states, self.engine.noises)
        settings = noise_settings | {
            "f_0": forces,
            "gate": gate,
            "frozen_limit": frozen_limit,
            "outlier_limit": outlier_limit,
        }
        self._settings = settings
        held = self.magnet.in_core(self.engine.core)
        self.core: Any = self._build(self.engine, held, settings)
        self.reset()

    @classmethod
    def takes(cls, machine: Machine) -> bool:
        """Whether it can be of a machine: of any, or of one with a single axis.

        Parameters
        ----------
        machine : Machine
            The machine.
        """
        return cls.several_axes or machine.single

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.machine.name}>"

    def _card(self) -> Card:
        from ambkit.result.card import Card

        rows = [(state.name, state.role, state.unit) for state in self.states]
        title = f"{type(self).__name__} of {self.machine.name}"
        return Card(title, rows, None, ["state", "role", "unit"])

    @property
    def nominal(self) -> Estimator:
        """The filter with the noise that it starts from; the inner one where noise is found."""
        return self

    @cached_property
    def inputs(self) -> Inputs:
        """What the controller reads; the exported C takes its inputs so. It may be set."""
        return Inputs(u=Scaling(unit=self.machine.control_unit))

    @property
    def options(self) -> Mapping[str, Any]:
        """What it was made with beside machine, magnet, noise and precision."""
        apart = ("machine", "magnet", "noise", "precision")
        return {name: value for name, value in self._made[1].items() if name not in apart}

    def for_machine(self, machine: Machine) -> Self:
        """Return the same filter of a machine with the same axes, such as at another speed.

        Parameters
        ----------
        machine : Machine
            The other machine.
        """
        args, options = self._made
        if args:
            return type(self)(machine, *args[1:], **options)
        return type(self)(**options | {"machine": machine})

    @staticmethod
    def load(path: str | os.PathLike[str], *, precision: Precision = "float64") -> Estimator:
        """Return the estimator in a file, of whatever kind it is.

        Parameters
        ----------
        path : path
            Written by `save`, ``ambkit tune`` and others; see `ambkit.FilterFile`.
        precision : {"float64", "float32"}
            What it computes in.

        Raises
        ------
        ConfigError
            With all that is wrong in it; also where a file that it names has changed since.
        AmbkitError
            The file cannot be read, or what it says cannot be built.
        """
        made: Estimator = late_binding.call("load_filter", path, precision)
        return made

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        machine: str | os.PathLike[str] | None = None,
        magnet: str | os.PathLike[str] | None = None,
    ) -> None:
        """Write all that makes it what it is as TOML, through a temporary file.

        Parameters
        ----------
        path : path
            The file.
        machine, magnet : path, optional
            The files of its machine (or a preset's name) and of the expert or force map that it
            asks, the same for all bearings. Where they are not given and needed, they are written
            beside `path`, as ``NAME.machine.toml`` and ``NAME.expert.json``.

        Raises
        ------
        AmbkitError
            A file cannot be written; or it knows its magnet by what has no file.
        """
        late_binding.call("save_filter", self, path, machine, magnet)

    @property
    def states(self) -> tuple[Descriptor, ...]:
        """What the states are, in their order: name, unit, typical size, role."""
        return self.engine.states

    @property
    def model(self) -> Model:
        """The sampled model that it predicts with."""
        return self.engine.model

    def linear_system(self) -> LinearSystem | None:
        """Return the system from y and u to position and velocity, of one that predicts by none."""
        return None

    def linear_model(self, k_i: Any, k_s: Any) -> LinearModel:
        """Return what it predicts with as matrices.

        Parameters
        ----------
        k_i, k_s : float or array_like (p,)
            Stiffnesses at the operating point [N/A], [N/m].
        """
        return LinearModel.of(self.model, k_i, k_s, self._settings)

    def _build(self, engine: Engine, magnet: Magnet, settings: dict[str, Any]) -> Any:
        """Return the core's estimator of this kind."""
        raise NotImplementedError

    @property
    def _parts(self) -> Callable[..., list[Part]]:
        """What returns the parts of a machine that its model has."""
        return machine_parts

    def reset(
        self,
        mean: ArrayLike | None = None,
        std: Sequence[float] | Literal["diffuse"] | None = None,
    ) -> None:
        """Start anew.

        Any start will do: good samples bring the filter back to the rotor. What is beyond what a
        rotor between its stops can do is held to that (``core/include/ambkit/envelope.h``).

        Parameters
        ----------
        mean : array_like (n,), optional
            The states: displacement [m], velocity [m/s], disturbance force [N], lagged position
            [m], and what else the model has; finite. Default: at rest in the middle, with the
            current that holds the rotor there.
        std : sequence of n floats, or "diffuse", optional
            Their standard deviations, finite and positive. Default: three times the measurement
            noise, a tenth of the travel in the plant's time constant, the weight, three times the
            measurement noise; currents are anywhere, noise is as large as it is. ``"diffuse"``:
            nothing is known but the stops and the sensor, and the first samples tell the rest.

        Raises
        ------
        ValueError
            There are not as many numbers as states, a mean is not finite, or a standard deviation
            not finite and positive.
        """
        if isinstance(std, str) and std != "diffuse":
            raise ValueError(f"std must be {len(self.states)} numbers or 'diffuse', got {std!r}")
        initial_std = self.default_std() if std is None else std
        start = self.equilibrium_state(0.0) if mean is None else mean
        for name, item in (("mean", start), ("std", initial_std)):
            if not isinstance(item, str) and np.ndim(item) != 1:
                raise ValueError(
                    f"{name} must be {len(self.states)} numbers, one for each state, has shape "
                    f"{np.shape(item)}"
                )
        self.core.reset(
            self._representable(real("mean", start)),
            None
            if isinstance(initial_std, str)
            else self._representable(real("std", initial_std), positive=True),
        )

    def _representable(self, values: ArrayLike, *, positive: bool = False) -> NDArray[np.float64]:
        """Return finite values as near as this precision has them; others as they are."""
        a = np.asarray(values, dtype=float)
        known = np.finfo(self.precision)
        near = np.clip(a, -float(known.max), float(known.max))
        if positive:
            near = np.where(near > 0, np.maximum(near, float(known.tiny)), near)
        return np.where(np.isfinite(a), near, a)

    def transfer_from(self, other: Estimator) -> None:
        """Bumpless transfer: take mean, covariance and counts of bad samples from another filter.

        A filter that was learned anew so replaces the running one between two samples. In C, where
        the state is the caller's, nothing needs to be done: the next step is given the new
        parameters, and the same state.

        Parameters
        ----------
        other : Estimator
            Any of the linear, adaptive, extended and unscented Kalman filters where this is one of
            them; for the UD filter another of its kind. Sampling time and sensor should be
            the same.

        Raises
        ------
        ValueError
            One of the two keeps something else as well, such as a scale of the magnet, which means
            something only beside its own parameters; or they differ in precision.
        """
        if self.precision != other.precision:
            raise ValueError(
                f"both must have one precision, got {self.precision} and {other.precision}"
            )
        self.core.transfer_from(other.core)

    def default_std(self) -> tuple[float, ...]:
        """Return the standard deviations with which a filter starts; see :meth:`reset`."""
        names = [state.name for state in self.states]
        return tuple(
            (dict(zip(names, self._usual_std, strict=True)) | dict(self.start_std)).values()
        )

    @cached_property
    def _usual_std(self) -> tuple[float, ...]:
        """Those of its kind, for a bearing and the variances that it was made with."""
        return self.view.start_std(self.variances, self.states)

    def equilibrium_state(
        self,
        x: float | NDArray[np.float64],
        shown: float | NDArray[np.float64] | None = None,
        current: Any = None,
    ) -> NDArray[np.float64]:
        """Return the states (n,), each in its unit [m, m/s, N ...], of a rotor at rest.

        Parameters
        ----------
        x : float or ndarray (runs,)
            Displacement [m]; of several runs the states are (runs, n).
        shown : float or ndarray (runs,), optional
            What the sensor shows [m]; by default what it shows of x.
        current : float, optional
            The magnet's, and what was demanded in the samples before [A]; by default what holds the
            rotor there, see :attr:`levitation_current`.

        Notes
        -----
        Of several axes x are the rotor's coordinates (q,), 0 for all of them in the middle,
        `shown` the readings (m,) and `current` the axes' currents (p,).
        """
        return self.view.equilibrium_state(
            self.states, self.levitation_current, x, shown, current, self.precision
        )

    def initial_state(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the states at rest at the first measurement within the travel.

        Parameters
        ----------
        y : ndarray (N,) or (runs, N)
            Measured positions [m].

        Returns
        -------
        ndarray (n,) or (runs, n)
            The states, each in its unit [m, m/s, N ...].
        """
        return self.view.initial_state(self.states, self.levitation_current, y, self.precision)

    @cached_property
    def levitation_current(self) -> Any:
        """Current that holds the rotor in the middle [A], and by how much more away from it [A/m].

        By what the filter knows of its magnet; 0 without a current among the states. Of a whole
        machine such a pair for each axis.
        """
        return self.view.levitation_current(self.magnet, self.states)

    @cached_property
    def law_error(self) -> NDArray[np.float64]:
        """What its force law leaves out of the machine's (``ambkit/law_error.h``); empty: nothing.

        Coefficients of a polynomial in current and displacement, axis by axis.
        """
        return law_errors(self.machine, self.magnet) if self.by_model else np.zeros(0)

    def _with_law_error(self, history: dict[str, Any], u: NDArray[Any]) -> dict[str, Any]:
        """Add to the covariances of a record what the law's error makes of them."""
        if "covariance" in history and self.law_error.size:
            n = len(self.states)
            diagonal = [packed(i, i, n) for i in range(n)]
            before = np.concatenate([np.zeros_like(u[:1]), u[:-1]])
            history["covariance"][:, diagonal] += self._law_variance(history["mean"], before)
        return history

    def _law_variance(self, mean: NDArray[Any], u: NDArray[Any]) -> NDArray[Any]:
        """Return what the law's error adds to the variances (n, states) after controls (n, p)."""
        law, means, controls = (
            np.ascontiguousarray(item, self.precision) for item in (self.law_error, mean, u)
        )
        return np.asarray(self.core.law_variance(law, means, controls))

    def predict(self, u: float) -> NDArray[np.float64]:
        """Go one sample on (eq. 9, 10).

        Parameters
        ----------
        u : float
            Control signal that acted since the last sample [V].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and what else the model has.
        """
        self.core.predict(u)
        return self.mean

    def update(self, y: float) -> NDArray[np.float64]:
        """Take in a measurement (eq. 11-13).

        Parameters
        ----------
        y : float
            Measured position [m].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and what else the model has.
        """
        self.core.update(y)
        return self.mean

    def step(self, y: float, u: float) -> NDArray[np.float64]:
        """Predict, then take in a measurement. Never raises on bad input: see :attr:`status`.

        Parameters
        ----------
        y : float
            Measured position [m].
        u : float
            Control signal that acted since the last sample [V].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and what else the model has.
        """
        self._core_step(y, u)
        return self._live_mean.copy()

    def in_si(self, y: ArrayLike, u: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
        """Turn what the controller reads into SI, as the exported C does, to the last bit.

        Parameters
        ----------
        y : array_like (n,)
            Positions, in the unit that `inputs` says, [m] without.
        u : array_like (n,)
            Control signals, likewise, [V] without.

        Returns
        -------
        tuple of ndarray (n,)
            Position [m] and control signal [V], in the precision of the estimator.
        """
        number = np.float32 if self.precision == "float32" else np.float64
        return self.inputs.y.value(y, number), self.inputs.u.value(u, number)

    def run(self, record: Record, *, covariance: bool = False) -> Estimate:
        """Run along a whole record, from a fresh start at its first measurement within the travel.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V]; u[k] acts from sample k to k + 1. Of a machine
            with ``y_NAME`` of each reading and ``u_NAME`` of each axis, and where it is not the
            machine's own with the ``speed`` of rotation [rad/s]; of one with ``[angle]`` with the
            readings of that sensor, see ``estimate_angle``.
        covariance : bool
            Keep the covariances, 10 numbers a sample.

        Raises
        ------
        RecordError
            Where the record's sampling time is not the bearing's.
        """
        y, u = self._start(record)
        speed, heard = self._rotation(record)
        if speed is None:
            history = self.core.run(y, u, covariance=covariance)
        else:
            turn, of = self.engine.core.run_turning, self.engine.model_of_core
            history = turn(self.core, y, u, speed, of, covariance=covariance, heard=heard)
        return self._estimated(record.t, self._with_law_error(history, u), self.name)

    def _rotation(self, record: Record) -> tuple[NDArray[Any] | None, bool]:
        """Return how the model turns along a record, None: as made; whether that is heard."""
        if self.machine.angle is not None and self.view.speed is not None:
            return self.hear(readings_of(self.machine, record)), True
        return self.turning(dict(record.signals).get("speed"), len(record)), False

    def hear(self, readings: ArrayLike) -> NDArray[Any]:
        """Let the model of a machine follow the readings of its angle's sensor.

        Parameters
        ----------
        readings : array_like (n,)
            Of pulses the time since one came [s], of an encoder [rad], of a speed signal [rad/s],
            as ``AngleEstimate.of`` takes them.

        Returns
        -------
        ndarray (n, 8)
            What the filter hears of the rotation at each sample, the fields of ``amb_rotation``
            (``core/include/ambkit/angle.h``) [their SI units].
        """
        angle = AngleEstimate.of(self.machine, readings, precision=self.precision)
        assert self.machine.angle is not None  # else there is no estimate
        self.engine.stand(self.core)  # nothing is left of a speed that it followed before
        self.engine.schedule_speeds(*self.machine.angle.range(self.machine.speed))
        if (synchronous := self.engine.synchronous_states()) is not None:
            std = [float(item) for item in self.default_std()]
            self.engine.model_of_core.synchronous(synchronous | {"std": std})
        self.engine.model_of_core.turn(float(angle.heard[0, 0]), 0.0)
        return angle.heard

    def turning(self, speed: NDArray[np.float64] | None, n: int) -> NDArray[Any] | None:
        """Let the model of a machine follow the speed of its rotor.

        Parameters
        ----------
        speed : ndarray (n,), optional
            Of rotation at the samples [rad/s]; by default the machine's own.
        n : int
            Samples.

        Returns
        -------
        ndarray (n,) or None
            The speed that it follows [rad/s]; None where it is the machine's own.
        """
        own = self.view.speed
        if own is None:
            return None
        speeds = np.full(n, own) if speed is None else np.asarray(speed, float)
        self.engine.stand(self.core)  # nothing is left of a speed that it followed before
        if bool((speeds == own).all()):
            return None
        self.engine.schedule_speeds(float(speeds.min()), float(speeds.max()))
        self.engine.model_of_core.turn(float(speeds[0]), 0.0)
        return np.ascontiguousarray(speeds, self.precision)

    def run_raw(self, y: ArrayLike, u: ArrayLike, *, covariance: bool = False) -> Estimate:
        """Run along a rig's own numbers, as the exported C does: to the last bit, from its start.

        Parameters
        ----------
        y, u : array_like (n,)
            What the controller reads, in the units of `inputs`; u[k] acts from sample k to k + 1.
        covariance : bool
            As in `run`.

        Returns
        -------
        Estimate
            In SI, from t = 0 on.

        Raises
        ------
        ValueError
            The two are not equally long.
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

    def smooth(self, record: Record) -> Estimate:
        """Estimate each sample of a record from all of it, not only from what came before.

        The fixed-interval smoother of Rauch, Tung and Striebel (1965), in the form of Bryson and
        Frazier modified by Bierman (1973), which inverts no covariance. Samples that the filter
        leaves out are bridged. Where it was held because it knew no place any more, or started
        afresh, nothing is carried back over the gap.

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
            This kind has no covariance that the smoother could go back by.
        RecordError
            The record's sampling time is not the bearing's.
        """
        if not self.smooths:
            raise ValueError(
                f"{self.name}: cannot be smoothed; the linear, adaptive, extended and UD "
                "Kalman filters can"
            )
        y, u = self._start(record)
        history = self._with_law_error(self.core.smooth(y, u), u)
        return self._estimated(record.t, history, f"{self.name}, smoothed")

    def _estimated(
        self, t: NDArray[np.float64], history: dict[str, Any], name: str | None = None
    ) -> Estimate:
        """Wrap what the core wrote of a whole record, in arrays by name."""
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

    def _start(self, record: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Reset to the first measurement of a record within the travel; return its y and u."""
        of_type(Record, record=record)
        check_sampling(self.machine, record)
        y, u = self.view.signals(record)
        self.reset(self.initial_state(y))
        return y, u

    def forecast(self, estimate: Estimate, record: Record, ahead: int) -> NDArray[np.float64]:
        """Predict the measurement ``ahead`` samples after each estimate.

        Parameters
        ----------
        estimate : Estimate
            Of this filter along the record, n samples.
        record : Record
            With ``u`` [V].
        ahead : int
            How many samples ahead.

        Returns
        -------
        ndarray (n - ahead,)
            Element k is the prediction of ``record["y"][k + ahead]`` [m], made from the estimate
            at k and the control signals that acted since.
        """
        mean = np.ascontiguousarray(real("estimate.mean", estimate.mean))
        _, u = self.view.signals(record)
        return self.view.column(np.asarray(self.core.forecast(mean, u, ahead, estimate.scale)))

    @property
    def mean(self) -> NDArray[np.float64]:
        """State estimate (n,): x [m], v [m/s], f_d [N], x_m [m], and what else the model has."""
        return self._live_mean.copy()

    # Looked up once: they are asked at every sample.
    @cached_property
    def _core_step(self) -> Callable[[float, float], int]:
        return self.core.step  # type: ignore[no-any-return]

    @cached_property
    def _live_mean(self) -> NDArray[np.float64]:
        return self.core.live_mean  # type: ignore[no-any-return]

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the state estimate (n, n) [products of the states' units].

        That of a disturbance force includes the error of the filter's force law.
        """
        P = np.asarray(self.core.covariance)
        if self.law_error.size:
            P += np.diag(self._law_variance(self.mean, self.core.last_u)[0])
        return P

    @property
    def innovation(self) -> Any:
        """Last measurement less its prediction [m]; of several readings (m,)."""
        return self.core.innovation

    @property
    def innovation_variance(self) -> Any:
        """Its variance S as the filter expects it [m^2]; of several readings (m,)."""
        return self.core.variance

    @property
    def scale(self) -> tuple[float, float] | None:
        """Estimated magnet constant over the known one, and its standard deviation.

        None where this kind does not estimate it.
        """
        if self.core.scale is None:
            return None
        value, variance = self.core.scale
        return float(value), math.sqrt(variance)

    @property
    def status(self) -> Status:
        """What the last step had to say."""
        return Status(self.core.status)


def check_sampling(machine: Machine, record: Record) -> None:
    """Refuse a record that was not sampled as the bearing says."""
    if len(record.t) < 2:
        return
    T = float(record.t[-1] - record.t[0]) / (len(record.t) - 1)
    if abs(T - machine.sampling_time) > 1e-3 * machine.sampling_time:
        raise RecordError(
            f"the record is sampled every {T:.6g} s, but {machine.name!r} has "
            f"sampling_time = {machine.sampling_time:.6g} s"
        )
