"""Values of a machine and a run by dotted keys, such as ``magnet.air_gap``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel

from ambkit.base.config.document import Document, updated
from ambkit.base.config.problems import expected_quantity, fields_of, names_of, unknown_key
from ambkit.base.config.quantities import InOther, Quantity, SignalIn
from ambkit.base.config.toml_text import flattened, nested
from ambkit.base.errors import AmbkitError
from ambkit.machine.forces.drawing import drawing_of
from ambkit.machine.parts import Magnet, magnet_constant

OF_RUN = "scenario."  #: Prefix of the run's keys; all others are the machine's.


class Key(NamedTuple):
    """The value at a key."""

    value: Any  #: Current value in SI; None if unset.
    unit: str  #: SI unit of a number; empty for a word.
    above: float | None = None  #: Exclusive lower limit of a number.
    at_least: float | None = None

    def allows(self, number: float) -> bool:
        """Whether a number is within the limits."""
        above = self.above is None or number > self.above
        return above and (self.at_least is None or number >= self.at_least)


def key_in(model: Document, key: str) -> Key:
    """Return the value at a key of a description."""
    here: Any = model
    place: SignalIn | None = None
    quantity: Quantity | None = None
    for step in _steps(model, key):
        if isinstance(here, tuple):
            here = _part(here, step, key)
            continue
        if _in_drawing(here, step):
            here = drawing_of(here.force_map, dict(here.drawing))
            continue
        fields = fields_of(type(here)) if isinstance(here, BaseModel) else {}
        if step not in fields:
            known = list(model.tables() if here is model else fields)
            raise AmbkitError(f"there is no key {key} to vary: {unknown_key(step, known)}")
        field = fields[step]
        place = next((mark for mark in field.metadata if isinstance(mark, SignalIn)), place)
        quantity, here = expected_quantity(field), _value(here, step)
    if isinstance(here, BaseModel | tuple | dict):
        raise AmbkitError(f"{key} is a table: name one of its keys")
    if quantity is None:
        return Key(here, "1" if isinstance(here, float) else "")
    unit = quantity.unit.replace("@", place.unit if place else "1")
    return Key(here, unit, quantity.above, quantity.at_least)


def by_places(model: Document, key: str) -> str:
    """Return a key with indices instead of names, unique for each quantity."""
    here: Any = model
    steps = []
    for step in _steps(model, key):
        if isinstance(here, tuple):
            at = next(at for at, item in enumerate(here) if step in _called(item, at))
            here, step = here[at], str(at)
        elif _in_drawing(here, step):
            here = drawing_of(here.force_map, dict(here.drawing))
        else:
            here = _value(here, step)
        steps.append(step)
    return ".".join(steps)


def _in_drawing(part: Any, step: str) -> bool:
    """Return whether the next keys are those of a magnet's drawing."""
    return step == "drawing" and isinstance(part, Magnet) and part.has_drawing


def _steps(model: Document, key: str) -> list[str]:
    """Return the steps to a key; the short form of a machine with one axis is expanded."""
    return model._long_key(key).split(".")


def _value(part: BaseModel, key: str) -> Any:
    return getattr(part, names_of(type(part))[key])


def _part(parts: tuple[Any, ...], step: str, key: str) -> Any:
    """Return an element of a list by name or index."""
    for at, part in enumerate(parts):
        if step in _called(part, at):
            return part
    known = [_called(item, at)[0] for at, item in enumerate(parts)]
    raise AmbkitError(f"there is no key {key} to vary: {unknown_key(step, known)}")


def _called(part: Any, at: int) -> tuple[str, ...]:
    """Return the names of a list's element: its name, if it has one, and its index."""
    name = getattr(part, "name", None)
    return (str(at),) if name is None else (str(name), str(at))


def changed(model: Any, values: Mapping[str, Any]) -> Any:
    """Return a copy of a frozen description with values changed at dotted keys, unchecked."""
    return _changed(model, nested((_steps(model, key), value) for key, value in values.items()))


def _changed(model: Any, tree: Mapping[str, Any]) -> Any:

    def other(old: Any, name: str) -> Any:
        if name not in tree:
            return old
        new = tree[name]
        return _changed(old, new) if isinstance(new, dict) else InOther.like(old, new)

    if isinstance(model, tuple):
        results = []
        for at, item in enumerate(model):
            for name in _called(item, at):
                item = other(item, name)
            results.append(item)
        return tuple(results)
    if isinstance(model, Magnet):
        return _magnet(model, dict(tree))
    names = names_of(model.__class__)
    return updated(model, {names[key]: other(_value(model, key), key) for key in tree})


def _magnet(magnet: Magnet, values: dict[str, Any]) -> Magnet:
    """Return a magnet with other values, with coil and constant kept consistent."""
    # The constant follows from turns and area; if the constant varies, the coil is omitted.
    if "drawing" in values:
        other = dict(magnet.drawing) | flattened(values["drawing"])
        values["drawing"] = tuple(other.items())
    if "magnet_constant" in values:
        new = magnet.with_constant(values.pop("magnet_constant"))
        values |= {key.removeprefix("magnet__"): value for key, value in new.items()}
    turns, area, angle = (
        values.get(name, getattr(magnet, name)) for name in ("turns", "pole_area", "pole_angle")
    )
    if turns is not None and area is not None:
        values["magnet_constant"] = magnet_constant(turns, area, angle or 0.0)
    return updated(magnet, values)
