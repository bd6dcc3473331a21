"""One figure of merit, stated once: a number in SI with everything needed to present it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from ambkit.base.units import engineering, interval, percent, rpm, with_error

if TYPE_CHECKING:
    from ambkit.result.report import Figure

Value = float | int | bool | str | tuple[float, float] | None

ZERO = 273.15  #: 0 degrees Celsius [K].


def decibels(factor: float) -> str:
    """Return a factor of an amplitude in decibels, as text."""
    if not 0 < factor < math.inf:
        return "∞" if factor else "-∞"
    return f"{20 * math.log10(factor):.1f} dB"


class Form(NamedTuple):
    """Format of the numbers of a unit for which engineering notation is unsuitable."""

    si: str  #: Unit of the number itself.
    text: Callable[[Any], str]


FORMS = {
    "dB": Form("1", decibels),
    "|S|": Form("1", lambda v: f"{v:.3f}" if math.isfinite(v) else "unstable"),
    "deg": Form("rad", lambda v: f"{math.degrees(v):.1f}°"),
    "%": Form("1", lambda v: percent(v, 3)),
    "degC": Form("K", lambda v: f"{v - ZERO:.1f} °C" if math.isfinite(v) else "runs away"),
    "rpm": Form("rad/s", rpm),
    "turns": Form("rad/s", lambda v: engineering(v / math.tau, "Hz", 4) if v > 1e-3 else "creeps"),
    "g mm": Form("kg m", lambda v: f"{1e6 * v:.4g} g mm"),
    "mm/s": Form("m/s", lambda v: f"{1e3 * v:.3g}"),
}


class At(NamedTuple):
    """Condition of a figure: frequency, speed or time."""

    key: str
    value: float
    unit: str = "Hz"


@dataclass(frozen=True)
class Row:
    """One figure of merit of one object: a loop, an axis, an estimator."""

    key: str  #: Key in JSON; groups such as ``rmse.x``.
    name: str  #: Displayed name; two blanks in front for one that belongs to the previous.
    value: Value | Mapping[str, Any]  #: In SI; None if unknown; a mapping by name for several axes.
    unit: str = "1"  #: SI unit, or one of `FORMS`.
    digits: int = 4
    of: str = ""  #: Object: a column of the table.
    section: tuple[str, ...] = ()  #: Table, and its place in JSON.
    symbol: str = ""
    error: float | None = None  #: Standard error.
    error_key: str = "standard_error"  #: Meaning of `error`, in JSON.
    interval: tuple[float, float] | None = None  #: 95 % interval.
    at: At | None = None
    below: float | str | None = None  #: Upper limit; for a zone the worst permitted.
    least: float | None = None  #: Lower limit.
    note: str = ""
    detail: bool = False  #: Whether it is for verbose output only.
    like: float | None = None  #: Value whose prefix it uses: the one that it is an error of.

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return self.value is not None and self.value == self.value

    @property
    def kept(self) -> bool | None:
        """Whether it is within its limit; None if there is no limit, or the value is unknown."""
        value: Any = self.value
        if not self.known:
            return None
        if self.least is not None:
            return bool(value >= self.least)
        if self.below is None:
            return None
        return bool(value <= self.below if isinstance(self.below, str) else value < self.below)

    @property
    def si(self) -> str:
        """Unit of `value`."""
        return FORMS[self.unit].si if self.unit in FORMS else self.unit

    def text(self) -> str:
        """Return the displayed value with unit and error."""
        value, error = self.value, self.error
        assert not isinstance(value, Mapping)  # `singles` are shown
        if not error or not isinstance(value, float) or self.unit in FORMS:
            return self.shown(value)
        if not (math.isfinite(value) and math.isfinite(error)):
            return self.shown(value)
        like = value or error
        number, _, unit = engineering(value, self.unit, 15, like).partition(" ")
        of = engineering(error, self.unit, 15, like).partition(" ")[0]
        return f"{with_error(float(number), float(of))} {unit}".rstrip()

    def shown(self, value: Value, digits: int | None = None) -> str:
        """Return a number of this row's unit as text; a dash if there is none."""
        digits = self.digits if digits is None else digits
        if isinstance(value, bool):
            return "yes" if value else "no"
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return "–"
        if isinstance(value, tuple):
            low, high = value
            if self.unit in FORMS:
                return f"{self.shown(low)} to {self.shown(high)}"
            return interval(low, high, self.unit, digits, like=max(value, key=abs))
        if isinstance(value, str | int):
            return str(value)
        if self.unit in FORMS:
            return FORMS[self.unit].text(value)
        if math.isinf(value):
            return "∞" if value > 0 else "-∞"
        if self.unit == "1":
            return f"{value:.{digits - 1}f}"
        return engineering(value, self.unit, digits, self.like)

    def limit(self) -> str:
        """Return its limit as text; empty if there is none."""
        if self.least is not None:
            return f"at least {self._round(self.least)}"
        if isinstance(self.below, str):
            return self.below
        return "" if self.below is None else f"below {self._round(self.below)}"

    def _round(self, limit: float) -> str:
        return f"{limit:g}" if self.unit in ("1", "|S|") else self.shown(limit, 3)

    def place(self) -> str:
        """Return its condition as text; empty if unknown."""
        if self.at is None or not math.isfinite(self.at.value):
            return ""
        return Row("", "", self.at.value, self.at.unit, 4).text()

    def confidence(self) -> str:
        """Return its interval as text; empty if there is none."""
        return "" if self.interval is None else self.shown(self.interval)


def singles(rows: Iterable[Row]) -> Iterator[Row]:
    """Yield rows with one value each: a mapping, such as by axis, gives several."""
    for row in rows:
        if not isinstance(row.value, Mapping):
            yield row
            continue
        yield from singles(
            replace(row, key=f"{row.key}.{name}", name=f"{row.name}, {name}", value=value)
            for name, value in row.value.items()
        )


def put(rows: list[Row], **where: Any) -> list[Row]:
    """Return rows of one object, with their section and column."""
    return [replace(row, **where) for row in rows]


class Section(NamedTuple):
    """Layout of a section's rows."""

    title: str
    #: One line per object and one column per figure, instead of the transpose.
    across: bool = False


class Part(NamedTuple):
    """A chapter of the page."""

    title: str
    lead: str = ""  #: Markdown.
    section: tuple[str, ...] | None = None  #: Its tables are of the sections with this prefix.
    figures: Sequence[Figure] = ()  #: Figures; those in `figures` too are shown here only.


class Stated:
    """Content of a result, for the tellers."""

    __slots__ = ()

    signed: ClassVar[bool] = False
    """Whether its page is a verdict, to be signed."""

    TITLE: ClassVar[str] = ""
    """Title; ``{0.machine.name}`` stands for attributes of the result."""
    SECTIONS: ClassVar[Mapping[tuple[str, ...], Section]] = {}
    """Layout of the sections; in their titles ``{0...}`` as in `TITLE`."""

    @property
    def title(self) -> str:
        """Title with its object."""
        return self.TITLE.format(self)

    @property
    def finding(self) -> str:
        """The main finding, in one sentence."""
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[Row]:
        """The figures of merit."""
        raise NotImplementedError

    @property
    def sections(self) -> Mapping[tuple[str, ...], Section]:
        """Layout of each section of the rows."""
        return {
            name: Section(title.format(self), across)
            for name, (title, across) in self.SECTIONS.items()
        }

    @property
    def chapters(self) -> Sequence[Part]:
        """Chapters of the page after the first, which has the remaining content."""
        return ()

    @property
    def facts(self) -> Mapping[str, str]:
        """Conditions."""
        return {}

    @property
    def notes(self) -> Sequence[str]:
        """Remarks."""
        return ()

    @property
    def series(self) -> Mapping[str, Any]:
        """Content besides the figures of merit, as in JSON."""
        return {}

    def figures(self) -> Sequence[Figure]:
        """Return its figures, the main one first.

        Returns
        -------
        sequence of Figure
            Empty if there is nothing to plot.
        """
        return ()
