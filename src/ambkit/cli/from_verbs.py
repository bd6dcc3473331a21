"""Commands made from verbs: options from their signatures, help from their docstrings."""

from __future__ import annotations

import argparse
import difflib
import inspect
import os
import re
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from textwrap import fill
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Union,
    cast,
    get_args,
    get_origin,
)

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.result.result import Result

VERBS = {
    "assess": "assess:assess",
    "assess sweep": "assess:assess_sweep",
    "assess speed": "assess:assess_speed",
    "assess log": "assess:assess_log",
    "design": "design:design",
    "excite": "excite:excite",
    "excite sensitivity": "excite:excite_sensitivity",
    "faults": "faults:inject_faults",
    "rotor": "rotor:campbell",
    "rotor modes": "rotor:mode_shapes",
    "rotor unbalance": "rotor:unbalance_response",
    "pil": "pil:pil",
    "tune": "tune:tune",
    "tune robust": "tune:tune_robust",
    "tune trade-off": "tune:tune_trade_off",
}
"""Module and function of each command."""

MAKES = {
    "excite": (".parquet",), "excite sensitivity": (".parquet",), "faults": (".parquet",),
    "pil": (".parquet",), "tune": (".toml",), "tune robust": (".toml",),
}  # fmt: skip
"""Endings of what a command makes, beside those of all results."""

PICTURES = (".png", ".svg", ".pdf", ".html")
ROWS = (".json", ".csv", ".tex", ".html")
"""What every result can be written as."""


SAME = re.compile(r"[Aa]s for `ambkit ([\w -]+)`")
"""Of a parameter that has the meaning that it has in another command."""


class Misused(AmbkitError):
    """A command line that its command does not understand."""

    def __init__(self, message: str, command: str | None) -> None:
        super().__init__(message)
        self.command = command


class Description(NamedTuple):
    """What a command needs of a numpydoc docstring."""

    summary: str
    text: str
    parameters: dict[str, str]
    examples: list[str]


class Parser(argparse.ArgumentParser):
    """A parser whose refusals are errors like all others."""

    def __init__(self, name: str) -> None:
        super().__init__(
            name, formatter_class=Layout, allow_abbrev=False, add_help=False, exit_on_error=False
        )
        self.add_argument("-h", "--help", action="help", help="Show this help.")

    def error(self, message: str) -> Any:
        """Refuse the command line, with the option that was perhaps meant."""
        unknown = re.match(r"unrecognized arguments: (--[^\s=]+)", message)
        if unknown:
            near = difflib.get_close_matches(unknown[1], self._option_string_actions, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            message = f"there is no option {unknown[1]}{hint}"
        raise Misused(message, self.prog)


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help in columns, on a terminal of any width."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=width())

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        value = self._format_args(action, action.dest.upper())
        return f"{', '.join(action.option_strings)} {value}"


def width() -> int:
    """Return how many columns a help has."""
    return min(shutil.get_terminal_size().columns, 100)


class Once(argparse.Action):
    """An option that is taken once: the first of two would be dropped."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        """Take the value."""
        if self.dest in namespace:
            raise Misused(f"{option} is given more than once", parser.prog)
        setattr(namespace, self.dest, values)


def verb_called(name: str) -> Callable[..., Any]:
    """Return the verb of a command."""
    module, _, function = VERBS[name].partition(":")
    return cast(Callable[..., Any], getattr(import_module(f"ambkit.verbs.{module}"), function))


def described(verb: Callable[..., Any]) -> Description:
    """Read the docstring of a verb; what is as for another is looked up there."""
    text, *sections = re.split(r"\n(?=[A-Z][\w ]+\n-+\n)", inspect.getdoc(verb) or "")
    parts = {title: body for title, _, body in (part.split("\n", 2) for part in sections)}
    parameters = {}
    for entry in re.split(r"\n(?=\S)", parts.get("Parameters", "")):
        names, _, lines = entry.partition("\n")
        about, same = " ".join(lines.split()).replace("`", ""), SAME.search(lines)
        other = described(verb_called(same[1])).parameters if same else {}
        for name in names.partition(" :")[0].split(", "):
            parameters[name] = other.get(name, about)
    examples = [line.strip() for line in parts.get("Examples", "").splitlines()]
    examples = [line.removeprefix("$ ") for line in examples if line.startswith("$ ")]
    return Description(text.partition("\n")[0], text.strip().replace("`", ""), parameters, examples)


def parser_of(name: str, verb: Callable[..., Any]) -> Parser:
    """Return the parser of a command: what the verb takes, and what is done with its result."""
    about = described(verb)
    parser = Parser(f"ambkit {name}")
    lines = "".join(f"\n    {line}" for line in about.examples)
    paragraphs = (fill(text, width()) for text in about.text.split("\n\n"))
    parser.description = "\n\n".join(paragraphs) + (f"\n\nFor example:{lines}" if lines else "")
    beside = [other for other in VERBS if other.startswith(f"{name} ")]
    if beside:
        parser.description += f"\n\nFurther commands: {', '.join(beside)}."
    for parameter in inspect.signature(verb).parameters.values():
        text = about.parameters[parameter.name].replace("%", "%%")
        # Annotations of parameters alone: those of results name what is not imported.
        settings = _settings(eval(parameter.annotation, verb.__globals__))
        required = parameter.default is parameter.empty
        if parameter.name == "records" or (
            required and parameter.kind is not parameter.KEYWORD_ONLY
        ):
            parser.add_argument(
                parameter.name, help=text, **_positional(settings, parameter.default)
            )
        else:
            parser.add_argument(
                f"--{parameter.name.replace('_', '-')}", dest=parameter.name,
                help=text + _default(parameter.default), default=argparse.SUPPRESS,
                required=required,
                **{"action": Once} | settings,
            )  # fmt: skip
    _add_outputs(parser, (*MAKES.get(name, ()), *ROWS))
    return parser


def _positional(settings: dict[str, Any], default: Any) -> dict[str, Any]:
    if settings.pop("action", None) != "append":
        return settings
    return settings | {"nargs": "+" if default is inspect.Parameter.empty else "*"}


def _add_outputs(parser: Parser, endings: Sequence[str]) -> None:
    files = {
        "--out": f"Write the result: {', '.join(endings)} (page). May be repeated.",
        "--plot": f"Draw it: {', '.join(PICTURES)}. May be repeated.",
    }
    own = "--out" in parser._option_string_actions  # of a verb that writes a folder by itself
    for option, text in {} if own else files.items():
        parser.add_argument(
            option, type=Path, action="append", default=[], metavar="FILE", help=text
        )
    parser.add_argument("--json", action="store_true", help="Print JSON, in SI units.")
    parser.add_argument("--verbose", action="store_true", help="Print all figures.")


def _default(value: Any) -> str:
    """Return a default as the help shows it."""
    if value is None or value is False or value == () or value is inspect.Parameter.empty:
        return ""
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else value
    return f" [default: {text}]"


def _settings(annotation: Any) -> dict[str, Any]:
    """Return what argparse must know of a type: a text where the verb itself reads it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        kinds = [part for part in parts if part is not NoneType]
        return _settings(next(filter(_is_list, kinds), kinds[0]))
    if origin is Annotated:
        return {"metavar": annotation.__metadata__[0]}
    if _is_list(annotation):
        return _settings(parts[0]) | {"action": "append"}
    if origin is Literal:
        return {"choices": parts}
    if annotation is bool:
        return {"action": "store_true"}
    if annotation in (int, float):
        return {"type": annotation, "metavar": "N" if annotation is int else "NUMBER"}
    return {"metavar": "NAME"}


def _is_list(annotation: Any) -> bool:
    return get_origin(annotation) is Sequence


def called(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return the command that a shell calls, of one word or two, and what it is given."""
    count = 2 if " ".join(arguments[:2]) in VERBS else 1
    return " ".join(arguments[:count]), arguments[count:]


def run(name: str, arguments: Sequence[str]) -> int:
    """Call a verb with what a shell gives, deliver its result, and return the exit code."""
    from ambkit.cli import printing

    verb = verb_called(name)
    parser = parser_of(name, verb)
    try:
        options = vars(parser.parse_args(arguments))
    except argparse.ArgumentError as error:
        parser.error(str(error))
    makes = "plot" in options  # else it writes a folder by itself
    out, plots = (options.pop("out"), options.pop("plot")) if makes else ((), ())
    as_json, verbose = options.pop("json"), options.pop("verbose")
    _check_files("--out", out, (*MAKES.get(name, ()), *ROWS), options)
    _check_files("--plot", plots, PICTURES, options)
    result: Result = verb(**options)
    if not makes:
        printing.written.append(Path(options["out"]))
    printing.deliver_result(
        result,
        [
            *((path, result.save) for path in out),
            *((path, partial(printing.save_figure, result)) for path in plots),
        ],
        as_json=as_json,
        verbose=verbose,
    )
    if as_json:  # else it is among the notes
        printing.say_adequacy(getattr(result, "adequacy", ()))
    return 0 if getattr(result, "passed", True) else 1


def _check_files(
    option: str, paths: Sequence[Path], endings: Sequence[str], arguments: dict[str, Any]
) -> None:
    """Refuse files that cannot be written, or that the command reads, before it begins."""
    texts = [item for value in arguments.values()
             for item in (value if isinstance(value, list) else [value])]  # fmt: skip
    read = [Path(text) for text in texts if isinstance(text, str)]
    for path in paths:
        problem = None
        if path.suffix.lower() not in endings:
            problem = f"must end with {' or '.join(endings)}"
        elif path.is_dir():
            problem = "is a folder"
        elif not path.parent.is_dir():
            problem = f"cannot be written: there is no folder {path.parent}"
        elif not os.access(path.parent, os.W_OK):
            problem = f"cannot be written: nor can its folder {path.parent}"
        elif path.exists() and any(item.is_file() and item.samefile(path) for item in read):
            problem = "is read by this command, and would be overwritten"
        if problem:
            raise AmbkitError(f"{option}: {path} {problem}")


def command(name: str) -> Callable[[], None]:
    """Return a command for typer, which only lists it."""

    def listed() -> None: ...

    listed.__doc__ = described(verb_called(name)).summary
    return listed
