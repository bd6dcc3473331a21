"""Sums of products as text, and the order in which intermediate results are computed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

Factor = str | None
"""A symbol in C, or None for one."""


class Term(NamedTuple):
    """One term of a sum in C."""

    text: str
    symbols: frozenset[str]
    """What it is made of."""


Sum = list[Term]
"""Terms in the order in which they are added up."""


def product(*factors: Factor) -> Term:
    """Return a product of one or two symbols, the factors in the order of their names."""
    symbols = sorted(factor for factor in factors if factor is not None)
    return Term(" * ".join(symbols) or "AMB_C(1.0)", frozenset(symbols))


def in_place(constant: Factor) -> Factor:
    """Return a constant where it is stored."""
    return None if constant is None else f"model->{constant}"


def products(pairs: Iterable[tuple[Factor, str | None]]) -> Sum:
    """Return the products of factors with symbols; a symbol None stands for zero."""
    return [product(factor, symbol) for factor, symbol in pairs if symbol is not None]


def total(terms: Iterable[Term]) -> str:
    """Return a sum as C, term by term; the text of zero where there is none."""
    return " + ".join(term.text for term in terms) or "AMB_C(0.0)"


def symbols_of(sums: Iterable[Sum]) -> set[str]:
    """Return all symbols of some sums."""
    return {symbol for terms in sums for term in terms for symbol in term.symbols}


class Stages:
    """Intermediate results, in the order in which they are computed."""

    def __init__(self) -> None:
        self._computed: list[tuple[str, str, frozenset[str]]] = []

    def add(self, name: str, terms: Sum, *, times: str | None = None) -> str | None:
        """Return the symbol of a sum (times a symbol), or None if the sum is empty."""
        # What is a symbol already keeps its own name.
        if not terms:
            return None
        if len(terms) == 1 and times is None and {terms[0].text} == terms[0].symbols:
            return terms[0].text
        text, symbols = total(terms), frozenset(symbols_of([terms]))
        if times is not None:
            text, symbols = f"({text}) * {times}", symbols | {times}
        self._computed.append((name, text, symbols))
        return name

    def needed(self, results: Iterable[Sum]) -> tuple[list[str], set[str]]:
        """Return the lines that results ask for, at once or through others, and all symbols."""
        all_symbols, lines = symbols_of(results), []
        for name, text, symbols in reversed(self._computed):
            if name in all_symbols:
                lines.append(f"const amb_real {name} = {text};")
                all_symbols |= symbols
        return lines[::-1], all_symbols
