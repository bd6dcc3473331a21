"""Standard streams as they come: closed, or without the letters that are to be printed."""

from __future__ import annotations

import codecs
import io
import os
import sys

_PLAIN = {
    "µ": "u", "μ": "u", "Ω": "Ohm", "°": "deg", "±": "+/-", "²": "^2", "³": "^3", "×": "x",
    "·": " ", "–": "-", "—": "-", "−": "-", "…": "...", "≤": "<=", "≥": ">=", "→": "->",
    "∞": "inf", "√": "sqrt", "σ": "sigma", "\u00a0": " ", "“": '"', "”": '"', "‘": "'", "’": "'",
}  # fmt: skip
"""How engineers write in ASCII; of units, as `ambkit.base.units` reads them."""


def prepare() -> None:
    """Make stdin, stdout and stderr fit to use."""
    # One that is closed becomes the null device: who closes it does not want the output, and no
    # file that is written may take its number. Letters that a stream does not have are spelt out.
    codecs.register_error("spelt", _spelt)
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            null = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115 - as long as we run
            setattr(sys, name, null)
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="spelt")


def _spelt(error: UnicodeError) -> tuple[str, int]:
    """Write letters that an encoding lacks in ASCII; others as TOML and JSON escape them."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    return "".join(_PLAIN.get(letter) or _escaped(ord(letter)) for letter in letters), error.end


def _escaped(code: int) -> str:
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a file's name that is no text
        return f"\\x{code - 0xDC00:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
