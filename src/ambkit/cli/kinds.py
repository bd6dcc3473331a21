"""The estimators that a user can name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli import printing
from ambkit.cli.parameters import only_axis
from ambkit.estimate.registry import KINDS, check_named, kind_called

if TYPE_CHECKING:
    from ambkit.assessment.arguments import Chosen
    from ambkit.estimate.named import Factory
    from ambkit.machine.machine import Bearing, Machine

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
    with printing.progress("training the expert"):
        return built(chosen, machine, synchronous=synchronous)


def to_export(
    target: str, estimator: str | None, choice: Sequence[str] = NAMES
) -> tuple[Machine, Chosen]:
    """Return the machine and the estimator that a user wants to export."""
    from ambkit.assessment.arguments import export_given

    return export_given(target, estimator, choice)


def axis_to_export(
    target: str, estimator: str | None, choice: Sequence[str] = NAMES
) -> tuple[Bearing, Chosen]:
    """Return the machine with one axis and the estimator that a user wants to export."""
    machine, result = to_export(target, estimator, choice)
    return only_axis(machine, target), result
