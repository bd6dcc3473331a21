"""Tables in a terminal of 80 columns, and in a narrower one: no name and no number is cut."""

import sys
from pathlib import Path

import pytest
from paper.reproduction import Judged
from rich.console import Console

from ambkit.base.units import engineering
from ambkit.cli import printing
from ambkit.result.tables import table

FILTERS = "linear,steady-state,observer,low-pass,extended"
EACH = " ".join(f"--filter {name}" for name in FILTERS.split(","))


def _seen(text):
    """Return the words of a text, in its order, without what tables are drawn with."""
    return text.replace("─", " ").split()


def _wide(tables):
    """Return the words of all cells, as they are in a terminal with room for all."""
    words = []
    for of in tables:
        if not isinstance(of, str):
            cells = [cell for row in [of.headers, *of.rows] for cell in row]
            words += _seen(" ".join([of.title, *cells]))
    return words


@pytest.fixture
def narrow(monkeypatch):
    """Let the terminal have so many columns; return the tables that come to be shown."""
    shown = []
    show = printing.show

    def keep(tables):
        tables = list(tables)
        shown.extend(tables)
        show(tables)

    def to(width):
        monkeypatch.setattr(printing, "stdout", lambda: Console(width=width, highlight=False))
        monkeypatch.setattr(printing, "show", keep)
        return shown

    return to


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("rotor tum_mlps", ["2152.8 rpm", "33.57 Hz"]),
        (f"assess zittau_axial --verbose {EACH}", ["steady-state", "0.01272972"]),
        ("assess tum_mlps --verbose --filter linear", ["0.15813124", "2152.8 rpm", "416.7 g mm"]),
        ("simulate zittau_axial --duration 50ms", []),
        (f"faults zittau_axial {EACH} --faults knock --faults outage-1ms", []),
        (f"compare zittau_axial {EACH} --seeds 1", FILTERS.split(",")),
        ("excite zittau_axial --duration 0.5s", []),
    ],
)
def test_no_table_cuts_a_name_or_a_number(call, narrow, words, names):
    shown = narrow(80)
    out = call(*words.split()).out
    assert "…" not in out
    for name in names:
        assert name in out
    seen = _seen(out)
    assert shown
    assert not set(_wide(shown)) - set(seen)
    tables = [line for line in out.splitlines() if line.startswith(" ")]
    assert max(map(len, tables)) <= 80


def test_a_pipe_has_eighty_columns(call, monkeypatch):
    monkeypatch.delenv("COLUMNS")
    monkeypatch.setattr(sys, "__stdout__", None)  # what tells of a terminal's size
    shown = call("assess", "zittau_axial", *EACH.split()).out
    assert 60 < max(map(len, shown.splitlines())) <= 80
    assert set(FILTERS.split(",")) <= set(shown.split())


def test_a_word_wider_than_the_screen_is_not_cut(narrow, capsys):
    narrow(40)
    path = "a/" * 40 + "machine.toml"
    printing.show([f"The machine in {path} is stable with all of its filters."])
    assert f"The machine in\n{path}\nis stable" in capsys.readouterr().out


@pytest.mark.parametrize("columns", [80, 50])
def test_presets_fit_with_whole_names_and_descriptions(call, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    out = call("presets").out
    assert max(map(len, out.splitlines())) <= columns
    for preset in call("presets", "--json").json:
        assert f"{preset['name']} " in out
        assert " ".join(preset["description"].split()) in " ".join(out.split())


def test_columns_that_have_no_room_come_below(narrow, capsys):
    narrow(44)
    heads = ["", *(f"a-long-name-{k}" for k in range(5))]
    row = [engineering(k / 7, "m", digits=6) for k in range(5)]
    printing.show([table("Errors", heads, [["first row", *row], ["second", *row]])])
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 44
    for word in (*heads, *row):
        assert word in out
    assert out.count("first row") == 3


def test_summary_of_the_paper_cuts_nothing(narrow, capsys):
    row = {
        "id": "figure8.rms", "what": "root mean square of the error of the speed, adaptive filter",
        "paper": 0.123456789, "ours": 1.23456789e-5, "unit": "mm/s",
        "verdict": "agrees", "runs": None, "spread": None,
    }  # fmt: skip
    narrow(60)
    printing.show(printing.on_screen(Judged(Path("out"), [row]), verbose=False))
    out = capsys.readouterr().out
    assert "…" not in out
    assert set(row["what"].split()) <= set(_seen(out))
    assert {"agrees", "mm/s", "0.1235"} <= set(_seen(out))
