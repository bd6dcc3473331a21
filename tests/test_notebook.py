"""What notebooks show of objects, their plots, and what completion offers."""

import base64
import dataclasses
import re
import sys
from html import unescape
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import Expert, KalmanFilter, Machine, Record
from ambkit.assessment.injection_experiment import design_injection
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si
from ambkit.control.control import Control
from ambkit.judge.comparison import compare
from ambkit.judge.comparison.score import ComparisonSet
from ambkit.result.card import spread
from ambkit.result.report import Axis, Figure, Heatmap, Panel
from ambkit.result.report.figure import paper_style
from ambkit.workflow.comparison import LoopScores
from ambkit.workflow.design_candidates import TunedCandidate
from ambkit.workflow.designed import Design
from tests.hostile import NOT_PRINTABLE, PRINTABLE, Page, called

BEARING = Machine.preset("zittau_axial")
SCENARIO = ambkit.scenario_for(BEARING, step="0.1 mm", load="3 N", duration="80 ms")
RECORD = ambkit.simulate(BEARING, SCENARIO).record
ESTIMATE = KalmanFilter(BEARING).run(RECORD, covariance=True)


@pytest.fixture(scope="module")
def shown():
    """One of each that a notebook shows, under the name of its class."""
    from ambkit.identification.forces.lift_off import LiftOff, fit_lift_off
    from ambkit.workflow.lift_off import LiftedOff

    scores = compare(BEARING, SCENARIO, {"linear": lambda: KalmanFilter(BEARING)}, [0])
    study = ambkit.compare(BEARING, "linear", seeds=1)
    errors = {"x": 3e-6, "v": 2e-3, "f_d": 0.5}
    candidate = TunedCandidate("linear", Path("a.toml"), True, "truth", {}, errors, 9e-6, 3e-6)
    assessed = ambkit.assess(BEARING, "linear")
    one_sided = Machine.preset("inteco_ml")
    injection = design_injection(BEARING, ambkit.Scenario(duration=1.0))
    points = [
        LiftOff(0, gap, 0.1 + 200 * gap, 0.0, gap, 1e-12, "") for gap in (1e-3, 2e-3, 3e-3, 4e-3)
    ]
    made = [
        BEARING, RECORD, ESTIMATE, Expert.paper(), study,
        ComparisonSet({"paper": study}), LoopScores(BEARING, {}, {"a step": scores}, range(1)),
        ambkit.identify_online(BEARING, RECORD),
        ambkit.simulate(BEARING, duration="10 ms"),
        ambkit.filter(RECORD, ["linear"], machine=BEARING, settling="5 ms"),
        ambkit.tune(BEARING, filter="linear", budget=2, seeds=1),
        Design(Path("d"), BEARING, Control(), (candidate,), candidate, assessed, 0.1,
               ("It is slow.",), None, {}),
        LiftedOff(one_sided, fit_lift_off(points, one_sided.rotor.mass), None),
        assessed, ambkit.assess_sweep(BEARING, "linear", amplitudes=["1 um"]),
        ambkit.tune_trade_off(BEARING, peaks=[2.2], filter="linear", budget=2, seeds=1),
        injection, ambkit.assess_log(injection.record, BEARING, "linear"),
    ]  # fmt: skip
    return {type(each).__name__: each for each in made}


NAMES = (
    "Machine", "Record", "Estimate", "Expert", "Study", "ComparisonSet",
    "LoopScores", "OnlineComparison", "Run", "Filtering", "Tuned", "Design",
    "LiftedOff", "Assessment", "TradeOff", "Sweep", "Injection", "AssessedLog",
)  # fmt: skip


def read(html):
    """What there is to read in a table."""
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def test_a_signal_is_summed_up_by_its_ends_and_its_root_mean_square():
    values = np.array([np.nan, 1e-3, 3e-3, 5e-3])  # about a mean: no standard deviation
    assert spread(values, "m") == ["1\u00a0mm", "5\u00a0mm", "3.416\u00a0mm"]


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_shows_a_table_and_a_picture(shown, name):
    html = shown[name]._repr_html_()
    assert picture(html).startswith(b"\x89PNG")
    assert html.count("<tr>") > 1
    page = Page(html)
    assert (page.found, page.scripts) == ([], 0)


def picture(html):
    (packed,) = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    return base64.b64decode(packed)


@pytest.mark.pictures
@pytest.mark.parametrize("name", quick(NAMES, ("Record", "Expert", "ComparisonSet")))
def test_pictures_of_a_notebook_are_light(shown, name):
    assert 1_000 < len(picture(shown[name]._repr_html_())) < 150_000


@pytest.mark.parametrize("name", NAMES)
def test_all_are_plotted_both_ways(shown, name):
    from plotly.graph_objects import Figure as Interactive

    matplotlib.use("agg")
    from matplotlib import pyplot

    interactive = shown[name].plot()
    assert isinstance(interactive, Interactive)
    before = pyplot.get_fignums()
    axes = shown[name].plot(static=True)
    assert len(pyplot.get_fignums()) == len(before) + 1
    assert axes.shape == (len(axes),)
    axes[0].set_title("the user goes on")
    if name == "Record":
        axes[0].figure.canvas.draw()
    pyplot.close(axes[0].figure)


def test_an_identification_by_likelihood_is_shown():
    rate = ambkit.Scenario(duration="0.2 s", reference=ambkit.Sine(amplitude="50 µm", frequency=20))
    found = ambkit.identify(
        BEARING, ambkit.simulate(BEARING, rate).record, free=["magnet_constant"]
    )
    for each in (found, found.likelihood):
        assert "magnet_constant" in read(each._repr_html_())
        assert each.plot().data


def test_the_tables_have_the_figures():
    table = read(BEARING._repr_html_())
    for text in ("air gap 2 mm", "bias current 1.5 A", "k_i 10.05 N/A", "mass 0.518 kg"):
        assert text in table.replace("\u00a0", " ")
    signals = read(RECORD._repr_html_()).replace("\u00a0", " ")
    assert "801 samples" in signals
    assert "every 0.1 ms" in signals
    assert f"{1e3 * RECORD['y'].max():.4g} mm" in signals
    told = read(ESTIMATE._repr_html_())
    assert f"Mean NIS {ESTIMATE.nis[1:].mean():.3f}" in told
    gap = Record(RECORD.t, {"y": np.where(RECORD.t < 0.01, np.nan, RECORD["y"])})
    assert read(gap._repr_html_()).endswith(" 100")


def hostile(text):
    bearing = called(BEARING, text)
    signals = {**RECORD.signals, text: RECORD["y"]}
    record = Record(RECORD.t, signals, {**RECORD.units, text: "m"}, {"source": text})
    filtering = ambkit.filter(RECORD, ["linear"], machine=BEARING)
    yield bearing
    yield record
    yield dataclasses.replace(ESTIMATE, estimator=text)
    yield Expert.paper().model_copy(update={"source": text})
    machine = BEARING.model_copy(update={"name": text, "description": text})
    yield dataclasses.replace(
        filtering, machine=machine, record=record, estimators={text: filtering["linear"]}
    )
    yield dataclasses.replace(ambkit.identify_online(BEARING, RECORD), known=bearing)


@pytest.mark.filterwarnings("ignore:Glyph:UserWarning")  # of characters that no font has
@pytest.mark.parametrize("text", [PRINTABLE[3], PRINTABLE[5], "".join(NOT_PRINTABLE)])
def test_other_peoples_names_stay_text(text):
    for thing in hostile(text):
        html = thing._repr_html_()
        page = Page(html)
        assert (page.found, page.scripts) == ([], 0)
        assert 'class="tex2jax_ignore mathjax_ignore"' in html  # nor is it a formula
        drawn = thing.plot().to_json()
        assert "<script" not in drawn
        assert "<img" not in drawn


def test_own_axes_get_a_panel_and_keep_their_look():
    from matplotlib.figure import Figure as Canvas

    first, second, third = Canvas().subplots(3)
    first.set_facecolor("ivory")
    assert RECORD.plot(ax=first) is first
    assert "position" in first.get_ylabel()
    assert first.get_xlabel() == "time [s]"
    assert matplotlib.colors.same_color(first.get_facecolor(), "ivory")
    names = [text.get_text() for text in first.get_legend().get_texts()]
    assert {"measured", "reference", "truth"} == set(names)
    ESTIMATE.plot(ax=second, panel="force")
    drawn = max(second.lines, key=lambda line: len(line.get_xdata()))
    assert drawn.get_ydata() == pytest.approx(ESTIMATE.f_d)
    ESTIMATE.plot(ax=third, panel=-1)
    assert "innovation" in third.get_ylabel()
    several = Canvas().subplots(2, 2)
    assert RECORD.plot(ax=several) is several
    assert [ax.get_ylabel().split()[0] for ax in several.flat] == [
        "position", "control", "velocity", "disturbance",
    ]  # fmt: skip


def test_a_map_in_own_axes_has_its_colour_bar():
    from matplotlib.figure import Figure as Canvas

    line, canvas = np.linspace(0, 1, 5), Canvas(layout="constrained")
    heat = Heatmap(line, line, np.add.outer(line, line), Axis("force", "N"))
    Figure("a", "", "", [Panel(Axis("x"), Axis("y"), [heat])]).plot(ax=canvas.subplots())
    assert [ax.get_ylabel() for ax in canvas.axes] == ["y", "force [N]"]


def test_what_cannot_be_drawn_is_reported_in_a_line():
    from matplotlib.figure import Figure as Canvas

    ax = Canvas().subplots()
    for wrong, told in (
        ({"ax": 3}, "ax must be axes of matplotlib, is of type int"),
        ({"ax": ax, "panel": "torque"}, "there is no panel 'torque'; there are 0 \"position"),
        ({"ax": ax, "panel": 9}, "there is no panel 9"),
        ({"ax": [ax] * 9}, "ax has 9 axes, and there are 0 "),
    ):
        with pytest.raises(AmbkitError) as caught:
            RECORD.plot(**wrong)
        assert str(caught.value).startswith(told)
        assert "\n" not in str(caught.value)


def test_without_plotly_the_plot_is_of_matplotlib(monkeypatch):
    matplotlib.use("agg")
    from matplotlib import pyplot

    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    axes = RECORD.plot()
    assert axes[0].get_ylabel().startswith("position")
    pyplot.close(axes[0].figure)


@pytest.mark.parametrize(
    "thing",
    [BEARING, Machine, SCENARIO, ambkit.PID, ambkit.PID(), ambkit.Step, Expert.paper(), Expert],
    ids=lambda thing: getattr(thing, "__name__", type(thing).__name__),
)
def test_completion_shows_what_users_look_for(thing):
    names = {name for name in dir(thing) if not name.startswith("_")}
    assert not {n for n in names if n.startswith("model_")} | names & {"copy", "dict", "json"}
    of_class = thing if isinstance(thing, type) else type(thing)
    own = {name for name in vars(of_class) if not name.startswith("_")} - {"model_config"}
    assert own - {n for n in own if n.startswith("model_")} <= names
    if not isinstance(thing, type):
        assert set(of_class.model_fields) <= names


def test_ipython_shows_and_completes_the_same():
    shell_of = pytest.importorskip("IPython.core.interactiveshell")
    shell = shell_of.InteractiveShell.instance()
    try:
        shell.user_ns["bearing"] = BEARING
        data, _ = shell.display_formatter.format(BEARING)
        assert data["text/html"] == BEARING._repr_html_()
        completer = sys.modules["IPython.core.completer"]
        with completer.provisionalcompleter():
            found = list(shell.Completer.completions("bearing.", len("bearing.")))
        completed = {each.text.lstrip(".") for each in found}
        assert {"magnet", "replace", "plot"} <= completed
        assert not [name for name in completed if name.startswith("model_")]
    finally:
        shell_of.InteractiveShell.clear_instance()


def test_quantities_are_taken_with_their_units():
    assert in_si("step", "50 µm", "m") == in_si("step", 5e-5, "m") == 5e-5
    assert in_si("step", np.float32(0.5), "m") == 0.5
    assert in_si("step", None, "m") is None
    assert ambkit.scenario_for(BEARING, step="50 µm", load="3 N", duration="0.2 s") == (
        ambkit.scenario_for(BEARING, step=5e-5, load=3.0, duration=0.2)
    )
    assert len(RECORD.between("10 ms", "20 ms")) == 100
    noise = ambkit.FilterNoise(measurement="83 µm^2", disturbance="2 N^2/s")
    assert noise == ambkit.FilterNoise(83e-12, None, 2.0)
    slow = ambkit.LowPass(BEARING, velocity="300 rad/s")
    assert slow.corners["velocity"] == 300.0
    assert ambkit.filter(RECORD, ["linear"], machine=BEARING, settling="5 ms").settling == 5e-3


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            lambda: ambkit.filter(RECORD, machine="rig.toml"),  # a name of a file
            "rig.toml: cannot be read: No such file or directory",
        ),
        (lambda: ambkit.filter(RECORD, machine=3), "machine must be of type Machine, is the int 3"),
        (
            lambda: KalmanFilter("rig.toml"),
            "machine must be of type "
            "Machine, is the str 'rig.toml'; Machine.preset or Machine.load gives one",
        ),
        (
            lambda: ambkit.filter(BEARING, machine=BEARING),
            "record must be of type Record, is the Machine",
        ),
        (
            lambda: ambkit.filter(RECORD, machine=BEARING, settling="5 V"),
            'settling must be in s: "5 V": V cannot be converted to s',
        ),
        (
            lambda: ambkit.scenario_for(BEARING, step=[1]),
            "step must be a number in m or a text with its unit, is the list [1]",
        ),
        (
            lambda: ambkit.simulate(BEARING, 3).record,
            "scenario must be of type Scenario, is the int 3",
        ),
        (
            lambda: ambkit.identify(BEARING, ["log.csv"]),
            "log.csv: cannot be read: No such file or directory",
        ),
        (
            lambda: ambkit.identify(BEARING, [RECORD, 3]),
            "records must be of type Record or str or PathLike, is the int 3",
        ),
        (
            lambda: KalmanFilter(Machine),
            "machine must be of type Machine, is the type Machine; Machine(...) makes one",
        ),
        (
            lambda: KalmanFilter(BEARING, noise=1e-12),
            "noise must be of type FilterNoise, is the float 1e-12",
        ),
        (
            lambda: ambkit.train(RECORD).expert,
            "machine must be of type Machine or StiffnessMap, is the Record",
        ),
    ],
)
def test_wrong_types_are_reported_in_a_line(wrong, message):
    with pytest.raises((TypeError, AmbkitError)) as caught:
        wrong()
    assert str(caught.value) == message


def test_a_reading_is_not_a_record_and_the_message_helps():
    class Read:
        record = RECORD

        def __repr__(self):
            return "x" * 99

    with pytest.raises(TypeError, match=r"is the Read; give its \.record"):
        ambkit.tune(BEARING, Read())


def test_estimates_of_a_gap_and_without_covariance_are_drawn():
    lost = np.where((RECORD.t > 0.02) & (RECORD.t < 0.05), np.nan, RECORD["y"])
    record = Record(RECORD.t, {"y": lost, "u": RECORD["u"]})
    assert "MISSING 299" in read(KalmanFilter(BEARING).run(record)._repr_html_())
    assert "missing" in {trace.name for trace in record.plot().data} | {
        shape.name for shape in record.plot().layout.shapes
    }


@pytest.mark.filterwarnings("ignore")  # of Jupyter, about itself
def test_the_page_runs_as_a_notebook(tmp_path):
    nbformat, nbclient = (pytest.importorskip(name) for name in ("nbformat", "nbclient"))
    pytest.importorskip("ipykernel")
    text = (Path(__file__).parent.parent / "docs" / "start" / "notebook.md").read_text(
        encoding="utf-8"
    )
    cells = re.findall(r"```\{code-cell\}\n(.*?)```", text, re.S)
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, resources=resources).execute()
    outputs = [output for cell in notebook.cells for output in cell.outputs]
    pages = [output.get("data", {}) for output in outputs]
    # A progress bar that has gone leaves an empty one.
    shown = [page["text/html"] for page in pages if page.get("text/html")]
    assert "zittau_axial" in shown[0]
    assert "adaptive Kalman filter" in shown[1]
    assert all("data:image/png;base64," in html for html in shown[:2])
    assert any("image/png" in page for page in pages)  # the user's own axes
    nbformat.validate(notebook)


@pytest.mark.parametrize(
    "thing",
    [
        BEARING, ambkit.Machine.preset("tum_mlps"), SCENARIO, RECORD, ESTIMATE, Expert.paper(),
        KalmanFilter(BEARING), ambkit.ExtendedKalmanFilter(ambkit.Machine.preset("tum_mlps")),
        ambkit.AdaptiveNoise(KalmanFilter(BEARING)),
    ],
    ids=lambda thing: type(thing).__name__,
)  # fmt: skip
def test_what_is_public_has_a_short_repr_and_a_card(thing):
    text = repr(thing)
    assert text.startswith(f"<{type(thing).__name__.removeprefix('Placed')}")
    assert text.endswith(">")
    assert len(text) < 200
    assert "\n" not in text
    page = thing._repr_html_()
    assert "<table>" in page
    assert page.count("<tr>") > 0


def test_a_repr_escapes_what_a_file_says():
    assert (
        re.search(r"[\x1b\n]", repr(Expert.paper().model_copy(update={"source": "a\x1b[31m\nb"})))
        is None
    )


def test_a_notebook_shows_every_figure_of_pyplot_not_the_first_alone():
    """Matplotlib's defaults, set about each figure, switched off the mode that shows them."""
    with matplotlib.rc_context({"interactive": True}), paper_style(BEARING.figure()):
        assert matplotlib.is_interactive()
