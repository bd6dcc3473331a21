"""Bars: on a terminal, in a notebook without widgets, and nowhere else."""

import io
import sys
from types import ModuleType, SimpleNamespace

import pytest

import ambkit
from ambkit.base.progress import in_notebook, progress


@pytest.fixture
def notebook(monkeypatch):
    """What a notebook was given to display; each picture as its HTML, at once."""
    shown = []

    class Handle:
        def update(self, thing, *, raw=False):
            shown.append(thing if raw else thing._repr_mimebundle_((), ()))

    def display(thing, *, display_id):
        assert display_id
        shown.append(thing._repr_mimebundle_((), ()))
        return Handle()

    ipython, sub = ModuleType("IPython"), ModuleType("IPython.display")
    ipython.get_ipython = lambda: SimpleNamespace(kernel=object())
    sub.display = display
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", sub)
    monkeypatch.setattr("ambkit.base.progress._REDRAWN", 0.0)
    return shown


def test_without_a_reader_nothing_is_shown(capsys):
    assert not in_notebook()
    with progress("counting", 2) as tell:
        tell("next")
        tell()
    assert capsys.readouterr() == ("", "")


def test_a_terminal_shows_a_bar(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with progress("counting", 2) as tell:
        tell("the\nnext [bold]one")
    assert "the\\nnext [bold]one" in terminal.getvalue()


def test_a_notebook_shows_a_bar_and_takes_it_away(notebook, capsys):
    with progress("counting", 2) as tell:
        for text in ("half", "all"):
            tell(text)
    pages = [each["text/html"] for each in notebook]
    assert "counting" in pages[0] or "counting" in pages[1]
    assert ["half" in page for page in pages].count(True) == 1
    assert "━" in pages[-2]
    assert "all" in pages[-2]
    assert notebook[-1] == {"text/plain": "", "text/html": ""}
    assert capsys.readouterr() == ("", "")


def test_a_failure_takes_the_bar_away_as_well(notebook):
    with pytest.raises(ValueError, match="no"), progress("counting"):
        raise ValueError("no")
    assert notebook[-1]["text/html"] == ""


def test_long_functions_show_it_by_themselves(notebook):
    ambkit.inject_faults("zittau_axial", ["linear"], faults=["knock"], samples=0)
    assert any("knock" in each["text/html"] for each in notebook)


def test_a_command_writes_lines_to_a_pipe(capsys, monkeypatch):
    monkeypatch.setattr("ambkit.base.progress._LINES_APART", 0.0)
    monkeypatch.setattr("ambkit.base.progress.of_a_command", [True])
    with progress("counting", 2, unit="runs") as tell:
        tell("next", 1)
    assert capsys.readouterr().err.startswith("counting: next: 1 of 2 runs, ")
    with progress("counting") as tell:
        tell("")
    assert capsys.readouterr().err == "counting\n"
