"""Description of a machine: poles, modal truncation, collocation, damping, separation."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.units import engineering, percent
from ambkit.control.control_candidates import PIDS
from ambkit.control.default_control import default_control
from ambkit.control.stabilising_controller import holding
from ambkit.judge.modal_reduction import reduction
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.machine.axes import isolated_axes
from ambkit.machine.components import BearingAt, SensorAt
from ambkit.machine.forces.drawing import computed_force_of_both
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.machine.placement_checks import NODE
from ambkit.machine.rotors.modes import Bending
from ambkit.models.continuous import open_loop
from ambkit.models.machine_parts import machine_model
from ambkit.rotordynamics.separation_margins import separations

COUPLED = 0.01  #: Inertial coupling above which axes are not independent.
MATTERS = 0.01  #: Residual compliance, relative to the magnets', above which it is reported.
SHAKEN = 0.5  #: Share of a mode's own damping below which the loss is reported.


class Remark(NamedTuple):
    """An anomaly of a machine that may be intended."""

    text: str
    path: tuple[str | int, ...] = ()  #: Key of the machine, if there is one.


def described(machine: Machine) -> tuple[str, tuple[Remark, ...]]:
    """Return a short description of a machine, and remarks."""
    model = machine_model(machine)
    about = [
        machine.name,
        f"{len(machine.axes)} axes",
        engineering(machine.rotor.mass, "kg"),
        f"{len(machine.readings)} readings",
        f"{engineering(machine.speed * 30 / math.pi, '1')} rpm",
        f"{len(model.states)} states",
    ]
    remarks = [Remark(_of_the_poles(machine)), *of_bending(machine), *of_shared_iron(machine)]
    if machine.speed:
        remarks = [
            Remark(separations(machine).sentence()),
            Remark(default_control(machine).summary),
            *remarks,
        ]
    return "; ".join(about), tuple(remarks)


def _of_the_poles(machine: Machine) -> str:
    """Return the unstable poles, and those of the isolated axes, in words."""
    linear, masses = stiffnesses(machine), machine.effective_masses
    same: dict[tuple[str, str], list[str]] = {}
    for axis, mass, k in zip(machine.axes, masses, linear, strict=True):
        pair = engineering(mass, "kg", 4), engineering(math.sqrt(k.k_s / mass), "rad/s", 4)
        same.setdefault(pair, []).append(axis.name)
    bearings = ", ".join(
        f"{' and '.join(names)} {mass} and {pole}" for (mass, pole), names in same.items()
    )
    share = machine.coupling
    if share < COUPLED and not machine.speed:
        return f"the axes are independent; effective mass and unstable pole: {bearings}"
    poles = open_loop(machine, [k.k_s for k in linear]).unstable
    text = " and ".join(
        dict.fromkeys(
            engineering(pole.real, "rad/s", 6)
            if abs(pole.imag) < 1e-9 * pole.real
            else f"{pole.real:.6g} ± {pole.imag:.4g}j rad/s"
            for pole in poles[poles.imag >= 0]
        )
    )
    return (
        f"unstable poles without control: {text}; effective mass and unstable pole of the isolated "
        f"axes: {bearings}; inertial coupling {100 * share:.0f} %"
    )


def of_shared_iron(machine: Machine) -> Iterator[Remark]:
    """Yield what filters neglect if the axes of a bearing share their iron."""
    for at, bearing in enumerate(machine.bearings):
        if bearing.magnet.both_axes:
            axis = next(a.name for a in machine.axes if a.bearing is bearing)
            force = computed_force_of_both(machine.isolated_axis(axis)).coupling
            yield Remark(
                f"{bearing.name}: filters neglect that its axes are coupled: a force changes "
                f"by up to {engineering(force, 'N')} with the other axis",
                ("bearing", at, "magnet", "both_axes"),
            )


def of_bending(machine: Machine) -> Iterator[Remark]:
    """Yield remarks on the bending of a machine's rotor."""
    bending = machine.bending
    if bending is None:
        return
    yield Remark(_kept(machine, bending))
    yield from _left_out(machine, bending)
    compared = reduction(machine)
    if compared is not None:
        yield Remark(compared.text(), () if compared.good else ("rotor", "modes_up_to"))
    yield from _nodes(machine, bending)
    if default_control(machine).chosen.control == PIDS[0]:
        yield _held(machine, bending)


def _hertz(frequency: float) -> str:
    return engineering(frequency / (2 * math.pi), "Hz", 5)


def _kept(machine: Machine, bending: Bending) -> str:
    modes = len(bending.frequency) - bending.attached
    at = ", ".join(map(_hertz, bending.frequency[:modes]))
    count = "1 bending mode is" if modes == 1 else f"{modes} bending modes are"
    text = f"{count} kept, of the free rotor at {at}" if modes else "no bending mode is kept"
    centre = machine.rotor.centre
    if machine.rotor.type in ("shaft", "matrices"):
        text += f"; its centre of mass is at {engineering(centre, 'm')}"
    if machine.rotor.type == "modes":
        text += "; their gyroscopics are unknown and omitted"
    return text


def _left_out(machine: Machine, bending: Bending) -> Iterator[Remark]:
    """Yield the residual flexibility of truncated modes."""
    if bending.residual is None:
        return
    first = f", from {_hertz(bending.left_out[0])} on," if bending.left_out else ""
    if bending.attached:
        extra = ", ".join(map(_hertz, bending.frequency[-bending.attached :]))
        yield Remark(
            f"the static compliance of the modes left out{first} is kept by {bending.attached} "
            f"attached shapes, at {extra}"
        )
        return
    places = [bearing.place for bearing in machine.bearings if bearing.type == "radial"]
    names = [bearing.name for bearing in machine.bearings if bearing.type == "radial"]
    stiff = {
        axis.bearing.name: abs(ConstantStiffness.of(isolated).k_s)
        for axis, isolated in zip(machine.axes, isolated_axes(machine), strict=True)
    }
    shares = np.diag(bending.residual(places)) * np.array([stiff[name] for name in names])
    k = int(np.argmax(shares))
    at = engineering(shares[k] / stiff[names[k]], "m/N", 3)
    text = (
        f"the modes left out{first} have a static compliance of at most {at}, in bearing "
        f"{names[k]}: {percent(shares[k])} of the inverse of its negative stiffness"
    )
    if shares[k] > MATTERS:
        yield Remark(
            f"{text}, too much: raise rotor.modes_up_to, or set rotor.residual = true",
            ("rotor", "modes_up_to"),
        )
    else:
        yield Remark(text)


def _nodes(machine: Machine, bending: Bending) -> Iterator[Remark]:
    """Yield sensors and magnets at nodes, and nodes between them."""
    modes = len(bending.frequency) - bending.attached
    of_keys: dict[str, tuple[SensorAt | BearingAt, ...]] = {
        "sensor": machine.sensors,
        "bearing": machine.bearings,
    }
    for key, placed in of_keys.items():
        for at, entry in enumerate(placed):
            if entry.type in ("axial", "thrust"):
                continue
            out = bending.shape(entry.place)
            if nodes := _modes(bending, np.abs(out[:modes]) < NODE):
                what = "does not see it" if key == "sensor" else "does not hold it"
                yield Remark(
                    f"{key} {entry.name} at {engineering(entry.place, 'm')} is at a node of "
                    f"{nodes}, and {what}",
                    (key, at, "place"),
                )
    for at, bearing in enumerate(machine.bearings):
        radial = [sensor for sensor in machine.sensors if sensor.type != "axial"]
        if bearing.type != "radial" or not radial:
            continue
        near = min(radial, key=lambda item: abs(item.place - bearing.place))
        pull, seen = bending.shape(bearing.place), bending.shape(near.place)
        if nodes := _modes(bending, pull[:modes] * seen[:modes] < 0):
            yield Remark(
                f"a node of {nodes}, is between bearing {bearing.name} and its sensor "
                f"{near.name}: a controller that damps the measured motion excites this mode",
                ("bearing", at, "place"),
            )


def _modes(bending: Bending, which: NDArray[np.bool_]) -> str:
    """Return bending modes with their frequencies, empty for none."""
    return " and of ".join(
        f"mode {k + 1}, {_hertz(bending.frequency[k])}" for k in np.flatnonzero(which)
    )


def _held(machine: Machine, bending: Bending) -> Remark:
    """Return how the controllers of a simulation levitate the rotor, or that they do not."""
    result = holding(machine)
    if not result.held:
        pole = result.growing[0] if result.growing else complex(result.poles.real.max())
        fed = ""
        if holding(machine, "estimate").held:
            fed = ', or an estimator that feeds the controllers (feedback = "estimate")'
        delay = f"a delay of {engineering(machine.delay, 's')}" if machine.delay else "no delay"
        return Remark(
            f"no decentralised PID in the search is stable: with the best one {_hertz(pole.imag)} "
            f"grows by {pole.real:.3g}/s; the loop has {delay} and a sampling time of "
            f"{engineering(machine.sampling_time, 's')}; remedies: a shorter one, sensors nearer "
            f"to the magnets, more damping{fed or ', or another controller'}"
        )
    modes = len(bending.frequency) - bending.attached
    rates = []
    for k in range(modes):
        near = np.abs(np.abs(result.poles.imag) - bending.frequency[k]).argmin()
        rates.append(-result.poles[near].real / abs(result.poles[near]))
    worst = int(np.argmin(rates / bending.damping_ratio[:modes]))
    pid = result.pids[0]
    text = (
        f"decentralised PIDs are stable, such as kp {engineering(pid.kp, 'A/m', 4)}, "
        f"kd {engineering(pid.kd, 'A s/m', 3)}, its derivative filtered by "
        f"{engineering(pid.derivative_filter, 's', 3)}"
    )
    if rates[worst] < SHAKEN * bending.damping_ratio[worst]:
        text += (
            f"; the damping ratio of mode {worst + 1}, {_hertz(bending.frequency[worst])}, is then "
            f"{rates[worst]:.2g}"
        )
    return Remark(text)
