"""Prefix of all names of an export: valid for compilers, linkers, CMake and file systems."""

from __future__ import annotations

import re

from ambkit.base.errors import AmbkitError

LONGEST = 16  #: Maximum length, so that names differ within C99's 31 significant characters.

_WORDS = {
    "a header of C": (
        *("assert", "complex", "ctype", "errno", "fenv", "float", "inttypes", "iso646", "limits"),
        *("locale", "math", "setjmp", "signal", "stdarg", "stdbool", "stddef", "stdint", "stdio"),
        *("stdlib", "string", "tgmath", "time", "wchar", "wctype"),
    ),
    "a target of the build": (
        *("all", "all_build", "clean", "edit_cache", "help", "install", "package", "run_tests"),
        *("package_source", "rebuild_cache", "selftest", "test", "zero_check", "main"),
    ),
    "a word of C or C++": (
        *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else"),
        *("enum", "extern", "for", "goto", "if", "inline", "int", "long", "register", "restrict"),
        *("return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union"),
        *("unsigned", "void", "volatile", "while", "and", "asm", "bool", "catch", "class", "true"),
        *("delete", "explicit", "export", "false", "friend", "mutable", "namespace", "new", "not"),
        *("operator", "or", "private", "protected", "public", "template", "this", "throw", "try"),
        *("typeid", "typename", "using", "virtual", "xor", "nullptr", "noexcept", "constexpr"),
    ),
    "a device, and no file, on Windows": (
        *("aux", "con", "nul", "prn"),
        *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10)),
    ),
}


def checked(prefix: str | None, name: str) -> str:
    """Return the prefix of an export."""
    if prefix is None:
        made = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST]
        return made if _wrong(made) is None else f"axis_{made}"[:LONGEST]
    if (wrong := _wrong(prefix)) is not None:
        raise AmbkitError(f"prefix {wrong}")
    return prefix


def _wrong(prefix: str) -> str | None:
    """Return its error, or None."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        return f'must be a C identifier, a letter first, is "{prefix}"'
    if len(prefix) > LONGEST:
        return f'must have at most {LONGEST} characters, "{prefix}" has {len(prefix)}'
    lower = prefix.lower()
    if lower == "amb" or lower.startswith(("amb_", "ambkit")):
        return f'must not be "{prefix}": the names of the core start with "amb_"; give another'
    for what, words in _WORDS.items():
        if lower in words:
            return f'must not be "{prefix}", which is {what}; give another'
    return None
