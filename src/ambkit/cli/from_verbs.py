"""Commands made from verbs: options from their signatures, help from their docstrings."""

import argparse
import difflib
import inspect
import os
import re
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from ambkit.base.errors import AmbkitError
from ambkit.cli import catalogue
from ambkit.cli.catalogue import Misused

PLAIN = ("Document", "Statement", "Workbench")  #: Types of results without figures and details.
OPERANDS = ("records", "name")  #: Optional parameters that are positional.

REPEATED = " Repeatable."

SAME = re.compile(r"[Aa]s for `ambkit ([\w -]+)`")
"""Marks a parameter with the meaning that it has in another command."""


class Description(NamedTuple):
    """A numpydoc docstring, as needed for a command."""

    summary: str
    text: str
    parameters: dict[str, str]
    examples: list[str]


class Parser(argparse.ArgumentParser):
    """A parser that raises its errors like all others."""

    def __init__(self, name: str) -> None:
        super().__init__(
            name, formatter_class=Layout, allow_abbrev=False, add_help=False, exit_on_error=False
        )
        self.add_argument("-h", "--help", action="help", help="Show this help.")

    def parse_args(self, arguments: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments; a negative quantity such as -3N is the value of its option."""
        joined: list[str] = []
        for argument in arguments or ():
            if joined and re.match(r"-[\d.]", argument) and re.fullmatch(r"--[\w-]+", joined[-1]):
                joined[-1] += f"={argument}"
            else:
                joined.append(argument)
        return super().parse_args(joined, namespace)

    def error(self, message: str) -> Any:
        """Reject the command line, with the most similar option."""
        unknown = re.match(r"unrecognized arguments: (--[^\s=]+)", message)
        if unknown:
            near = difflib.get_close_matches(unknown[1], self._option_string_actions, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            message = f"there is no option {unknown[1]}{hint}"
        raise Misused(message, self.prog)


fill = partial(textwrap.fill, break_on_hyphens=False)


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help in columns, for a terminal of any width."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=width())

    def _split_lines(self, text: str, width: int) -> list[str]:
        return fill(text, width).splitlines()

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        value = self._format_args(action, action.dest.upper())
        return f"{', '.join(action.option_strings)} {value}"


def width() -> int:
    """Return the width of a help in columns."""
    return min(shutil.get_terminal_size().columns, 100)


class SingleUse(argparse.Action):
    """An option that may appear once; otherwise the first of two would be ignored."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        """Take the value."""
        if self.dest in namespace:
            raise Misused(f"{option} is given more than once", parser.prog)
        setattr(namespace, self.dest, values)


def described(verb: Callable[..., Any]) -> Description:
    """Parse the docstring of a verb, and look up parameters documented elsewhere."""
    text, *sections = re.split(r"\n(?=[A-Z][\w ]+\n-+\n)", inspect.getdoc(verb) or "")
    parts = {title: body for title, _, body in (part.split("\n", 2) for part in sections)}
    parameters = {}
    for entry in re.split(r"\n(?=\S)", parts.get("Parameters", "")):
        names, _, lines = entry.partition("\n")
        about, same = " ".join(lines.split()).replace("`", ""), SAME.search(lines)
        other = described(catalogue.verb_called(same[1])).parameters if same else {}
        for name in names.partition(" :")[0].split(", "):
            parameters[name] = other.get(name, about)
    examples = [line.strip() for line in parts.get("Examples", "").splitlines()]
    examples = [line.removeprefix("$ ") for line in examples if line.startswith("$ ")]
    return Description(text.partition("\n")[0], text.strip().replace("`", ""), parameters, examples)


def parser_of(name: str, verb: Callable[..., Any]) -> Parser:
    """Return the parser of a command: parameters of the verb, and output of its result."""
    about = described(verb)
    parser = Parser(f"ambkit {name}")
    lines = "".join(f"\n    {line}" for line in about.examples)
    paragraphs = (fill(text, width()) for text in about.text.split("\n\n"))
    parser.description = "\n\n".join(paragraphs) + (f"\n\nFor example:{lines}" if lines else "")
    if beside := catalogue.within(name):
        parser.description += "\n\n" + fill(f"Further commands: {', '.join(beside)}.", width())
    for place, parameter in enumerate(inspect.signature(verb).parameters.values()):
        text = about.parameters[parameter.name].replace("%", "%%")
        # Annotations of parameters only: those of results name what is not imported.
        settings = _settings(eval(parameter.annotation, verb.__globals__))
        if not settings.get("metavar", True):
            continue  # for Python only
        required = parameter.default is parameter.empty
        if (
            parameter.name in OPERANDS
            or (place, parameter.name) == (0, "machine")
            or (required and parameter.kind is not parameter.KEYWORD_ONLY)
        ):
            parser.add_argument(
                parameter.name, help=text, **_positional(settings, parameter.default)
            )
        else:
            parser.add_argument(
                f"--{parameter.name.replace('_', '-')}", dest=parameter.name,
                help=text + REPEATED * (settings.get("action") == "append")
                + _default(parameter.default),
                default=argparse.SUPPRESS, required=required, **{"action": SingleUse} | settings,
            )  # fmt: skip
    if "--out" not in parser._option_string_actions:  # else the verb writes a folder itself
        _add_outputs(parser, name, verb)
    parser.add_argument("--json", action="store_true", help="Print JSON, in SI units.")
    if catalogue.returns(verb) not in PLAIN:
        parser.add_argument("--verbose", action="store_true", help="Print all figures.")
    return parser


def _positional(settings: dict[str, Any], default: Any) -> dict[str, Any]:
    required = default is inspect.Parameter.empty
    if settings.pop("action", None) != "append":
        # An omitted operand uses the verb's default.
        return settings if required else settings | {"nargs": "?", "default": argparse.SUPPRESS}
    return settings | {"nargs": "+" if required else "*"}


def _add_outputs(parser: Parser, name: str, verb: Callable[..., Any]) -> None:
    makes = catalogue.products(name, verb)
    forms = [
        (f"{what}=" if what else "") + " ".join(endings)
        for what, endings in makes.items() if endings
    ]  # fmt: skip
    texts = {}
    if forms:
        value = "[WHAT=]FILE" if len(makes) > 1 else "FILE"
        texts["--out"] = value, f"Write the result: {'; '.join(forms)}."
    if catalogue.returns(verb) not in PLAIN:
        texts["--plot"] = "FILE", f"Write a figure: {' '.join(catalogue.PICTURES)}."
    for option, (value, text) in texts.items():
        parser.add_argument(
            option, type=Path, action="append", default=[], metavar=value,
            help=text + REPEATED,
        )  # fmt: skip


def _default(value: Any) -> str:
    """Return a default for the help."""
    if value is None or value is False or value == () or value is inspect.Parameter.empty:
        return ""
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else value
    return f" [default: {text}]"


def _settings(annotation: Any) -> dict[str, Any]:
    """Return argparse's settings of a type: a text if the verb itself parses it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        kinds = [part for part in parts if part is not NoneType]
        return _settings(next(filter(_is_list, kinds), kinds[0]))
    if origin is Annotated:
        return {"metavar": annotation.__metadata__[0]}
    if _is_list(annotation):
        return _settings(parts[0]) | {"action": "append"}
    if origin is Literal:
        settings = {"choices": parts, "type": type(parts[0])}
        return settings | ({"metavar": "NAME"} if len("".join(map(str, parts))) > 40 else {})
    if annotation is bool:
        return {"action": "store_true"}
    if annotation in (int, float):
        return {"type": annotation, "metavar": "N" if annotation is int else "NUMBER"}
    return {"metavar": "NAME"}


def _is_list(annotation: Any) -> bool:
    return get_origin(annotation) is Sequence


def run(name: str, arguments: Sequence[str]) -> int:
    """Call a verb with the arguments of a shell, deliver its result, and return the exit code."""
    from ambkit.cli import printing

    verb = catalogue.verb_called(name)
    parser = parser_of(name, verb)
    try:
        options = vars(parser.parse_args(arguments))
    except argparse.ArgumentError as error:
        parser.error(str(error))
    own = "out" in inspect.signature(verb).parameters  # it writes a folder itself
    out = {} if own else _targets(options.pop("out", []), catalogue.products(name, verb))
    plots = options.pop("plot", [])
    as_json, verbose = options.pop("json"), options.pop("verbose", False)
    targets = [(path, catalogue.products(name, verb)[what]) for path, what in out.items()]
    if own and name in catalogue.MAKES:
        targets = [(Path(options["out"]), catalogue.MAKES[name][""])]
    read = options | {"out": None}
    _check_files("--out", targets, read)
    _check_files("--plot", [(path, catalogue.PICTURES) for path in plots], read)
    try:
        result = verb(**options)
    except AmbkitError as error:
        printing.draw_refused(error, plots)
        raise
    if own:
        printing.written.append(getattr(result, "path", None) or Path(options["out"]))
    beside = {what or path.suffix: path for path, what in out.items()}
    files: list[printing.File] = [
        (path, partial(result.save_product, what, beside=beside) if what else result.save)
        for path, what in out.items()
    ]
    files += [(path, lambda path: result.figures()[0].save(path)) for path in plots]
    if catalogue.returns(verb) in PLAIN:
        return printing.deliver_document(result, files, as_json=as_json)
    screen = printing.on_screen(result, verbose=verbose)
    printing.deliver(result.to_dict(), screen, files, as_json=as_json)
    if as_json:  # otherwise part of the notes
        printing.say_adequacy(result)
    return 0 if getattr(result, "passed", True) else 1


def _targets(paths: Sequence[Path], makes: Mapping[str, Sequence[str]]) -> dict[Path, str]:
    """Return which product a command writes into each file."""
    results: dict[Path, str] = {}
    for path in sorted(paths, key=lambda path: _parts(path)[0] != ""):
        what, file = _parts(path)
        if what and len(makes) > 1 and what not in makes:
            raise AmbkitError(f"--out: there is no {what}=; known: {', '.join(sorted(makes)[1:])}")
        results |= {file: what} if what in makes else {path: ""}
    return results


def _parts(path: Path) -> tuple[str, Path]:
    match = re.fullmatch(r"([a-z-]+)=(.+)", str(path))
    return (match[1], Path(match[2])) if match else ("", path)


def _check_files(
    option: str, files: Sequence[tuple[Path, Sequence[str]]], arguments: dict[str, Any]
) -> None:
    """Reject files that cannot be written, or are inputs of the command, before it begins."""
    texts = [item for value in arguments.values()
             for item in (value if isinstance(value, list) else [value])]  # fmt: skip
    read = [Path(text) for text in texts if isinstance(text, str)]
    for path, endings in files:
        problem = None
        if tuple(endings) == catalogue.FOLDER:
            continue
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


SHELLS = ("bash", "zsh", "tcsh")


def completion(arguments: Sequence[str]) -> str:
    """Return the script for a shell's completion."""
    import shtab

    if len(arguments) != 1 or arguments[0] not in SHELLS:
        raise Misused(f"--print-completion takes one of {', '.join(SHELLS)}", "ambkit")
    return shtab.complete(_tree(), arguments[0])


def _tree() -> argparse.ArgumentParser:
    """Return one parser of all commands: first words, with second ones below them."""
    top = argparse.ArgumentParser("ambkit")
    top.add_argument("--version", action="store_true", help="Print the version.")
    top.add_argument("--debug", action="store_true", help="With an error, show its place.")
    commands = top.add_subparsers()
    for first in dict.fromkeys(name.partition(" ")[0] for name in catalogue.VERBS):
        parser = commands.add_parser(
            first, help=catalogue.summary(first), parents=_parents(first), add_help=False
        )
        below = catalogue.within(first)
        if below:
            more = parser.add_subparsers()
            for name in below:
                second = name.partition(" ")[2]
                more.add_parser(
                    second, help=catalogue.summary(name), parents=_parents(name), add_help=False
                )
    return top


def _parents(name: str) -> list[argparse.ArgumentParser]:
    """Return the parser of a command, whose file operands have completion."""
    if name in catalogue.GROUPS:
        return []
    import shtab

    parser = parser_of(name, catalogue.verb_called(name))
    for action in parser._actions:
        if action.nargs != 0 and action.choices is None:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return [parser]
