"""Declarations of the parts of a machine for its continuous model, before sampling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Protocol

from ambkit.models.model import Descriptor


class Unit(float):
    """One in every machine of a kind."""

    def __reduce__(self) -> str:
        return "UNIT"  # its identity distinguishes it


UNIT: Final = Unit(1.0)  #: One by structure; 1.0 may be another number in another machine.
Row = Mapping[str, float]  #: Coefficients by name; named ones are in the pattern, zero or not.
Place = str | Row  #: A position of the rotor, or a combination of several.


def row(place: Place) -> dict[str, float]:
    """Return a place as a linear form of coordinates."""
    return {place: UNIT} if isinstance(place, str) else dict(place)


def place(form: Mapping[str, float]) -> Place:
    """Return a linear form of the coordinates, with a structural one along a coordinate."""
    return {q: UNIT if q in "xyz" and value == 1 else value for q, value in form.items()}


class Part(Protocol):
    """One part of a machine."""

    def declare(self, plan: Plan) -> None:
        """Declare its contribution; names may be declared by a later part."""


class Plan:
    """The continuous linear model as a list of named terms."""

    # States, forces and controls share one name space; each may drive a state. States are in the
    # order of declaration.

    def __init__(self, T: float) -> None:
        self.T = T
        self.states: list[Descriptor] = []
        self.owner: list[int] = []
        self.forces: list[Descriptor] = []
        self.controls: list[Descriptor] = []
        self.measurements: list[Descriptor] = []
        self.noises: list[Descriptor] = []
        self.rates: dict[tuple[str, str], float] = {}
        self.inertia: dict[str, Row] = {}
        self.pushes: dict[str, Row] = {}
        self.riders: dict[str, str] = {}
        self.places: dict[str, Row] = {}
        self.currents: dict[str, str] = {}
        self.k_i: dict[str, float] = {}
        self.past: dict[str, tuple[list[str], float]] = {}
        self.readings: list[dict[str, float]] = []
        self.sources: list[tuple[Row, bool]] = []
        self.rests: dict[str, Row] = {}
        self._parts = 0

    def add(self, part: Part) -> None:
        """Let a part declare its contribution."""
        part.declare(self)
        self._parts += 1

    def state(self, name: str, unit: str, size: float, role: str, start: float = 1.0) -> None:
        """Add a state."""
        self.states.append(replace(self._named(name, unit, size, role), start=start))
        self.owner.append(self._parts)

    def rate(self, state: str, by: str, value: float) -> None:
        """Add the term value [1/s, times the units] of a state or control to a state's rate."""
        self.rates[state, by] = self.rates.get((state, by), 0.0) + value

    def force(self, name: str, size: float, place: Place, k_i: float | None = None) -> None:
        """Add a magnet force at a place, which depends on the displacement there."""
        # Held over a sample, except for the effect of its current by a current stiffness k_i [N/A].
        self.forces.append(self._named(name, "N", size, "magnet force"))
        self.places[name] = row(place)
        self.pushes[name] = row(place)
        if k_i is not None:
            self.k_i[name] = k_i

    def varies(self, force: str) -> bool:
        """Return whether a force with a current stiffness changes within a sample."""
        # A commanded current is held, unless a dead time ends within the sample.
        current = self.currents.get(force, "")
        held = current in {at.name for at in self.controls}
        return force in self.k_i and (not held or self.past.get(current, ([], 1.0))[1] < 1)

    def push(self, state: str, place: Place) -> None:
        """Let a state [N] act on the rotor at a place without a magnet."""
        self.pushes[state] = row(place)

    def act_by(self, force: str, *states: str) -> None:
        """Let states [N] that lag a magnet's force replace it; collocated inputs do not lag."""
        place = self.pushes.pop(force)
        self.pushes |= dict.fromkeys(states, place)
        for rider in [rider for rider, of in self.riders.items() if of == force]:
            del self.riders[rider]
            self.pushes[rider] = place

    def control(self, name: str, size: float) -> None:
        """Add an amplifier's commanded current."""
        self.controls.append(self._named(name, "A", size, "control current"))

    def measure(self, name: str, unit: str, size: float, reading: Row) -> None:
        """Add a measurement, a linear form of the state."""
        self.measurements.append(Descriptor(name, unit, size, "position sensor"))
        self.readings.append(dict(reading))

    def add_to_reading(self, measurement: str, reading: Row) -> None:
        """Add a linear form of the state to an existing measurement."""
        names = [at.name for at in self.measurements]
        if measurement not in names:
            raise ValueError(f"no measurement {measurement}; there are {', '.join(names)}")
        self.readings[names.index(measurement)].update(reading)

    def noise(self, name: str, unit: str, size: float, intensity: Row, *, walk: bool) -> None:
        """Add a noise source, white and independent in each state that it drives."""
        role = "random walk" if walk else "noise"
        self.noises.append(Descriptor(name, unit, size, role))
        self.sources.append((dict(intensity), walk))

    def rest(self, state: str, values: Row) -> None:
        """State the equilibrium of a state."""
        self.rests[state] = dict(values)

    @property
    def structure(self) -> Any:
        """Return what determines the sampled pattern without dead time."""
        return _structure(vars(self))

    def check(self) -> None:
        """Check that names refer to declared states, forces and controls."""
        forces, controls = ({at.name for at in of} for of in (self.forces, self.controls))
        for state, force in self.riders.items():
            if force not in forces:
                raise ValueError(f"{state} is collocated with {force}, not a magnet")
        for force, current in self.currents.items():
            if force not in forces:
                raise ValueError(f"{current} feeds {force}, which is no magnet's force")
        for control in self.past:
            if control not in controls:
                raise ValueError(f"no amplifier has the demanded current {control}, which is late")
        for source, places in self.pushes.items():
            for position in places:
                if position not in self.inertia:
                    raise ValueError(f"{source} pushes at {position}, which is no position")

    def _named(self, name: str, unit: str, size: float, role: str) -> Descriptor:
        used_names = {at.name for at in (*self.states, *self.forces, *self.controls)}
        if name in used_names:
            raise ValueError(f"there are two of the name {name}")
        return Descriptor(name, unit, size, role)


def _structure(item: Any) -> Any:
    """Return nested values without their numbers, except for structural ones."""
    if isinstance(item, Descriptor):
        return item.name
    if isinstance(item, dict):
        return tuple((key, _structure(value)) for key, value in item.items())
    if isinstance(item, list | tuple):
        return tuple(map(_structure, item))
    return None if isinstance(item, float) and item is not UNIT else item
