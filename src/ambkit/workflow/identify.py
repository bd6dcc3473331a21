"""Identification from records: model, initial values, validation."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ambkit import arguments
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.base.quantity_arguments import QuantityLike, all_of_type, in_si, names_in, of_type
from ambkit.data.reading import load
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_saving import made_by
from ambkit.identification.coil import CoilFit, fit_coil
from ambkit.identification.corpus.corpus import Corpus, identify_corpus
from ambkit.identification.forces.force_map import force_map
from ambkit.identification.maximum_likelihood.axis_model import AxisModel
from ambkit.identification.maximum_likelihood.load_steps import fit_between_load_steps
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.identification.noise import Noise, StandstillNoise, standstill_noise
from ambkit.identification.online import comparison
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.machine.axes import axis_named, isolated
from ambkit.machine.machine import Machine
from ambkit.workflow.identified import (
    Identified,
    check_disjoint,
    check_mappable,
    filter_following_load,
    validations,
)


def starting_model(
    machine: Machine,
    axis: str | None = None,
    *,
    rest: StandstillNoise | None = None,
    load_std: Any = None,
) -> LoopModel:
    """Return the initial model of an identification."""
    load_std = in_si("load_std", load_std, "N")
    axis = axis_named(machine, axis)
    of_axis = machine.isolated_axis(axis)
    seen = (rest or {}).get("y")
    if isinstance(seen, Noise):
        of_axis = of_axis.replace(sensor__noise_variance=seen.variance)
    load_std = math.nan if load_std is None else load_std
    if machine.single:
        return LoopModel(of_axis, load_std=load_std)
    return AxisModel(of_axis, load_std=load_std, machine=machine, axis=axis)


def identify(
    machine: Machine,
    records: Record | Sequence[Record],
    axis: str | None = None,
    *,
    others: Sequence[Record] = (),
    names: Sequence[str] | None = None,
    rest: StandstillNoise | None = None,
    free: Iterable[str] | None = None,
    load_std: QuantityLike | None = None,
    map_forces: bool = False,
    nodes: tuple[int, int] | None = None,
    note: Callable[[str], None] = lambda _text: None,
) -> Identified:
    """Identify an axis of a machine from closed-loop records, and validate it."""
    of_type(Machine, machine=machine)
    records, others = (all_of_type(Record, records=item) for item in (records, others))
    start = starting_model(machine, axis, rest=rest, load_std=load_std)
    looked_for = usual(start) if free is None else tuple(free)
    named(looked_for)
    check_disjoint(others, records)
    if map_forces:
        check_mappable(machine)
    records, others = ([start.record(one) for one in item] for item in (records, others))
    try:
        result, parts, structure = fit_between_load_steps(
            records, start, looked_for, lines=machine.single, note=note
        )
    except ConfigError as error:
        raise AmbkitError(
            f"the most likely parameters are not physical ({error}): does the rotor hardly "
            "move, is it in contact, or are the records of another machine?"
        ) from None
    checks = validations(result, records, parts, others, names, structure.suspect)
    forces = None
    if map_forces:
        forces = force_map(result.model, parts, nodes=nodes, settling=result.settling, note=note)
    return Identified(
        isolated(machine, axis),
        records,
        parts,
        result,
        checks,
        bool(others),
        rest or {},
        structure,
        forces,
    )


LEAST = 3  #: Minimum number of logs of a corpus: fewer cannot be validated by each other.

Note = Callable[[str], None]


def by_likelihood(
    machine: Any, records: Any, axis: str | None, channels: Any, window: Any, *, free: Any,
    validate: Any, rest: Any, load_std: Any, nodes: Any, note: Note,
) -> Identified:  # fmt: skip
    """Identify an axis of a machine from records, and validate it."""
    known = arguments.machine_argument(machine)
    rest_noise = standstill(rest, channels)
    starting_model(known, axis, rest=rest_noise, load_std=load_std)
    named(tuple(free or ()))
    sources, others = (names_in(Record, records=item) for item in (records, validate))
    _refuse_shared(sources, others)
    logs, other_logs = (
        arguments.record_arguments(item, known, channels, window) for item in (sources, others)
    )
    names = [Path(item).name if isinstance(item, str | os.PathLike) else f"record {k}"
             for k, item in enumerate(others or sources, 1)]  # fmt: skip
    with arguments.arguments_of_the_user():
        result = identify(
            known, logs, axis, others=other_logs, names=names, rest=rest_noise, free=free,
            load_std=load_std, map_forces=nodes is not None, nodes=_nodes(nodes), note=note,
        )  # fmt: skip
    source = ", ".join(Path(s).name for s in sources if isinstance(s, str | os.PathLike))
    return replace(result, inputs=arguments.inputs_argument(channels), source=source)


def _refuse_shared(records: list[Any], others: list[Any]) -> None:
    # Path.resolve raises for circular links; reading the record reports them
    read, validated = (
        {os.path.realpath(item) for item in items if isinstance(item, str | os.PathLike)}
        for items in (records, others)
    )
    if same := read & validated:
        raise AmbkitError(
            f"{Path(next(iter(same))).name} is to be identified from and validated on: a model is "
            "judged on a record that it has not seen"
        )


def standstill(rest: Any, channels: Any) -> dict[str, Any]:
    """Return the noise of each signal of a standstill record, with its own channel map if named."""
    if rest is None:
        return {}
    if isinstance(rest, Record):
        return standstill_noise(rest)
    file, _, own = os.fspath(rest).partition("@")
    return standstill_noise(load(file, own or channels))


def _nodes(nodes: Any) -> tuple[int, int] | None:
    """Return the nodes along current and displacement, from ``"9x7"``, or ``"9"`` for both."""
    if nodes is None:
        return None
    sides = nodes.lower().split("x") if isinstance(nodes, str) else [str(side) for side in nodes]
    if len(sides) > 2 or not all(side.isdecimal() and 4 <= int(side) <= 33 for side in sides):
        raise AmbkitError(
            "nodes must be nodes along current and displacement such as 9x7, 4 to 33 each, is "
            f"{nodes!r}"
        )
    return int(sides[0]), int(sides[-1])


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedCorpus(Corpus):
    """A machine identified from many logs, with its filter."""

    known: Machine | None = None  #: Prior.

    @cached_property
    def filter(self) -> Estimator:
        """The extended filter of the pooled parameters."""
        made, raised = filter_following_load(self.machine, self.model.disturbance_noise)
        origin = made_by("identify", f"likelihood of {len(self.by_log)} logs")
        keys = ("noise.measurement", "noise.control", "noise.disturbance") * self.machine.single
        made.origin = dict.fromkeys(keys, origin) | raised
        return made

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether the filter is adequate."""
        return judge_adequacy(self.filter)

    @property
    def notes(self) -> list[str]:
        return [*super().notes, *sentences(self.adequacy)]

    @property
    def series(self) -> dict[str, Any]:
        known = {} if self.known is None else {"machine": self.known.name}
        return dict(super().series) | known

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        self.machine.save(path)

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the filter."""
        self.filter.save(path, machine=beside.get(".toml"))


def by_corpus(
    known: Machine, start: LoopModel, records: Any, channels: Any, window: Any, *, free: Any,
    note: Note,
) -> IdentifiedCorpus:  # fmt: skip
    """Identify each log, pool the results, and predict each log by the others."""
    paths = [Path(path) for path in names_in(records=records)]
    names = [path.name for path in paths]
    if len(names) < LEAST:
        raise AmbkitError(f"a corpus has {LEAST} logs or more, {len(names)} are given")
    if len(set(names)) < len(names):
        raise AmbkitError("two logs of a corpus have the same name")
    note("reading the logs")
    read = arguments.record_arguments([str(path) for path in paths], known, channels, window)
    logs = dict(zip(names, map(start.record, read), strict=True))
    corpus = identify_corpus(logs, start, free, note=note)
    return IdentifiedCorpus(**vars(corpus), known=known)


def online(
    machine: Any, record: Any, axis: str | None, channels: Any, window: Any, *, method: str,
    initial: Any, disturbance: Any,
) -> comparison.OnlineComparison:  # fmt: skip
    """Identify the magnet constant by all methods; one of them defines the resulting machine."""
    known = arguments.machine_argument(machine)
    model = starting_model(known, axis)
    start = in_si("initial", initial, "N m^2/A^2")
    if start is not None and not start > 0:
        raise AmbkitError(f"initial must be greater than 0, is {start:g} N m^2/A^2")
    (log,) = arguments.record_arguments(record, known, channels, window)
    if isinstance(disturbance, str):
        if disturbance in log:
            disturbance = log[disturbance]
        else:
            try:
                disturbance = in_si("disturbance", disturbance, "N")
            except AmbkitError as error:
                hint = f"or a signal of the record: {', '.join(log)}"
                raise AmbkitError(f"{error}, {hint}") from None
    log = model.record(log)
    with arguments.arguments_of_the_user():
        force = model.force_of_others(log) + (0.0 if disturbance is None else disturbance)
        result = comparison.compare_online(
            log, model.isolated, start=start, disturbance=force, method=method
        )
    if not known.single:
        result = replace(result, several=known)
    if method != "all":
        _ = result.machine  # raises if nothing was identified
    return result


def coil(
    machine: Any, records: Any, axis: str | None, channels: Any, window: Any, *,
    operating_point: Any, note: Note,
) -> CoilFit:  # fmt: skip
    """Identify a coil from steps of its control signal."""
    known = isolated(arguments.machine_argument(machine), axis)
    paths = [Path(path) for path in names_in(records=records)]
    logs = [arguments.record_argument(path, channels, window) for path in paths]
    fit = fit_coil(logs, [path.name for path in paths], note=note)
    at = in_si("operating_point", operating_point, "m")
    return replace(fit, known=known, operating_point=at)
