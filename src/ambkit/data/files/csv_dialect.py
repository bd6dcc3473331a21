"""Dialect of a CSV file, detected from its text: separator, decimal sign, header, unit row.

The pair of separator and decimal sign is chosen with which most cells of the first lines are
numbers. (clevercsv 0.8.5 detects only the separator, no better, in 13 times the time.)
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from ambkit.base.escaping import one_line
from ambkit.data.files.timestamps import layouts

_NO_NUMBER = (
    *("nan", "-nan", "+nan", "nan()", "nan(ind)", "-nan(ind)", "nan(snan)"),
    *("na", "n/a", "#n/a", "#nv", "null", "none", "nil", "missing", "nodata", "no data", "invalid"),
    *("1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind", "1.#ind00", "-1.#ind00", "1.#qnan0"),
    *("#value!", "#div/0!", "#num!", "#wert!", "-", "--", "---", "–", "?", "*", "."),
)
MISSING = frozenset(
    (
        "",
        "NaN",
        "NaN()",
        "NoData",
        *(way(cell) for cell in _NO_NUMBER for way in (str, str.upper, str.title)),
    )
)
"""Notations of a missing number."""

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "spaces"}
LOOKED_AT = 200  # lines
_JUDGED = 100_000  # characters or cells of them for the detection of the dialect

_WORD = re.compile(r"\S+(?: \[[^\]]*\])?")  # "y [mm]" is one
_LABEL = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])])?")
_ENDLESS = re.compile(r"([+-]?)(?:1\.#INF\d*|∞|oo)")
_SEP_LINE = re.compile(r'"?sep=(.)"?[;,\t]*')  # Excel's statement in the first line
_NUMBER = (
    r"[+-]?(?:\d+(?:{0}\d*)?|{0}\d+)(?:[eEdD][+-]?\d+)?|[+-]?(?:inf|Inf|INF|infinity|Infinity)"
)
_NUMBERS = {sign: re.compile(_NUMBER.format(re.escape(sign))) for sign in ".,"}


class Dialect(NamedTuple):
    """Dialect of a CSV file; lines count from 0."""

    separator: str  #: One of `SEPARATORS`; a space means any number of spaces and tabs.
    decimal: str  #: ``"."`` or ``","``.
    names: tuple[str, ...]  #: Names of the columns; empty where the file has no header.
    units: tuple[str | None, ...]  #: Unit of each column in the header.
    header: int | None  #: Line with the names.
    body: int  #: First line with numbers.
    numeric: tuple[int, ...] = ()  #: Indices of the columns with numbers.
    closed: bool = False  #: Whether a separator ends each line too.
    stamps: tuple[int, ...] = ()  #: Indices of the columns with times as text.
    passed_over: int = 0  #: Number of ignored lines above the numbers.

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.units)

    def cells(self, line: str) -> list[str]:
        """Split a line into cells."""
        result = split(line, self.separator)
        return result[:-1] if self.closed and len(result) > self.width else result

    def describe(self) -> str:
        """Describe anything unusual for the report; empty for a plain CSV."""
        words = [f"{SEPARATORS[self.separator]} between cells"] if self.separator != "," else []
        words += ["decimal comma"] if self.decimal == "," else []
        if self.passed_over:
            words.append(f"{self.passed_over} line{'s' * (self.passed_over > 1)} above the header")
        return ", ".join(words)


def split(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without surrounding spaces."""
    if separator == " ":
        return _WORD.findall(line)
    if '"' in line:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    else:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def number_of(cell: str, decimal: str = ".") -> float | None:
    """Parse a cell; None if it is no number. A missing one is NaN."""
    if cell in MISSING:
        return float("nan")
    if endless := _ENDLESS.fullmatch(cell):  # as on Windows and in some instruments
        return float(f"{endless[1]}inf")
    if not _NUMBERS[decimal].fullmatch(cell):
        return None
    return float(cell.replace(decimal, ".").translate(_EXPONENT))


_EXPONENT = str.maketrans("dD", "ee")  # as in Fortran


_NUMBERING = re.compile(r"^\d+ ?[:.)] ?")  #: Of names that are listed.
COMMENTS = ("#", "%")  #: First character of a comment: NumPy's and MATLAB's.


def find(lines: Sequence[str], separators: Sequence[str] = tuple(SEPARATORS)) -> Dialect | None:
    """Detect the dialect of a CSV file."""
    separator_line = _SEP_LINE.fullmatch(lines[0].strip(" ")) if lines else None
    numbered = [
        (n, line)
        for n, line in enumerate(lines)
        if line.strip() and line[0] not in COMMENTS and not (separator_line and n == 0)
    ]
    if not numbered:
        return None
    known = (
        [separator_line[1]] if separator_line and separator_line[1] in SEPARATORS else separators
    )
    pairs = [(sep, sign) for sep in known for sign in ".," if sep != sign]
    judged = _few([line for _, line in numbered])
    separator, decimal = max(pairs, key=lambda pair: _score(judged, *pair))
    rows = [(n, split(line, separator)) for n, line in numbered]
    if not any(_is_number(cell, decimal) for _, row in rows for cell in row):
        # No number at all: a header only.
        separator = max(",;\t|", key=numbered[0][1].count)
        header = split(numbered[0][1], separator)
        names, units = zip(*map(label, header), strict=True)
        line = numbered[0][0]
        return Dialect(separator, ".", names, units, line, line + 1, tuple(range(len(names))))
    result = _header(rows, separator, decimal)
    return result if result.names else _named_by_a_comment(result, lines)


def _few(rows: Sequence[Any]) -> Sequence[Any]:
    """Return the first of some lines or rows: for very long ones a few suffice."""
    longest = max(map(len, rows))
    return rows[: max(8, _JUDGED // longest)]


def _named_by_a_comment(result: Dialect, lines: Sequence[str]) -> Dialect:
    """Take the names from the comment above the numbers, if they are there (as in NumPy)."""
    units: tuple[str, ...] = ()
    for n in range(result.body - 1, -1, -1):
        text = lines[n].lstrip("#% ").strip()
        if lines[n][:1] not in COMMENTS or not text:
            continue
        listed = [_NUMBERING.sub("", cell) for cell in re.split(r"\t|\s{2,}", text)]
        text = text.rpartition(":")[2].strip()
        for cells in (listed, *(split(text, s) for s in (result.separator, *SEPARATORS))):
            if len(cells) == result.width > 1 and not any(
                not cell or _is_number(cell, result.decimal) or "=" in cell for cell in cells
            ):
                names, own_units = zip(*map(label, cells), strict=True)
                if not units and _are_units(cells):  # the names are above them
                    units, result = tuple(cells), result._replace(names=names, header=n)
                    break
                return result._replace(names=names, units=units or own_units, header=n)
    return result


def _score(lines: Sequence[str], separator: str, decimal: str) -> tuple[float, int, int]:
    """Count the cells that are numbers, if they are the majority of their line."""
    rows = [split(line, separator) for line in lines]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    score = 0.0
    for row in rows[len(rows) // 2 :]:  # below what may be numbers of a long header
        filled = [cell for cell in row if cell not in MISSING]
        if len(row) == width and filled:
            numbers = sum(_is_number(cell, decimal) for cell in filled)
            score += numbers * (numbers / len(filled)) ** 2
    # With equal scores the more frequent separator is right: "1 2" is not one cell. With equal
    # widths too, the one that the header also has.
    return score, width, sum(len(row) == width for row in rows)


def _header(rows: list[tuple[int, list[str]]], separator: str, decimal: str) -> Dialect:
    """Find the names and units above the numbers."""
    with_numbers = [row for _, row in rows if any(_is_number(c, decimal) for c in row)]
    width = Counter(map(len, with_numbers)).most_common(1)[0][0]
    closed = width > 1 and not any(row[-1] for _, row in rows if len(row) == width)
    if closed:  # a separator ends each line
        width -= 1
        rows = [(n, row[:-1] if len(row) > width else row) for n, row in rows]
        with_numbers = [row for _, row in rows if any(_is_number(c, decimal) for c in row)]
    full_rows = _few([row for row in with_numbers if len(row) == width])
    numeric, stamps = _columns(full_rows, width, decimal)
    places = tuple(numeric)

    def holds_numbers(row: list[str]) -> bool:
        if len(row) != width or any(number_of(row[k], decimal) is None for k in numeric):
            return False
        # Dashes are units only of dimensionless numbers.
        return not any(row) or any(_is_number(row[k], decimal) for k in numeric)

    first = next(k for k, (_, row) in enumerate(rows) if holds_numbers(row))
    if names := _named_by_pairs([row for _, row in rows[:first]]):
        units = ("ms", None) * (width // 2)
        place = rows[first][0]
        return Dialect(
            separator, decimal, names, units, place - 1, place, places, passed_over=place
        )
    titles = [
        k
        for k, (_, row) in enumerate(rows[:first])
        # LabVIEW has a column "Comment" without cells.
        if (len(row) == width or (k == first - 1 and len(row) == width + 1 > 2))
        and not any(_is_number(cell, decimal) or layouts(cell) for cell in _dimensional(row))
    ]
    if not titles:
        unnamed = (None,) * width
        return Dialect(separator, decimal, (), unnamed, None, rows[0][0], places, closed, stamps)
    last = titles[-1]
    rows[last] = rows[last][0], rows[last][1][:width]
    # Names above units may be numbers, such as an oscilloscope's channels.
    above = last - 1 if last and len(rows[last - 1][1]) == width else last
    not_times = [cell for k, cell in enumerate(rows[last][1]) if k not in stamps]  # hh:mm:ss
    if above == last or not _are_units(not_times):
        header = last
        names, units = zip(*map(label, rows[header][1]), strict=True)
    else:
        header = above
        names = tuple(label(cell)[0] for cell in rows[header][1])
        cells = rows[last][1]
        units = (None,) * width if set(cells) <= {"-", ""} else tuple(map(_bare, cells))
    # A damaged line right below the header belongs to the numbers, so that it is reported.
    body = rows[last + 1][0]
    place = rows[header][0]
    return Dialect(separator, decimal, names, units, place, body, places, closed, stamps, header)


def _columns(
    rows: Sequence[list[str]], width: int, decimal: str
) -> tuple[list[int], tuple[int, ...]]:
    """Return the columns of numbers, and those of times of day, by rows of this width."""
    numeric = [
        k
        for k in range(width)
        if sum(number_of(row[k], decimal) is not None for row in rows) > 0.5 * len(rows)
        and any(_is_number(row[k], decimal) for row in rows)
    ]
    stamps = tuple(
        k
        for k in range(width)
        if k not in numeric
        and sum(bool(layouts(row[k])) for row in rows) > 0.5 * sum(bool(row[k]) for row in rows)
    )
    return numeric, stamps


def _named_by_pairs(rows: Sequence[list[str]]) -> tuple[str, ...]:
    """Return the names of channels with a time each, as TwinCAT's oscilloscope exports them."""
    # Above the numbers are lines such as Name, x, Name, y; times are in milliseconds.
    pairs = [row for row in rows if len(row) > 2 and len(row) % 2 == 0 and len({*row[::2]}) == 1]
    names = next((row[1::2] for row in pairs if row[0] == "Name"), []) if len(pairs) > 2 else []
    return tuple(cell for name in names for cell in ("Time", name))


def label(text: str) -> tuple[str, str | None]:
    """Split ``"y [mm]"`` into the name and the unit, None without one."""
    text = one_line(text)
    match = _LABEL.fullmatch(text)
    return (match[1], match[2]) if match else (text, None)


def _are_units(row: Sequence[str]) -> bool:
    """Return whether most cells of a row that are not empty are units."""
    from ambkit.data.signals import si_unit

    bare = [*filter(None, map(_bare, row))]
    known = 0
    for unit in bare:
        with suppress(ValueError):
            si_unit(re.sub(r"^[\d., ]+(?=[^\W\d])", "", unit))  # 100 ns, of a fieldbus
            known += 1
    return 2 * known > len(bare)


def _dimensional(row: list[str]) -> list[str]:
    """Return a row without the 1 of dimensionless quantities, if most of it are units."""
    rest = [cell for cell in row if cell != "1"]
    return rest if 2 * len(rest) > len(row) and _are_units(rest) else row


def _bare(cell: str) -> str | None:
    """Return a unit without its brackets, or None."""
    unit = cell.strip("[](){}<> ")
    return unit or None


def _is_number(cell: str, decimal: str) -> bool:
    return cell not in MISSING and number_of(cell, decimal) is not None
