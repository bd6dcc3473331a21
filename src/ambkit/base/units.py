"""Units at the boundary: parse ``"2 mm"`` into SI, format SI for humans.

Numbers are parsed with `decimal.Decimal`, so that ``"2 mm"`` is exactly the float ``0.002`` and
values survive repeated reading and writing unchanged.
"""

import math
import re
from decimal import Decimal, DecimalException
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pint import UnitRegistry

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"\s*([+-]?\d+),(\d+)")
_WITHIN_QUANTITY = re.compile(r"(?:(?<=\d)|(?<=\d\sN)|(?<=\d\sA)) (?!to\b)(?=[A-Za-zµΩ%])")
_LONGEST = 100  # characters of a unit
_SHOWN = 60  # characters of a text in a message
_REVOLUTIONS = ("rpm", "krpm", "rps", "revolution/min", "revolution/s")
_PREFIXES = {"M": 6, "k": 3, "": 0, "m": -3, "µ": -6, "n": -9, "p": -12, "f": -15}

Root = tuple[Decimal, dict[str, Any]]
"""Factor of a unit to pint's root units, and their exponents; none is zero."""

# pint's import and registry take a second, longer than most commands. Products of these units have
# the same size as in pint, and need no import.
_ROOTS = {"g": "gram", "m": "meter", "s": "second", "A": "ampere", "K": "kelvin", "rad": "radian"}
_TURN = "6.283185307179586476925286766"
_COMMON = {
    "1": ("1", ""),
    "dimensionless": ("1", ""),
    "%": ("0.01", ""),
    "N": ("1", "kg m/s^2"),
    "Pa": ("1", "N/m^2"),
    "J": ("1", "N m"),
    "W": ("1", "J/s"),
    "V": ("1", "W/A"),
    "ohm": ("1", "V/A"),
    "H": ("1", "V s/A"),
    "T": ("1", "V s/m^2"),
    "Hz": ("1", "1/s"),
    "min": ("60", "s"),
    "deg": ("0.01745329251994329576923690768", "rad"),
    "rpm": ("0.1047197551196597746154214461", "rad/s"),
}
_SPELLINGS = {
    "mil": "thou", "mils": "thou", "Volt": "V", "Volts": "V", "volts": "V", "Amps": "A",
    "amps": "A", "Ampere": "A", "Second": "s", "MIL": "thou", "MILS": "thou", "SEC": "s",
}  # fmt: skip
"""Notations of instruments; pint's mil is an angle."""
_SPELLED = re.compile(rf"\b({'|'.join(_SPELLINGS)})\b")
_SHIFTS = {"G": 9, **_PREFIXES, "c": -2, "u": -6, "μ": -6}
_FACTOR = re.compile(
    r"(?P<operator>^|\s*[*/]\s*|\s+)"
    r"(?:\((?P<product>[^()]+)\)|(?P<unit>[A-Za-zµμ%]+|1)(?:(?:\^|\*\*)(?P<power>-?[1-9]))?)"
)


@cache
def _registry() -> "UnitRegistry[Any]":
    from pint import UnitRegistry

    return UnitRegistry(non_int_type=Decimal)


@cache
def _root(unit: str) -> Root:
    if len(unit) > _LONGEST:  # pint's time is quadratic in it
        raise ValueError(f'"{unit[:20]}..." is not a known unit')
    if "," in unit:  # pint would ignore it
        raise ValueError(f'"{unit}" is not a known unit')
    unit = _SPELLED.sub(lambda match: _SPELLINGS[match[0]], unit)
    return _common_root(unit) or _root_by_pint(unit)


def _common_root(unit: str) -> Root | None:
    """Return the root of a product of common units; None for any other."""
    size, exponents, end = Decimal(1), dict.fromkeys(_ROOTS.values(), 0), 0
    while end < len(unit):
        match = _FACTOR.match(unit, end)
        if match is None or (match["operator"] and not end):
            return None
        factor = _common_root(match["product"]) if match["product"] else _named(match["unit"])
        if factor is None:
            return None
        n = int(match["power"] or 1) * (-1 if "/" in match["operator"] else 1)
        size = size * factor[0] ** n if n > 0 else size / factor[0] ** -n
        for root, exponent in factor[1].items():
            exponents[root] += n * exponent
        end = match.end()
    return size, {root: n for root, n in exponents.items() if n}


def _named(name: str) -> Root | None:
    """Return the root of a common unit with its prefix."""
    shift = 0
    if name not in _COMMON and name not in _ROOTS:
        shift, name = _SHIFTS.get(name[0], 0), name[1:] if name[0] in _SHIFTS else ""
    if name in _ROOTS:
        return Decimal(1).scaleb(shift), {_ROOTS[name]: 1}
    number, others = _COMMON.get(name, ("", ""))
    if not number or (shift and not others):  # a plain number takes no prefix
        return None
    size, exponents = _root(others)
    return Decimal(number).scaleb(shift) * size, exponents


def _root_by_pint(unit: str) -> Root:
    registry = _registry()
    try:
        parsed = registry.parse_units(unit)
        scale, root = registry.get_root_units(parsed)
        offset = registry.Quantity(Decimal(0), parsed).m_as(root)
    except Exception:  # pint passes on any error of its tokenizer and evaluator
        raise ValueError(f'"{unit}" is not a known unit') from None
    if offset != 0:
        raise ValueError(f"{unit} does not start at zero, use {root:~} instead")
    size = Decimal(str(scale))
    if not 0 < float(size) < math.inf:  # of an exponent with many digits
        raise ValueError(f'"{unit}" is too large or too small a unit')
    return size, dict(registry.Quantity(1, root).unit_items())


@cache
def _decimal_factor(from_unit: str, to_unit: str) -> Decimal:
    (source, source_root), (target, target_root) = _root(from_unit), _root(to_unit)
    # pint treats an angle as a plain number, and would accept "50 rad/s" as 50 Hz. Revolutions per
    # minute are a frequency nevertheless.
    if source_root != target_root and (from_unit in _REVOLUTIONS and target_root == _root("Hz")[1]):
        return source / _root("revolution")[0] / target
    if source_root != target_root:
        raise ValueError(f"{from_unit} cannot be converted to {to_unit}")
    return source / target


def factor(from_unit: str, to_unit: str) -> float:
    """Return the factor from `from_unit` to `to_unit`."""
    return float(_decimal_factor(from_unit, to_unit))


def parse(text: str, unit: str) -> float:
    """Parse a number with its unit, and return it in `unit`."""
    comma = _DECIMAL_COMMA.match(text)
    excerpt = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    if comma:
        raise ValueError(f'"{excerpt}" has a decimal comma, write {comma[1]}.{comma[2]}')
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f'"{excerpt}" is not a number with a unit')
    number, unit_text = match.groups()
    if not unit_text and unit != "1":
        raise ValueError(f'"{excerpt}" has no unit')
    if unit_text and unit == "1" and unit_text != "%":
        raise ValueError(f'"{excerpt}" must be a plain number')
    try:
        value = float(Decimal(number) * _decimal_factor(unit_text or "1", unit))
    except ValueError as error:
        raise ValueError(f'"{excerpt}": {error}') from None
    except DecimalException:  # of an exponent that a Decimal cannot have
        value = math.inf
    if not math.isfinite(value):
        raise ValueError(f'"{excerpt}" is too large or too small a number')
    return value


def base_unit(text: str) -> str:
    """Return the SI base units of a number with its unit."""
    match = _QUANTITY.fullmatch(text)
    if match is None or not match[2]:
        parse(text, "m")  # which raises the error
        raise ValueError(f'"{text[:_SHOWN]}" has no unit')
    symbols = {root: symbol for symbol, root in _ROOTS.items()} | {"gram": "kg"}
    powers = (f"{symbols.get(root, root)}^{n}" for root, n in _root(match[2])[1].items())
    return "*".join(powers) or "dimensionless"


def engineering(value: float, unit: str, digits: int | None = 6, like: float | None = None) -> str:
    """Format a value in engineering notation: ``0.002, "m"`` gives ``"2 mm"``."""
    if not math.isfinite(value):
        return f"{value} {unit}"
    exact = Decimal(repr(float(value)) if digits is None else f"{value:.{digits}g}")
    if unit == "1":
        return _plain(exact)
    head, symbol, power, tail, own = _split(unit)
    least = Decimal(1).scaleb(-power)
    chooses = abs(exact)
    if like is not None and math.isfinite(like) and like != 0:
        # Rounded as with the usual digits, so that 9999.99 and its error agree.
        chooses = abs(Decimal(f"{like:.4g}"))
    if not symbol or chooses == 0 or least <= chooses < 10_000:
        return f"{_plain(exact)} {unit}"
    scales = [(prefix, (shift - own) * power) for prefix, shift in _PREFIXES.items()]
    fitting = [scale for scale in scales if chooses.scaleb(-scale[1]) >= least]
    prefix, shift = fitting[0] if fitting else scales[-1]
    return f"{_plain(exact.scaleb(-shift))} {head}{prefix}{symbol}{tail}"


def figure(number: Any, unit: str, digits: int = 4, like: float | None = None) -> str:
    """Format a value of a table, or several by name; a dash if there is none."""
    # The error of a value, or its reference, uses the value's prefix: `like`.
    if isinstance(number, dict):
        return ", ".join(f"{k} {figure(item, unit, digits, like)}" for k, item in number.items())
    if number is None or not math.isfinite(number):
        return "–"
    return engineering(number, unit, digits=digits, like=like)


def interval(
    low: float, high: float, unit: str, digits: int | None = 6, like: float | None = None
) -> str:
    """Format an interval, with a common unit written once."""
    first, last = (engineering(end, unit, digits, like) for end in (low, high))
    number, _, of = first.partition(" ")
    return f"{number if last.endswith(f' {of}') else first} to {last}"


def with_error(value: float, error: float) -> str:
    """Format a plain number with its error, both to the second digit of the error."""
    if not math.isfinite(error):
        return f"{value:.3g}"
    if abs(value) >= 1e12 or error >= 1e6:
        return f"{value:.3g} ± {error:.2g}"
    if error <= 1e-9 * abs(value):  # rounding
        return f"{value:.4g} ± 0"
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def rpm(speed: float, digits: int = 5) -> str:
    """Format a speed of rotation [rad/s] in revolutions per minute, without exponent."""
    turns = speed * 30 / math.pi
    return f"{Decimal(f'{turns:.{digits}g}'):f} rpm" if math.isfinite(turns) else f"{turns} rpm"


def percent(share: float, digits: int = 2) -> str:
    """Format a share in percent, without exponent."""
    return f"{Decimal(f'{100 * share:.{digits}g}'):f} %" if math.isfinite(share) else "–"


def typeset(text: str) -> str:
    """Typeset the result of `engineering`: ``"-6 mm^2"`` becomes ``"−6 mm²"``."""
    # No line break between a number and its unit, within a unit, or before an error.
    text = text.replace("^2", "²").replace(" ± ", "\u00a0±\u00a0")
    text = re.sub(r"(?<![\w.)])-(?=[\d.∞])", "−", text)  # neither in words, nor in "ISO 14839-3"
    return _WITHIN_QUANTITY.sub("\u00a0", text)


def _plain(number: Decimal) -> str:
    """Format without trailing zeros; with an exponent only if that is shorter."""
    number = number.normalize()
    return f"{number:f}" if -6 < number.adjusted() < 7 else f"{number:e}".replace("e+", "e")


def _split(unit: str) -> tuple[str, str, int, str, int]:
    """Split a unit into (before, symbol, power, after, power of ten of its prefix)."""
    numerator = unit.partition("/")[0]
    terms = list(re.finditer(r"([A-Za-zΩ]+)(?:\^(\d+))?", numerator))
    if not terms:
        return "", "", 1, unit, 0
    term = next((t for t in terms if t[1] == "m"), terms[0])
    own, symbol = (3, "g") if term[1] == "kg" else (0, term[1])
    return unit[: term.start()], symbol, int(term[2] or 1), unit[term.end(1) :], own
