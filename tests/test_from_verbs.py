"""Commands made from verbs."""

from __future__ import annotations  # a verb's annotations are read as text

import inspect
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import pytest

from ambkit.cli import catalogue, from_verbs

Length = Annotated["float | str", "LENGTH"]


def halve(
    machine: Annotated[str, "MACHINE"],
    records: Sequence[Annotated[str, "RECORD"]] = (),
    *,
    position: Length | None = None,
    peaks: Sequence[float] = (1.5, 2.0),
    kind: Literal["a", "b"] = "a",
    count: int = 3,
    quick: bool = False,
):
    """Halve a thing.

    Parameters
    ----------
    machine : str
        What is halved by 50 %.
    records : sequence of str, optional
        Of it.
    position : optional
        As for `ambkit assess`.
    peaks : optional
        Limits.
    kind, count, quick : optional
        How.

    Examples
    --------
    $ ambkit halve thing
    """


def parsed(*arguments):
    return vars(from_verbs.parser_of("halve", halve).parse_args(arguments))


@pytest.mark.parametrize(("arguments", "expected"), [
    (["m"], {"machine": "m", "records": []}),
    (["m", "a.csv", "b.csv"], {"records": ["a.csv", "b.csv"]}),
    (["m", "--position", "0.1 mm"], {"position": "0.1 mm"}),
    (["m", "--peaks", "1.7", "--peaks", "2"], {"peaks": [1.7, 2.0]}),
    (["m", "--kind", "b", "--count", "4", "--quick"], {"kind": "b", "count": 4, "quick": True}),
    (["m", "--out", "a.json", "--out", "a.csv"], {"out": [Path("a.json"), Path("a.csv")]}),
])  # fmt: skip
def test_arguments_reach_the_verb(arguments, expected):
    found = parsed(*arguments)
    assert found | expected == found


def test_what_is_not_given_is_left_to_the_verb():
    assert set(parsed("m")) == {"machine", "records", "out", "plot", "json", "verbose"}


@pytest.mark.parametrize(("arguments", "message"), [
    (["m", "--cuont", "3"], "there is no option --cuont; did you mean --count?"),
    (["m", "--coun", "3"], "there is no option --coun; did you mean --count?"),
    (["m", "--count", "3", "--count", "4"], "--count is given more than once"),
    (["m", "--kind", "c"], "invalid choice: 'c'"),
    (["m", "--peaks", "high"], "invalid float value: 'high'"),
    ([], "required: MACHINE"),
])  # fmt: skip
def test_what_is_not_understood_is_refused(arguments, message):
    parser = from_verbs.parser_of("halve", halve)
    with pytest.raises((from_verbs.Misused, from_verbs.argparse.ArgumentError), match=message):
        parser.parse_args(arguments)


def test_the_help_is_the_docstring():
    text = from_verbs.parser_of("halve", halve).format_help()
    for said in (
        "Halve a thing.",
        "For example:\n    ambkit halve thing",
        "--position LENGTH",
        "by 50 %",
        "[default: 1.5, 2.0]",
        "[default: a]",
        "MACHINE [RECORD ...]",
    ):
        assert said in text  # fmt: skip
    assert "--seed" not in text


def test_the_front_page_lists_every_command_once():
    listed = re.findall(r"^  ([a-z]+)  ", catalogue.front(), re.MULTILINE)
    assert len(listed) == len(set(listed))
    assert set(listed) == {name.partition(" ")[0] for name in catalogue.VERBS}
    assert max(map(len, catalogue.front().splitlines())) <= 80


@pytest.mark.parametrize("name", [name for name in catalogue.VERBS if name != "campaign"])
def test_each_verb_is_described(name, monkeypatch):
    verb = catalogue.verb_called(name)
    parameters = inspect.signature(verb).parameters
    about = from_verbs.described(verb)
    assert set(about.parameters) - {""} == set(parameters)
    assert not any(text.startswith("As for") for text in about.parameters.values())
    assert about.examples
    assert all(f"ambkit {name} " in f"{example} " for example in about.examples)
    options = from_verbs.parser_of(name, verb)._option_string_actions
    assert len([option for option in options if option.startswith("--")]) - 1 <= 12
    monkeypatch.setenv("COLUMNS", "80")
    lines = from_verbs.parser_of(name, verb).format_help().splitlines()
    assert max(len(line) for line in lines if "    ambkit" not in line) <= 80


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom ambkit.cli.main import main\n"
        f"for name in {list(catalogue.VERBS)}:\n"
        "    try: main([*name.split(), '--help'])\n"
        "    except SystemExit as left: assert not left.code\n"
        "heavy = 'numpy scipy pydantic typer rich matplotlib'.split()\n"
        "print([name for name in heavy if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


@pytest.mark.parametrize("name", [name for name in catalogue.VERBS if name != "campaign"])
def test_the_examples_of_each_verb_are_understood(name):
    verb = catalogue.verb_called(name)
    for example in from_verbs.described(verb).examples:
        words = shlex.split(example.partition(" > ")[0])[1 + len(name.split()) :]
        assert from_verbs.parser_of(name, verb).parse_args(words)


def lines_of_pages():
    """Each command line on the pages, in the README and in examples, with its place."""
    root = Path(__file__).parent.parent
    first = {name.partition(" ")[0] for name in catalogue.VERBS}
    pages = [*root.glob("docs/**/*.md"), root / "README.md", *root.glob("examples/*.toml")]
    for page in pages:
        if page.name == "changes.md":
            continue
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^(?:#  *)?(ambkit [a-z].*)$", text, re.MULTILINE):
            if line.split()[1] in first:
                yield pytest.param(line, id=f"{page.name}: {line[:60]}")


@pytest.mark.parametrize("line", list(lines_of_pages()))
def test_each_command_on_the_pages_is_understood(line):
    words = shlex.split(re.split(r" [|>#] ?", line)[0])[1:]
    name, following = catalogue.called(words)
    if name in catalogue.GROUPS:
        return
    verb = catalogue.verb_called(name)
    assert from_verbs.parser_of(name, verb).parse_args(following)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_completes_commands_and_options(shell, capsys):
    assert main_of("--print-completion", shell) == 0
    script = capsys.readouterr().out
    for name in ("lift-off", "simulate", "--max-sensitivity"):
        assert name in script


@pytest.mark.parametrize(("words", "message"), [
    (["exprt"], "there is no command exprt; did you mean export?"),
    (["export", "fm"], "there is no command export fm; did you mean export fmu?"),
    (["--print-completion", "fish"], "takes one of bash, zsh, tcsh"),
    (["identify", "m", "a.csv", "--out", "fitler=f.toml"],
     "there is no fitler=; known: filter, force-map"),
])  # fmt: skip
def test_a_command_line_that_is_none_is_refused(words, message, capsys):
    assert main_of(*words) == 2
    assert message in capsys.readouterr().err


def main_of(*words):
    from ambkit.cli.main import main

    with pytest.raises(SystemExit) as left:
        main(list(words))
    return left.value.code
