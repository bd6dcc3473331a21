"""Pictures of single results: what they show, and the files they go to."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import fe_map
import numpy as np
import pytest

import ambkit
from ambkit.data import recordings
from ambkit.estimate.registry import KINDS
from ambkit.fuzzy.expert_card import training_figure
from ambkit.fuzzy.rule_selection import with_surface
from ambkit.identification.forces.lift_off import fit_lift_off, lift_off_figure, load_points
from ambkit.judge.comparison import compare
from ambkit.judge.comparison.seeds import comparison_figure
from ambkit.judge.evaluation import evaluate, filter_figure
from ambkit.machine.forces.force_points import load_force_points
from ambkit.result.report import Band, Bars, Heatmap, Line, Note, Points
from ambkit.result.report.style import OF_KINDS, SIGNALS
from ambkit.result.signal_styles import looks
from ambkit.simulation.run_figure import simulation_figure
from ambkit.workflow.training import measured_force


@pytest.fixture(scope="module")
def scenario():
    return ambkit.Scenario(duration=0.2, reference=ambkit.Step(amplitude=0.3e-3, time=0.02))


@pytest.fixture(scope="module")
def run(bearing, scenario):
    return ambkit.simulate(bearing, scenario, filter=ambkit.KalmanFilter(bearing))


def lines(panel):
    return {item.legend: item for item in panel.items if isinstance(item, Line)}


def test_a_run_is_shown_with_its_truth_and_estimate(run, bearing):
    figure = simulation_figure(run)
    position, velocity, current, disturbance = figure.panels
    assert set(lines(position)) == {"measured", "reference", "truth", "estimate"}
    np.testing.assert_array_equal(lines(velocity)["estimate"].y, run.estimate.v)
    np.testing.assert_array_equal(lines(current)["control current"].y, run.record["iu"])
    np.testing.assert_array_equal(lines(disturbance)["truth"].y, run.record["f_d"])


def test_a_run_without_estimator_shows_none(run, bearing):
    figure = simulation_figure(replace(run, estimate=None))
    assert "estimate" not in {text for text, _ in figure.legend()}


def test_current_limits_are_shown_where_they_matter(run, bearing):
    weak = bearing.replace(amplifier__current_limit=0.6)
    still = ambkit.simulate(bearing, ambkit.Scenario(duration=0.02, noise=False))
    near = simulation_figure(replace(run, machine=weak))
    assert "limit" in {text for text, _ in near.legend()}
    assert "limit" not in {text for text, _ in simulation_figure(still).legend()}


def test_currents_and_noise_among_the_states_have_panels(scenario):
    bearing = ambkit.preset("zittau_axial").replace(
        amplifier__bandwidth="500 Hz",
        sensor__coloured_noise={"variance": "100 um^2", "bandwidth": "200 Hz"},
        sensor__hum=[{"frequency": "50 Hz", "amplitude": "20 um"}],
    )
    kalman, observer = ambkit.KalmanFilter(bearing), ambkit.ExtendedStateObserver(bearing)
    run = ambkit.simulate(bearing, scenario, filter=kalman)
    estimate, record = run.estimate, run.record
    seen = estimate["n_y"] + estimate["hum_c"]

    *_, current, _, noise = simulation_figure(run).panels
    np.testing.assert_array_equal(lines(current)["estimate"].y, estimate["i"])
    np.testing.assert_array_equal(lines(noise)["estimate"].y, seen)
    np.testing.assert_array_equal(lines(noise)["measured"].y, record["y"] - record["x_m"])

    evaluated = {"linear": evaluate(kalman, record), "mine": evaluate(observer, record)}
    current, noise = filter_figure(record, evaluated).panels[3:5]
    assert set(lines(current)) == {"truth", "linear", "mine"}
    assert set(lines(noise)) == {"measured", "linear"}  # an observer knows none
    np.testing.assert_array_equal(lines(current)["truth"].y, record["iu"])
    late = record.t > 0.05
    whole = lines(noise)["measured"].y[late]
    assert np.std(whole - lines(noise)["linear"].y[late]) < 0.8 * np.std(whole)


def test_filters_are_shown_by_their_own_styles_with_their_innovations(run, bearing):
    law = ambkit.ClosedLaw(bearing)
    evaluated = {
        "linear": evaluate(ambkit.KalmanFilter(bearing), run.record),
        "closed-law": evaluate(ambkit.AdaptiveKalmanFilter(bearing, law), run.record),
        "mine": evaluate(ambkit.KalmanFilter(bearing, gravity="disturbance"), run.record),
    }
    figure = filter_figure(run.record, evaluated)
    assert len(figure.panels) == 3 + len(evaluated)
    shown = lines(figure.panels[2])
    assert {"linear", "closed-law", "mine", "truth"} == set(shown)
    assert len({SIGNALS[line.signal].colour for line in shown.values()}) == len(shown)
    bounds = lines(figure.panels[3])["±2√S"].y
    expected = 2 * np.sqrt(evaluated["linear"].estimate.innovation_variance)
    assert bounds[-1] == expected[-1]
    assert np.isnan(bounds[0])  # the start, when the filter knew nothing


def test_what_is_smoothed_lies_on_what_is_filtered(run, bearing):
    kalman = ambkit.KalmanFilter(bearing)
    evaluated = {"linear": evaluate(kalman, run.record), "mine": evaluate(kalman, run.record)}
    smoothed = {name: kalman.smooth(run.record) for name in evaluated}
    panel = filter_figure(run.record, evaluated, smoothed).panels[2]
    shown = lines(panel)
    after = [shown["linear, smoothed"], shown["mine, smoothed"]]
    np.testing.assert_array_equal(after[0].y, smoothed["linear"].f_d)
    layers = {SIGNALS[line.signal].layer for line in after}
    assert min(layers) > max(
        SIGNALS[line.signal].layer for line in shown.values() if line not in after
    )


def test_a_filters_first_guesses_do_not_flatten_the_rest(run, bearing):
    evaluated = {"linear": evaluate(ambkit.KalmanFilter(bearing), run.record)}
    panel = filter_figure(run.record, evaluated).panels[2]
    low, high = panel.y.limits
    f_d = evaluated["linear"].estimate.f_d
    assert f_d.min() < low < f_d[1000:].min()
    assert high > f_d[1000:].max()


def test_a_gap_flattens_nothing(run, bearing):
    """What is wild after it is cut off, and told; where nothing is wild, nothing is cut off."""
    y = run.record["y"].copy()
    y[700:1300] = np.nan
    gap = ambkit.Record(run.record.t, {"y": y, "u": run.record["u"]})
    evaluation = evaluate(ambkit.KalmanFilter(bearing), gap)
    *_, shown = filter_figure(gap, {"linear": evaluation}).panels
    e = evaluation.estimate.innovation
    largest = int(np.argmax(np.abs(e)))
    assert 1300 <= largest < 1310
    low, high = shown.y.limits
    assert -low == high < 0.3 * abs(e[largest])
    usual = e[200:690]
    assert np.abs(usual).max() < high < 3 * np.abs(usual).max()
    marks = [item for item in shown.items if isinstance(item, Points)]
    assert sum(mark.x.size for mark in marks) == (np.abs(e) > high).sum()
    (note,) = (item for item in shown.items if isinstance(item, Note))
    assert note.text == f"{1e6 * e[largest]:.0f} µm".replace("-", "−")
    assert np.isnan(lines(shown)["innovation"].y[700:1300]).all()

    filters = {"linear": ambkit.KalmanFilter(bearing), "low-pass": ambkit.LowPass(bearing)}
    whole = {name: evaluate(one, run.record) for name, one in filters.items()}
    calm, unbound = filter_figure(run.record, whole).panels[3:]
    assert np.isnan(lines(unbound)["±2√S"].y).all()  # a low-pass expects nothing
    assert calm.y.limits is None
    assert not any(isinstance(item, Points) for item in calm.items)


def test_what_the_rig_logged_is_shown():
    record = ambkit.Record.load(recordings.folder() / "sinus_kalman.csv")
    evaluated = {"linear": evaluate(ambkit.KalmanFilter(ambkit.preset("inteco_ml")), record)}
    position, velocity, *_ = filter_figure(record, evaluated).panels
    assert "logged by the rig" in lines(position)
    np.testing.assert_array_equal(lines(velocity)["logged by the rig"].y, record["v_logged"])


def test_lift_off_points_lie_off_the_law_by_their_residuals():
    points = load_points(recordings.folder() / "lift_off_points.csv")
    fit = fit_lift_off(points, 0.06054, gap_range=(4e-3, 16e-3))
    law, residuals = lift_off_figure(fit).panels
    (shown,) = (item for item in law.items if isinstance(item, Points))
    np.testing.assert_allclose(shown.y - fit.current(shown.x), fit.residuals, atol=1e-12)
    assert residuals.y.unit == "mA"


def test_a_training_shows_its_curve_and_its_error(bearing):
    stiff = ambkit.stiffness_map(bearing)
    expert = ambkit.train(stiff).expert
    curve, error, slope, *_ = training_figure(expert, stiff).panels
    (line,) = (item for item in curve.items if isinstance(item, Line))
    np.testing.assert_array_equal(line.y, expert.learning_curve)
    (surface,) = (item for item in error.items if isinstance(item, Heatmap))
    assert np.sqrt(np.mean(surface.z**2)) == pytest.approx(stiff.force_rms(expert.force), rel=0.1)
    assert slope.title.startswith("tangent $k_i$")
    [k_i] = [item for item in slope.items if isinstance(item, Heatmap)]
    force = expert.force(*np.meshgrid(k_i.x, k_i.y))
    np.testing.assert_allclose(k_i.z, np.gradient(force, k_i.x, axis=1), rtol=0.05)


def test_a_comparison_shows_mean_and_spread(bearing, scenario):
    makers = {"linear": lambda: ambkit.KalmanFilter(bearing)}
    scores = {"0.3 mm": compare(bearing, scenario, makers, range(3))}
    position = comparison_figure(scores).panels[0]
    (bars,) = (item for item in position.items if isinstance(item, Bars))
    score = scores["0.3 mm"]["linear"]
    assert bars.values == pytest.approx([score.mean("x")])
    assert bars.error == pytest.approx([score.spread("x")])


def test_the_ending_says_how_to_draw(run, bearing, tmp_path):
    figure = simulation_figure(run)
    assert figure.save(tmp_path / "a.PNG").read_bytes().startswith(b"\x89PNG")
    assert ET.parse(figure.save(tmp_path / "a.svg")).getroot().tag.endswith("svg")
    page = figure.save(tmp_path / "a.html").read_text()
    assert "Plotly.newPlot" in page
    assert page.count("<section") == 1
    paper = figure.save(tmp_path / "a.pdf").read_bytes()
    assert paper.startswith(b"%PDF")
    run.save(tmp_path / "b.pdf")
    assert (tmp_path / "b.pdf").read_bytes() == paper
    wrong = r"a.gif: cannot draw .gif, use .png, .svg, .pdf, .html"
    with pytest.raises(ambkit.AmbkitError, match=wrong):
        figure.save(tmp_path / "a.gif")
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"a.PNG", "a.svg", "a.html", "a.pdf", "b.pdf"}


def test_innovations_of_a_long_record_are_shown_by_how_far_most_reach(bearing):
    record = ambkit.simulate(bearing, duration="1 s").record
    y = record["y"].copy()
    y[2000:4000] = np.nan
    record = ambkit.Record(record.t, {"y": y, "u": record["u"]})
    evaluation = evaluate(ambkit.KalmanFilter(bearing), record)
    panel = filter_figure(record, {"linear": evaluation}).panels[-1]
    (band,) = (item for item in panel.items if isinstance(item, Band))
    bounds = lines(panel)["±2√S"].y
    assert np.nanmedian(band.high) == pytest.approx(bounds[-1], rel=0.15)
    assert np.nanmedian(band.low) == pytest.approx(-bounds[-1], rel=0.15)
    lost = (band.x > record.t[2050]) & (band.x < record.t[3950])
    assert np.isnan(band.high[lost]).all()
    assert np.isfinite(band.high[~lost]).mean() > 0.9


def test_filters_without_a_look_of_their_own_are_reported_apart():
    names = ["linear", "adaptive", "closed-law", "extended", "ud", "low-pass", "mine.toml"]
    shown = [SIGNALS[style] for style, _ in looks(names)]
    assert len({(look.colour, look.dash) for look in shown}) == len(names)
    # What lies below is wider than what may lie on it, so that both are seen.
    below = sorted(shown, key=lambda look: look.layer)
    assert below[0].width > 2 * min(look.width for look in below[1:])


def test_a_dense_force_map_leaves_room_to_read_how_well_it_is_known(tmp_path):
    bearing = ambkit.Machine.load(fe_map.written(tmp_path))
    points = load_force_points(tmp_path / "fe.csv", tmp_path / "channels.toml")
    measured = measured_force(fe_map.BEARING, points)
    assert bearing.magnet.force_map is not None
    expert = ambkit.train(measured.stiffness).expert
    figure = with_surface(
        training_figure(expert, measured.stiffness), measured.surface, measured.stiffness
    )
    known = figure.panels[1]
    (surface,) = (item for item in known.items if isinstance(item, Heatmap))
    grid = np.meshgrid(surface.x, surface.y)
    assert (surface.z >= measured.surface.standard_error(*grid)).all()
    assert len(surface.levels) <= 6
    (marks,) = (item for item in known.items if isinstance(item, Points))
    assert SIGNALS[marks.signal].size < SIGNALS["measurement"].size / 2


def test_each_kind_of_filter_has_a_look_of_its_own():
    assert len(set(OF_KINDS)) >= len(KINDS)
