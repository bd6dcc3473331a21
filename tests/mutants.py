"""How much of an exported filter its self-test sees: faults planted one by one, and the score.

    python tests/mutants.py [KIND ...] [--precision double] [--boundaries] [--sample N]
    python tests/mutants.py --machine tum_mlps [--sample N]

Constants of the data file change by a tenth; operators of the C that flies turn into others. Each
mutant is compiled with its self-test (by tcc where it is installed) and judged exactly, and as
where a compiler rounds otherwise; also without the CRC that gives constants away. What is left
alive is compiled by gcc with optimisation: where the program is the same to the last byte, the
mutant is the original (trivial compiler equivalence, Papadakis et al. 2015).
"""

import argparse
import functools
import json
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import unseen

INCLUDES = ("-I.", "-Icore/include", "-Icore", "-Iselftest")
JUDGE = """#include "{0}_selftest.h"
#include <stdio.h>
#if defined(CONTROLLED)
#include "{0}_control_selftest.h"
#endif

int main(void)
{{
  {0}_selftest_result found;
  {0}_selftest(&found);
  const unsigned int wrong = found.wrong;
  bool exact = {0}_selftest_passed(&found, true);
  bool loose = {0}_selftest_passed(&found, false);
  found.wrong &= ~{1}_WRONG_CONSTANTS;
  bool exact_without = {0}_selftest_passed(&found, true);
  const bool loose_without = {0}_selftest_passed(&found, false);
#if defined(CONTROLLED)
  {0}_control_selftest(&found);
  exact = exact && {0}_control_selftest_passed(&found, true);
  loose = loose && {0}_control_selftest_passed(&found, false);
  found.wrong &= ~{1}_WRONG_CONSTANTS;
  exact_without = exact_without && {0}_control_selftest_passed(&found, true);
#endif
  (void)printf("%d %d %d %d %u %u %u", exact, loose, exact_without, loose_without, wrong,
               found.wrong_status, found.unequal);
  return 0;
}}
"""
SECONDS = 3  # A mutant that takes longer hangs, and a watchdog would see it.


class Mutant(NamedTuple):
    """One fault."""

    file: str
    line: int
    old: str
    new: str
    start: int  # place of the old text
    text: str  # its line

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.old} -> {self.new}: {self.text}"


class Verdict(NamedTuple):
    """Whether the self-test passes, which it should not."""

    exact: bool
    loose: bool
    exact_without_crc: bool
    loose_without_crc: bool


KILLED = Verdict(False, False, False, False)

_OPERATORS = {
    "+": "-", "-": "+", "*": "/", "/": "*", "+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=",
    "<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&",
    "|": "&", "&": "|", "|=": "&=", "&=": "|=", "++": "--", "--": "++", "!": "", "u-": "",
    "true": "false", "false": "true",
}  # fmt: skip
_BOUNDARIES = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
_TOKENS = re.compile(
    r"/\*.*?\*/|\"(?:\\.|[^\"])*\"|^[ \t]*#(?:\\\n|.)*?$|\b\d[\w.]*(?:[eE][-+]\d+)?\w*|[A-Za-z_]\w*"
    r"|->|\+\+|--|<<=|>>=|<<|>>|[-+*/|&^]=|[<>=!]=|&&|\|\||[-+*/|&<>!=(){}\[\],;?:.~^%]",
    re.DOTALL | re.MULTILINE,
)
_TYPE = r"(?:amb_\w+|\w+_state|\w+_estimates|\w+_command|u?int\w*|void|bool|char|const)"
_NUMBER = re.compile(r"-?\b\d+(?:\.\d+)?(?:e[-+]?\d+)?[FU]?\b")


def of_operators(name: str, text: str, *, boundaries: bool = False) -> Iterator[Mutant]:
    """Give each operator of a C file as another one; pointers, declarations and macros aside."""
    tokens = [m for m in _TOKENS.finditer(text) if not m[0].lstrip().startswith(("/*", '"', "#"))]
    depth = 0
    for n, token in enumerate(tokens[1:], 1):
        depth += (token[0] == "{") - (token[0] == "}")
        old = token[0]
        if depth == 0 or old not in _OPERATORS:
            continue
        unary = not re.fullmatch(r"[\w.]+|[)\]]", tokens[n - 1][0]) or tokens[n - 1][0] == "return"
        if old in ("*", "&") and (unary or _is_type(tokens, n)):
            continue  # of pointers
        if old == "+" and unary:
            continue
        others = [_OPERATORS["u-" if old == "-" and unary else old]]
        if boundaries and old in _BOUNDARIES:
            others.append(_BOUNDARIES[old])
        for new in others:
            yield _mutant(name, text, token.start(), old, new)


def _is_type(tokens: list[re.Match[str]], n: int) -> bool:
    """Whether what stands before a star or an ampersand is a type, or a cast."""
    before = tokens[n - 1][0]
    if before == ")":
        return re.fullmatch(rf"\*|{_TYPE}", tokens[n - 2][0]) is not None
    return re.fullmatch(_TYPE, before) is not None


def of_constants(name: str, text: str) -> Iterator[Mutant]:
    """Give each number of a data file's initialisers, a tenth larger; a zero has none."""
    end = text.index("_data_crc(void)")
    for match in _NUMBER.finditer(text, text.index('_data.h"'), end):
        before = text[: match.start()].rstrip()
        if text[match.start() - 1] == "[" or before.endswith("Configuration"):
            continue  # a length
        word = match[0].rstrip("FU")
        if float(word) == 0.0:
            continue
        whole = re.fullmatch(r"-?\d+", word)
        new = (
            str(max(int(word) + 1, round(1.1 * int(word))))
            if whole
            else f"{1.1 * float(word):.17g}"
        )
        if not whole and not re.search(r"[.e]", new):
            new += ".0"
        yield _mutant(name, text, match.start(), match[0], new + match[0][len(word) :])


def _mutant(name: str, text: str, start: int, old: str, new: str) -> Mutant:
    begin = text.rfind("\n", 0, start) + 1
    line = text[begin : text.find("\n", start)].strip()
    return Mutant(name, text.count("\n", 0, start) + 1, old, new, start, line)


class Bench:
    """An export with what judges it, compiled again for each fault.

    Parameters
    ----------
    folder : Path
        The export.
    name : str
        Its prefix.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.compiler = shutil.which("tcc") or "gcc"
        sources = [*folder.glob(f"{name}*.c"), *folder.glob("core/src/*.c")]
        self.sources = sorted(str(file.relative_to(folder)) for file in sources)
        selftest = sorted(
            str(file.relative_to(folder)) for file in folder.glob(f"selftest/{name}_*.c")
        )
        self.selftest = selftest
        self.controlled = (folder / f"{name}_control.c").exists()
        if self.controlled:
            self._flags = (*self._flags, "-DCONTROLLED")
        self._work = Path(tempfile.mkdtemp(prefix="mutants"))
        (self._work / "judge.c").write_text(JUDGE.format(name, name.upper()))
        self._objects: dict[str, Path] = {}
        for file in [*self.sources, *selftest, str(self._work / "judge.c")]:
            made = self._work / (Path(file).stem + ".o")
            self._call([self.compiler, *self._flags, "-c", file, "-o", str(made)], folder)
            self._objects[file] = made

    _flags = ("-std=c99", "-O0", "-DAMB_NO_CONTRACTION", *INCLUDES)

    def close(self) -> None:
        shutil.rmtree(self._work)

    def text(self, file: str) -> str:
        return (self.folder / file).read_text()

    @functools.cached_property
    def _reads(self) -> dict[str, set[str]]:
        """Return what each source is compiled of: itself, and the headers that it includes."""
        reads = {}
        for file in self.sources:
            words = ["gcc", "-std=c99", "-MM", *INCLUDES, file]
            listed = self._call(words, self.folder).stdout.replace("\\\n", " ").split()[1:]
            reads[file] = {str(Path(name)) for name in listed}
        return reads

    @functools.cached_property
    def flying(self) -> list[str]:
        """Return the files whose operators fly: the C and the headers that it includes."""
        seen = set[str]().union(*self._reads.values())
        return sorted(file for file in seen if not file.endswith((f"{self.name}_data.c", "crc.h")))

    @functools.cached_property
    def linked(self) -> set[str]:
        """Return the functions that a controller's program has of it; others do not fly."""
        called = ["init", "reset", "step"]
        if self.controlled:
            called += ["control_init", "control_step", "control_transfer"]
        roots = [f"-Wl,-u,{self.name}_{what}" for what in called]
        sections = ("-ffunction-sections", "-fdata-sections")
        # What is inlined is a function of its own here, or nobody would find it.
        flags = ("-std=c99", "-w", "-O0", "-Dalways_inline=unused", *sections, "-nostdlib", "-r")
        made = self._work / "linked.o"
        words = ["gcc", *flags, *INCLUDES, *self.sources, "-Wl,--gc-sections", *roots]
        self._call([*words, "-o", str(made)], self.folder)
        listed = self._call(["nm", "--defined-only", str(made)], self.folder).stdout
        # The core's names are others to the linker (core/include/ambkit/precision.h).
        renamed = self.text("core/include/ambkit/precision.h")
        own = {new: old for old, new in re.findall(r"^#define (\w+) (amb_\w+)$", renamed, re.M)}
        found = {line.split()[2] for line in listed.splitlines() if line.split()[1] in "tT"}
        return {own.get(name, name) for name in found}

    def operators(self, *, boundaries: bool = False) -> list[Mutant]:
        """Return a mutant of each operator that flies."""
        linked = self.linked
        return [
            mutant
            for file in self.flying
            for mutant in of_operators(file, self.text(file), boundaries=boundaries)
            if _function_at(self.text(file), mutant.start) in linked | {""}
        ]

    @functools.cached_property
    def never_run(self) -> set[tuple[str, int]]:
        """Return the lines, by file and number, at which the self-test never comes by."""
        made = self._work / "covered"
        made.mkdir(exist_ok=True)
        judge = str(self._work / "judge.c")
        files = [str(self.folder / file) for file in (*self.sources, *self.selftest)]
        includes = [f"-I{self.folder / flag[2:]}" for flag in INCLUDES]
        words = ["gcc", *(flag for flag in self._flags if flag not in INCLUDES), *includes]
        self._call([*words, "--coverage", *files, judge, "-o", "covered"], made)
        self._call(["./covered"], made)
        notes = sorted(path.name for path in made.glob("*.gcda"))
        said = self._call(["gcov", "--json-format", "--stdout", *notes], made).stdout
        counts: dict[tuple[str, int], int] = {}
        for line in said.splitlines():
            for file in json.loads(line)["files"]:
                path = Path(file["file"])
                name = str(path.relative_to(self.folder)) if self.folder in path.parents else ""
                for each in file["lines"]:
                    at = name, each["line_number"]
                    counts[at] = counts.get(at, 0) + each["count"]
        return {at for at, count in counts.items() if count == 0}

    def judge(self, mutant: Mutant) -> Verdict:
        """Compile and run it."""
        with tempfile.TemporaryDirectory(dir=self._work) as place:
            folder = self._copy(mutant, Path(place))
            changed = [file for file in self.sources if mutant.file in self._reads[file]]
            kept = [file for file in self._objects if file not in changed]
            parts = [*changed, *(str(self._objects[file]) for file in kept)]
            words = [self.compiler, *self._flags, *parts, "-o", "judged"]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
            if done.returncode != 0:
                return KILLED  # by the compiler
            try:
                said = subprocess.run(
                    ["./judged"], cwd=folder, capture_output=True, text=True, timeout=SECONDS
                )
            except subprocess.TimeoutExpired:
                return KILLED
            words = said.stdout.split()
            return Verdict(*(word == "1" for word in words[:4])) if len(words) == 7 else KILLED

    @functools.cached_property
    def _original(self) -> bytes:
        return self._optimised(self.folder)

    def is_the_same(self, mutant: Mutant) -> bool:
        """Whether an optimising compiler makes the same program of it."""
        with tempfile.TemporaryDirectory(dir=self._work) as place:
            return self._optimised(self._copy(mutant, Path(place))) == self._original

    def _copy(self, mutant: Mutant, to: Path) -> Path:
        for path in ("core", self.name):
            source = self.folder / path
            if source.is_dir():
                shutil.copytree(source, to / path)
        for file in [*self.folder.glob("*.[ch]"), *self.folder.glob("selftest/*.[ch]")]:
            target = to / file.relative_to(self.folder)
            target.parent.mkdir(exist_ok=True)
            if file.suffix == ".c" and "selftest" in file.parts:
                continue
            shutil.copy(file, target)
        text = self.text(mutant.file)
        end = mutant.start + len(mutant.old)
        (to / mutant.file).write_text(text[: mutant.start] + mutant.new + text[end:])
        return to

    def _optimised(self, folder: Path) -> bytes:
        sections = ("-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-s")
        selftest = [str(self.folder / file) for file in self.selftest]
        flags = ("-std=c99", "-w", "-O2", "-ffp-contract=off", *sections, "-Wl,--build-id=none")
        flags += ("-DCONTROLLED",) * self.controlled
        files = (*self.sources, *selftest, str(self._work / "judge.c"))
        words = ["gcc", *flags, *INCLUDES, *files, "-o", "same"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            return done.stderr.encode()
        made = folder / "same"
        content = made.read_bytes()
        made.unlink()
        return content

    @staticmethod
    def _call(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True)


def _function_at(text: str, place: int) -> str:
    """Return the function that a place in a C file is in; nothing before the first."""
    begin = text.rfind("\n{", 0, place)
    if begin < 0:
        return ""
    head = text[text.rfind(";", 0, begin) + 1 : begin]
    return re.findall(r"^[A-Za-z_][\w *]*?(\w+)\(", head, re.MULTILINE)[-1]


def function_of(bench: Bench, mutant: Mutant) -> str:
    """Return the function that a mutant is in."""
    return _function_at(bench.text(mutant.file), mutant.start)


def why(bench: Bench, mutant: Mutant, known: tuple[unseen.UndetectedFault, ...]) -> str | None:
    """Return why a mutant makes no difference, where that is known."""
    for each in known:
        if (
            mutant.file.endswith(each.file)
            and each.text in mutant.text
            and each.function in ("", function_of(bench, mutant))
        ):
            return each.why
    return None


class Score(NamedTuple):
    """What became of the mutants."""

    mutants: int
    exact: list[Mutant]  # alive in exact mode, and no equivalents
    loose: list[Mutant]  # alive in loose mode, likewise
    without_crc: list[Mutant]  # alive in exact mode but for the CRC
    same: int  # that a compiler proves to be the original

    def __str__(self) -> str:
        alive = (len(self.exact), len(self.loose), len(self.without_crc))
        return "{} mutants, {} the same program; alive: exact {}, loose {}, without CRC {}".format(
            self.mutants, self.same, *alive
        )


def score(bench: Bench, mutants: list[Mutant], jobs: int = 2) -> Score:
    """Judge all of them."""
    with ThreadPoolExecutor(jobs) as pool:
        verdicts = list(pool.map(bench.judge, mutants))
        alive = [
            m for m, v in zip(mutants, verdicts, strict=True) if v.loose or v.exact_without_crc
        ]
        same = {m for m, one in zip(alive, pool.map(bench.is_the_same, alive), strict=True) if one}
    pairs = [(m, v) for m, v in zip(mutants, verdicts, strict=True) if m not in same]
    return Score(
        len(mutants),
        [m for m, v in pairs if v.exact],
        [m for m, v in pairs if v.loose],
        [m for m, v in pairs if v.exact_without_crc],
        len(same),
    )


def main() -> None:
    """Print the score of some kinds; gains are not 1, where a product would be a quotient."""
    from export_cases import BEARING, export_c, export_of

    from ambkit import Machine

    gained = BEARING.replace(sensor__gain=0.8, amplifier__gain=1.6)

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=["linear", "adaptive", "tabulated"])
    parser.add_argument("--precision", choices=["float", "double"], default="float")
    parser.add_argument("--boundaries", action="store_true", help="also < as <= and so on")
    parser.add_argument("--machine", metavar="NAME", help="the linear filter of a preset, by loops")
    parser.add_argument("--sample", type=int, metavar="N", help="so many of each, drawn")
    given = parser.parse_args()
    for kind in [given.machine] if given.machine else given.kinds:
        with tempfile.TemporaryDirectory() as place:
            to = Path(place) / "c"
            if given.machine:
                made = export_c(Machine.preset(kind), None, to, prefix="f", loops=True,
                                precision=given.precision)  # fmt: skip
            else:
                made = export_of(gained, kind, to, prefix="f", precision=given.precision)
            bench = Bench(made.folder, "f")
            known = unseen.lists(bool(given.machine), False, False)
            constants = list(of_constants("f_data.c", bench.text("f_data.c")))
            operators = bench.operators(boundaries=given.boundaries)
            for what, mutants in (("constants", constants), ("operators", operators)):
                if given.sample and given.sample < len(mutants):
                    mutants = random.Random(0).sample(mutants, given.sample)
                found = score(bench, mutants)
                print(f"{kind}, {what}: {found}")
                for label, alive in zip(("exact", "loose", "without CRC"), found[1:4], strict=True):
                    for mutant in alive:
                        reason = why(bench, mutant, known)
                        print(f"  {label}: {mutant}" + (f" [{reason}]" if reason else ""))
                unexplained = [m for m in found.exact if why(bench, m, known) is None]
                print(f"  exact, neither killed nor explained: {len(unexplained)}")
                sys.stdout.flush()
            bench.close()


if __name__ == "__main__":
    main()
