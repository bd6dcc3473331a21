"""A force law: its statement, and its functions as they are computed.

A law is stated as physics has it. Computed so, it would lose all digits near the origin, where two
equal pulls are subtracted. So each function is written out as steps, in the order in which the C
adds and multiplies, and is held to the law: `check` refuses steps that are not the force of the
statement, or not its derivatives as SymPy finds them.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import sympy as sp

Expr = Any

iu, x, k, i0, s0, there = sp.symbols("iu x k i0 s0 there")
"""Control current, displacement; magnet constant, bias current, air gap; 1, or 0 for one side."""

DIGITS, POINTS = 60, 5
"""Steps and law agree to so many digits, at so many places."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a law.

    Attributes
    ----------
    symbol : Symbol
        In the equations, and the field of the C struct.
    about : str
        What it is, with its unit.
    value : str
        Its value in Python, from ``m``, the ``[magnet]`` of a machine.
    """

    symbol: Expr
    about: str
    value: str


@dataclass(frozen=True)
class Key:
    """A key of ``[magnet]`` that only this law needs: it may be absent."""

    name: str
    unit: str
    example: str
    about: str


@dataclass(frozen=True)
class Function:
    """A function of a law, as it is computed.

    Attributes
    ----------
    name : {"force", "force_one_sided", "tangent", ...}
        Its name in C, behind that of the law. `force` and `tangent` must be there.
    about : str
        In C.
    steps : tuple of (str, str)
        Intermediate results in their order: name, expression.
    results : dict
        For each result its expression as it is computed and what it must be by the law. One called
        ``return`` is returned.
    more : tuple of Symbol
        Arguments between the law and (iu, x): `there`, where a text serves one side and two.
    """

    name: str
    about: str
    steps: tuple[tuple[str, str], ...]
    results: dict[str, tuple[str, Expr]]
    more: tuple[Expr, ...] = ()


@dataclass(frozen=True)
class Law:
    """A force law.

    Attributes
    ----------
    name : str
        As of its files.
    about, reference : str
        What it is, and where it is published.
    parameters : tuple of Parameter
        In the order of the C struct.
    functions : tuple of Function
        As they are computed.
    holds_for : str
        Which magnets it is the law of: a condition in Python on ``m``. The closed law has none,
        and holds where no other does.
    keys : tuple of Key
        What it adds to ``[magnet]``.
    shared : bool
        Whether others compute its functions as well: plant and lanes.
    stem, struct : str
        In C, where they are not ``amb_NAME`` and ``amb_NAME_law``.
    """

    name: str
    about: str
    parameters: tuple[Parameter, ...]
    functions: tuple[Function, ...]
    holds_for: str = ""
    keys: tuple[Key, ...] = ()
    reference: str = ""
    shared: bool = False
    stem: str = ""
    struct: str = ""

    @property
    def title(self) -> str:
        """What it is, at the start of a sentence."""
        return self.about[0].upper() + self.about[1:]

    @property
    def prefix(self) -> str:
        """What its names in C begin with."""
        return self.stem or f"amb_{self.name}"

    @property
    def type(self) -> str:
        """Its struct in C."""
        return self.struct or f"{self.prefix}_law"

    @property
    def symbols(self) -> list[Expr]:
        """Its parameters in the equations."""
        return [item.symbol for item in self.parameters]


def two_sides(side: Expr, gap: Expr, current: Expr) -> Expr:
    """Return the whole force of a magnet, of one side or two, from what one side pulls."""
    own = side.subs({gap: s0 - x, current: i0 + iu}, simultaneous=True)
    other = side.subs({gap: s0 + x, current: i0 - iu}, simultaneous=True)
    return own - there * other


def relative(force: Expr) -> Expr:
    """Return a force less that at the origin."""
    return force - force.subs({iu: 0, x: 0})


def check(law: Law, f: Function) -> None:
    """Refuse a function that does not compute what the law says.

    Raises
    ------
    ValueError
        With the name of the function and of the result.
    """
    known = {str(s): s for s in (*law.symbols, there, iu, x)}
    for name, text in f.steps:
        known[name] = sp.sympify(text, known)
    for name, (text, stated) in f.results.items():
        off = sp.sympify(text, known) - stated
        for place in _places([*law.symbols, *f.more, iu, x]):
            if abs(sp.N(off.subs(place), DIGITS)) > sp.Float(10) ** (20 - DIGITS):
                raise ValueError(f"{f.name}: {name} is not that of the law, at {place}")


def _places(symbols: list[Expr]) -> Iterator[dict[Expr, Expr]]:
    """Yield places at which a law is defined: all positive, and within the air gap."""
    draw = random.Random(0)
    for number in range(POINTS):
        place = {s: sp.Rational(draw.randint(1, 999), 1000) for s in symbols}
        place[there] = number % 2
        yield place | {item: place[item] + 1 for item in (s0, i0) if item in place}
