"""The estimators that a user can name."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli import output
from ambkit.cli.options import find_machine, only_axis
from ambkit.estimate.registry import FILTER_SUFFIX, KINDS, check_named, kind_called, learned_magnet

if TYPE_CHECKING:
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.estimate.named import Factory
    from ambkit.machine.machine import Bearing, Machine
    from ambkit.machine.magnets import MagnetModel

NAMES = tuple(KINDS)


def estimator_option(choice: Iterable[str]) -> Any:
    """Return the option that takes a file with an expert, or one of these names."""
    return typer.Option(
        "--estimator",
        "--filter",
        metavar="FILE",
        help="A filter's file (.toml), from 'ambkit tune'; or an expert for the adaptive filter, "
        "from 'ambkit train', or a force map (.csv); or a name: "
        f"{', '.join(choice)}. The linear filter without it.",
    )


def names(text: str) -> list[str]:
    """Split a list of estimators, such as ``linear,closed-law``; each counts once."""
    return list(dict.fromkeys(part.strip() for part in text.split(",")))


def known(text: str) -> str:
    """Check such a list, as the callback of an option."""
    try:
        for name in names(text):
            check_named(name)
    except AmbkitError as error:
        raise typer.BadParameter(str(error)) from None
    return text


def one_of(text: str) -> str:
    """Check the name of one kind, or a filter's file, as the callback of an option."""
    if text == "all" or "," in text:
        raise typer.BadParameter(f"a loop has one estimator, given are {text}")
    return known(text)


def is_a_name(name: str) -> str:
    """Check the name of one kind, as the callback of an option."""
    try:
        return kind_called(name).name
    except AmbkitError as error:
        raise typer.BadParameter(str(error)) from None


def factories(
    chosen: Iterable[str],
    machine: Machine,
    expert: Path | None = None,
    synchronous: Sequence[str] = (),
) -> dict[str, Factory]:
    """Return what builds each of the chosen estimators, as often as asked."""
    from ambkit.estimate.experts import experts
    from ambkit.estimate.named import expanded
    from ambkit.estimate.named import factories as built

    chosen = expanded(chosen)
    if expert is not None and "adaptive" not in chosen:
        raise AmbkitError("--expert is for --estimator adaptive, which is not among those chosen")
    magnets = {"adaptive": experts(expert, machine)} if expert is not None else {}
    if "adaptive" not in chosen or magnets:
        return built(chosen, machine, magnets, synchronous)
    with output.progress("training the expert"):
        return built(chosen, machine, synchronous=synchronous)


class Chosen(NamedTuple):
    """A kind of estimator to export, and what it asks for k_i and k_s; None for the kind's own."""

    kind: str
    magnet: MagnetModel | None
    file: FilterFile | None = None
    """The filter whose kind and magnet these are, where it is in a file."""


def exported(text: str | None, machine: Machine, choice: Iterable[str] = NAMES) -> Chosen:
    """Return the estimator that a user names, or the adaptive filter of the expert in a file."""
    from ambkit.estimate.experts import experts
    from ambkit.estimate.filter_file import FilterFile

    if text is None or text in choice:
        return Chosen(text or "linear", _learned(text or "linear", machine))
    if text in NAMES:
        raise AmbkitError(f"--estimator: {text} cannot be exported yet; {', '.join(choice)} can")
    path = Path(text)
    if path.suffix == FILTER_SUFFIX:
        found = FilterFile.load_for(text, machine)
        if found.kind not in choice:
            raise AmbkitError(
                f"{path}: {found.kind} cannot be exported so; {', '.join(choice)} can"
            )
        return Chosen(found.kind, found.asked(), found)
    if not (path.suffix or path.exists() or os.sep in text):
        near = difflib.get_close_matches(text, choice, 1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(choice)}"
        raise AmbkitError(f'--estimator: there is no estimator and no file "{text}"; {hint}')
    return Chosen("adaptive", experts(path, machine))


def to_export(
    target: str, estimator: str | None, choice: Iterable[str] = NAMES
) -> tuple[Machine, Chosen]:
    """Return the machine and the estimator that a user wants to export."""
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.workflow.given import is_filter

    if not is_filter(target):
        machine = find_machine(target)
        return machine, exported(estimator, machine, choice)
    if estimator is not None:
        raise AmbkitError(f"{target} is a filter already: leave out --estimator")
    machine = FilterFile.load(target).plant
    return machine, exported(target, machine, choice)


def axis_to_export(
    target: str, estimator: str | None, choice: Iterable[str] = NAMES
) -> tuple[Bearing, Chosen]:
    """Return the machine with one axis and the estimator that a user wants to export."""
    machine, found = to_export(target, estimator, choice)
    return only_axis(machine, target), found


def _learned(name: str, bearing: Machine) -> MagnetModel | None:
    """Return what is learned for a kind; None where it knows by itself."""
    if name != "adaptive":
        return learned_magnet(name, bearing)
    with output.progress("training the expert"):
        return learned_magnet(name, bearing)
