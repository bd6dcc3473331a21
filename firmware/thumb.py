"""Thumb-2 instructions on numbers that are known or not: what `path` follows a program with.

Whole numbers and addresses are followed; of floating-point registers only what is moved through
them, and every result of their arithmetic is unknown. What is not known is None.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from firmware.registers import LR, MASK, PC, SP, Flags, State, Unknown

_NAMES = {f"r{i}": i for i in range(16)} | {
    "sb": 9, "sl": 10, "fp": 11, "ip": 12, "sp": SP, "lr": LR, "pc": PC,
}  # fmt: skip
CONDITIONS = (
    "eq", "ne", "cs", "hs", "cc", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le",
)  # fmt: skip


class Instruction(NamedTuple):
    """One line of a disassembly."""

    at: int
    name: str  # mnemonic without width: "ldr", "vmov.f32"
    operands: tuple[str, ...]
    size: int  # bytes


def register(text: str) -> int | None:
    """Return the number of a core register; None: it is none."""
    return _NAMES.get(text)


def listed(text: str) -> list[str]:
    """Return the registers of a list in braces."""
    found: list[str] = []
    for part in text.strip("{}").split(","):
        first, _, last = part.strip().partition("-")
        if last:
            kind = first[0]
            found += [f"{kind}{i}" for i in range(int(first[1:]), int(last[1:]) + 1)]
        else:
            found.append(first)
    return found


# ---- What instructions do ----


def _signed(a: int) -> int:
    return a - (a >> 31 << 32)


def _added(a: int, b: int, carry: int) -> tuple[int, Flags]:
    total = a + b + carry
    low = total & MASK
    over = not -(1 << 31) <= _signed(a) + _signed(b) + carry < 1 << 31
    return low, Flags(low >> 31 == 1, low == 0, total > MASK, over)


def _shifted(value: int | None, how: str, by: int | None) -> int | None:
    if value is None or by is None:
        return None
    if how == "lsl":
        return value << by & MASK if by < 32 else 0
    if how == "lsr":
        return value >> by if by < 32 else 0
    if how == "asr":
        return _signed(value) >> min(by, 31) & MASK
    if how == "ror":
        return (value >> by % 32 | value << 32 - by % 32) & MASK
    raise Unknown(f"shift {how}")


def _value(state: State, at: int, texts: tuple[str, ...]) -> int | None:
    """Return an operand: a number or a register, perhaps shifted."""
    text = texts[0]
    if text.startswith("#"):
        return int(text[1:], 0) & MASK
    number = register(text)
    if number is None:
        raise Unknown(f"operand {text}")
    value = at + 4 if number == PC else state.r[number]
    if len(texts) > 1:
        how, _, by = texts[1].partition(" ")
        amount = int(by[1:], 0) if by.startswith("#") else state.r[_NAMES[by]]
        value = _shifted(value, how, amount)
    return value


_ADDRESS = re.compile(r"\[(\w+)(?:, (#-?\w+|\w+)(?:, lsl #(\d+))?)?\](!?)(?:, (#-?\w+))?$")


def _address(state: State, insn: Instruction, text: str) -> int | None:
    """Return the address that an operand in brackets says, and write back where it says so."""
    found = _ADDRESS.match(text)
    if found is None:
        raise Unknown(f"address {text}")
    base_name, offset_text, shift, writes, after = found.groups()
    base = register(base_name)
    assert base is not None
    start = (insn.at + 4 & ~3) if base == PC else state.r[base]
    offset: int | None = 0
    if offset_text is not None:
        offset = _value(state, insn.at, (offset_text,))
        if shift and offset is not None:
            offset = offset << int(shift)
    at = None if start is None or offset is None else start + offset & MASK
    if writes:
        state.r[base] = at
    elif after:
        state.r[base] = None if start is None else start + int(after[1:], 0) & MASK
    return at


_WIDTHS = {"": 4, "b": 1, "h": 2, "sb": -1, "sh": -2}


def _loads(state: State, insn: Instruction) -> None:
    width = _WIDTHS[insn.name[3:]]
    value = state.load(_address(state, insn, ", ".join(insn.operands[1:])), abs(width))
    if width < 0 and value is not None:
        value = (value - (value >> 8 * -width - 1 << 8 * -width)) & MASK
    state.r[_NAMES[insn.operands[0]]] = value


def _stores(state: State, insn: Instruction) -> None:
    value = state.r[_NAMES[insn.operands[0]]]
    width = _WIDTHS[insn.name[3:]]
    state.store(_address(state, insn, ", ".join(insn.operands[1:])), value, width)


def _two(state: State, insn: Instruction) -> None:
    at = _address(state, insn, ", ".join(insn.operands[2:]))
    for k, text in enumerate(insn.operands[:2]):
        here = None if at is None else at + 4 * k
        if insn.name == "ldrd":
            state.r[_NAMES[text]] = state.load(here)
        else:
            state.store(here, state.r[_NAMES[text]])


def _words(state: State, text: str) -> list[tuple[list[int | None], int]]:
    """Return where the words of a register list stand: a file of registers, and the place."""
    found: list[tuple[list[int | None], int]] = []
    for name in listed(text):
        if name[0] == "s" and name[1:].isdigit():
            found.append((state.s, int(name[1:])))
        elif name[0] == "d":
            found += [(state.s, 2 * int(name[1:])), (state.s, 2 * int(name[1:]) + 1)]
        else:
            found.append((state.r, _NAMES[name]))
    return found


def _many(state: State, insn: Instruction) -> None:
    """Move several words: push, pop, ldmia, stmdb and their like for floating-point registers."""
    name = insn.name.lstrip("v")
    if name in ("push", "pop"):
        base, text, back, down = SP, insn.operands[0], True, name == "push"
    else:
        first, text = insn.operands
        base, back, down = _NAMES[first.rstrip("!")], first.endswith("!"), "db" in name
    words = _words(state, text)
    size = 4 * len(words)
    start = state.r[base]
    low = None if start is None else start - size if down else start
    kept = state.r[base] if not back else low if down else None if low is None else low + size
    if back or not any(file is state.r and i == base for file, i in words):
        state.r[base] = kept
    for k, (file, i) in enumerate(words):
        at = None if low is None else low + 4 * k
        if name in ("push", "stm", "stmia", "stmdb"):
            state.store(at, start if file is state.r and i == base else file[i])
        else:
            file[i] = state.load(at)


def _float(state: State, insn: Instruction) -> None:
    """Follow what only moves; of the rest nothing is known afterwards."""
    name, operands = insn.name.split(".")[0], insn.operands
    if name in ("vldr", "vstr"):
        at = _address(state, insn, ", ".join(operands[1:]))
        for k, (file, i) in enumerate(_words(state, operands[0])):
            here = None if at is None else at + 4 * k
            if name == "vldr":
                file[i] = state.load(here)
            else:
                state.store(here, file[i])
    elif name == "vmov" and not operands[-1].startswith("#"):
        half = len(operands) // 2
        into = [each for text in operands[:half] for each in _words(state, text)]
        if len(operands) == 3:  # two core registers and one of double width
            cut = 2 if operands[1] in _NAMES else 1
            into = [each for text in operands[:cut] for each in _words(state, text)]
            half = cut
        of = [file[i] for text in operands[half:] for file, i in _words(state, text)]
        for (file, i), value in zip(into, of, strict=True):
            file[i] = value
    elif name == "vmrs":
        state.flags = Flags()
    elif name not in ("vcmp", "vcmpe", "vmsr"):
        for file, i in _words(state, operands[0]):
            file[i] = None


_LOGICAL: dict[str, Callable[[int, int], int]] = {
    "and": lambda a, b: a & b, "orr": lambda a, b: a | b, "eor": lambda a, b: a ^ b,
    "bic": lambda a, b: a & ~b, "orn": lambda a, b: a | ~b & MASK,
}  # fmt: skip
_MULTIPLIED: dict[str, Callable[..., int]] = {
    "mul": lambda a, b: a * b, "mla": lambda a, b, c: a * b + c, "mls": lambda a, b, c: c - a * b,
    "udiv": lambda a, b: a // b if b else 0,
    "sdiv": lambda a, b: int(_signed(a) / _signed(b)) if b else 0,
}  # fmt: skip


def _sum(state: State, insn: Instruction) -> None:
    """Add, subtract or compare."""
    name = insn.name
    compared = name in ("cmp", "cmn")
    base = {"cmp": "sub", "cmn": "add"}.get(name, name.removesuffix("w"))
    sets = compared or base not in ("add", "adc", "sub", "sbc", "rsb")
    base = base if base in ("add", "adc", "sub", "sbc", "rsb") else base[:-1]
    operands = insn.operands if compared else insn.operands[1:]
    if not compared and (len(operands) < 2 or operands[1].startswith(("ls", "as", "ro"))):
        operands = insn.operands  # the first one is also what the result goes to
    a = _value(state, insn.at, operands[:1])
    b = _value(state, insn.at, operands[1:])
    carry: int | None = {"add": 0, "sub": 1, "rsb": 1}.get(base, state.flags.c)
    if a is None or b is None or carry is None:
        result, flags = None, Flags()
    elif base in ("add", "adc"):
        result, flags = _added(a, b, int(carry))
    elif base == "rsb":
        result, flags = _added(~a & MASK, b, 1)
    else:
        result, flags = _added(a, ~b & MASK, int(carry))
    if sets:
        state.flags = flags
    if not compared:
        state.r[_NAMES[insn.operands[0]]] = result


def _logic(state: State, insn: Instruction) -> None:
    """Combine, test, move or shift; the carry of a shift is not followed."""
    name = {"tst": "ands", "teq": "eors"}.get(insn.name, insn.name)
    tested = insn.name in ("tst", "teq")
    plain = (*_LOGICAL, "mov", "mvn", "movw", "lsl", "lsr", "asr", "ror")
    sets = name not in plain
    base = name[:-1] if sets else name
    operands = insn.operands if tested else insn.operands[1:]
    if base in ("mov", "movw", "mvn"):
        value = _value(state, insn.at, operands)
        result = value if base != "mvn" else None if value is None else ~value & MASK
    else:
        if not tested and len(operands) == 1:
            operands = insn.operands
        a = _value(state, insn.at, operands[:1])
        b = _value(state, insn.at, operands[1:])
        if base in _LOGICAL:
            result = None if a is None or b is None else _LOGICAL[base](a, b) & MASK
        else:
            result = _shifted(a, base, b)
    if sets:
        known = None if result is None else (result >> 31 == 1, result == 0)
        n, z = (None, None) if known is None else known
        shifts = base in ("lsl", "lsr", "asr", "ror") or len(operands) > 2
        state.flags = Flags(n, z, None if shifts else state.flags.c, state.flags.v)
    if not tested:
        state.r[_NAMES[insn.operands[0]]] = result


def _field(state: State, insn: Instruction) -> None:
    """Take a part of a register, or all of it as a number of fewer bits."""
    name, operands = insn.name, insn.operands
    into = _NAMES[operands[0]]
    if name[1:3] == "xt":
        bits, low, of = (8 if name.endswith("b") else 16), 0, operands[-1]
    elif name in ("ubfx", "sbfx"):
        bits, low, of = int(operands[3][1:], 0), int(operands[2][1:], 0), operands[1]
    else:  # bfi, bfc: some bits are others
        state.r[into] = None
        return
    value = state.r[_NAMES[of]]
    if value is not None:
        value = value >> low & (1 << bits) - 1
        if name[0] == "s" and value >> bits - 1:
            value = (value - (1 << bits)) & MASK
    if name[3:4] == "a" and value is not None:  # and added to another one
        other = state.r[_NAMES[operands[1]]]
        value = None if other is None else (value + other) & MASK
    state.r[into] = value


def _product(state: State, insn: Instruction) -> None:
    name, operands = insn.name.replace("muls", "mul"), insn.operands
    if name in ("umull", "smull"):
        values = [state.r[_NAMES[text]] for text in operands[2:]]
        for text in operands[:2]:
            state.r[_NAMES[text]] = None
        if None not in values:
            a, b = (v if name[0] == "u" else _signed(v) for v in values if v is not None)
            state.r[_NAMES[operands[0]]] = a * b & MASK
            state.r[_NAMES[operands[1]]] = a * b >> 32 & MASK
        return
    texts = operands[1:] if len(operands) > 2 else operands
    values = [state.r[_NAMES[text]] for text in texts]
    known = [v for v in values if v is not None]
    result = _MULTIPLIED[name](*known) & MASK if len(known) == len(values) else None
    state.r[_NAMES[operands[0]]] = result
    if insn.name == "muls":
        n, z = (None, None) if result is None else (result >> 31 == 1, result == 0)
        state.flags = state.flags._replace(n=n, z=z)


_DONE: tuple[tuple[re.Pattern[str], Callable[[State, Instruction], None]], ...] = tuple(
    (re.compile(pattern + r"$"), do)
    for pattern, do in (
        (r"ldr(|b|h|sb|sh)", _loads), (r"str(|b|h)", _stores), (r"ldrd|strd", _two),
        (r"v?(push|pop)|v?(ldm|stm)(|ia|db)", _many), (r"v.*", _float),
        (r"(add|sub)[sw]?|(adc|sbc|rsb)s?|cmp|cmn", _sum),
        (r"(mov|mvn|and|orr|eor|bic|orn|lsl|lsr|asr|ror)s?|movw|tst|teq", _logic),
        (r"[us]xta?[bh]|[us]bfx|bfi|bfc", _field), (r"muls?|mla|mls|[us]div|[us]mull", _product),
    )
)  # fmt: skip


def execute(state: State, insn: Instruction) -> None:
    """Do what an instruction does that leads to the next one."""
    if insn.name == "nop" or insn.name.startswith(("dmb", "dsb")):
        return
    if insn.name == "movt":
        into = _NAMES[insn.operands[0]]
        low = state.r[into]
        value = int(insn.operands[1][1:], 0)
        state.r[into] = None if low is None else low & 0xFFFF | value << 16
        return
    for pattern, do in _DONE:
        if pattern.match(insn.name):
            do(state, insn)
            return
    raise Unknown(f"instruction {insn.name}")
