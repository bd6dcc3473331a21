"""The field's words: the glossary, and what it replaced, counted so that it only becomes less.

`words.txt` lists names and phrases that go, what to write instead, and how many are left. A pattern
is a regular expression in lower case; in a name ``_`` joins words (``work_points?`` also finds
`WorkPoint` and `work_point_of`), in a text any white space does. Run as a program it prints the
table with today's numbers, or with a pattern each place where it stands.
"""

import re
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "models", "core/include", "core/src", "sim", "bindings", "docs", "examples")
FILES = ("README.md", "CONTRIBUTING.md", "firmware/README.md")
LEFT_OUT = {"__pycache__", "_build", "jupyter_execute", "plotly", "recordings", "generated"}
NAMES_OF_BEFORE = ("docs/changes.md", "docs/glossary.md")

_LONG = r'"""[^"\\]*(?:(?:\\.|"(?!""))[^"\\]*)*"""'
_SHORT = r'"[^"\\\n]*(?:\\.[^"\\\n]*)*"'
PYTHON = re.compile(rf"#[^\n]*|{_LONG}|{_SHORT}", re.S)
C = re.compile(rf"//[^\n]*|/\*.*?\*/|{_SHORT}", re.S)
TOML = re.compile(rf"#[^\n]*|{_LONG}|{_SHORT}", re.S)
MARKDOWN = re.compile(r"^(```+|:::+\{terminal\})[^\n]*\n.*?^(```+|:::+)\s*$|`[^`\n]+`", re.S | re.M)
TEXTS = {".py": PYTHON, ".pyi": PYTHON, ".toml": TOML, ".md": MARKDOWN, ".rst": MARKDOWN}


class Word(NamedTuple):
    """A line of the table."""

    scope: str  #: ``name``, ``text`` or ``both``.
    left: int  #: How many there may be.
    pattern: str
    instead: str


@cache
def words():
    lines = (ROOT / "tests/words.txt").read_text(encoding="utf-8").splitlines()
    fields = (re.split(r"  +", line.strip(), maxsplit=3) for line in lines if line[:1] not in "#")
    return [Word(scope, int(left), *rest) for scope, left, *rest in fields]


def files():
    """Yield what we wrote ourselves."""
    yield from (ROOT / name for name in FILES)
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            name = path.relative_to(ROOT).as_posix()
            ours = path.suffix in {*TEXTS, ".h", ".c", ".cpp", ".j2"} and path.is_file()
            if ours and LEFT_OUT.isdisjoint(path.parts) and name not in NAMES_OF_BEFORE:
                yield path


def _parts(path):
    """Return a file's names and its text, each with blanks in the place of the other."""
    content = path.read_text(encoding="utf-8")
    pattern = MARKDOWN if path.name.endswith(".md.j2") else TEXTS.get(path.suffix, C)
    inside, outside, end = [], [], 0
    for match in pattern.finditer(content):
        between = content[end : match.start()]
        inside += [_blank(between), match[0]]
        outside += [between, _blank(match[0])]
        end = match.end()
    matched, other = "".join(inside), "".join(outside) + content[end:]
    return (matched, other) if pattern is MARKDOWN else (other, matched)


def _blank(text):
    return re.sub(r"[^\n]", " ", text)


@cache
def _in_name(name):
    """Return the patterns in an identifier, and how often."""
    lower = "_".join(part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+|[0-9]+", name))
    counts = (
        (pattern, len(re.findall(rf"(?<![a-z])(?:{pattern.replace(' ', '_')})(?![a-z])", lower)))
        for scope, _, pattern, _ in words() if scope in ("name", "both")
    )  # fmt: skip
    return tuple(count for count in counts if count[1])


def _in_text(pattern):
    joined = pattern.replace(" ", r"\s+(?:[#*/]+\s+)?")
    return re.compile(rf"(?<![a-z0-9])(?:{joined})(?![a-z0-9])")


def _letters(pattern):
    """Return letters of which some are wherever a pattern matches: most texts have none."""
    for optional in (r"\([^()]*\)\??", r"\([^()]*\)\??", r"[a-z][?*{]"):
        pattern = re.sub(optional, " ", pattern)
    return [max(re.findall(r"[a-z]+|^", way), key=len) for way in pattern.split("|")]


def places():
    """Return where each pattern stands, as ``file:line``."""
    table = words()
    found = {word.pattern: [] for word in table}
    texts = [
        (w.pattern, _letters(w.pattern), _in_text(w.pattern))
        for w in table if w.scope in ("text", "both")
    ]  # fmt: skip
    for path in files():
        names, text = _parts(path)
        where = path.relative_to(ROOT).as_posix()
        for match in re.finditer(r"[A-Za-z_][A-Za-z0-9_]*", names):
            for pattern, count in _in_name(match[0]):
                found[pattern] += [f"{where}:{names.count(chr(10), 0, match.start()) + 1}"] * count
        lower = text.lower()
        for pattern, letters, compiled in texts:
            some = any(each in lower for each in letters)
            for match in compiled.finditer(lower) if some else ():
                found[pattern].append(f"{where}:{text.count(chr(10), 0, match.start()) + 1}")
    return found


def test_words_that_go_only_become_less():
    found = places()
    more = [
        f"{word.pattern} ({word.scope}): {len(found[word.pattern])}, may be {word.left}; use "
        f"{word.instead}"
        for word in words()
        if len(found[word.pattern]) > word.left
    ]
    assert not more, "\n".join(more)


CONCEPTS = {
    "levitation current": "src/ambkit/machine/loading.py",
    "operating point": "src/ambkit/control/linear/linear_plant.py",
    "observer poles": "src/ambkit/estimate/observer.py",
    "collocation": "src/ambkit/rotordynamics/machine_report.py",
    "sensitivity peak": "src/ambkit/judge/loop/margins.py",
    "dead time": "src/ambkit/models/parts/delay.py",
    "process noise": "src/ambkit/models/parts/disturbance.py",
    "plausibility check": "src/ambkit/judge/plausibility.py",
    "gain scheduling": "core/src/turning.c",
    "bumpless transfer": "core/src/control.c",
}


@pytest.mark.parametrize("concept", CONCEPTS)
def test_a_concept_is_found_at_the_place_that_does_it(concept):
    assert concept in (ROOT / CONCEPTS[concept]).read_text(encoding="utf-8").lower()


def test_the_glossary_names_what_there_is():
    rows = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").splitlines()
    terms = [row.split("|")[1:-1] for row in rows if row.startswith("| ") and "---" not in row]
    assert len(terms) >= 70
    for *_, where in terms:
        for path in re.findall(r"`([\w/]+(?:/|\.\w+))`", where):
            base = (
                ROOT if path.startswith(("core/", "sim/", "models/laws/")) else ROOT / "src/ambkit"
            )
            assert (base / path).exists(), path


if __name__ == "__main__":
    everywhere = places()
    if len(sys.argv) > 1:
        print("\n".join(everywhere[sys.argv[1]]))
    else:
        for word in words():
            number = len(everywhere[word.pattern])
            print(f"{word.scope:4}  {number:4}  {word.pattern:34}  {word.instead}")
