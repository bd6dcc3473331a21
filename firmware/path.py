"""How many instructions a call takes at most, along any path: a bound, and not what was seen.

The linked program is followed instruction by instruction with whole numbers and addresses that are
known, or not (`thumb`): constants are, and so are counters and what is made of them; inputs, the
caller's memory and all floating-point numbers may be anything. Where a branch depends on what is
not known both ways are followed; where they meet again, in the same round of the same loops, the
longer one counts and what both know alike is kept (abstract execution; Gustafsson, Ermedahl,
Sandberg and Lisper 2006). Loops end where their counters say so.
"""

from __future__ import annotations

import heapq
import re
import subprocess
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import NamedTuple

from ambkit.base.errors import AmbkitError
from ambkit.export.pil.build import ARM
from firmware.flow_graph import Graph, is_it, sets_pc
from firmware.registers import LR, PC, SP, State, Unknown
from firmware.thumb import CONDITIONS, Instruction, execute, register

MOST_ROUNDS = 5000
"""Rounds of a loop after which it is taken for one whose end depends on data."""

_RETURN = 0xFFFFFFFE
_STACK = 0x20400000
_OBJECTS = 0x20000000
_APART = 0x10000


class Bound(NamedTuple):
    """What was found."""

    instructions: int | None  # at most, from the first one to the return; None: no bound
    why: str  # not, where there is none


class Program(NamedTuple):
    """A linked image."""

    instructions: dict[int, Instruction]
    names: dict[int, str]  # of functions, by their addresses
    constants: bytes


_LINE = re.compile(r"^\s*([0-9a-f]+):\t(?:((?:[0-9a-f]{4} ?)+)\s*\t)([\w.]+)(?:\t([^@;]*))?")
_SYMBOL = re.compile(r"^([0-9a-f]+) <([^>]+)>:$")
_TARGET = re.compile(r"\s*<[^>]*>")


def load(image: Path) -> Program:
    """Read a linked program by binutils."""
    listing = _call("objdump", "-d", str(image))
    raw = image.with_suffix(".constants")
    _call("objcopy", "-O", "binary", "-j", ".text", str(image), str(raw))
    instructions: dict[int, Instruction] = {}
    names: dict[int, str] = {}
    for line in listing.splitlines():
        if (symbol := _SYMBOL.match(line)) is not None:
            names[int(symbol[1], 16)] = symbol[2]
        elif (found := _LINE.match(line)) is not None:
            at, code, name, rest = int(found[1], 16), found[2].split(), found[3], found[4] or ""
            size = 2 * len(code)
            operands = _operands(_TARGET.sub("", rest).strip())
            instructions[at] = Instruction(at, re.sub(r"\.[nw]$", "", name), operands, size)
    return Program(instructions, names, raw.read_bytes())


def _operands(text: str) -> tuple[str, ...]:
    """Split at commas that are in no brackets and no braces."""
    parts = re.findall(r"(?:\[[^\]]*\]!?|\{[^}]*\}|[^,\[{])+", text)
    return tuple(part.strip() for part in parts if part.strip())


def bound(
    image: Path, function: str, objects: int, points: Mapping[tuple[int, int], str] | None = None
) -> Bound:
    """Return how many instructions a call of a function takes at most."""
    program = load(image)
    state = State(program.constants)
    state.r[SP], state.r[LR] = _STACK, _RETURN
    for k in range(4):
        state.r[k] = _OBJECTS + _APART * k if objects >> k & 1 else None
    for k in range(4, objects.bit_length()):
        if objects >> k & 1:
            state.store(_STACK + 4 * (k - 4), _OBJECTS + _APART * k)
    for (k, offset), name in (points or {}).items():
        state.store(_OBJECTS + _APART * k + offset, _place(image, name))
    (entry,) = [at for at, name in program.names.items() if name == function]
    try:
        return Bound(Walk(program).call(state, entry), "")
    except Unknown as error:
        return Bound(None, str(error))


def _place(image: Path, name: str) -> int:
    """Return the address of a constant."""
    found = re.search(rf"^(\w+) . {name}$", _call("nm", str(image)), re.MULTILINE)
    if found is None:
        raise AmbkitError(f"{image}: has no {name}")
    return int(found[1], 16)


class _Path(NamedTuple):
    """One way through a function, until now."""

    at: int
    rounds: dict[int, int]  # of the loops that it is in, by their headers
    state: State
    taken: int  # instructions


class Walk:
    """A program that is followed."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.entries = {at for at, name in program.names.items() if ".cold" not in name}
        self.graphs: dict[int, Graph] = {}

    def call(self, state: State, entry: int) -> int:
        """Follow a function to its return; what it takes. The state becomes the one after it."""
        if entry not in self.graphs:
            self.graphs[entry] = Graph(self, entry)
        graph, back, order = self.graphs[entry], state.r[LR], count()
        open_: list[tuple[tuple[int, ...], int, _Path]] = []
        ends: list[tuple[State, int]] = []

        def push(path: _Path) -> None:
            heapq.heappush(open_, (graph.place(path.at, path.rounds), next(order), path))

        push(_Path(entry, graph.entered({}, _RETURN, entry), state.copy(), 0))
        while open_:
            place, _, path = heapq.heappop(open_)
            most = path.taken
            while open_ and open_[0][0] == place:  # they meet
                other = heapq.heappop(open_)[2]
                path.state.join(other.state)
                most = max(most, other.taken)
            for there, to, taken in self.stretch(path.state, path.at, graph):
                if to is None:
                    if there.r[PC] != back:
                        raise Unknown(f"{self.where(path.at)} returns where data say")
                    ends.append((there, most + taken))
                else:
                    rounds = graph.entered(path.rounds, path.at, to)
                    if max(rounds.values(), default=0) > MOST_ROUNDS:
                        raise Unknown(f"a loop in {self.where(to)} ends where data say")
                    push(_Path(to, rounds, there, most + taken))
        after = ends[0][0]
        for end, _ in ends[1:]:
            after.join(end)
        state.take(after)
        return max(most for _, most in ends)

    def stretch(self, state: State, at: int, graph: Graph) -> list[tuple[State, int | None, int]]:
        """Follow to where ways part or meet: the states there, where they go on, what it took."""
        taken = 0
        while True:
            insn = self.program.instructions.get(at)
            if insn is None:
                raise Unknown(f"there is no instruction at {at:#x}")
            taken += 1
            after = insn.at + insn.size
            if is_it(insn):
                more, after = self.predicated(state, insn)
                taken += more
                ways: list[int | None] = [after]
            else:
                more, ways = self.one(state, insn, after, graph)
                taken += more
            if ways == [None] or len(ways) > 1:
                return [(state if k == 0 else state.copy(), to, taken) for k, to in enumerate(ways)]
            (to,) = ways
            assert to is not None
            if to in graph.meets:
                return [(state, to, taken)]
            at = to

    def one(
        self, state: State, insn: Instruction, after: int, graph: Graph
    ) -> tuple[int, list[int | None]]:
        """Do one instruction: what it took besides itself, and where it may go on."""
        name = insn.name
        if name[:1] == "b" and name[1:] in CONDITIONS:
            taken, target = state.holds(name[1:]), int(insn.operands[0], 16)
        elif name in ("cbz", "cbnz"):
            value = state.r[_number(insn.operands[0])]
            taken = None if value is None else (value == 0) == (name == "cbz")
            target = int(insn.operands[1], 16)
        elif name in ("tbb", "tbh"):
            return 0, list(dict.fromkeys(self.chosen(state, insn)))
        else:
            return self.straight(state, insn, after, graph)
        ways = [target, after] if taken is None else [target if taken else after]
        return 0, list(dict.fromkeys(ways))

    def straight(
        self, state: State, insn: Instruction, after: int, graph: Graph
    ) -> tuple[int, list[int | None]]:
        """Do what has one way to go on: within the function, or by a call and after it."""
        name = insn.name
        if name in ("b", "bl"):
            target: int | None = int(insn.operands[0], 16)
        elif name in ("bx", "blx"):
            target = state.r[_number(insn.operands[0])]
        else:
            execute(state, insn)
            if not sets_pc(insn):
                return 0, [after]
            target = state.r[PC]
        if target is None:
            raise Unknown(f"{self.where(insn.at)} goes where data say")
        if name in ("bl", "blx"):
            state.r[LR] = after | 1
            return self.call(state, target & ~1), [after]
        if target & ~1 in graph.ways and name == "b":
            return 0, [target & ~1]
        if target & ~1 in self.entries:  # which returns for this one
            return self.call(state, target & ~1), [None]
        state.r[PC] = target
        return 0, [None]

    def predicated(self, state: State, insn: Instruction) -> tuple[int, int]:
        """Do what an `it` makes conditional; each instruction counts, whether done or not."""
        at, condition, taken = insn.at + insn.size, insn.operands[0], 0
        for letter in "t" + insn.name[2:]:
            done = state.holds(condition)
            done = not done if letter == "e" and done is not None else done
            inner = _plain(self.program.instructions[at])
            if inner.name in ("b", "bx", "bl", "blx") or sets_pc(inner):
                raise Unknown(f"{self.where(at)} leaves under a condition")
            taken += 1
            at += inner.size
            if done is None:
                other = state.copy()
                execute(other, inner)
                state.join(other)
            elif done:
                execute(state, inner)
        return taken, at

    def chosen(self, state: State, insn: Instruction) -> list[int]:
        """Return where a table that stands behind a jump leads: one way, or all."""
        wide = 2 if insn.name == "tbh" else 1
        index = state.r[_number(insn.operands[0].strip("[]").split(",")[1].strip())]
        if index is None:
            return self.table(insn)
        entry = state.load(insn.at + 4 + wide * index, wide)
        assert entry is not None
        return [insn.at + 4 + 2 * entry]

    def table(self, insn: Instruction) -> list[int]:
        """Return all ways of a table, which ends where code goes on, or where they lead."""
        wide = 2 if insn.name == "tbh" else 1
        base = at = insn.at + 4
        found: list[int] = []
        end = base
        while end in self.program.instructions and self.program.instructions[end].name[0] == ".":
            end += self.program.instructions[end].size
        while at < end:
            entry = int.from_bytes(self.program.constants[at : at + wide], "little")
            if entry == 0:
                break  # padding
            found.append(base + 2 * entry)
            at, end = at + wide, min(end, found[-1])
        return found

    def where(self, at: int) -> str:
        """Return the name of the function that an address lies in."""
        below = [place for place in self.program.names if place <= at]
        return self.program.names[max(below)] if below else hex(at)


def _plain(insn: Instruction) -> Instruction:
    """Return an instruction without the condition in its name."""
    first, dot, rest = insn.name.partition(".")
    first = first[:-2] if first[-2:] in CONDITIONS else first
    return insn._replace(name=first + dot + rest)


def _number(text: str) -> int:
    found = register(text)
    if found is None:
        raise Unknown(f"register {text}")
    return found


def _call(tool: str, *words: str) -> str:
    done = subprocess.run([ARM + tool, *words], capture_output=True, text=True)
    if done.returncode != 0:
        raise AmbkitError(f"{ARM}{tool} failed:\n{done.stderr.strip()}")
    return done.stdout
