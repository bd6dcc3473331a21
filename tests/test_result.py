"""A result states each figure once, and every teller shows it."""

import json
import math
from dataclasses import dataclass, field

import pytest

import ambkit
from ambkit import Machine, Result
from ambkit.base.errors import AmbkitError
from ambkit.result.page import short
from ambkit.result.row import At, Row, Section, put
from ambkit.result.tables import remarks, tables

HOSTILE = r"<b>\input{x}</b> $1$ 50% _a_ \x1b[2J | `rm` #"

ROWS = [
    Row("peak", "peak of |S|", 1.7437, "|S|", below=3.0, at=At("peak_frequency", 80.3)),
    Row("zone", "zone", "B", below="A"),
    Row("mass", "mass", 0.04511, "kg", error=2.3e-4, interval=(0.04465, 0.04557), symbol="m"),
    Row("margin", "margin", 0.318, "%", least=0.4),
    Row("gain", "gain margin", 10 ** (6 / 20), "dB"),
    Row("phase", "phase", math.radians(45.8), "deg", detail=True),
    Row("unknown", "loss", None, "W", note="give the resistance"),
]


@dataclass(frozen=True)
class Made(Result):
    """A result of given rows."""

    given: list[Row]
    name: str = "made"
    across: bool = False
    more: dict[str, object] = field(default_factory=dict)

    title = property(lambda self: self.name)
    finding = property(lambda self: f"{self.name}: found.")
    rows = property(lambda self: self.given)
    series = property(lambda self: self.more)
    sections = property(lambda self: {("part",): Section(self.name, self.across)})


def made(of="linear", **options):
    return Made(put(ROWS, section=("part",), of=of), **options)


@pytest.mark.parametrize(("row", "text", "limit"), [
    (ROWS[0], "1.744", "below 3"), (ROWS[1], "B", "A"), (ROWS[2], "45.11 ± 0.23 g", ""),
    (ROWS[3], "31.8 %", "at least 40 %"), (ROWS[4], "6.0 dB", ""), (ROWS[5], "45.8°", ""),
    (ROWS[6], "–", ""), (Row("n", "n", 12), "12", ""), (Row("b", "b", True), "yes", ""),
    (Row("s", "s", math.inf, "|S|"), "unstable", ""), (Row("i", "i", -math.inf), "-∞", ""),
    (Row("p", "p", (-9.99, 20.2), "N", 3), "-9.99 to 20.2 N", ""),
    (Row("t", "t", math.inf, "degC", below=403.15), "runs away", "below 130.0 °C"),
    (Row("r", "r", 100 * math.pi, "rpm"), "3000 rpm", ""),
    (Row("u", "u", 4.2e-6, "g mm"), "4.2 g mm", ""),
    (Row("z", "z", 0.0, "m", error=6.2e-7), "0.00 ± 0.62 µm", ""),
])  # fmt: skip
def test_a_row_is_shown_as_an_engineer_writes_it(row, text, limit):
    assert row.text() == text
    assert row.limit() == limit


def test_a_limit_is_kept_or_not():
    assert [row.kept for row in ROWS] == [True, False, None, False, None, None, None]
    assert Row("t", "t", math.inf, "degC", below=403.15).kept is False
    assert Row("v", "v", "unstable", below="A").kept is False
    assert Row("v", "v", "A", below="A").kept is True
    assert Row("c", "c", None, "degC", below=403.15).kept is None
    assert Row("n", "n", math.nan, "degC", below=403.15).kept is None


def test_what_is_beside_a_value_has_keys_and_sentences(tmp_path):
    """The values themselves are read back from every teller in test_tellers."""
    result = made()
    data = json.loads(result.to_json())["part"]["linear"]
    assert data["peak_frequency"] == 80.3
    assert data["mass_standard_error"] == 2.3e-4
    assert data["mass_interval_95"] == [0.04465, 0.04557]
    assert (data["peak_kept"], data["zone_kept"], data["margin_limit"]) == (True, False, 0.4)
    result.page(tmp_path / "p.html")
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "Not kept: zone (linear), margin (linear)." in page
    assert "loss: give the resistance" in page
    assert "loss: give the resistance" in remarks(result)


def test_details_are_for_those_who_ask_for_more():
    (table,) = tables(made(), verbose=False)
    assert [line[0] for line in table.rows] == [
        "peak of |S|", "  at", "zone", "mass", "margin", "gain margin",
    ]  # fmt: skip
    assert table.headers == ["", "linear", "95 % interval", "limit"]


def test_what_it_is_of_stands_beside_each_other():
    result = Made([*put(ROWS[:1], section=("part",), of="a"), *put(ROWS[:2], of="b",
                                                                   section=("part",))])  # fmt: skip
    (table,) = tables(result)
    assert table.rows[0] == ["peak of |S|", "1.744", "1.744", "below 3"]
    assert table.rows[2] == ["zone", "–", "B ✗", "A"]
    assert short([result]) == "Not kept: zone (b)."
    assert short([Made(put(ROWS[:1]))]) == "All limits are kept."


def test_series_stand_beside_the_rows():
    data = made(more={"part": {"linear": {"poles": [1, 2]}}, "speed": 3.0}).to_dict()
    assert data["part"]["linear"]["poles"] == [1, 2]
    assert data["part"]["linear"]["zone"] == "B"
    assert data["speed"] == 3.0


def test_names_of_others_stay_text(tmp_path):
    result = made(of=HOSTILE, name=HOSTILE)
    result.page(tmp_path / "p.html")
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    for shown in (page, result._repr_html_()):
        assert "<b>\\input" not in shown
        assert "&lt;b&gt;" in shown
    body = "".join(line for line in result.to_latex().splitlines() if not line.startswith("%"))
    assert r"\input" not in body
    assert r"\_a\_" in body
    assert "\x1b" not in repr(made(name="\x1b[2J"))


def test_it_is_saved_by_the_ending(tmp_path):
    result = made()
    for ending, begins in ((".json", "{"), (".csv", "section,"), (".tex", "%"), (".html", "<!")):
        result.save(tmp_path / f"r{ending}")
        assert (tmp_path / f"r{ending}").read_text(encoding="utf-8").startswith(begins)
    with pytest.raises(
        AmbkitError, match=r"must end in \.json, \.csv, \.tex, \.html, \.png, \.svg or \.pdf"
    ):
        result.save(tmp_path / "r.xls")


def test_a_verbs_result_is_one():
    found = ambkit.assess(Machine.preset("zittau_axial"), "linear")
    assert isinstance(found, Result)
    assert repr(found).startswith("<Assessment: zittau_axial, controller fed by linear: zone")
    row = found.to_pandas().query("section == 'loops' and of == 'linear' and key == 'peak'")
    assert row["value"].item() == found.loops["linear"].peak


def test_figures_by_axis_are_nested_in_json_and_lines_of_tables():
    rows = [Row("rms", "rms", {"A1": 1e-6, "A2": 3e-6}, "m"), Row("error.x", "x", 2e-6, "m")]
    result = Made(put(rows, section=("part",)))
    assert result.to_dict()["part"] == {"rms": {"A1": 1e-6, "A2": 3e-6}, "error": {"x": 2e-6}}
    (table,) = tables(result)
    assert table.rows == [["rms, A1", "1 µm"], ["rms, A2", "3 µm"], ["x", "2 µm"]]
    assert list(result.to_pandas()["key"]) == ["rms.A1", "rms.A2", "error.x"]
