"""What an ARMv7-M knows: registers, flags and memory, each number known or not (None)."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from ambkit.base.errors import AmbkitError

_T = TypeVar("_T")

MASK = 0xFFFFFFFF
SP, LR, PC = 13, 14, 15


class Unknown(AmbkitError):
    """What a program does here cannot be told: an address, a target or an instruction."""


class Flags(NamedTuple):
    """Condition flags; each may be unknown."""

    n: bool | None = None
    z: bool | None = None
    c: bool | None = None
    v: bool | None = None


class State:
    """Registers, flags and memory; what is not in memory is unknown, or read only."""

    def __init__(self, constants: bytes) -> None:
        self.constants = constants
        self.r: list[int | None] = [None] * 16
        self.s: list[int | None] = [None] * 32
        self.flags = Flags()
        self.memory: dict[int, int] = {}  # bytes

    def copy(self) -> State:
        """Return another one that is the same."""
        made = State(self.constants)
        made.r, made.s = list(self.r), list(self.s)
        made.flags, made.memory = self.flags, dict(self.memory)
        return made

    def take(self, other: State) -> None:
        """Become what another one is."""
        self.r, self.s = other.r, other.s
        self.flags, self.memory = other.flags, other.memory

    def join(self, other: State) -> None:
        """Keep what both know alike."""
        self.r = [_same(a, b) for a, b in zip(self.r, other.r, strict=True)]
        self.s = [_same(a, b) for a, b in zip(self.s, other.s, strict=True)]
        self.flags = Flags(*(_same(a, b) for a, b in zip(self.flags, other.flags, strict=True)))
        theirs = other.memory
        self.memory = {at: b for at, b in self.memory.items() if theirs.get(at) == b}

    def load(self, at: int | None, size: int = 4) -> int | None:
        """Return `size` bytes at an address."""
        if at is None:
            return None
        if at >= 0 and at + size <= len(self.constants):
            return int.from_bytes(self.constants[at : at + size], "little")
        found = [self.memory.get(at + i) for i in range(size)]
        if None in found:
            return None
        return sum(byte << 8 * i for i, byte in enumerate(found) if byte is not None)

    def store(self, at: int | None, value: int | None, size: int = 4) -> None:
        """Write `size` bytes; to an address that is unknown nothing can be."""
        if at is None:
            raise Unknown("a store goes to an address that depends on data")
        if at < len(self.constants):
            raise Unknown("a store goes to constants")
        for i in range(size):
            if value is None:
                self.memory.pop(at + i, None)
            else:
                self.memory[at + i] = value >> 8 * i & 0xFF

    def holds(self, condition: str) -> bool | None:
        """Return whether a condition is met; None: it may be."""
        n, z, c, v = self.flags
        even = None if n is None or v is None else n == v
        told: dict[str, bool | None] = {
            "eq": z, "cs": c, "hs": c, "mi": n, "vs": v,
            "hi": _and(c, _not(z)), "ge": even, "gt": _and(_not(z), even),
        }  # fmt: skip
        if condition in told:
            return told[condition]
        against = {
            "ne": "eq", "cc": "cs", "lo": "cs", "pl": "mi", "vc": "vs", "ls": "hi", "lt": "ge",
            "le": "gt",
        }  # fmt: skip
        return _not(told[against[condition]])


def _same(a: _T | None, b: _T | None) -> _T | None:
    return a if a == b else None


def _not(a: bool | None) -> bool | None:
    return None if a is None else not a


def _and(a: bool | None, b: bool | None) -> bool | None:
    if a is False or b is False:
        return False
    return None if a is None or b is None else True
