"""The figure and report toolkit on synthetic data: both renderings, the page, the terminal."""

import base64
import gzip
import itertools
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import html
from paper import verdicts
from paper.reproduction import Judged
from quick import quick

from ambkit.base.errors import AmbkitError
from ambkit.cli import printing
from ambkit.data.reading import RejectedLog, read
from ambkit.data.reading.reading_figure import reading_figure, refused_figure
from ambkit.result.report import (
    Axis,
    Band,
    Bars,
    Cells,
    Chapter,
    Equation,
    Figure,
    FigureBlock,
    Heatmap,
    Intervals,
    Line,
    Note,
    Panel,
    Points,
    Remark,
    Report,
    Rule,
    Span,
    TableBlock,
    Text,
    blocks,
    markup,
    screen,
    style,
    write_report,
)
from ambkit.result.report.figure import paper_style
from ambkit.result.report.items import BUCKETS, decimate

TIME = Axis("time $t$", "s")


def step_response():
    """Two panels over one time axis, 20,001 samples, noise in and around the signals."""
    noise = np.random.default_rng(1)
    t = np.linspace(0, 0.4, 20001)
    x = 0.5e-3 * (1 - np.exp(-t / 0.02) * np.cos(160 * t))
    force = np.where(t > 0.25, 3.0, 0.0)
    position = [
        Span(0.25, 0.4, "load of 3 N", signal="disturbance", label=""),
        Line(t, x + 9.1e-6 * noise.standard_normal(t.size), signal="measured"),
        Line(t, np.full_like(t, 0.5e-3), signal="reference"),
        Line(t, x, signal="truth"),
        Line(t, x + 1e-6 * noise.standard_normal(t.size), signal="estimate adaptive"),
        Rule(0.9e-3, text="clearance", signal="limit", label=""),
    ]
    load = [
        Band(t[::50], force[::50] - 0.3, force[::50] + 0.3, label="2 σ of the filter"),
        Line(t, force, signal="truth"),
        Line(t, force + 0.1 * noise.standard_normal(t.size), signal="estimate linear"),
    ]
    return Figure(
        "fig15",
        "Step response, 0.5 mm",
        "The **position** hardly differs, $F_\\mathrm{St}$ does; see [](#table4).",
        [
            Panel(TIME, Axis("displacement $x$", "mm", 1e3), position),
            Panel(TIME, Axis("disturbance force $F_\\mathrm{St}$", "N"), load),
        ],
        source="paper, Fig. 15",
    )


def force_map():
    """Two heat maps beside each other, one of them signed, with markers."""
    i, x = np.linspace(-1.5, 1.5, 31), np.linspace(-5e-4, 5e-4, 21)
    current, position = np.meshgrid(i, x)
    force = 6.7e-6 * (
        ((1.5 + current) / (2e-3 - position)) ** 2 - ((1.5 - current) / (2e-3 + position)) ** 2
    )
    error = force - 10.05 * current - 7537.5 * position
    axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    signed = Heatmap(i, x, error, Axis("error", "N"), diverging=True)
    points = Points(i[::15], x[::10], signal="paper", label="operating points")
    return Figure(
        "force-map",
        "Magnet force",
        "Left the force, right what a constant linearisation leaves of it.",
        [
            Panel(*axes, [Heatmap(i, x, force, Axis("force", "N"))], title="force"),
            Panel(*axes, [signed, points], title="error of $k_i i_u + k_s x$"),
        ],
        columns=2,
    )


def learning_curve():
    n = np.arange(1.0, 2001.0)
    items = [
        Line(n, 1.4 * n**-0.25, signal="series 1", label="steepest gradient"),
        Line(n, 0.043 + 1.3 * np.exp(-n / 20), signal="series 2", label="least squares"),
        Rule(1.41, signal="constant", text="constant linearisation"),
        Rule(100.0, "x", text="100 iterations", signal="bound", label=""),
        Note(500.0, 0.043, "0.043 N"),
    ]
    log = Axis("force error, RMS", "N", scale="log")
    return Figure(
        "fig10", "Learning curve", "", [Panel(Axis("iteration", scale="log"), log, items)]
    )


def comparison():
    steps = ["0.1 mm", "0.3 mm", "0.5 mm"]
    bars = [
        Bars(steps, [0.2, 0.4, 0.58], [0.02, 0.03, 0.05], signal="estimate linear"),
        Bars(steps, [0.2, 0.3, 0.33], [0.02, 0.03, 0.04], signal="estimate adaptive"),
    ]
    gap = np.linspace(2e-3, 16e-3, 12)
    fit = [
        Line(gap, 60 * gap, signal="fit"),
        Points(gap, 61 * gap, 0.05 + 0 * gap, signal="measurement"),
    ]
    return Figure(
        "gain",
        "What it buys",
        "",
        [
            Panel(Axis("step"), Axis("RMSE of $F_\\mathrm{St}$", "N"), bars),
            Panel(Axis("gap", "mm", 1e3, limits=(0.0, 18e-3)), Axis("current", "A"), fit),
        ],
    )


def matrix():
    """A table of coloured cells, one of them empty."""
    shade = np.array([[0.0, 0.5], [np.nan, 1.0], [0.2, 0.3]])
    cells = Cells(["x\n[µm]", "NIS"], ["one", "two", "three"], shade, [["1", "2"]] * 3)
    return Figure("matrix", "All by all", "", [Panel(Axis(""), Axis(""), [cells])])


def estimates():
    """Rows of intervals, on a linear and on a logarithmic axis, beside where they began."""
    texts = ["6.65 N mm²/A²", "1.99 mm"]
    rows = Intervals(["$k$", "$s_0$"], [1.25, 0.99], [1.22, 0.97], [1.29, 1.01], texts)
    wide = Intervals(["$Q_u$"], [1.5], [0.2], [11.0], [""], signal="identified", label="")
    ratio, start = Axis("estimate / start"), Rule(1.0, axis="x", signal="start")
    return Figure(
        "estimates",
        "What was found",
        "",
        [
            Panel(ratio, Axis(""), [start, rows], title="bearing"),
            Panel(Axis("estimate / start", scale="log"), Axis(""), [start, wide], title="noise"),
        ],
        columns=2,
    )


ALL = [step_response, force_map, learning_curve, comparison, matrix, estimates]
ROWS = [
    {
        "id": "table4.largest",
        "what": "Largest deviation from Table 4 [N/A]",
        "paper": None,
        "ours": 0.0047,
        "unit": "N/A",
        "verdict": "agrees",
    },
    {
        "id": "noise",
        "what": "Variance of the control signal",
        "paper": 8e-5,
        "ours": "8e-5 ± 1e-6",
        "unit": "V²",
        "verdict": "differs",
    },
]


def report():
    table = TableBlock(
        "table4",
        "Current stiffness $k_i$ in N/A",
        ["$x$ [mm]", "0 A", "0.75 A"],
        [[0.0, 10.05, 10.05], [0.5, 12.15, 8.45]],
        digits=".2f",
        highlight={(1, 2): "Misprint: its mirror image is 8.47."},
        source="paper, Table 4",
    )
    magnet = r"F = k\left[\left(\frac{i_0+i_u}{s_0-x}\right)^2-\ldots\right]"
    first = [Text("With $k_i$ from [](#table4), <b>see</b> [](#fig15)."), Equation(magnet, "eq. 1")]
    return Report(
        "A & B",
        "subtitle",
        "What *this* is.",
        "0.1.0",
        [
            Chapter("one", "The filter", [*first, FigureBlock(step_response())], "In short."),
            Chapter("two", "The map", [FigureBlock(force_map()), table, Remark("Chosen", "$T$")]),
            Chapter("three", "More", [FigureBlock(each()) for each in ALL[2:]]),
        ],
        {"Seed": "1"},
        partial(verdicts.summary, ROWS),
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_report(report(), tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def page(written):
    return written.read_text(encoding="utf-8")


# Style


def lightness(colour):
    """CIE L* of an sRGB colour."""
    parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(116 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16)


def contrast(colour):
    """Contrast with white (WCAG 2)."""
    luminance = ((lightness(colour) + 16) / 116) ** 3
    return 1.05 / (luminance + 0.05)


@pytest.mark.parametrize(
    "together",
    [
        ["reference", "truth", "measured", "estimate"],
        ["truth", "estimate linear", "estimate adaptive", "estimate closed law"],
        ["measured", "logged", "estimate linear", "estimate adaptive", "bound"],
        ["constant", "series 1", "series 2", "series 3", "series 4"],
        ["paper", "ours", "constant"],
        ["innovation", "bound", "limit"],
        ["smoothed", "smoothed 2", "smoothed 3"],
        ["record 1", "record 1 start", "record 1 held"],
    ],
)
def test_lines_that_meet_differ_without_colour(together):
    for one, other in itertools.combinations(map(style.style_of, together), 2):
        assert one.dash != other.dash or abs(lightness(one.colour) - lightness(other.colour)) > 15


def test_lines_are_strong_enough_and_noise_lies_behind():
    noise = style.SIGNALS["measured"]
    for name, look in style.SIGNALS.items():
        assert name == "measured" or contrast(look.colour) >= 3, name
        assert look is noise or (look.layer > noise.layer and look.width >= noise.width)
    assert all(contrast(colour) >= 4.5 for colour in verdicts.COLOURS.values())


def test_heat_maps_read_in_grey():
    steps = np.diff([lightness(colour) for colour in style.SEQUENTIAL])
    assert (steps < -4).all()
    signed = [lightness(colour) for colour in style.DIVERGING]
    assert np.argmax(signed) == len(signed) // 2
    assert min(signed) > 40  # dark numbers on the contours stay readable


@pytest.mark.parametrize("colours", [style.SEQUENTIAL, style.DIVERGING])
def test_text_on_cells_can_be_read(colours):
    """Its contrast is at least 4 to 1 (WCAG 2 asks 4.5 of small, 3 of large text)."""
    for place in np.linspace(0, 1, len(colours)):
        ground = colours[round(place * (len(colours) - 1))]
        ratio = contrast(style.ink_on(colours, place)) / contrast(ground)
        assert max(ratio, 1 / ratio) >= 4.0


def test_unknown_signal_names_the_nearest():
    with pytest.raises(ValueError, match="'estimate adaptive'"):
        Line(np.zeros(2), np.zeros(2), signal="estimate adaptiv")


# Decimation


@given(
    n=st.integers(1, 3000), buckets=st.integers(1, 100), seed=st.integers(0, 99), gaps=st.booleans()
)
def test_decimation_keeps_extremes_ends_and_gaps(n, buckets, seed, gaps):
    draw = np.random.default_rng(seed)
    x, y = np.arange(n) * 0.1, draw.standard_normal(n)
    if gaps:
        y[draw.random(n) < 0.01] = np.nan
    few_x, few_y = decimate(x, y, buckets)
    index = np.rint(few_x / 0.1).astype(int)
    assert (np.diff(index) > 0).all()
    np.testing.assert_array_equal(few_y, y[index])  # samples only, none invented
    assert index[0] == 0
    assert index[-1] == n - 1
    if n <= 4 * buckets:
        assert few_x.size == n
        return
    assert few_x.size <= 5 * buckets
    size = -(-n // buckets)
    for start in range(0, n, size):
        whole = y[start : start + size]
        kept = few_y[(index >= start) & (index < start + size)]
        assert np.isnan(whole).any() == np.isnan(kept).any()
        if not np.isnan(whole).all():
            assert np.nanmin(kept) == np.nanmin(whole)
            assert np.nanmax(kept) == np.nanmax(whole)


def test_decimation_follows_a_curve_that_turns_back():
    angle = np.linspace(0, 40 * np.pi, 50001)
    radius = 1 + angle / 100
    x, y = decimate(radius * np.cos(angle), radius * np.sin(angle), 100)
    assert x.size <= 5000
    # The chord between neighbours stays within a hundredth of the curve.
    middle = np.hypot(x[1:] + x[:-1], y[1:] + y[:-1]) / 2
    assert (middle > 0.99 * np.minimum(np.hypot(x, y)[1:], np.hypot(x, y)[:-1])).all()


@pytest.mark.parametrize(("slope", "width", "layer"), [(20, 0.6, 2), (300, 1.2, 4)])
def test_a_line_whose_ripple_fills_an_area_is_thin_and_behind(slope, width, layer):
    t, noise = np.linspace(0, 1, 9001), np.random.default_rng(1).standard_normal(9001)
    look = Line(t, slope * t + noise, signal="estimate linear").look
    assert (look.width, look.layer, bool(look.dash)) == (width, layer, width > 1)


# Description


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Line([1, 2, 3], [1, 2]), "lengths differ"),
        (lambda: Line([[1, 2]], [[1, 2]]), "one dimension"),
        (lambda: Bars(["a"], [1, 2]), "1 categories, but 2 values"),
        (lambda: Intervals(["a"], [1], [0], [2], []), "rows, texts and values differ in length"),
        (lambda: Heatmap([1, 2], [1, 2, 3], np.zeros((2, 3)), TIME), "z has shape"),
        (lambda: Figure("fig 1", "", "", [Panel(TIME, TIME, [])]), "letters, digits"),
        (lambda: Figure("fig1", "", "", []), "at least one panel"),
        (
            lambda: Figure("f", "", "", [Panel(TIME, TIME, [Bars(["a"], [1]), Bars(["b"], [1])])]),
            "differ in their categories",
        ),
        (lambda: TableBlock("t", "", ["a", "b"], [[1]]), "1 cells for 2 columns"),
        (lambda: TableBlock("t", "", ["a"], [[1]], highlight={(1, 0): "why"}), "no cell"),
    ],
)
def test_descriptions_that_cannot_be_drawn_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_legend_names_each_signal_once_and_alt_text_tells_what_is_seen():
    figure = step_response()
    names = [name for name, _ in figure.legend()]
    assert names.count("truth") == 1
    assert "disturbance force" not in names  # label=""
    assert "displacement x [mm] over time t [s]" in figure.description()
    assert figure.shares_x(0)
    assert not figure.shares_x(1)


@given(low=st.floats(-1e6, 1e6), span=st.floats(1e-6, 1e6), diverging=st.booleans())
def test_contour_levels_are_inside_even_and_enough(low, span, diverging):
    z = np.array([[low, low + span], [low, low + span]])
    surface = Heatmap([0, 1], [0, 1], z, Axis("z"), diverging=diverging)
    bottom, top = surface.shown_limits
    slack = 1e-6 * (top - bottom) + 1e-9 * max(abs(bottom), abs(top))
    assert surface.levels[0] >= bottom - slack
    assert surface.levels[-1] <= top + slack
    assert 2 <= surface.levels.size <= 11
    around = Heatmap([0, 1], [0, 1], z, Axis("z"), diverging=diverging, zero=False)
    assert np.array_equal(around.levels, surface.levels[surface.levels != 0])


@pytest.mark.parametrize("at", [3.142791200911549e-06, 2.0128177653286204e-06])
def test_limits_hold_where_matplotlib_finds_none_about_one_point(at):
    axis = Axis("cost", "ns", 1e9, "log", (0.7 * at, 1.4 * at))
    alone = Points(np.array([at]), np.array([1.0]), np.array([0.0]), signal="series 1", label="")
    items = [alone, Rule(0.5, signal="truth", label="limit")]
    _, axes = Figure("cost", "Cost", "", [Panel(axis, Axis("error"), items)]).draw()
    assert axes[0].get_xlim() == pytest.approx((0.7e9 * at, 1.4e9 * at))


def test_a_mean_is_printed_with_its_spread_and_its_runs():
    row = {
        "id": "a", "what": "error", "paper": None, "ours": -0.6397, "unit": "N",
        "verdict": "better", "spread": 0.0078, "runs": 20,
    }  # fmt: skip
    assert verdicts.ours(row) == "−0.6397 ± 0.0078"
    assert verdicts.runs(row) == "20"
    assert verdicts.ours({**row, "spread": None, "runs": None}) == "−0.6397"
    assert verdicts.runs({**row, "runs": None}) == "–"


# Formulas and Markdown


def test_formulas_become_mathml():
    root = ElementTree.fromstring(
        markup.mathml(
            r"\begin{bmatrix}\hat{x}_{k|k-1} & \frac{k_s}{m}\\ 0 & \sqrt{2}\end{bmatrix}", True
        )
    )
    assert root.get("display") == "block"
    tags = [node.tag for node in root.iter()]
    assert tags.count("mtr") == 2
    assert tags.count("mtd") == 4
    assert {"msub", "mover", "mfrac", "msqrt"} <= set(tags)
    assert root.find(".//msub/mrow/mo[@lspace='0']").text == "|"


def test_labels_become_the_html_plotly_draws():
    label = r"$\hat{x}_\mathrm{St}^2 < \sigma$ & more [N/A]"
    assert markup.label_html(label) == (
        "<i>x\u0302</i><sub>St</sub><sup>2</sup>&lt;<i>σ</i> &amp; more [N/A]"
    )


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (r"\foo", r"\\foo is not understood"),
        (r"x \ {y", "braces do not match"),
        ("x_1_2", "DoubleSubscripts"),
    ],
)
def test_formulas_that_are_not_understood_are_refused(source, message):
    with pytest.raises(ValueError, match=message):
        markup.mathml(source)


@pytest.mark.parametrize("label", ["cost 5 $", r"$\frac{1}{2}$"])
def test_labels_that_plotly_cannot_draw_are_refused(label):
    with pytest.raises(ValueError, match="label"):
        markup.label_html(label)


def test_markdown_knows_formulas_and_names_but_no_html():
    html = markup.markdown("*a* $k_i$ [](#fig1) <script>x</script>", {"fig1": "Figure 3"})
    assert '<em>a</em> <math display="inline"><mrow><msub>' in html
    assert '<a href="#fig1">Figure 3</a>' in html
    assert "<script>" not in html
    with pytest.raises(ValueError, match="#nowhere"):
        markup.markdown("[](#nowhere)")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("F_St at rest, k_i", r"$F_\mathrm{St}$ at rest, $k_i$"),
        (r"$k_i$ and `k_s` of $F_\mathrm{mag}$", r"$k_i$ and `k_s` of $F_\mathrm{mag}$"),
        ("[](#fig13.k_i), width_k_i, k_ix", "[](#fig13.k_i), width_k_i, k_ix"),
    ],
)
def test_symbols_are_typeset_in_prose_alone(text, shown):
    assert markup.symbols(text) == shown
    assert markup.symbols(shown) == shown


def test_the_summary_is_typeset():
    row = {"id": "a.k_i", "what": "F_St & x", "paper": None, "ours": 1.0, "unit": "N",
           "verdict": "not given"}  # fmt: skip
    html = verdicts.summary([row], {"a": "Chapter 1"})
    assert '<a href="#a">' in html
    assert "</msub></mrow></math> &amp; x" in html


# Static


def drawn(figure):
    return [figure.image(ending) for ending in (".png", ".svg", ".pdf")]


@pytest.mark.pictures
@pytest.mark.parametrize("build", quick(ALL, [force_map]))
def test_pictures_are_the_same_bytes_in_another_process_whatever_its_defaults(build):
    """Nothing depends on the order of sets, on addresses or on the user's rcParams."""
    code = (
        f"import sys; sys.path[:0] = {sys.path!r}\n"
        "import matplotlib, test_report_toolkit as t\n"
        "own = {'font.size': 20, 'axes.grid': False, 'svg.fonttype': 'none'}\n"
        "matplotlib.rcParams.update(own); before = dict(matplotlib.rcParams)\n"
        f"sys.stdout.buffer.write(b'AND'.join(t.drawn(t.{build.__name__}())))\n"
        "assert dict(matplotlib.rcParams) == before\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    png, svg, pdf = pictures = drawn(build())
    assert run.stdout == b"AND".join(pictures)
    assert png.startswith(b"\x89PNG")
    assert b"tEXt" not in png[:200]  # no software, no date
    root = ElementTree.fromstring(svg)
    assert root.find("{http://www.w3.org/2000/svg}title").text == build().title
    assert b"dc:date" not in svg
    assert len(svg) < 300_000
    assert b"CreationDate" not in pdf


@pytest.mark.parametrize("build", ALL)
def test_nothing_is_written_beyond_the_edge(build):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = build()
    with paper_style(figure):
        canvas, _ = figure.draw()
        FigureCanvasAgg(canvas).draw()
        box, (width, height) = canvas.get_tightbbox(), canvas.get_size_inches()
    assert box.x0 >= 0
    assert box.y0 >= 0
    assert box.x1 <= width
    assert box.y1 <= height


def test_axis_factor_turns_metres_into_millimetres():
    with paper_style(step_response()):
        _, axes = step_response().draw()
    tops = sorted(axis.get_ylim()[1] for axis in axes)
    assert 0.9 < tops[0] < 1.0  # mm
    assert 3.0 < tops[1] < 4.0  # N


# Interactive


def numbers(values):
    return np.array(values, dtype=np.float64)  # null becomes NaN


@pytest.mark.parametrize("build", ALL)
def test_plotly_accepts_each_property(build):
    from plotly.graph_objects import Figure as PlotlyFigure

    figure = build()
    plotly = screen.described(figure)
    PlotlyFigure(plotly)  # raises for an unknown property or an impossible value
    text = screen.to_json(plotly)
    assert "<" not in text
    assert json.loads(text) == plotly
    shown = [
        part["name"] for part in plotly["data"] + plotly["layout"]["shapes"] if part["showlegend"]
    ]
    assert sorted(shown) == sorted(markup.label_html(name) for name, _ in figure.legend())


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (45, 90, {"tickformat": "~g"}),  # nanoseconds: 50, 60, 70
        (2e-4, 3e-3, {"tickformat": "~g", "dtick": "D2"}),
        (1e-3, 1e2, {"tickformat": "~g", "dtick": 1}),
        (1e-9, 1e3, {"dtick": 2}),  # powers of ten
    ],
)
def test_labels_on_a_logarithmic_axis_are_whole_numbers(low, high, ticks):
    x = np.geomspace(low, high, 7)
    panel = Panel(Axis("x", scale="log"), Axis("y", scale="log", limits=(low, high)), [Line(x, x)])
    layout = screen.described(Figure("a", "", "", [panel]))["layout"]
    for axis in (layout["xaxis"], layout["yaxis"]):
        assert {key: axis[key] for key in ("tickformat", "dtick") if key in axis} == ticks


def test_both_renderings_show_the_same_numbers():
    figure = step_response()
    measured = figure.panels[0].items[1]
    trace = next(t for t in screen.described(figure)["data"] if t["name"] == "measured")
    y = numbers(trace["y"])
    assert y.size <= 4 * BUCKETS
    shown = 1e3 * measured.y
    assert [y.min(), y.max()] == pytest.approx([shown.min(), shown.max()], abs=5e-6 * np.ptp(shown))
    surface = screen.described(force_map())["data"][0]
    heat = force_map().panels[0].item(Heatmap)
    np.testing.assert_allclose(numbers(surface["z"]), heat.z, rtol=1e-6)
    assert surface["contours"]["start"] == heat.levels[0]


# Page


def test_page_refers_to_nothing_outside_itself(page):
    root = html.fromstring(page)
    ids, images = root.xpath("//@id"), [*root.iter("img")]
    assert len(ids) == len(set(ids))
    for reference in root.xpath("//@src | //@href"):
        assert reference.startswith("data:") or reference[1:] in ids, reference[:80]
    assert "default-src 'none'" in page
    assert "@import" not in page[: page.index("<body>")]
    assert "url(" not in page[: page.index("<body>")]
    assert len(images) == len(ALL)
    assert all(len(image.get("alt")) > 20 for image in images)


def test_page_is_small_and_has_plotly_with_its_licence(page):
    """Scatter, bars, contours and heat maps: the cartesian bundle, packed."""
    assert len(page.encode()) < 2.5e6
    packed = re.search(r'id="plotly.js">([^<]+)<', page)[1]
    script = gzip.decompress(base64.b64decode(packed)).decode()
    assert "plotly.js (cartesian" in script[:200]
    assert "Licensed under the MIT license" in script[:300]
    licence = Path(screen.__file__).parent / "plotly" / "LICENSE"
    assert "MIT" in licence.read_text(encoding="utf-8")


@given(
    values=st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=2, max_size=300),
    repeats=st.sampled_from([1, 200]),
)
def test_numbers_of_lines_are_within_what_is_seen(values, repeats):
    y = np.array(values * repeats)
    written = numbers(Axis("y").numbers(y))
    np.testing.assert_array_equal(np.isnan(written), np.isnan(y))
    span = np.ptp(y[np.isfinite(y)]) if np.isfinite(y).any() else 0.0
    np.testing.assert_allclose(written, y, rtol=1e-15, atol=5e-6 * span)


@pytest.mark.parametrize("end", [np.inf, -np.inf])
def test_what_is_infinite_is_a_gap_in_json(end):
    x = np.linspace(1.0, 2.0, 500)
    y = np.where(x > 1.5, end, x)
    figure = Figure("a", "", "", [Panel(Axis("x"), Axis("y"), [Line(x, y)])])
    (line,) = json.loads(screen.to_json(screen.described(figure)))["data"]
    assert numbers(line["y"])[:250] == pytest.approx(y[:250], abs=5e-6)
    assert set(line["y"][250:]) == {None}


def test_lines_that_would_lose_what_is_seen_keep_it():
    x = np.linspace(1.0, 2.0, 500)
    spike = x.copy()
    spike[100] = 1e6
    small = np.geomspace(1e-12, 1.0, 500)
    log = Axis("y", scale="log")
    near = Axis("y", limits=(0, 3))
    for axis, y, error in ((Axis("y"), x, 5e-6), (log, small, 5e-6), (near, spike, 5e-6)):
        figure = Figure("a", "", "", [Panel(Axis("x"), axis, [Line(x, y)])])
        (line,) = json.loads(screen.to_json(screen.described(figure)))["data"]
        tolerance = error * y if axis is log else error
        assert (np.abs(numbers(line["y"]) - y) <= tolerance).all()
    assert len(json.dumps(line["x"])) < 11 * x.size  # no more digits than are seen


@pytest.mark.long
def test_a_page_of_many_pictures_has_them_packed(monkeypatch, tmp_path):
    monkeypatch.setattr("ambkit.result.report.page.HEAVY", 1000)
    made = write_report(report(), tmp_path)
    assert "<noscript>" in made.read_text(encoding="utf-8")
    shown = "[...document.querySelectorAll('img')].filter((i) => i.naturalWidth > 100).length"
    assert seen_in_a_browser(made, 6, shown) == 6


def test_page_numbers_links_and_escapes(page):
    assert "<title>A &amp; B</title>" in page
    assert '<a href="#table4">Table 1</a>' in page
    assert '<a href="#fig15">Figure 1</a>' in page
    assert "&lt;b&gt;see&lt;/b&gt;" in page
    assert re.search(r'class="num marked">8\.45<sup>†</sup>', page)
    assert "Long lines (up to 20,001 samples)" in page
    assert '<a href="#table4">Largest deviation' in page  # from the row's id
    assert re.search(r"✓</span>agrees", page)


def test_report_writes_all_files_and_the_same_ones_again(written, tmp_path):
    said = []
    assert write_report(report(), tmp_path, said.append).read_bytes() == written.read_bytes()
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert names == {f"{build().id}.{kind}" for build in ALL for kind in ("png", "svg")}
    assert said[0] == "figure 1 of 6: Step response, 0.5 mm"
    assert len(said) == 7


def test_report_that_contradicts_itself_is_refused_before_the_work(tmp_path):
    twice = replace(report(), chapters=[*report().chapters, Chapter("fig15", "again", [])])
    with pytest.raises(ValueError, match="'fig15' is used twice"):
        write_report(twice, tmp_path)
    assert not list(tmp_path.iterdir())


def test_unwritable_place_is_named_and_the_old_file_stays(tmp_path):
    old = tmp_path / "file"
    old.write_bytes(b"old")
    with pytest.raises(AmbkitError, match=r"file/figures: cannot be made"):
        write_report(report(), old)
    (tmp_path / "folder" / "fig15.png" / "content").mkdir(parents=True)
    with pytest.raises(AmbkitError, match=r"fig15.png: cannot be written"):
        step_response().save(tmp_path / "folder" / "fig15.png")
    assert old.read_bytes() == b"old"
    assert {path.name for path in tmp_path.rglob("*")} == {
        "file", "folder", "fig15.png", "content"
    }  # fmt: skip  # no temporary left


def seen_in_a_browser(page, figures, ask="1"):
    """Open a page; it must draw its figures, fetch nothing, and complain of nothing.

    Returns what the browser answers to `ask` then.
    """
    playwright = pytest.importorskip("playwright.sync_api")
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if not program:
        pytest.skip("no chromium here to open the page with")
    complaints, asked = [], []
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=program, args=["--no-sandbox"])
        opened = browser.new_page(viewport={"width": 1300, "height": 9000})
        opened.on("console", lambda message: complaints.append(message.text))
        opened.on("pageerror", lambda error: complaints.append(str(error)))
        opened.on("request", lambda request: asked.append(request.url))
        opened.goto(page.as_uri())
        drawn = opened.locator(".plot.live:has(.main-svg)")
        playwright.expect(drawn).to_have_count(figures, timeout=60_000)
        answer = opened.evaluate(ask)
        browser.close()
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [page.as_uri()]
    assert complaints == []
    return answer


def test_browser_draws_every_figure_and_fetches_nothing(written):
    seen_in_a_browser(written, 6)


@pytest.mark.parametrize("jump", [0.0, -0.5])
def test_browser_draws_a_log_as_read_and_as_refused(tmp_path, jump):
    t = 1e-3 * np.arange(2000)
    y = np.sin(20 * t)
    y[800:900] = y[800]
    t[1000:] += 0.01 + jump
    rows = zip(t.tolist(), y.tolist(), np.cos(20 * t).tolist(), strict=True)
    lines = ["t [s],y [mm],u [V]", *(f"{a},{b},{c}" for a, b, c in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    page = tmp_path / "log.html"
    try:
        figure = reading_figure(read(tmp_path / "log.csv"))
    except RejectedLog as refused:
        figure = refused_figure(refused)
    figure.save(page)
    ask = """JSON.stringify({
        legend: [...document.querySelectorAll(".legendtext")].map(each => each.textContent),
        marks: document.querySelectorAll(".shapelayer path").length,
        lines: [...document.querySelectorAll(".plot .js-line")]
            .map(each => each.getBBox().width),
        wider: document.documentElement.scrollWidth > innerWidth,
        headings: document.querySelectorAll("h2").length,
        caption: document.querySelector("figcaption").textContent,
    })"""
    seen = json.loads(seen_in_a_browser(page, 1, ask))
    assert not seen["wider"]
    assert seen["headings"] == 0  # one picture has no chapters
    assert seen["marks"] >= len(figure.panels)
    if jump:
        assert seen["legend"] == ["clock", "time between samples", "as read", "refused for this"]
        assert sum(width > 100 for width in seen["lines"]) == len(figure.panels) == 4, seen["lines"]
        assert "log.csv:1002: t jumps from 0.999 s to 0.51 s" in seen["caption"]
    else:
        assert {"as read", "frozen", "missing", "time between samples"} == set(seen["legend"])


# Summary


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), ("a", "a"), (0.04715, "0.04715"), (-8e-5, "−8×10⁻⁵"), (2e12, "2×10¹²"), (7, "7")],
)
def test_numbers_are_written_for_humans(value, text):
    assert blocks.number(value) == text


@pytest.mark.parametrize("width", [60, 100])
def test_terminal_table_fits_and_tells_the_verdict_without_colour(width, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    printing.show(printing.on_screen(Judged(Path("out"), ROWS), verbose=False))
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= width
    assert "✓ agrees" in text
    assert "≠ differs" in text
    assert "[N/A]" in text  # not taken for markup
    assert "agrees 1, differs 1" in text


def test_unknown_verdict_is_refused():
    with pytest.raises(ValueError, match="unknown verdict 'fine'"):
        verdicts.tally([{**ROWS[0], "verdict": "fine"}])


def test_names_below_bars_may_hold_formulas():
    figure = Figure("bars", "", "", [Panel(Axis(""), Axis("y"), [Bars(["$k_i$", "b"], [1, 2])])])
    (bars,) = json.loads(screen.to_json(screen.described(figure)))["data"]
    assert bars["x"] == ["<i>k</i><sub><i>i</i></sub>", "b"]


def labels_of(axis):
    """The boxes of an axis's labels on the canvas, of ticks that are seen."""
    low, high = sorted(axis.get_view_interval())
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    return [tick.label1.get_window_extent() for tick in ticks
            if tick.label1.get_text() and low <= tick.get_loc() <= high]  # fmt: skip


def test_ticks_side_by_side_do_not_touch_and_a_short_logarithmic_axis_has_some():
    y = np.linspace(1.1, 2.8, 9)
    ends = (np.array([value]) for value in (0.0054, -0.0817, 0.1128))
    delay = Intervals(["$T_d$"], *ends, ["50.54 µs"], signal="identified", label="")
    figure = Figure("ticks", "Ticks", "", [
        Panel(Axis("delay", "samples"), Axis(""), [delay]),
        Panel(Axis("x"), Axis("y", scale="log"), [Line(y, y, label="")]),
    ], columns=2)  # fmt: skip
    with paper_style(figure):
        canvas, axes = figure.draw()
        canvas.draw_without_rendering()
    for ax in axes:
        boxes = sorted(labels_of(ax.xaxis), key=lambda box: box.x0)
        assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))
    assert len(labels_of(axes[1].yaxis)) >= 3
