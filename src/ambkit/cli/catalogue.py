"""The commands: their verbs, outputs and names in the shell."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, cast

from ambkit.base.errors import AmbkitError

COMMANDS = {
    "Describe": {
        "presets": "presets:presets",
        "check": "check:check",
        "schema": "check:schema",
        "workbench": "workbench:workbench",
        "magnet": "magnet:magnet",
        "rotor": "rotor:campbell",
        "rotor modes": "rotor:mode_shapes",
        "rotor unbalance": "rotor:unbalance_response",
        "rotor waterfall": "rotor:waterfall",
    },
    "Measure": {
        "excite": "excite:excite",
        "excite sensitivity": "excite:excite_sensitivity",
        "read": "read:read",
        "read guess": "read:guess_channels",
        "identify": "identify:identify",
        "identify corpus": "identify:identify_corpus",
        "identify online": "identify:identify_online",
        "identify lift-off": "identify:identify_lift_off",
        "identify coil": "identify:identify_coil",
    },
    "Design": {
        "train": "train:train",
        "train map": "train:train_map",
        "tune": "tune:tune",
        "tune robust": "tune:tune_robust",
        "tune trade-off": "tune:tune_trade_off",
        "design": "design:design",
    },
    "Run": {"simulate": "simulate:simulate", "filter": "filter:filter"},
    "Evaluate": {
        "compare": "compare:compare",
        "compare steps": "compare:compare_steps",
        "assess": "assess:assess",
        "assess sweep": "assess:assess_sweep",
        "assess speed": "assess:assess_speed",
        "assess log": "assess:assess_log",
        "faults": "faults:inject_faults",
        "diagnose": "diagnose:diagnose",
        "diagnose limits": "diagnose:diagnose_limits",
        "campaign": "campaign:campaign",
        "campaign run": "campaign:campaign",
        "campaign status": "campaign:campaign_status",
        "campaign report": "campaign:campaign_report",
        "campaign replay": "campaign:campaign_replay",
        "campaign rare": "campaign:campaign_rare",
        "campaign problem": "campaign:campaign_problem",
    },
    "Deploy": {
        "export c": "export:export_c",
        "export cost": "export:export_cost",
        "export fmu": "export:export_fmu",
        "export ssp": "export:export_ssp",
        "export a2l": "export:export_a2l",
        "export mat": "export:export_mat",
        "pil": "pil:pil",
    },
    "Paper": {"reproduce": "reproduce:reproduce"},
}
"""Module and function of each command, by purpose."""

VERBS = {name: place for of in COMMANDS.values() for name, place in of.items()}

GROUPS = {"export": "Export a filter as C, FMU, A2L or MAT-file."}
"""First words that are no commands by themselves."""

RECORDS = (".csv", ".parquet")
FOLDER = ("DIR",)

MAKES: Mapping[str, Mapping[str, Sequence[str]]] = {
    "identify": {"": (".toml",), "filter": (".toml",), "force-map": RECORDS},
    "identify corpus": {"": (".toml",), "filter": (".toml",)}, "identify online": {"": (".toml",)},
    "identify lift-off": {"": (".toml",)}, "identify coil": {"": (".toml",)},
    "train": {"": (".json",), "filter": (".toml",)},
    "train map": {"": (".json", ".csv", ".parquet", ".toml"), "filter": (".toml",)},
    "simulate": {"": RECORDS}, "filter": {"": RECORDS},
    "compare": {"": RECORDS, "filters": FOLDER}, "compare steps": {"": RECORDS},
    "excite": {"": RECORDS}, "excite sensitivity": {"": RECORDS}, "faults": {"": RECORDS},
    "magnet": {"": RECORDS},
    "pil": {"": RECORDS}, "tune": {"": (".toml",)}, "tune robust": {"": (".toml",)},
    "read": {"": RECORDS}, "presets": {"": (".toml",)}, "read guess": {"": (".toml",)},
    "schema": {"": (".json",)}, "workbench": {"": (".html",)}, "campaign problem": {"": (".json",)},
    "export fmu": {"": (".fmu",)}, "export ssp": {"": (".ssp",)}, "export a2l": {"": (".a2l",)},
    "export mat": {"": (".mat",)},
    "campaign replay": {"": RECORDS, "estimates": RECORDS, "machine": (".toml",)},
}  # fmt: skip
"""File types of a command besides those of all results, by the name in WHAT=FILE."""

PICTURES = (".png", ".svg", ".pdf", ".html")
ROWS = (".json", ".csv", ".tex", ".html")  #: File types of every result.

BEGIN = """Kalman filters for magnetic bearings, from a machine or a recording to C code.

    ambkit presets zittau_axial > my.toml
    ambkit simulate my.toml --step "0.3 mm" --out run.csv
    ambkit filter run.csv --machine my.toml --plot run.png
"""
"""Introduction of ``ambkit --help``."""


class Misused(AmbkitError):
    """An invalid command line."""

    def __init__(self, message: str, command: str | None) -> None:
        super().__init__(message)
        self.command = command


def verb_called(name: str) -> Callable[..., Any]:
    """Return the verb of a command."""
    module, _, function = VERBS[name].partition(":")
    return cast(Callable[..., Any], getattr(import_module(f"ambkit.verbs.{module}"), function))


def products(name: str, verb: Callable[..., Any]) -> Mapping[str, Sequence[str]]:
    """Return the file types of a command, by the name in WHAT=FILE."""
    makes = MAKES.get(name, {})
    own = tuple(makes.get("", ()))
    rows = (
        ()
        if returns(verb) in ("Document", "Workbench")
        else tuple(end for end in ROWS if end not in own)
    )
    return {"": own + rows} | {what: ends for what, ends in makes.items() if what}


def returns(verb: Callable[..., Any]) -> str:
    """Return the name of the type that a verb returns."""
    return str(verb.__annotations__.get("return", ""))


def summary(name: str) -> str:
    """Return a line on a command."""
    return GROUPS.get(name) or (verb_called(name).__doc__ or "").partition("\n")[0]


def within(name: str) -> list[str]:
    """Return the commands that begin with the name of another one."""
    return [other for other in VERBS if other.startswith(f"{name} ")]


def listing(names: Sequence[str], width: int = 0) -> str:
    """Return a line for each of several commands."""
    column = max(width, *map(len, names)) + 2
    return "\n".join(f"  {name.ljust(column)}{summary(name)}" for name in names)


def front() -> str:
    """Return the text of ``ambkit --help``."""
    purposes = {
        title: tuple(dict.fromkeys(name.partition(" ")[0] for name in of))
        for title, of in COMMANDS.items()
    }
    width = max(len(name) for names in purposes.values() for name in names)
    sections = "\n".join(f"{title}:\n{listing(names, width)}" for title, names in purposes.items())
    return (
        f"usage: ambkit COMMAND ...\n\n{BEGIN}\n{sections}\n\n"
        "Options:\n"
        "  -h, --help                    Show this help, or that of a command.\n"
        "  --version                     Print the version.\n"
        "  --debug                       Print the traceback of an error.\n"
        "  --print-completion SHELL      Print a completion script for bash, zsh or tcsh.\n"
    )


def of_group(name: str) -> str:
    """Return the help of a first word that is no command by itself."""
    commands = listing(within(name))
    return f"usage: ambkit {name} COMMAND ...\n\n{GROUPS[name]}\n\nCommands:\n{commands}\n"


def called(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return the command of a command line, of one word or two, and its arguments."""
    count = 2 if " ".join(arguments[:2]) in VERBS else 1
    return " ".join(arguments[:count]), arguments[count:]


def unknown(name: str, following: Sequence[str]) -> Misused:
    """Return the error for an unknown command, with the most similar one."""
    words = f"{name} {following[0]}" if name in GROUPS and following else name
    near = difflib.get_close_matches(words, [*VERBS, *GROUPS], 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    return Misused(f"there is no command {words}{hint}", "ambkit")
