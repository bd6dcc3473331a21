"""The C core of ambkit."""

from collections.abc import Sequence
from typing import Annotated, Any, overload

import numpy
from numpy.typing import NDArray


class Magnet:
    """Force and stiffnesses at (iu [A], x [m]); arrays (n,)."""

    def force(self, iu: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
        """Force relative to the bias force [N], (n,)."""

    def through_origin(self, iu: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """k_i [N/A], k_s [N/m] with F = k_i iu + k_s x."""

    def tangent(self, iu: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """k_i = dF/diu [N/A], k_s = dF/dx [N/m]."""

    @property
    def parameters(self) -> dict[str, Any]:
        """What the C struct holds, by the names of its fields."""

    @property
    def in_c(self) -> tuple[str, str, str, str]:
        """
        How it is called in C: struct, methods, header and source, and what it is.
        """

class Constant(Magnet):
    """Constant stiffness (paper, eq. 14)."""

    def __init__(self, k_i: float, k_s: float) -> None: ...

class Law(Magnet):
    """A force law (models/laws), by its name and fields."""

    def __init__(self, name: str, **fields: float) -> None: ...

class Table(Magnet):
    """Bilinear stiffness tables, rows of x."""

    def __init__(self, x_min: float, dx: float, iu_min: float, diu: float, k_i: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], k_s: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)]) -> None: ...

class Surface(Magnet):
    """Bicubic force (ambkit/surface.h), rows of x."""

    def __init__(self, x_min: float, dx: float, iu_min: float, diu: float, f: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], f_i: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], f_x: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], f_ix: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], ampere: float, metre: float) -> None: ...

class Fuzzy(Magnet):
    """Fuzzy basis function network (paper, eq. 32-33)."""

    def __init__(self, centre_iu: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], centre_x: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], sharpness_k_i: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], weight_k_i: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], sharpness_k_s: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], weight_k_s: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], per_ampere: float, per_metre: float, iu_min: float, iu_max: float, x_min: float, x_max: float, normalised: bool) -> None: ...

    def basis(self, of_k_s: bool, iu: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
        """
        Fuzzy basis functions (n, rules), eq. 32: normalised ones sum to 1. Held to the box.
        """

MAX_RULES: int = 64

def exp_negative(t: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
    """exp(-t) for t >= 0 as the core computes it, (n,)."""

def phi(z: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
    """
    phi_1, phi_2, phi_3 (n, 3) at z >= 0 as the core computes them, (n,): the sums over n of (-z)^n / (n+k)!.
    """

class Model:
    """The paper's axis, four states (core/generated/axial.h)."""

    def __init__(self, T: float, m: float, K_sen: float, T_sen: float, as_printed: bool) -> None: ...

def transition(A: Any, time: float) -> Any:
    """Exponentials of A times a time (..., n, n)."""

def process_noise(A: Any, intensity: Any, time: float) -> Any:
    """
    Covariances that white noises (k, n) leave in the states over a time (k, n, n).
    """

def sampled(T: float, states: int, controls: int, row: Any, column: Any, use: Any, value: list[float], k_i: list[float], late: list[tuple[int, list[int], float]], intensity: Any) -> tuple[Any, Any]:
    """
    Transition of a plan over one sample, and the covariances of its noises.
    """

def rebuild(fields: dict[str, Any], parameters: list[float]) -> Any:
    """
    The numbers of a model, by the fields of amb_rebuild, from its parameters.
    """

def intensity(view: dict[str, Any]) -> list[float]:
    """Process noise intensities of the axes of a machine [N^2/s]."""

def dwell(view: dict[str, Any]) -> float:
    """
    Samples for which a rotor at rest stays within a very coarse step of its sensor.
    """

def caps_and_start(view: dict[str, Any], role: list[int], index: list[int], size: list[float], vague: list[float], var_y: list[float]) -> tuple[list[float], list[float]]:
    """
    The most that each state can be, and its standard deviation at the start.
    """

def corners(view: dict[str, Any], var_y: float, intensity: float) -> list[float]:
    """Corner frequencies of the low-pass filters of an axis [rad/s]."""

OK: int = 0

MISSING: int = 1

FROZEN: int = 2

SATURATED: int = 4

BAD_CONTROL: int = 8

BAD_VARIANCE: int = 16

HELD: int = 32

BAD_PARAMETER: int = 64

UNEXCITED: int = 128

OUTLIER: int = 256

INCONSISTENT: int = 512

NOISE_LIMIT: int = 1024

RESTARTED: int = 2048

CONTACT: int = 4096

MIRRORED: int = 8192

OUTSIDE: int = 16384

class Estimator:
    """One of the family (ambkit/estimator.h)."""

    def reset(self, mean: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], std: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None) -> None:
        """
        Start from a mean (4,) and standard deviations (4,), uncorrelated; None: diffuse.
        """

    def transfer_from(self, other: Estimator) -> None:
        """Go on where another is: its mean, covariance and counts."""

    @overload
    def predict(self, u: float) -> int:
        """One sample on; returns the status."""

    @overload
    def predict(self, u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> int:
        """The same with u (controls,)."""

    @overload
    def update(self, y: float) -> int:
        """Take in y; returns the status."""

    @overload
    def update(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> int:
        """The same with y (sensors,)."""

    @overload
    def step(self, y: float, u: float) -> int:
        """Predict with u, update with y."""

    @overload
    def step(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> int:
        """The same with arrays."""

    def run(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], *, covariance: bool = False, instructions: str | None = None) -> dict[str, Any]:
        """A whole record; u[k] acts from sample k to k + 1."""

    def smooth(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)]) -> dict[str, Any]:
        """A whole record, mean and covariance by all of it (ambkit/smoother.h)."""

    def forecast(self, mean: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], ahead: int, scale: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None) -> NDArray[numpy.float64]:
        """
        Measurements `ahead` samples after each of mean (n, states): (n - ahead, sensors) [m].
        """

    @property
    def mean(self) -> NDArray[numpy.float64]:
        """State estimate (states,)."""

    @property
    def live_mean(self) -> Annotated[NDArray[numpy.float64], dict(writable=False)]:
        """The same, read only, which follows the estimator."""

    @property
    def covariance(self) -> NDArray[numpy.float64]:
        """Its covariance (states, states)."""

    def law_bias(self, law: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], gain: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], mean: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], covariance: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], used: Annotated[NDArray[numpy.bool_], dict(shape=(None, None), order='C', writable=False)], before: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None, carried: bool = True) -> NDArray[numpy.float64]:
        """
        The bias (n, states) by its law's error along n samples, see ambkit/law_error.h.
        """

    @property
    def last_u(self) -> NDArray[numpy.float64]:
        """Last control signals (controls,)."""

    @property
    def scale(self) -> object:
        """
        Scale of the magnet's force and its variance; None where not estimated.
        """

    @property
    def parameters(self) -> dict[str, Any]:
        """
        Settings, and what was computed from them, by the names of their fields.
        """

    @property
    def own(self) -> dict[str, Any]:
        """What only this kind has, by the names of the fields."""

    @property
    def state(self) -> bytes:
        """
        All that it knows, as bytes of this build, for an estimator that was made alike.
        """

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def status(self) -> int: ...

    @property
    def health(self) -> list[int]:
        """What there is to say of each sensor."""

    @property
    def innovation(self) -> object: ...

    @property
    def variance(self) -> object: ...

    @property
    def k_i(self) -> object: ...

    @property
    def k_s(self) -> object: ...

class Kalman(Estimator):
    """Kalman filter (paper, eq. 7-21, Fig. 8)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> None: ...

    def run(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], k_i: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)] | None = None, k_s: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)] | None = None, *, covariance: bool = False, instructions: str | None = None) -> dict[str, Any]:
        """A whole record, with given stiffnesses (n,) or the magnet's."""

class Extended(Estimator):
    """Extended Kalman filter."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> None: ...

    def widen(self, std: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Know the state less surely: by standard deviations (states,) more, uncorrelated.
        """

class UD(Estimator):
    """Extended filter on a factor (ambkit/ud.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> None: ...

    @property
    def factor(self) -> object:
        """U (states, states) and D (states,) of the covariance U D U'."""

class Unscented(Estimator):
    """Unscented filter (ambkit/unscented.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, reach: float, curvature: float, **settings: Any) -> None: ...

class Contact(Estimator):
    """Extended filter with stops (ambkit/contact.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, first: Any, second: Any, numbers: Any, displacement: Any, velocity: Any, later: Any, coupling: Any, bias: Any, brief: bool, scatter: float, **settings: Any) -> None: ...

    def run(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], *, covariance: bool = False, instructions: str | None = None, on: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)] | None = None) -> dict[str, Any]:
        """
        A whole record; the magnets have no current from sample k to k + 1 where on[k] is 0.
        """

    def deenergise(self) -> None:
        """Before a prediction: the magnets had no current."""

    def contact_forces(self, means: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], iu: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], on: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None) -> object:
        """
        Contact forces along the axes (n, forces) [N] over the samples that begin at means of the states (n, states), under control currents (n, controls) [A] where `on` (n,) is 1, and without magnet forces where it is 0.
        """

class AdaptiveNoise(Estimator):
    """Noise found online (ambkit/adaptive_noise.h)."""

    def __init__(self, around: Estimator, *, measurement: bool, disturbance: bool, share: float, first_share: float, most: float, window: int) -> None: ...

    @property
    def noise(self) -> object:
        """var_y [m^2] and var_d [N^2 a sample] as found so far."""

class Observer(Estimator):
    """Constant gain (ambkit/observer.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, gain: NDArray[Any], cov: NDArray[Any], variance: NDArray[Any], far: NDArray[Any], **settings: Any) -> None: ...

class LowPass(Estimator):
    """Low-pass filters (ambkit/low_pass.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, m: float, position: float, velocity: float, force: float, **settings: Any) -> None: ...

class Own(Estimator):
    """An estimator in Python."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, answer: Any, **settings: Any) -> None: ...

class Augmented(Estimator):
    """State augmented by the magnet's scale (ambkit/augmented.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, bias: NDArray[Any], std: float, var_k: float, min: float, max: float, fresh: float, least: float, **settings: Any) -> None: ...

class MultipleModel(Estimator):
    """Interacting models (ambkit/multiple_model.h)."""

    def __init__(self, magnet: Magnet | list[Magnet], model: Model, theta: NDArray[Any], leave: float, bias: NDArray[Any], fresh: float, least: float, **settings: Any) -> None: ...

    @property
    def weights(self) -> NDArray[numpy.float64]:
        """Probabilities of the models (n,)."""

class Adaline:
    """Force and magnet constant from the motion (eq. 22-25)."""

    def __init__(self, *, s0: float, i0: float, two_sided: bool, T: float, m: float, K_sen: float, a_sen: float, k_ui: float, iu_min: float, iu_max: float, f_0: float, bandwidth: float, rate_force: float, rate_k: float, least_excitation: float, k: float) -> None: ...

    def step(self, y: float, u: float, f_d: float = 0) -> int: ...

    def run(self, y: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], f_d: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> dict[str, Any]:
        """A whole record; u[k] and f_d[k] act from sample k to k + 1."""

    @property
    def state(self) -> bytes:
        """
        All that it has learned, as bytes of this build, for a learner that was made alike.
        """

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def force(self) -> float: ...

    @property
    def k(self) -> float: ...

    @property
    def excitation(self) -> float: ...

class MagnetRls:
    """Magnet constant by least squares, load unknown or known."""

    def __init__(self, *, s0: float, i0: float, two_sided: bool, T: float, m: float, K_sen: float, a_sen: float, k_ui: float, iu_min: float, iu_max: float, f_0: float, bandwidth: float, rate_force: float, forgetting: float, least_excitation: float, settling: int, with_load: bool, k: float) -> None: ...

    def step(self, y: float, u: float, f_d: float = 0) -> int: ...

    def run(self, y: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], f_d: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> dict[str, Any]:
        """A whole record; u[k] and f_d[k] act from sample k to k + 1."""

    @property
    def state(self) -> bytes:
        """
        All that it has learned, as bytes of this build, for a learner that was made alike.
        """

    @state.setter
    def state(self, arg: bytes, /) -> None: ...

    @property
    def force(self) -> float: ...

    @property
    def k(self) -> float: ...

    @property
    def load(self) -> float: ...

    @property
    def excitation(self) -> float: ...

class Rls:
    """Recursive least squares with forgetting."""

    def __init__(self, theta: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], known: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], *, forgetting: float, least_excitation: float) -> None: ...

    def run(self, phi: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], y: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> dict[str, Any]:
        """
        Regressors (samples, n) and outputs (samples); theta and excitation after each.
        """

class Isolation:
    """Fault isolation beside a filter (ambkit/isolation.h)."""

    def __init__(self, of: dict[str, Any]) -> None: ...

    def run(self, filter: Any, y: Any, u: Any, every: int, model: Any = None, speed: Any = None, measured: bool = False) -> dict[str, Any]:
        """
        Run a filter along a record, and search the window every so many samples; `speed` as `run_turning` takes it.
        """

    @property
    def room(self) -> tuple[int, int]:
        """Numbers of a row of the ring, and of the memory to work in."""

    def information(self, filter: Any, since: int, before: bool) -> Any:
        """
        Information of all columns on faults that began so many samples ago; `before`: beside any error then.
        """

def run_angle(settings: dict[str, Any], readings: Any) -> dict[str, Any]:
    """
    The rotor's angle along readings (n,) of its sensor, see ambkit/angle.h.
    """

class Control:
    """The whole controller (ambkit/control.h)."""

    def __init__(self, estimator: Estimator, fields: dict[str, Any]) -> None: ...

    def run(self, y: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], r: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu', writable=False)], fly: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], speed: float = 0, transferred: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None, recorded: dict[str, Any] | None = None, energised: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None) -> dict[str, Any]:
        """
        A record from power-on: readings (n, m) [m], references (n, q) [m], and whether it is to fly, 1 or 0. Or in flight from the first sample on, taken over with currents (p,) [A]. `recorded`: mean, u, covariance and snapshot of each sample, to begin the next at. `energised`: 0 where the power fails from that sample on.
        """

class LoopState:
    """Plant, controller and last sample of a closed loop; empty at first."""

    def __init__(self) -> None: ...

def simulate(loop: dict[str, Any], *, r: Any, load: Any, noise_u: Any, noise_y: Any, place: Any, current: Any, integral: Any, hovers: bool = True, estimator: Estimator | None = None, model: Model | None = None, control: Control | None = None, speed: Any = None, rotation: Any = None, base: Any = None, on: Any = None, scale: Any = None, faults: dict[str, Any] | None = None, beside: bool = False, fly: Any = None, state: LoopState | None = None, start: Any = None, own_controller: Any = None, own_plant: Any = None) -> dict[str, Any]:
    """
    A closed-loop run in one call; see sim/loop.h for shapes and units. With a state, an empty one at first, the next call goes on where this one ends. The start, of all states of the plant, is in place of rest.
    """

def instruction_sets() -> list[str]:
    """What this processor can compute lanes with, the fastest last."""

def run_batch(estimators: Sequence[Estimator], y: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], u: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], mean: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], std: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], *, truth: Annotated[NDArray[numpy.float64], dict(shape=(None, None, None), order='C', device='cpu', writable=False)] | None = None, skip: int = 0, means: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu')] | None = None, innovation: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu')] | None = None, variance: Annotated[NDArray[numpy.float64], dict(order='C', device='cpu')] | None = None, status: Annotated[NDArray[numpy.uint16], dict(order='C', device='cpu')] | None = None, instructions: str | None = None, threads: int = 1) -> tuple[NDArray[numpy.float64], NDArray[numpy.uint32]]:
    """
    Many runs side by side (sim/batch.h), each from its start mean, std (runs, 4). Arrays that are given are filled. Returns sums of squared errors (runs, 3) and flags (runs,).
    """

class Along:
    """What an estimator knows of each axis, by its states."""

    def __init__(self, rows: list[Any], axes: int, states: int) -> None: ...

class Plan:
    """A closed loop that is run many times, all but its number."""

    def __init__(self, loop: dict[str, Any], *, seed: int, std_u: list[float], std_y: list[float], noise_u: Any, noise_y: Any, windows: Any, mean: Any, std: Any, along: Along | None, **named: Any) -> None:
        """
        What `simulate` is named, and what sim/many.h has beside: noise, windows (axes, 7), and an estimator's start and rows along the axes.
        """

def fly(plans: Sequence[Plan], which: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], numbers: Annotated[NDArray[numpy.uint64], dict(shape=(None,), order='C', device='cpu', writable=False)], *, instructions: str | None = None, threads: int = 1) -> tuple[NDArray[numpy.float64], NDArray[numpy.int64]]:
    """
    Runs (runs,) of plans with these numbers: figures (runs, 20), counts of flags (runs, 15).
    """

def normal_noise(seed: int, run: int, stream: int, n: int) -> NDArray[numpy.float64]:
    """Standard normal noise (n,) of these counters; see sim/many.h."""

def philox(counter: Sequence[int], key: Sequence[int]) -> NDArray[numpy.uint32]:
    """
    Philox 4x32-10: four words of a counter (4,) and a key (2,) made random (4,).
    """
