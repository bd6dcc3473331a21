"""Each row of a result, read back from each teller, is its value under its name."""

import io
import json
import math
import re

import pandas
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import html
from rich.cells import cell_len
from rich.console import Console
from test_result import Made

import ambkit
from ambkit.assessment.injection_experiment import design_injection
from ambkit.base import units
from ambkit.base.units import typeset
from ambkit.result.card import MOST_ROWS, card_of
from ambkit.result.result import plain
from ambkit.result.row import FORMS, ZERO, At, Row, Section, singles
from ambkit.result.tables import MISSED, Table, by_name, escaped

READ = {
    "dB": lambda text: 10 ** (float(text.removesuffix(" dB")) / 20),
    "|S|": float,
    "deg": lambda text: math.radians(float(text.removesuffix("°"))),
    "%": lambda text: float(text.removesuffix(" %")) / 100,
    "degC": lambda text: float(text.removesuffix(" °C")) + ZERO,
    "rpm": lambda text: float(text.removesuffix(" rpm")) * math.pi / 30,
    "turns": lambda text: 2 * math.pi * units.parse(text, "Hz"),
    "g mm": lambda text: 1e-6 * float(text.removesuffix(" g mm")),
    "mm/s": lambda text: 1e-3 * float(text),
}
"""How a number is read that is written in one of the forms."""

COARSE = {"dB": 7e-3, "|S|": 6e-4, "deg": 1e-3, "degC": 0.06, "rpm": 0.0, "1": 6e-4}
"""What is lost of a number that is written with so many digits after the point."""


def check_cell(row, cell):
    """Hold a cell to the value of its row."""
    text, value = cell.removesuffix(MISSED).strip(), row.value
    if value is None or (isinstance(value, float) and math.isnan(value)):
        assert text == "–"
    elif isinstance(value, bool):
        assert text == ("yes" if value else "no")
    elif isinstance(value, str | int):
        assert text == str(value).strip()
    elif isinstance(value, float) and math.isfinite(value) and text != "creeps":
        number, error = text, ""
        if match := re.fullmatch(r"(\S+) ± (\S+)( \S+)?", text):
            number, error = (f"{part}{match[3] or ''}" for part in match.groups()[:2])
        assert bool(error) == bool(row.error)
        if row.error:
            assert math.isclose(units.parse(error, row.unit), row.error, rel_tol=0.06)
        read = READ[row.unit](number) if row.unit in FORMS else units.parse(number, row.unit)
        coarse = 0.6 * 10.0 ** (1 - row.digits) if row.unit == "1" else COARSE.get(row.unit, 0.0)
        coarse = 0.6 * row.error if row.error else coarse
        relative = 1e-9 if row.error else 6 * 10.0 ** -min(row.digits, 3)
        assert math.isclose(read, value, rel_tol=relative, abs_tol=coarse + 6e-7 * (value == 0))
    assert (kept(row) is False) == cell.endswith(MISSED)


def kept(row):
    """Whether a row keeps its limit, by the words of the limit: a least value is itself kept."""
    if row.value is None or row.value != row.value or row.least is row.below is None:
        return None
    value = row.value
    if row.least is not None:
        return not value < row.least
    return not value > row.below if isinstance(row.below, str) else not value >= row.below


def check_grid(table, rows, *, across):
    """Find each row of a section in its table, by its name and what it is of."""
    known = {row.name for row in rows if row.known}
    heads = [head.strip() for head in table.headers]
    for row in rows:
        if row.name not in known:
            continue
        line, column = (row.of, row.name.strip()) if across else (row.name, row.of)
        at = 1 + heads[1:].index(column.strip())
        (cells,) = [cells for cells in table.rows if cells[0] == line]
        check_cell(row, cells[at])


def cells_of(page):
    """The cells of the tables of a page, line by line."""
    return [[cell.text_content() for cell in line] for line in html.fromstring(page).iter("tr")]


def bare(text):
    return re.sub(r"[\s\u00a0]+", " ", text).strip()


def check_page(lines, table):
    """Find each line of a table as it is typeset."""
    there = {tuple(map(bare, line)) for line in lines}
    for cells in table.rows:
        assert tuple(bare(typeset(cell)) for cell in cells) in there


def check_json(result):
    data = json.loads(result.to_json())
    for row in result.rows:
        place = data
        for name in (*row.section, *([row.of] if row.of else []), *row.key.split(".")):
            place = place[name]
        assert place == json.loads(json.dumps(plain(row.value)))
        before = "" if name == "value" else f"{name}_"
        for key, value in {
            row.error_key: row.error, "interval_95": row.interval, "kept": kept(row),
            "limit": row.least if row.least is not None else row.below, "note": row.note or None,
        }.items():  # fmt: skip
            within = data
            for part in (*row.section, *([row.of] if row.of else []), *row.key.split(".")[:-1]):
                within = within[part]
            assert within.get(f"{before}{key}") == json.loads(json.dumps(plain(value)))


def check_pandas(result):
    frame = result.to_pandas()
    rows = list(singles(result.rows))
    assert len(frame) == len(rows)
    for row, line in zip(rows, frame.itertuples(), strict=True):
        assert (line.section, line.of, line.key) == (".".join(row.section), row.of, row.key)
        assert (line.name, line.unit) == (row.name.strip(), row.si)
        unknown = row.value is None or row.value != row.value
        assert pandas.isna(line.value) if unknown else line.value == row.value
        for cell, value in (
            (line.standard_error, row.error), (line.kept, kept(row)),
            *zip((line.low, line.high), row.interval or (None, None), strict=True),
            *zip((line.at, line.at_unit), (row.at or (None,) * 3)[1:], strict=True),
        ):  # fmt: skip
            assert pandas.isna(cell) if value is None else cell == value
        assert (line.limit, line.note) == (row.limit(), row.note)


def written(table, width):
    stream = io.StringIO()
    Console(file=stream, width=width, highlight=False, markup=False).print(table)
    return stream.getvalue()


def check_terminal(table):
    """Wide, each line is a row; narrow, no line is too long and no number is cut."""
    lines = {tuple(re.split(r"\s{2,}", line.strip())) for line in written(table, 5000).splitlines()}
    for cells in table.rows:
        assert tuple(part for cell in cells for part in re.split(r"\s{2,}", cell.strip()) if part
                     ) in lines  # fmt: skip
    narrow = written(table, 80)
    assert all(cell_len(line) <= 80 for line in narrow.splitlines())
    for cells in table.rows:
        assert all(word in narrow for word in cells[0].split())
        assert all(cell in narrow for cell in cells[1:] if cell[:1].isdigit() and len(cell) < 30)


def check(result, tmp_path):
    """Read each row of a result back from each teller."""
    check_json(result)
    check_pandas(result)
    latex, rows = result.to_latex(), list(singles(result.rows))
    result.page(tmp_path / "page.html")
    page = cells_of((tmp_path / "page.html").read_text(encoding="utf-8"))
    for section, table in by_name(result):
        across = result.sections.get(section, Section("")).across
        check_grid(table, [row for row in rows if row.section == section], across=across)
        check_terminal(table)
        check_page(page, table)
        for cells in table.rows:
            assert " & ".join(map(escaped, cells)) + r" \\" in latex
    first = next(by_name(result, verbose=False), None)
    if first is not None:
        shown = Table(*first[1][:2], first[1].rows[:MOST_ROWS], wide=False)
        check_page(cells_of(card_of(result).html()), shown)


UNITS = ("1", "m", "N", "s", "A", "W", "kg", "Hz", "V", *FORMS)
WORDS = st.text("abcdefgxyz", min_size=1, max_size=12)
NUMBERS = st.one_of(
    st.floats(1e-7, 1e7), st.floats(-1e3, -1e-3), st.sampled_from([0.0, math.nan]), st.none(),
    st.booleans(), st.integers(-999, 10**6), WORDS,
)  # fmt: skip


@st.composite
def results(draw):
    names = draw(st.lists(WORDS, min_size=1, max_size=5, unique=True))
    things = draw(st.lists(st.sampled_from(["linear", "A.x", "b c", "3"]), min_size=1, max_size=3,
                           unique=True))  # fmt: skip
    rows = []
    for section in draw(st.sampled_from([[("part",)], [("part",), ("b", "c")]])):
        for name in names:
            unit, digits = draw(st.sampled_from(UNITS)), draw(st.integers(3, 6))
            limit = draw(st.none() | st.floats(0.1, 10))
            for of in things:
                value = draw(NUMBERS)
                number = isinstance(value, float) and not math.isnan(value)
                positive = number and unit in ("dB", "turns", "degC", "%", "|S|", "deg", "mm/s")
                value = min(abs(value), 1e3) + 0.1 if positive else value
                error = draw(st.none() | st.sampled_from([1e-5, 0.01, 3.0]))
                error = error if number and unit not in FORMS else None
                least = draw(st.none() | st.sampled_from([value, 0.5])) if number else None
                rows.append(Row(
                    f"k_{name}", f"  {name}" if len(name) == 3 else f"the {name}", value, unit,
                    digits, of, section, error=error and abs(value) * error,
                    below=limit if number else None, detail=draw(st.booleans()), least=least,
                    interval=(value - 1, value + 2) if number and draw(st.booleans()) else None,
                    at=draw(st.none() | st.just(At("frequency", 12.5))),
                    note=draw(st.sampled_from(["", "of a note"])),
                ))  # fmt: skip
    return Made(rows, across=draw(st.booleans()))


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow,
          HealthCheck.function_scoped_fixture])  # fmt: skip
@given(result=results())
def test_rows_are_read_back_from_every_teller(result, tmp_path):
    check(result, tmp_path)


def some():
    """Results of verbs that take little time."""
    bearing = ambkit.preset("zittau_axial")
    rig = "tum_mlps"
    yield "run", lambda: ambkit.simulate(bearing, filter="extended", duration="50 ms")
    yield (
        "run of a machine",
        lambda: ambkit.simulate(ambkit.Machine.preset(rig), filter="extended", duration="20 ms"),
    )
    yield "campbell", lambda: ambkit.campbell(rig)
    yield "modes", lambda: ambkit.mode_shapes("ufu_flexible")
    yield "unbalance", lambda: ambkit.unbalance_response(rig)
    yield "assess", lambda: ambkit.assess(bearing, ["none", "extended"])
    yield (
        "online",
        lambda: ambkit.identify_online(bearing, ambkit.simulate(bearing, step="0.1 mm").record),
    )
    yield (
        "filter",
        lambda: ambkit.filter(ambkit.simulate(bearing, duration="0.1 s").record, machine=bearing),
    )
    yield "injection", lambda: design_injection(bearing, ambkit.Scenario(duration=1.0))


@pytest.mark.parametrize(("name", "make"), [*some()])
def test_each_row_of_a_verb_is_read_back(name, make, tmp_path):
    check(make(), tmp_path)
