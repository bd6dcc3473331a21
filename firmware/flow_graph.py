"""Control-flow graph of a function in a linked program, with its loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware.thumb import CONDITIONS, Instruction

if TYPE_CHECKING:
    from firmware.path import Walk


class Graph:
    """Control flow of a function, and its loops."""

    def __init__(self, walk: Walk, entry: int) -> None:
        self.ways: dict[int, list[int]] = {}
        before: dict[int, list[int]] = {}
        waiting = [entry]
        while waiting:
            at = waiting.pop()
            insn = walk.program.instructions.get(at)
            if at in self.ways or insn is None:
                continue
            following = _following(walk, insn, entry)
            self.ways[at] = following
            waiting += following
            for to in following:
                before.setdefault(to, []).append(at)
        self.meets = {at for at, froms in before.items() if len(froms) > 1} | {entry}
        self.rank, backs = self._ranked(entry)
        self.loops: dict[int, set[int]] = {}
        for of, header in backs:
            self.loops.setdefault(header, {header}).update(_reaching(of, header, before))
        self.meets |= set(self.loops)
        # Of each place the loops that it is in, the outermost first.
        outer = sorted(self.loops, key=lambda header: -len(self.loops[header]))
        self.nest = {at: [h for h in outer if at in self.loops[h]] for at in self.ways}

    def _ranked(self, entry: int) -> tuple[dict[int, int], list[tuple[int, int]]]:
        """Return the reverse postorder, and the ways that lead back."""
        done: list[int] = []
        backs: list[tuple[int, int]] = []
        under, seen = {entry}, {entry}
        stack = [(entry, iter(self.ways[entry]))]
        while stack:
            at, following = stack[-1]
            to = next(following, None)
            if to is None:
                stack.pop()
                under.discard(at)
                done.append(at)
            elif to in under:
                backs.append((at, to))
            elif to not in seen and to in self.ways:
                seen.add(to)
                under.add(to)
                stack.append((to, iter(self.ways[to])))
        return {at: k for k, at in enumerate(reversed(done))}, backs

    def place(self, at: int, rounds: dict[int, int]) -> tuple[int, ...]:
        """Return what orders places: who is behind, in an earlier round, goes first."""
        within = [part for h in self.nest[at] for part in (self.rank[h], rounds[h])]
        return (*within, self.rank[at])

    def entered(self, rounds: dict[int, int], of: int, to: int) -> dict[int, int]:
        """Return the rounds after a way that leads to `to`."""
        kept = {h: rounds.get(h, 0) for h in self.nest[to]}
        if to in self.loops:
            back = of in self.loops[to]
            inner = {h for h in kept if h != to and self.loops[h] <= self.loops[to]}
            kept = {h: n for h, n in kept.items() if h not in inner}
            kept |= dict.fromkeys(inner, 0)
            kept[to] = rounds.get(to, 0) + 1 if back else 0
        return kept


def _following(walk: Walk, insn: Instruction, entry: int) -> list[int]:
    """Return where an instruction may go on within its function."""
    name, after = insn.name, insn.at + insn.size
    if is_it(insn):
        for _ in insn.name[1:]:
            after += walk.program.instructions[after].size
        return [after]
    if name == "b":
        ways = [int(insn.operands[0], 16)]
    elif name[:1] == "b" and name[1:] in CONDITIONS:
        ways = [int(insn.operands[0], 16), after]
    elif name in ("cbz", "cbnz"):
        ways = [int(insn.operands[1], 16), after]
    elif name in ("tbb", "tbh"):
        ways = walk.table(insn)
    elif name == "bx" or sets_pc(insn):
        ways = []
    else:
        ways = [after]
    return [to for to in dict.fromkeys(ways) if to == entry or to not in walk.entries]


def _reaching(of: int, header: int, before: dict[int, list[int]]) -> set[int]:
    """Return all from where `of` is reached but by way of the header."""
    found, waiting = {header}, [of]
    while waiting:
        at = waiting.pop()
        if at not in found:
            found.add(at)
            waiting += before.get(at, [])
    return found


def is_it(insn: Instruction) -> bool:
    """Return whether an instruction begins an IT block."""
    return insn.name.startswith("it") and set(insn.name[1:]) <= set("te")


def sets_pc(insn: Instruction) -> bool:
    """Return whether an instruction writes the program counter."""
    if insn.name.startswith(("pop", "ldm")):
        return "pc" in insn.operands[-1]
    return insn.operands[:1] == ("pc",)
