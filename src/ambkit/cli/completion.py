"""Completion of commands, options and files in shells, by shtab."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ambkit.cli.catalogue import GROUPS, VERBS, Misused, summary, verb_called, within
from ambkit.cli.from_verbs import parser_of

SHELLS = ("bash", "zsh", "tcsh")


def script(arguments: Sequence[str]) -> str:
    """Return the script that a shell sources."""
    import shtab

    if len(arguments) != 1 or arguments[0] not in SHELLS:
        raise Misused(f"--print-completion takes one of {', '.join(SHELLS)}", "ambkit")
    return shtab.complete(_tree(), arguments[0])


def _tree() -> argparse.ArgumentParser:
    """Return one parser of all commands: first words, and second ones below them."""
    top = argparse.ArgumentParser("ambkit")
    top.add_argument("--version", action="store_true", help="Print the version.")
    top.add_argument("--debug", action="store_true", help="With an error, show its place.")
    commands = top.add_subparsers()
    for first in dict.fromkeys(name.partition(" ")[0] for name in VERBS):
        parser = commands.add_parser(
            first, help=summary(first), parents=_parents(first), add_help=False
        )
        below = within(first)
        if below:
            more = parser.add_subparsers()
            for name in below:
                second = name.partition(" ")[2]
                more.add_parser(second, help=summary(name), parents=_parents(name), add_help=False)
    return top


def _parents(name: str) -> list[argparse.ArgumentParser]:
    """Return the parser of a command, whose operands that are files are completed as such."""
    if name in GROUPS:
        return []
    import shtab

    parser = parser_of(name, verb_called(name))
    for action in parser._actions:
        if action.nargs != 0 and action.choices is None:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return [parser]
