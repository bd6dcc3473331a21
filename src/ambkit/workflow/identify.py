"""A bearing from records: what is looked for, what it starts from, what it is judged on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.base.quantity_arguments import Given, all_of_type, in_si, of_type
from ambkit.data.record import Record
from ambkit.identification.forces.force_map import force_map
from ambkit.identification.maximum_likelihood.axis_model import AxisModel
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.identification.noise import Noise, StandstillNoise
from ambkit.machine.force_laws import axis_named, isolated
from ambkit.machine.machine import Machine
from ambkit.workflow.identified import Identified, check_disjoint, records_of, validations


def starting_model(
    machine: Machine,
    axis: str | None = None,
    *,
    rest: StandstillNoise | None = None,
    load_std: Given | None = None,
) -> LoopModel:
    """Return the model that identification starts from."""
    load_std = in_si("load_std", load_std, "N")
    axis = axis_named(machine, axis)
    bearing = machine.isolated_axis(axis)
    seen = (rest or {}).get("y")
    if isinstance(seen, Noise):
        bearing = bearing.replace(sensor__noise_variance=seen.variance)
    load_std = math.nan if load_std is None else load_std
    if machine.single:
        return LoopModel(bearing, load_std=load_std)
    return AxisModel(bearing, load_std=load_std, machine=machine, axis=axis)


def parameters_to_find(start: LoopModel, free: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return what is looked for: what is asked for, or what a record usually tells."""
    names = usual(start) if free is None else tuple(free)
    named(names)
    return tuple(names)


def identify(
    machine: Machine,
    records: Record | Sequence[Record],
    axis: str | None = None,
    *,
    others: Sequence[Record] = (),
    names: Sequence[str] | None = None,
    rest: StandstillNoise | None = None,
    free: Iterable[str] | None = None,
    load_std: Given | None = None,
    map_forces: bool = False,
    nodes: tuple[int, int] | None = None,
    note: Callable[[str], None] = lambda _text: None,
) -> Identified:
    """Identify an axis of a machine from records of the loop, and validate what was found."""
    of_type(Machine, machine=machine)
    records, others = (all_of_type(Record, records=item) for item in (records, others))
    start = starting_model(machine, axis, rest=rest, load_std=load_std)
    looked_for = parameters_to_find(start, free)
    check_disjoint(others, records)
    if map_forces and not machine.single:
        raise AmbkitError(f"forces are mapped of one axis, {machine.name} has several")
    records, others = (records_of(start, item) for item in (records, others))
    try:
        result = maximum_likelihood(records, start, looked_for, lines=machine.single, note=note)
    except ConfigError as error:
        raise AmbkitError(
            f"what is likely under these records is no bearing that could be ({error}): does the "
            "rotor lie on a stop, or are they of another rig?"
        ) from None
    checks = validations(result, others or records, names)
    forces = None
    if map_forces:
        forces = force_map(result.model, records, nodes=nodes, settling=result.settling, note=note)
    return Identified(
        isolated(machine, axis), records, result, checks, bool(others), rest or {}, forces
    )
