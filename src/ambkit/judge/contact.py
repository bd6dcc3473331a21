"""Rotors on their touch-down bearings, and what filters make of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ambkit.base.arrays import Bools
from ambkit.base.units import percent
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.contact import RESOLVED, samples_of_contact
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.machine_model import View
from ambkit.estimate.registry import KINDS
from ambkit.machine.machine import Machine

LIES = 0.01  #: Share of the samples on a stop that is worth a sentence.


def on_stop(machine: Machine, record: Record) -> Bools:
    """Return where the readings show a rotor on a stop (n,); nowhere where noise hides it."""
    view, result = View(machine), np.zeros(len(record), bool)
    gains, readings = view.gains, machine.readings
    y = np.array([record[signal("y", r.name)] for r in readings]) / gains[:, None]
    noise = 2 * max(r.sensor.noise_variance**0.5 / gain
                    for r, gain in zip(readings, gains, strict=True))  # fmt: skip
    there, at = view.H @ view.seen @ y, 0
    for bearing in machine.bearings:
        along = there[at : (at := at + 1 + (bearing.type == "radial"))]
        if noise < 0.2 * bearing.clearance:
            result |= np.linalg.norm(along, axis=0) > bearing.clearance - noise
    return result


def stop_notes(machine: Machine, filter: str) -> Iterator[str]:
    """Yield why a filter, by its full name, cannot know the stops of a machine if it should."""
    if KINDS["contact"].label not in filter:
        return
    if not any(bearing.stop for bearing in machine.bearings):
        table = "[stop]" if machine.single else "[bearing.stop]"
        yield (
            f"no bearing of {machine.name} has a stop, so contact is the extended filter: state "
            f"stiffness and damping of the touch-down bearing in {table}"
        )
    for axis, samples in zip(machine.axes, samples_of_contact(machine), strict=True):
        if samples < RESOLVED:
            yield (
                f"{axis.name or machine.name}: a contact lasts {samples:.1f} samples under the "
                f"load capacity of the bearing, {RESOLVED:g} are needed for a consistent estimate"
            )


def contact_notes(
    machine: Machine, record: Record, estimates: Mapping[str, Estimate]
) -> Iterator[str]:
    """Yield which filters do not know the force of a stop, by their names."""
    known = any(bearing.stop is not None for bearing in machine.bearings)
    contact = [name for name, one in estimates.items() if KINDS["contact"].label in one.estimator]
    for note in stop_notes(machine, KINDS["contact"].label) if contact else ():
        yield f"{', '.join(contact)}: {note}"
    table = "[stop]" if machine.single else "[bearing.stop]"
    share = float(np.mean(on_stop(machine, record)))
    others = ", ".join(name for name in estimates if not known or name not in contact)
    if share > LIES and others:
        stated = "" if known else f", once {table} states its stiffness"
        yield (
            f"{others}: the rotor lies on a stop in {percent(share)} of the samples, and the force "
            "of the stop is taken for a disturbance force there, which can make the estimate worse "
            "than the sensor; the filter contact knows it"
            f"{stated}"
        )
