"""How times are written as text: the layouts that are known, and what a layout matches.

A layout is written as that of `time.strptime`: ``%Y %y %m %d %j %b %H %I %M %S %f %p %z``. Here
``.%f`` may be absent and has up to nine digits, ``%z`` at the end may be absent, and a space also
stands for a T.
"""

import re
from functools import cache

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


def layouts(cell: str) -> tuple[str, ...]:
    """Return the layouts that a time may have; two where day and month may be swapped."""
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
