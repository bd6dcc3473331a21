"""Names and terms of a model's entries in C."""

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ambkit.models.model import MATRICES, NUMBER, ONE, ROLES, SHOWN, ZERO, Model

Factor = str | None  #: A symbol in C, or None for one.


class Term(NamedTuple):
    """One term of a sum in C."""

    text: str
    symbols: frozenset[str]  #: Its symbols.


Sum = list[Term]  #: Terms in order of summation.


def product(*factors: Factor) -> Term:
    """Return a product of one or two symbols, the factors in the order of their names."""
    symbols = sorted(factor for factor in factors if factor is not None)
    return Term(" * ".join(symbols) or "AMB_C(1.0)", frozenset(symbols))


def in_place(constant: Factor) -> Factor:
    """Return a constant in its struct."""
    return None if constant is None else f"model->{constant}"


def products(pairs: Iterable[tuple[Factor, str | None]]) -> Sum:
    """Return the products of factors with symbols; None stands for zero."""
    return [product(factor, symbol) for factor, symbol in pairs if symbol is not None]


def total(terms: Iterable[Term]) -> str:
    """Return a sum as C, term by term; the text of zero if it is empty."""
    return " + ".join(term.text for term in terms) or "AMB_C(0.0)"


def symbols_of(sums: Iterable[Sum]) -> set[str]:
    """Return all symbols of some sums."""
    return {symbol for terms in sums for term in terms for symbol in term.symbols}


class Stages:
    """Intermediate results, in order of computation."""

    def __init__(self) -> None:
        self._computed: list[tuple[str, str, frozenset[str]]] = []

    def add(self, name: str, terms: Sum, *, times: str | None = None) -> str | None:
        """Return the symbol of a sum (times a symbol), or None if it is empty."""
        # A single symbol keeps its name.
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
        """Return the lines that results depend on, directly or indirectly, and all symbols."""
        all_symbols, lines = symbols_of(results), []
        for name, text, symbols in reversed(self._computed):
            if name in all_symbols:
                lines.append(f"const amb_real {name} = {text};")
                all_symbols |= symbols
        return lines[::-1], all_symbols


GIVEN = "const amb_model *model"
MEAN = "amb_real mean[AMB_STATES]"
COV = "amb_real cov[AMB_TRIANGLE]"
GROWTH = "amb_real growth[AMB_TRIANGLE]"
CURRENTS = "const amb_real iu[AMB_CONTROLS]"

KEYWORDS = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else",
    "enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "register",
    "restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef",
    "union", "unsigned", "void", "volatile", "while", "bool", "true", "false", "amb_real",
    "amb_model",
))  # fmt: skip
"""Reserved names in C, or in an included header."""

Naming = Mapping[tuple[str, int, int], str]  #: Names of constants by matrix, row and column.


class Names:
    """Names of one model's entries, and the functions' access to them."""

    def __init__(self, model: Model, naming: Naming | None = None) -> None:
        self.model = model
        self.n, self.p, self.c = len(model.states), len(model.forces), len(model.controls)
        self.m, self.k = len(model.measurements), len(model.noises)
        self.pairs = [(i, j) for i in range(self.n) for j in range(i, self.n)]
        self.where = {pair: at for at, pair in enumerate(self.pairs)}
        self.constants = self._constants(naming or {})
        self.between = "_" if self.n > 10 else ""
        reserved = {"F", "iu", "mean", "model", *(self.total_force(f) for f in range(self.p))}
        reserved |= KEYWORDS | set(self.constants.values())
        self.state = [at.name + "_" * (at.name in reserved) for at in model.states]

    def _constants(self, naming: Naming) -> dict[tuple[str, int, int], str]:
        """Return the name of each number, in the struct's order."""
        listed: list[tuple[str, int, int]] = []
        for name in MATRICES:
            pattern = self.model.pattern[name]
            if name == "N":
                numbers = [(k, i, j) for k in range(self.k) for i, j in self.pairs]
                listed += [(f"N{k}", i, j) for k, i, j in numbers if pattern[k, i, j] == NUMBER]
            else:
                rows, columns = (pattern == NUMBER).nonzero()
                results = [(name, int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
                listed += [at for at in results if name != "rest" or self.shown(at[1])]
        if unknown := [key for key in naming if key not in listed]:
            raise ValueError(f"the pattern has no number at {unknown}")
        return {**naming} | {
            key: "{}_{}_{}".format(*key) for key in listed if key not in naming
        }  # fmt: skip

    def entries(self, name: str, i: int) -> list[tuple[int, Factor]]:
        """Return the structural entries of a row, by ascending column; None for a one."""
        return [
            (j, None if kind == ONE else self.constants[name, i, j])
            for j, kind in enumerate(self.model.pattern[name][i].tolist())
            if kind != ZERO
        ]

    def pair(self, name: str, i: int, j: int) -> str:
        """Return a name for two states."""
        return f"{name}{i}{self.between}{j}"

    def P(self, i: int, j: int) -> str:
        """Return the symbol of a covariance."""
        return self.pair("P", min(i, j), max(i, j))

    def of_force(self, name: str, f: int, j: int) -> str:
        """Return a name for a force and a state."""
        return f"{name}{j}" if self.p == 1 else f"{name}{f}_{j}"

    def of_control(self, name: str, i: int, at: int) -> str:
        """Return a name for a state (or force) and a control."""
        return f"{name}{i}" if self.c == 1 else f"{name}{i}_{at}"

    def total_force(self, f: int) -> str:
        """Return the name of the total force at a magnet's place."""
        return "f_all" if self.p == 1 else f"f_all{f}"

    def of_p(self, name: str, f: int) -> str:
        """Return the name of a force's stiffness."""
        return name if self.p == 1 else f"{name}{f}"

    def shown(self, i: int) -> bool:
        """Return whether a state's equilibrium follows from the positions."""
        return ROLES.get(self.model.states[i].role) == SHOWN

    def loads(self, symbols: set[str]) -> list[str]:
        """Return the lines that load the symbols of other lines."""
        stored = {name: f"model->{name}" for name in self.constants.values()}
        stored |= {self.P(*ij): f"cov[{at}]" for ij, at in self.where.items()}
        for f in range(self.p):
            stored |= {self.of_p(name, f): f"k[{f}].{name}" for name in ("k_i", "k_s")}
        stored |= {name: f"mean[{i}]" for i, name in enumerate(self.state)}
        return [f"const amb_real {s} = {at};" for s, at in stored.items() if s in symbols]

    def function(
        self, doc: str, name: str, arguments: list[str], body: list[str], returns: str = "void"
    ) -> str:
        """Return an inlined function; the pattern may leave an argument unused."""
        arguments = [GIVEN, *arguments]
        text = "\n".join(body)
        argument_names = [re.sub(r"\[.*", "", at).replace("*", " ").split()[-1] for at in arguments]
        body = [f"(void){at};" for at in argument_names if not re.search(rf"\b{at}\b", text)] + body
        inside = "\n".join("  " + line for line in body)
        head = f"AMB_INLINE {returns} amb_model_{name}({', '.join(arguments)})"
        return f"/* {doc} */\n{head}\n{{\n{inside}\n}}\n"

    def form(self, doc: str, name: str, arguments: list[str], cases: list[list[str]]) -> str:
        """Return a function that returns a number; the last line of each case is its expression."""
        # The first argument selects force or sensor, by a switch if there are several.
        if len(cases) == 1:
            (lines,) = cases
            body = [*lines[:-1], f"return {lines[-1]};"]
        else:
            body = ["amb_real found;"]
            body += switched(arguments[0], [[*at[:-1], f"found = {at[-1]};"] for at in cases])
            body += ["return found;"]
        return self.function(doc, name, arguments, body, "amb_real")


def switched(argument: str, cases: list[list[str]]) -> list[str]:
    """Return lines that execute one of several cases, by an argument that counts from 0."""
    if len(cases) == 1:
        return cases[0]
    lines = [f"switch ({argument.split()[-1]}) {{"]
    for at, case in enumerate(cases):
        label = f"case {at}" if at < len(cases) - 1 else "default"
        lines += [f"{label}: {{", *(f"  {line}" for line in case), "  break;", "}"]
    return [*lines, "}"]
