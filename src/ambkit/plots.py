"""Pictures of single results: a run, an identification, a training, filters along a record.

Each function describes a :class:`ambkit.report.Figure`; `save_figure` draws it as ``.png``,
``.svg`` or, to zoom in, as ``.html``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.errors import AmbkitError
from ambkit.estimate import Status
from ambkit.report.figure import Figure, Panel
from ambkit.report.items import Axis, Bars, Heatmap, Item, Line, Note, Points, Rule
from ambkit.report.style import style_of

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.comparison import Score
    from ambkit.estimate import Estimate
    from ambkit.fuzzy import Expert
    from ambkit.identification import Identification
    from ambkit.identification.lift_off_fit import LiftOffFit
    from ambkit.identification.stiffness import StiffnessMap
    from ambkit.judgement import Judgement
    from ambkit.record import Record
    from ambkit.simulation import Run

ENDINGS = (".png", ".svg", ".html")
"""What `save_figure` can write."""

TIME = Axis("time", "s")
POSITION = Axis("position", "mm", 1e3)
VELOCITY = Axis("velocity", "mm/s", 1e3)
CURRENT = Axis("current", "A")
DISTURBANCE = Axis("disturbance force", "N")

_SIGNALS = {
    "linear": "estimate linear",
    "adaptive": "estimate adaptive",
    "closed-law": "estimate closed law",
}
_OTHERS = ("constant", "series 4", "series 1", "series 2")
_SMOOTHED = ("smoothed", "smoothed 2", "smoothed 3")


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Draw a figure into one file.

    Parameters
    ----------
    figure : Figure
        What to draw.
    path : path
        Its ending says how: ``.png``, ``.svg``, or ``.html``, a page that needs no net.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    AmbkitError
        Another ending, or the file cannot be written; an older one is left as it was.
    """
    from ambkit import files
    from ambkit.report import static

    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise AmbkitError(f"{path}: cannot draw {ending or 'that'}, use {', '.join(ENDINGS)}")
    picture = static.render(figure)
    if ending == ".html":
        files.write_text(path, _page(figure, picture))
    else:
        files.write_bytes(path, picture.png if ending == ".png" else picture.svg)
    return path


def _page(figure: Figure, picture: Any) -> str:
    import ambkit
    from ambkit.report.blocks import Chapter, FigureBlock, Report
    from ambkit.report.page import render_page

    report = Report(
        title=figure.title,
        subtitle="",
        lead="",
        version=ambkit.__version__,
        chapters=[Chapter("picture", "Picture", [FigureBlock(figure)])],
    )
    return render_page(report, {figure.id: picture})


def simulation_figure(run: Run, bearing: Bearing) -> Figure:
    """Show what happened in a simulated run, and what the estimator said to it."""
    record, estimate = run.record, run.estimate
    t, name = record.t, "estimate"

    def told(signal: str) -> list[Item]:
        return [] if estimate is None else [Line(t, estimate[signal], signal=name)]

    limits = [
        Rule(limit, signal="limit", label="limit")
        for limit in (bearing.current_min, bearing.current_max)
        if np.max(np.abs(record["iu"])) > 0.5 * abs(limit)
    ]
    position: list[Item] = [
        Line(t, record["y"], signal="measured"),
        Line(t, record["r"], signal="reference"),
        Line(t, record["x"], signal="truth"),
        *told("x"),
    ]
    control = Line(t, record["iu"], signal="control", label="control current")
    return Figure(
        id="simulation",
        title=f"Simulated run of {bearing.name}",
        caption="" if estimate is None else f"In the loop or beside it: {estimate.estimator}.",
        panels=[
            Panel(TIME, POSITION, position),
            Panel(TIME, VELOCITY, [Line(t, record["v"], signal="truth"), *told("v")]),
            Panel(TIME, CURRENT, [control, *limits]),
            Panel(TIME, DISTURBANCE, [Line(t, record["f_d"], signal="truth"), *told("f_d")]),
        ],
    )


def filter_figure(
    record: Record,
    judged: Mapping[str, Judgement],
    smoothed: Mapping[str, Estimate] | None = None,
) -> Figure:
    """Show what filters estimate along a record, and how their innovations fare.

    Parameters
    ----------
    record : Record
        What they ran along; reference, truth and logged estimates are shown where it has them.
    judged : mapping of str to Judgement
        The filters by their short names (``"linear"``, ``"adaptive"``, ``"closed-law"``).
    smoothed : mapping of str to Estimate, optional
        What their smoothers say, by the same names.
    """
    t, truth = record.t, record.truth
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    smoothed = smoothed or {}

    def known(signal: str, style: str, **label: str) -> list[Item]:
        return [Line(t, record[signal], signal=style, **label)] if signal in record else []

    def true(signal: str) -> list[Item]:
        return known(signal, "truth") if signal in truth else []

    def told(signal: str) -> list[Item]:
        filtered = [
            Line(t, judgement.estimate[signal], signal=style, label=label)
            for (style, label), judgement in zip(_looks(judged), judged.values(), strict=True)
        ]
        return [*filtered, *after(signal)]

    def after(signal: str) -> list[Item]:
        names = (label or style_of(style).label for style, label in _looks(smoothed))
        return [
            Line(t, estimate[signal], signal=style, label=f"{name}, smoothed")
            for style, name, estimate in zip(
                cycle(_SMOOTHED), names, smoothed.values(), strict=False
            )
        ]

    absent = _absent(record)
    innovations = [
        _innovations(name, judgement.estimate, time, absent) for name, judgement in judged.items()
    ]
    position = [*known("y", "measured"), *known("r", "reference"), *true("x"), *told("x")]
    velocity = [*known("v_logged", "logged"), *true("v"), *told("v")]
    disturbance = [*true("f_d"), *told("f_d")]
    settled = _settled(t, [judgement.estimate for judgement in judged.values()])
    return Figure(
        id="filter",
        title=f"Estimates along {record.meta.get('source') or 'the record'}",
        caption="Bounds: two standard deviations of the innovation as the filter expects it. First "
        "guesses, at the start and after a long gap, may reach beyond the axes.",
        panels=[
            Panel(time, POSITION, [*position, *known("x_logged", "logged"), *absent]),
            Panel(time, _limited(VELOCITY, velocity, settled), [*velocity, *absent]),
            Panel(time, _limited(DISTURBANCE, disturbance, settled), [*disturbance, *absent]),
            *innovations,
        ],
    )


def _absent(record: Record) -> list[Item]:
    """Mark where nothing was measured."""
    from ambkit.reading.picture import missing_spans

    t, lost = record.t, np.isnan(record["y"])
    edges = np.flatnonzero(np.diff(np.r_[False, lost, False]))
    stretches = [(float(t[a]), float(t[b - 1])) for a, b in edges.reshape(-1, 2)]
    return list(missing_spans(stretches, t))


def _looks(names: Iterable[str]) -> Iterator[tuple[str, str | None]]:
    """Style and label of each filter's lines; one without its own style takes what is left."""
    others = cycle(_OTHERS)
    for name in names:
        yield (_SIGNALS[name], None) if name in _SIGNALS else (next(others), name)


def _limited(axis: Axis, items: Iterable[Item], where: NDArray[np.bool_]) -> Axis:
    """Return the axis with limits that show the lines whole where they count."""
    shown = np.concatenate([item.y[where] for item in items if isinstance(item, Line)])
    low, high = np.nanmin(shown), np.nanmax(shown)
    margin = 0.05 * (high - low)
    if not margin > 0:
        return axis
    return replace(axis, limits=(float(low - margin), float(high + margin)))


def _settled(t: NDArray[np.float64], estimates: Iterable[Estimate]) -> NDArray[np.bool_]:
    """Where no filter guesses: in the dark at the start, and anew after a gap where it was HELD.

    What they guess there would flatten all else.
    """
    blind = np.zeros(t.size, dtype=bool)
    blind[0] = True
    for estimate in estimates:
        blind |= (estimate.status & np.uint16(Status.HELD)) != 0
    last = np.maximum.accumulate(np.where(blind, np.arange(t.size), 0))
    settled = np.asarray(t >= t[last] + 0.02 * np.ptp(t))
    return settled if settled.any() else np.ones(t.size, dtype=bool)


BEYOND = 1.5
"""An axis of innovations is cut where the largest is farther out by this than most are."""


def _innovations(name: str, estimate: Estimate, time: Axis, absent: Sequence[Item]) -> Panel:
    """Show innovations beside what the filter expects; mark those that would flatten the rest."""
    t = estimate.t
    told = estimate.used | ((estimate.status & np.uint16(Status.OUTLIER)) != 0)
    innovation = np.where(told, estimate.innovation, np.nan)
    expected = 2 * np.sqrt(estimate.innovation_variance)
    # The first bounds are so wide that they would make a line of all others.
    expected[expected > 1.5 * np.median(expected)] = np.nan
    expected[expected == 0] = np.nan  # a low-pass has no idea of them
    items: list[Item] = [
        Line(t, innovation, signal="innovation"),
        Line(t, expected, signal="bound", label="±2√S"),
        Line(t, -expected, signal="bound", label=""),
        *absent,
    ]
    axis = Axis(f"innov. {name}", "µm", 1e6)
    sizes = np.abs(innovation[np.isfinite(innovation)])
    if not sizes.size:
        return Panel(time, axis, items)
    most = float(np.nanmax([np.quantile(sizes, 0.995), *expected]))
    if sizes.max() <= BEYOND * most:
        return Panel(time, axis, items)
    edge = 1.3 * most
    far = np.flatnonzero(np.abs(np.nan_to_num(innovation)) > edge)
    for sign, style in ((1, "beyond above"), (-1, "beyond below")):
        side = far[np.sign(innovation[far]) == sign]
        if side.size:
            items.append(Points(t[side], np.full(side.size, 0.9 * sign * edge), signal=style))
    largest = far[np.argmax(np.abs(innovation[far]))]
    value = f"{1e6 * innovation[largest]:.0f} µm".replace("-", "−")
    up = innovation[largest] > 0
    # Beside the record's end the text would not fit.
    at = float(np.clip(t[largest], *(t[0] + np.ptp(t) * np.array([0.05, 0.95]))))
    items.append(Note(at, 0.84 * edge * (1 if up else -1), value, "below" if up else "above"))
    return Panel(time, replace(axis, limits=(-edge, edge)), items)


def identification_figure(found: Identification, start: float) -> Figure:
    """Show how the magnet constant was learned along a record, from `start` [N m^2/A^2].

    :func:`~ambkit.identification.online_figure.online_figure` shows several learners.

    Parameters
    ----------
    found : Identification
        The result.
    start : float
        Where learning began [N m^2/A^2].
    """
    from ambkit.identification.adaline import AdalineResult

    history = found.history
    panels = [
        Panel(TIME, Axis("magnet constant $k$", "N mm²/A²", 1e6), [
            Rule(start, signal="reference", label="start"),
            Rule(found.magnet_constant, signal="bound", label="result"),
            Line(history.t, history.k, signal="identified"),
        ]),
    ]  # fmt: skip
    if isinstance(history, AdalineResult):
        force = Line(history.t, history.force, signal="force", label="identified force")
        excitation = Line(history.t, history.excitation, signal="control", label="")
        panels.append(Panel(TIME, Axis("magnet force", "N"), [force]))
        panels.append(Panel(TIME, Axis("excitation"), [excitation]))
    return Figure(
        id="identification",
        title=f"Identification of {found.bearing.name}",
        caption="Where the excitation is too small, the magnet constant is held.",
        panels=panels,
    )


def lift_off_figure(fit: LiftOffFit) -> Figure:
    """Show lift-off points, the law through them, and what it leaves."""
    gap = Axis("distance $z$ at lift-off", "mm", 1e3)
    points = np.array([(p.gap, p.current, p.acceleration) for p in fit.points])
    at = np.linspace(0.0, 1.05 * points[:, 0].max(), 200)
    law = fit.current(at)
    # A point lies off the law for its own acceleration; that is how the residuals count.
    measured = fit.current(points[:, 0]) + fit.residuals
    return Figure(
        id="lift_off",
        title="Lift-off points and the law fitted to them",
        caption="Points as they would be without the acceleration that they were measured at.",
        panels=[
            Panel(gap, Axis("coil current $i$", "A"), [
                Line(at, law, signal="fit", label="F = k (i / (z + z_off))²"),
                Points(points[:, 0], measured, signal="measurement"),
            ]),
            Panel(gap, Axis("residual", "mA", 1e3), [
                Rule(0.0, signal="bound", label=""),
                Points(points[:, 0], fit.residuals, signal="measurement"),
            ]),
        ],
    )  # fmt: skip


def training_figure(expert: Expert, stiff: StiffnessMap) -> Figure:
    """Show how an expert learned, and by how much its force is off over the box."""
    iu = np.linspace(stiff.current[0], stiff.current[-1], 81)
    x = np.linspace(stiff.displacement[0], stiff.displacement[-1], 81)
    grid = np.meshgrid(iu, x)
    off = expert.force(*grid) - np.asarray(stiff.force(*grid))
    axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    curve = expert.learning_curve
    epochs = np.arange(curve.size, dtype=float)
    k_i, k_s = expert.stiffness(*grid)
    learning: list[Item] = [Line(epochs, curve, signal="estimate", label="")]
    return Figure(
        id="training",
        title=f"Expert of {len(expert.rules)} rules for {expert.source}",
        caption="The learning curve counts from the untrained network on.",
        panels=[
            Panel(
                Axis("step of the training"),
                Axis("force error", "N rms"),
                learning,
                title="learning curve",
            ),
            Panel(
                *axes,
                [Heatmap(iu, x, off, Axis("force error", "N"), diverging=True)],
                title="force of the expert, less the force it learned",
            ),
            Panel(*axes, [Heatmap(iu, x, k_i, Axis("$k_i$", "N/A"))], title="$k_i$"),
            Panel(*axes, [Heatmap(iu, x, k_s, Axis("$k_s$", "N/mm", 1e-3))], title="$k_s$"),
        ],
        columns=2,
    )


def comparison_figure(scores: Mapping[str, Mapping[str, Score]], what: str = "step") -> Figure:
    """Show the errors of several filters as bars.

    Parameters
    ----------
    scores : mapping of str to (mapping of str to Score)
        For each case, such as the height of a step, the score of each filter by its short name.
    what : str
        What the cases are.
    """
    shown = {
        "x": Axis("error of position", "µm rms", 1e6),
        "v": Axis("error of velocity", "mm/s rms", 1e3),
        "f_d": Axis("error of disturbance force", "N rms"),
    }
    cases, names = list(scores), list(next(iter(scores.values())))

    def bars(
        figure_of: Callable[[Score], float], spread_of: Callable[[Score], float]
    ) -> list[Item]:
        return [
            Bars(
                cases,
                np.array([figure_of(scores[case][name]) for case in cases]),
                np.array([spread_of(scores[case][name]) for case in cases]),
                signal=style,
                label=label,
            )
            for name, (style, label) in zip(names, _looks(names), strict=True)
        ]

    errors = [
        Panel(Axis(what), axis, bars(methodcaller("mean", signal), methodcaller("spread", signal)))
        for signal, axis in shown.items()
    ]
    nis = bars(lambda score: float(score.nis.mean()), lambda score: float(score.nis.std()))
    return Figure(
        id="comparison",
        title="Errors of the filters",
        caption="Means over the seeds; error bars: standard deviation over them.",
        panels=[
            *errors,
            Panel(Axis(what), Axis("mean NIS"), [*nis, Rule(1.0, signal="bound", label="")]),
        ],
        columns=2,
    )
