"""What the self-test of a controller lives through, as the simulation flies it."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Bools
from ambkit.control.control import Mode
from ambkit.control.controller_states import Controller, settling_of
from ambkit.data.signals import signal
from ambkit.estimate.core_model import NODE
from ambkit.estimate.estimate import Status
from ambkit.export.c import c_literals
from ambkit.export.c.snapshots import Snapshots, snapshots_of
from ambkit.export.c.test_vectors import flag_rows, without_digits
from ambkit.machine.accessories import rotation_signal
from ambkit.machine.machine import Machine
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Disturbance, Reference, Scenario, energised
from ambkit.simulation.waveforms import Constant, Ramp, Step, Sum

FAST_SEQUENCE: dict[str, Any] = {
    "waiting": 5, "lost": 30, "overloaded": 12, "rise": 0.012, "descent": 0.018, "settling": 17,
}  # fmt: skip
"""The sequence of the self-test: fields of ``amb_sequence``, and the settling at most."""
LIFTED, UP = 300, 130  #: Samples of a flight in the self-test, and from which on the rotor is up.
SLOW = 20  #: Samples of a plant's time constant, for each of which a flight takes as many more.
TRANSFER_SAMPLES = 40  #: Samples of a flight that is taken over.
OUTAGE = 288, 290  #: Samples of a power failure.
PUSH, PULL = 0.2, 3.0  #: Loads of the flights, in what an axis can pull with its greatest current.


class Vectors(NamedTuple):
    """Flights one after the other, N samples."""

    y: Array  # (N, readings), as the rig has them
    r: Array  # (N, axes) [m]
    u: Array  # (N, axes): what the controllers gave [V]
    speed: Array  # (N,) [rad/s]; or readings of the angle's sensor
    mode: NDArray[np.uint8]  # (N,): what they were doing
    fly: Bools  # (N,): whether they were told to fly
    energised: Bools  # (N,): whether the magnets were supplied from a sample on
    status: NDArray[np.uint16]  # (N,): flags of filter and controllers
    usable: Bools  # (N,): whether the estimate could be used
    mean: Array  # (N, states), each in its unit
    snapshots: Snapshots  # covariances that are restored, and where rounding is amplified
    starts: list[int]  # where flights begin at power-on ...
    transfers: list[int]  # ... and where those do that are taken over, ...
    transfer_currents: Array  # ... with these currents (axes,) [A]
    saturated: int  # samples in which a current was at its limit


def speeds_of(machine: Machine, scenario: Scenario | None) -> tuple[float, float] | None:
    """The slowest and the fastest rotation of a flight [rad/s]; None at the machine's own."""
    if machine.angle is not None:
        return machine.angle.range(machine.speed)
    if scenario is None or scenario.speed is None:
        return None
    n = max(2, round(scenario.duration / machine.sampling_time) + 1)
    speed = scenario.speed.sample(machine.sampling_time * np.arange(n + 1, dtype=float))
    if bool((speed == machine.speed).all()):
        return None
    return float(speed.min()), float(speed.max())


def fast_sequence(controller: Controller) -> dict[str, Any]:
    """Return fields of a sequence that firmware need not hold seconds of."""
    slow, settling = slowness(controller), settling_of(controller.estimator)
    longer = {key: slow * FAST_SEQUENCE[key] for key in ("lost", "overloaded")}
    slower = {key: FAST_SEQUENCE[key] / slow for key in ("rise", "descent")}
    return FAST_SEQUENCE | longer | slower | {"settling": min(settling, FAST_SEQUENCE["settling"])}


def slowness(controller: Controller) -> int:
    """Return by how much flights are longer than those of a plant that is fast [1]."""
    return max(1, settling_of(controller.estimator) // SLOW)


def vectors(controller: Controller, scenario: Scenario) -> Vectors:
    """Fly what the self-test flies, with the plant of the simulation."""
    # A step of the reference with a load, and loads beyond what the magnets hold with readings lost
    # and far away, and references that are none; on all axes in turn, and where the flight's speed
    # changes up and down with it: from where the rotor lies to where it lies again. Some trip, and
    # a rotor in flight is taken over.
    filter, machine = controller.estimator, controller.plant.machine
    turns = speeds_of(machine, scenario) is not None
    parts = []
    for case in _cases(controller, scenario):
        external_inputs = ExternalInputs(
            readings=case.readings, references=case.references, fly=case.fly,
            exported=fast_sequence(controller),
        )  # fmt: skip
        run = simulate_run(
            machine, case.scenario, estimator=filter,
            controllers=controller.law, external_inputs=external_inputs,
        )  # fmt: skip
        record, names = run.record, machine.axis_names
        y = np.column_stack([record[signal("y", r.name)] for r in machine.readings])
        r, u = (np.column_stack([record[signal(of, name)] for name in names]) for of in "ru")
        assert run.estimate is not None
        assert run.usable is not None
        mode = record["mode"].astype(np.uint8)
        fly = case.fly > 0
        speed = record[rotation_signal(machine.angle)]
        on = energised(case.scenario.off, case.scenario.on, record.t, machine.sampling_time) > 0
        part = (y, r, u, speed, mode, fly, on, run.status, run.usable, run.estimate.mean)
        part = _as_read(controller, part)
        parts.append((*part, _snapshots(controller, part, None, turns=turns)))
    flight_count = len(parts)
    transfer_currents = np.zeros(len(machine.axes))
    # Of a model that turns the core's controller alone follows no speed.
    if not turns:
        over, transfer_currents = _transferred(controller, parts[0])
        parts += over
    starts = np.cumsum([0, *(len(item[0]) for item in parts[:-1])]).tolist()
    filter.follow_speed(None, 1)  # what is written of the filter is of the machine's own speed
    *columns, snapshots = zip(*parts, strict=True)
    joined: list[Any] = [np.concatenate(item) for item in columns]
    joined.append(Snapshots.joined(snapshots))
    gain = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    low, high = (
        np.array([getattr(isolated, f"current_{end}") for isolated in controller.plant.isolated])
        for end in ("min", "max")
    )
    iu = joined[2] * gain
    full = ((iu >= high * (1 - 1e-6)) | (iu <= low * (1 - 1e-6))).any(axis=1)
    at = starts[:flight_count], starts[flight_count:]
    return Vectors._make([*joined, *at, transfer_currents, int(full.sum())])


def _as_read(controller: Controller, part: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a flight as the rig's numbers have it, which are rounded; what is in SI as it is."""
    filter, (y, r, _, speed, _, fly, on, *_) = controller.estimator, part
    raw = filter.inputs.y.numbers(y)
    if raw is y:
        return part
    number = np.dtype(filter.precision).type
    raw = raw.astype(number).astype(float)
    return (raw, *_along(controller, raw, r, speed, fly, on))


def _output(
    controller: Controller, y: Array, r: Array, speed: Array, fly: Bools, energised: Bools,
    transfer_currents: Array | None, recorded: dict[str, Array] | None = None,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Return the controller's output along readings (n, m)."""
    filter = controller.estimator
    number = np.dtype(filter.precision).type
    si, _ = filter.in_si(y, np.zeros(0))
    *signals, on = (np.ascontiguousarray(item, number) for item in (si, r, fly, energised))
    kernel = controller.in_core(**fast_sequence(controller))
    currents = None if transfer_currents is None else transfer_currents.astype(number)
    before = recorded and {key: values.astype(number) for key, values in recorded.items()}
    result: dict[str, Any] = kernel.run(*signals, float(speed[0]), currents, before, on)
    return result


def _along(
    controller: Controller, y: Array, r: Array, speed: Array, fly: Bools, energised: Bools,
    transfer_currents: Array | None = None,
) -> tuple[Any, ...]:  # fmt: skip
    """Return what the controller gives along readings (n, m), as `Vectors` has it from `r` on."""
    output = _output(controller, y, r, speed, fly, energised, transfer_currents)
    status, usable = output["status"], output["usable"] > 0
    return r, output["u"], speed, output["mode"], fly, energised, status, usable, output["mean"]


def _snapshots(
    controller: Controller, part: tuple[Any, ...], transfer_currents: Array | None, *, turns: bool
) -> Snapshots:
    """Return which covariances of a run are restored, and where rounding is amplified."""
    y, r, u, speed, mode, fly, on, status, *_ = part
    filter = controller.estimator
    # In float digits are lost, of several axes; what a core keeps beside them is not restored.
    kept = c_literals.called(filter).has_state
    if not (turns or kept or filter.machine.single or filter.precision == "float64"):
        return snapshots_of(
            controller,
            lambda of, recorded: _output(of, y, r, speed, fly, on, transfer_currents, recorded),
        )
    amplified = without_digits(filter, y, u)
    if len(controller.plant.machine.readings) > 1 and filter.precision == "float32":
        # Of a rotor that is thrown between its stops, rounding decides which readings are used.
        thrown = (mode == Mode.TRIPPED) & ((status & Status.OUTLIER) != 0)
        amplified |= np.maximum.accumulate(thrown)
    n = len(amplified)  # without a covariance to restore
    return Snapshots(np.zeros(n, bool), amplified, np.zeros((n, 0)))


def _transferred(
    controller: Controller, signals: tuple[Any, ...]
) -> tuple[list[tuple[Any, ...]], Array]:
    """Flights that are taken over, as `vectors` has them, and the currents that acted then."""
    # The readings are those of a flight at that time, and go on whatever is demanded now: it lands,
    # it is overloaded from the first sample on, and its sensors freeze and are lost.
    filter, machine = controller.estimator, controller.plant.machine
    y, r, u, speed, mode, *_ = signals
    flying = np.flatnonzero(mode == Mode.FLYING)  # none, where it is overloaded on its way up
    at = int(flying[10]) if len(flying) > 10 else UP
    n = TRANSFER_SAMPLES
    y, r, speed = y[at : at + n], r[at : at + n], np.full(n, speed[at])
    gain = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    transfer_currents = (gain * u[at - 1]).astype(np.dtype(filter.precision).type)
    landing, staying = np.arange(n) < n // 2, np.ones(n, bool)
    far = 60 * max(bearing.clearance for bearing in machine.bearings)
    corrupted = y.copy()
    corrupted[8:30], corrupted[34:37] = y[8], np.nan
    over = []
    for y_k, r_k, fly in ((y, r, landing), (y, r + far, staying), (corrupted, r, staying)):
        part = (y_k, *_along(controller, y_k, r_k, speed, fly, staying, transfer_currents))
        over.append((*part, _snapshots(controller, part, transfer_currents, turns=False)))
    return over, transfer_currents


class TestCase(NamedTuple):
    """One flight of the self-test, n samples."""

    scenario: Scenario
    readings: Array  # (n, readings): what is added to them [m]; NaN: lost
    references: Array  # (n, axes): what is added to the references [m]; NaN: none
    fly: Array  # (n,): whether it is told to fly, 1 or 0


def _cases(controller: Controller, scenario: Scenario) -> Iterator[TestCase]:
    machine, slow = controller.plant.machine, slowness(controller)
    n = LIFTED * slow

    def commands(*off: tuple[int, int]) -> Array:
        fly = np.ones(n)
        for first, end in off:
            fly[first * slow : end * slow] = 0.0
        return fly

    none, well = np.zeros((n, len(machine.axes))), np.zeros((n, len(machine.readings)))
    # On the way up it is called back, and lands.
    lands, references = commands((0, 8), (100, 106), (230, LIFTED)), none.copy()
    references[190 * slow, 0] = references[193 * slow, -1] = references[196 * slow, :] = np.nan
    landing_scenario = _event_scenario(machine, scenario, 1.0, PUSH, slow)
    yield TestCase(landing_scenario, _corrupted(machine, well, slow), references, lands)
    # It has tripped when the command is withdrawn, and lifts again until the power fails.
    pulled = _event_scenario(machine, scenario, -1.0, PULL, slow)
    off, on = (slow * k * machine.sampling_time for k in OUTAGE)
    failing = pulled.model_copy(update={"off": off, "on": on})
    again = commands((200, 210), (OUTAGE[1], OUTAGE[1] + 4))
    yield TestCase(failing, _lost(machine, well, slow), none, again)
    references = none.copy()
    references[180 * slow :: 3] = np.nan
    yield TestCase(pulled, well, references, commands())  # a current at its limit trips it


def _event_scenario(
    machine: Machine, scenario: Scenario, sign: float, share: float, slow: int
) -> Scenario:
    """Return a flight on all axes in turn: references of a twentieth of the travel, and loads."""
    # It begins where the rotor lies, as the exported controller does at power-on.
    T = slow * machine.sampling_time
    references, loads = [], []
    for k, axis in enumerate(machine.axes):
        way = sign * (-1.0 if k % 2 else 1.0)
        law = axis.bearing.magnet
        most = 4 * law.magnet_constant * law.bias_current * axis.bearing.amplifier.current_limit
        force, late = way * share * most / law.air_gap**2, UP + 8 * k
        force_step = Step(amplitude=force, time=(50 + late) * T)
        position_step = Step(amplitude=0.05 * way * axis.bearing.clearance, time=(12 + late) * T)
        references.append(Reference(axis=axis.name, position=position_step))
        loads.append(Disturbance(axis=axis.name, force=force_step))
    return Scenario(
        duration=LIFTED * T - machine.sampling_time, start="landed",
        controller=scenario.controller, reference=tuple(references), disturbance=tuple(loads),
        seed=scenario.seed, speed=_speed(machine, scenario, sign, LIFTED * T),
        sequence=scenario.sequence,
    )  # fmt: skip


def _speed(machine: Machine, scenario: Scenario, sign: float, duration: float) -> Sum | None:
    """Return a speed that grows over two nodes of the model, or falls, within those of a flight."""
    speeds = speeds_of(machine, scenario)
    if speeds is None:
        return None
    low, high = speeds
    by = min(2 * NODE / machine.sampling_time, high - low)
    first = low + 0.3 * (high - low - by) if sign > 0 else high - 0.1 * (high - low - by)
    ramp = Ramp(slope=sign * by / duration)
    return Sum(parts=(Constant(value=first), ramp))


def _corrupted(machine: Machine, well: Array, slow: int) -> Array:
    """Return what is added to the readings: losses, and readings far away."""
    added, travel = well.copy(), min(bearing.clearance for bearing in machine.bearings)
    added[170 * slow : 170 * slow + 4, 0], added[178 * slow, :] = np.nan, np.nan
    added[184 * slow, -1], added[188 * slow, 0] = 3 * travel, -3 * travel
    return added


def _lost(machine: Machine, well: Array, slow: int) -> Array:
    """Return readings that begin far away, and of which all are lost until it trips."""
    added, travel = well.copy(), max(bearing.clearance for bearing in machine.bearings)
    added[0], added[1] = 30 * travel, 3 * travel
    added[145 * slow : 180 * slow] = np.nan
    return added


def with_infinite_inputs(values: Array) -> Array:
    """Return the numbers, of which those that are none are infinite in turn: it is all the same."""
    result = values.copy()
    none = np.flatnonzero(np.isnan(values))
    result.flat[none[1::3]], result.flat[none[2::3]] = np.inf, -np.inf
    return result


def marks_of(tested: Vectors) -> NDArray[np.uint16]:
    """Return the mode of each sample and the marks that the template of the self-test has (N,)."""
    result = tested.mode + 8 * tested.fly.astype(np.uint16) + 32 * tested.usable.astype(np.uint16)
    result[tested.starts] += 16
    result[tested.transfers] += 64
    result[tested.snapshots.amplified] += 128
    result[1:][~tested.energised[:-1]] += 256
    return np.asarray(result)


def coverage(controller: Controller, tested: Vectors) -> list[tuple[str, str]]:
    """Return what the samples visit, in words: what, and how much of it."""
    runs = len(tested.starts) + len(tested.transfers)
    rows = [("samples", f"{len(tested.y)}, in {runs} flights, each from a start")]
    machine, states = controller.plant.machine, controller.estimator.states
    of = [
        (signal("u", axis.name), axis.bearing.amplifier.control_unit, tested.u[:, k])
        for k, axis in enumerate(machine.axes)
    ]
    of += [(state.name, state.unit, tested.mean[:, k]) for k, state in enumerate(states)]
    for name, unit, values in of:
        rows.append((f"`{name}`", f"{values.min():.4g} to {values.max():.4g} {unit}"))
    for mode in Mode:
        rows.append((f"`AMB_{mode.name}`", f"{int((tested.mode == mode).sum())} samples"))
    rows.append(("a current at its limit", f"{tested.saturated} samples"))
    rows.append(("a power failure", f"{int((~tested.energised).sum())} samples"))
    return [*rows, *flag_rows(tested.status)]
