"""Times as text, such as ``2024-05-03 12:00:00.123``, exact to the nanosecond."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache
from operator import methodcaller
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import RecordError, shortened

_FIELDS = {
    "Y": r"(?P<Y>\d{4})",
    "y": r"(?P<y>\d{2})",
    "m": r"(?P<m>\d{1,2})",
    "d": r"(?P<d>\d{1,2})",
    "j": r"(?P<j>\d{1,3})",
    "b": r"(?P<b>[A-Za-zä]{3})",
    "H": r"(?P<H>\d{1,2})",
    "I": r"(?P<I>\d{1,2})",
    "M": r"(?P<M>\d{1,2})",
    "S": r"(?P<S>\d{1,2})",
    "f": r"(?P<f>\d{1,9})",
    "p": r"(?P<p>[AaPp])\.?[Mm]\.?",
    "z": r"(?P<z>[Zz]|[+-]\d{2}(?::?\d{2})?)",
}
MONTHS = (
    *("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"),
    *("", "", "mär", "", "mai", "", "", "", "", "okt", "", "dez"),
    *("", "", "mrz", "", "", "", "", "", "", "", "", ""),
)
_CLOCK = r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d{1,9})?"
_KNOWN = (
    (r"\d{4}-\d{1,2}-\d{1,2}[ T]+" + _CLOCK, "%Y-%m-%d %H:%M:%S.%f%z"),
    (r"\d{4}/\d{1,2}/\d{1,2}[ T]+" + _CLOCK, "%Y/%m/%d %H:%M:%S.%f%z"),
    (r"\d{4}\.\d{1,2}\.\d{1,2}[ T]+" + _CLOCK, "%Y.%m.%d %H:%M:%S.%f%z"),
    (r"\d{8}[ T]+\d{6}(?:[.,]\d{1,9})?", "%Y%m%d %H%M%S.%f%z"),
    (r"\d{8}[ T]+" + _CLOCK, "%Y%m%d %H:%M:%S.%f%z"),
    (r"\d{1,2}-[A-Za-zä]{3}-\d{4} +" + _CLOCK, "%d-%b-%Y %H:%M:%S.%f%z"),
    (r"\d{1,2} [A-Za-zä]{3} \d{4} +" + _CLOCK, "%d %b %Y %H:%M:%S.%f%z"),
    (_CLOCK, "%H:%M:%S.%f%z"),
)
_ZONE = r"(?: *(?:[Zz]|[+-]\d{2}(?::?\d{2})?))?"
_LAYOUTS = tuple((re.compile(text + _ZONE), layout) for text, layout in _KNOWN)
_EITHER = re.compile(
    r"\d{1,2}([./-])\d{1,2}\1(\d{4}|\d{2}),?[ T]+" + _CLOCK + r"( ?[AaPp]\.?[Mm]\.?)?"
)


_DURATION = re.compile(r"(-?[\d.]*\d(?:e[+-]?\d+)?) ?(s|sec|ms|min|hr)")  #: Of a timetable.
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "hr": 3600.0}


def layouts(cell: str) -> tuple[str, ...]:
    """Return the possible layouts of a time; two if day and month are ambiguous."""
    if duration := _DURATION.fullmatch(cell):
        return (duration[2],)
    for pattern, layout in _LAYOUTS:
        if pattern.fullmatch(cell):
            return (layout,)
    either = _EITHER.fullmatch(cell)
    if not either:
        return ()
    sign, year, half = either.groups()
    comma = "," if re.match(r"[\d./-]+,", cell) else ""
    clock = f"{comma} %I:%M:%S.%f %p" if half else f"{comma} %H:%M:%S.%f"
    last = "Y" if len(year) == 4 else "y"
    return (f"%d{sign}%m{sign}%{last}{clock}", f"%m{sign}%d{sign}%{last}{clock}")


@cache
def pattern(layout: str) -> str:
    """Return the regular expression of a layout."""
    result, seen = [], set()
    for part in re.findall(r"[.,]%f|%z$| ?%p|%.?|.", layout, re.DOTALL):
        name = part[-1] if "%" in part else ""
        if name and part != "%%":
            if name not in _FIELDS:
                raise ValueError(f'"{part}" is none of %{" %".join(_FIELDS)}')
            if name in seen:
                raise ValueError(f'"%{name}" stands there twice')
            seen.add(name)
            field = _FIELDS[name]
            if part[0] in ".,":
                field = f"(?:[.,]{field})?"
            elif part == "%z":
                field = f"(?: *{field})?"
            result.append(f" *{field}" if part.startswith(" ") else field)
        elif part == " ":
            result.append("(?: +|T)")
        else:
            result.append(re.escape(part[-1]))
    if not seen & {"H", "I", "M", "S"}:
        raise ValueError("it has no time of the day: %H:%M:%S")
    if seen & {"Y", "y"} and not (seen & {"m", "b"} and "d" in seen) and "j" not in seen:
        raise ValueError("a date needs a month and a day: %Y-%m-%d")
    return "".join(result)


Ticks = NDArray[np.int64]

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
DAY = 24 * HOUR


#: Cells of a column; empty or None means missing.
Texts = Sequence[str | None] | NDArray[np.object_]
_NONE = np.array(None)


class Timestamps(NamedTuple):
    """A column of times."""

    seconds: Array  #: Seconds from the first one (n,); NaN if missing.
    layout: str  #: Layout of the text.
    remarks: tuple[str, ...]  #: First time; corrected midnights and summer time.
    certain: bool  #: Whether day and month are unambiguous, or irrelevant.


def read(
    texts: Texts, layout: str, name: str, place: Callable[[int], str], *, lenient: bool = False
) -> Timestamps:
    """Read a column of times."""
    cells = np.array(texts, dtype=object)
    cells[cells == _NONE] = ""
    texts = np.array(list(map(str.strip, cells.tolist())), dtype=object)
    possible = (layout,) if layout else layouts_of(texts)
    first = next(iter(texts), "")
    if not possible:
        what = f'"{first}" is no time that is known' if first else "is empty"
        raise RecordError(f'{name} {what}; give its format in the map, as "%d.%m.%Y %H:%M:%S.%f"')
    if (unit := possible[0]) in _SECONDS:
        try:
            seconds = np.char.replace(texts.astype(str), unit, "").astype(float) * _SECONDS[unit]
        except ValueError as error:
            raise RecordError(f"{name} is not in {unit} throughout") from error
        remarks = (f"{name} is text: seconds from {first}",)
        return Timestamps(seconds - seconds[0], "", remarks, True)
    parsed = {item: _parse(texts, item) for item in possible}
    sound = [item for item, result in parsed.items() if not result.wrong.any()]
    if not sound:
        chosen = min(parsed, key=lambda entry: int(parsed[entry].wrong.sum()))
        problems = [
            f"{place(at)}: {name}: {texts[at]!r} is no time of the format {chosen}"
            for at in np.flatnonzero(parsed[chosen].wrong).tolist()
        ]
        raise RecordError(shortened(problems))
    results = {item: _carried_on(name, parsed[item], texts, place, item) for item in sound}

    def rank(item: str) -> tuple[float, bool]:
        """Swapped day and month make long steps; the day is first, but before /."""
        longest_step = np.abs(np.diff(results[item][0])).max(initial=0)
        return longest_step, item.startswith(("%d/", "%m.", "%m-"))

    chosen = min(sound, key=rank)
    ticks, notes = results[chosen]
    same = all(np.array_equal(ticks, result) for result, _ in results.values())
    if not same and not lenient:
        other = next(item for item in sound if item != chosen)
        raise RecordError(
            f"{name}: which is the day in {first}, and which the month? Give the format in the "
            f'map: format = "{chosen}" or "{other}"'
        )
    seconds = ticks / SECOND
    seconds[_absent(texts)] = np.nan
    return Timestamps(seconds, chosen, tuple(notes), same)


def layouts_of(texts: Texts) -> tuple[str, ...]:
    """Return the layouts of a column's first times; empty if unknown."""
    return next((layouts(cell.strip()) for cell in texts[:200] if cell), ())


def unwrapped(ticks: Ticks, period: int) -> tuple[Ticks, int]:
    """Continue a time of day past midnight."""
    # ticks (n,); returns (n,)
    again = np.diff(ticks) < -period // 2
    return ticks + period * np.concatenate([[0], np.cumsum(again)]), int(again.sum())


def _absent(texts: Texts) -> Bools:
    return np.asarray(np.asarray(texts) == "", dtype=bool)


class _Parsed(NamedTuple):
    ticks: Ticks  #: Time of each cell since 1970 [ns]; 0 if missing.
    wrong: Bools  #: Which are invalid.
    zoned: bool  #: Whether they have an offset from UTC.


def _parse(texts: Texts, layout: str) -> _Parsed:
    expression = re.compile(pattern(layout), re.ASCII)
    matches = np.array(list(map(expression.fullmatch, texts)), dtype=object)
    wrong = np.asarray(matches == _NONE, dtype=bool)
    right = ~wrong
    fields = list(zip(*map(methodcaller("groups", ""), matches[right]), strict=True))
    names = expression.groupindex if fields else {}

    def text(name: str) -> NDArray[np.str_]:
        known = np.array(fields[names[name] - 1])
        cells = np.full(len(texts), "", dtype=known.dtype)
        cells[right] = known
        return cells

    def number(name: str, absent: int = 0) -> Ticks:
        if name not in names:
            return np.full(len(texts), absent, dtype=np.int64)
        cells = text(name)
        return np.where(cells == "", str(absent), cells).astype(np.int64)

    year, month, day = number("Y", 1970), number("m", 1), number("d", 1)
    if "y" in names:
        year = number("y") + np.where(number("y") < 70, 2000, 1900)
    if "b" in names:
        is_month = np.char.lower(text("b"))[:, None] == np.array(MONTHS)
        month = is_month.argmax(axis=1) % 12 + 1
        wrong |= ~is_month.any(axis=1)
    hour = number("I" if "I" in names else "H")
    wrong |= (hour < (1 if "I" in names else 0)) | (hour > (12 if "I" in names else 23))
    if "p" in names:
        late = np.char.lower(text("p")) == "p"
        hour = hour % 12 + 12 * late
    minute, second = number("M"), number("S")
    wrong |= (minute > 59) | (second > 59) | (month < 1) | (month > 12)
    wrong |= (year < 1900) | (year > 2200)
    months = np.where(wrong, 0, (year - 1970) * 12 + month - 1)
    start = _first_day(months)
    if "j" in names:
        day = number("j")
        wrong |= (day < 1) | (day > _first_day(months + 12) - start)
    else:
        wrong |= (day < 1) | (day > _first_day(months + 1) - start)
    fraction = np.zeros(len(texts), dtype=np.int64)
    if "f" in names:
        fraction = np.char.ljust(text("f"), 9, "0").astype(np.int64)
    zone, zoned = np.zeros(len(texts), dtype=np.int64), False
    if "z" in names:
        zone, some = _zone(text("z"))
        zoned = bool(some.any())
        if zoned:  # times with and without offsets are inconsistent
            wrong |= ~some
    clock = ((start + day - 1) * 24 + hour) * 60 + minute - zone
    ticks = (clock * 60 + second) * SECOND + fraction
    absent = _absent(texts)
    wrong &= ~absent
    ticks[wrong | absent] = 0
    return _Parsed(ticks, wrong, zoned)


def _first_day(months: Ticks) -> Ticks:
    """Return the first day of months since 1970, in days since 1970."""
    return months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)


def _zone(texts: NDArray[np.str_]) -> tuple[Ticks, Bools]:
    """Return the offset of each zone from UTC [minutes], and which times have one."""
    different, place = np.unique(texts, return_inverse=True)
    minutes = []
    for item in different.tolist():
        digits = item[1:].replace(":", "") or "0"
        sign = -1 if item[:1] == "-" else 1
        minutes.append(sign * (int(digits[:2]) * 60 + int(digits[2:] or 0)))
    return np.array(minutes, dtype=np.int64)[place], different[place] != ""


def _carried_on(
    name: str, parsed: _Parsed, texts: Texts, place: Callable[[int], str], layout: str
) -> tuple[Ticks, list[str]]:
    """Correct midnights and changes of summer time in a column, with remarks."""
    there = np.flatnonzero(~_absent(texts))
    if there.size == 0:
        return parsed.ticks, []
    went = parsed.ticks[there]
    remarks = [f"{name} is text, {layout}: seconds from {texts[int(there[0])]}"]
    dated = any(part in layout for part in ("%d", "%j"))
    if not dated:
        timed = "%H" in layout or "%I" in layout
        went, times = unwrapped(went, DAY if timed else HOUR)
        if times:
            what = "midnight" if timed else "the full hour"
            often = f", {times} times" if times > 1 else ""
            remarks.append(f"{name} goes past {what}{often}: carried on")
    elif not parsed.zoned:
        shift, turns = _summer_time(went)
        for at in turns:
            ends = shift[at] > shift[at - 1]
            what = "back by an hour, as summer time ends" if ends else "on, as summer time begins"
            remarks.append(f"{place(int(there[at]))}: {name} is put {what}: taken out")
        went = went + shift
    result = parsed.ticks.copy()
    result[there] = went - went[0]
    return result, remarks


def _summer_time(ticks: Ticks) -> tuple[Ticks, list[int]]:
    """Find changes of summer time: an hour, to the sample, early on a Sunday."""
    # returns (n,) [ns]
    steps = np.diff(ticks)
    none = np.zeros(ticks.size, dtype=np.int64)
    forward = steps[steps > 0]
    if forward.size < 2 or (usual := int(np.median(forward))) > 60 * SECOND:
        return none, []
    result = np.flatnonzero(np.abs(np.abs(steps - usual) - HOUR) <= usual // 2) + 1
    turns = []
    for at in result.tolist():
        after = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(ticks[at]) // 1000)
        before_hour = (-int(ticks[at - 1])) % HOUR
        if after.weekday() == 6 and after.hour < 4 and before_hour <= 1.5 * usual:
            turns.append(at)
    shift = none.copy()
    for at in turns:
        shift[at:] -= HOUR if steps[at - 1] > 0 else -HOUR
    return shift, turns
