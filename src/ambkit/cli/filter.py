"""``ambkit filter``: estimators along a record, judged."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.family import NAMES, known, names
from ambkit.cli.options import (
    RECORDS,
    ExpertFile,
    Json,
    MapFile,
    Plot,
    arguments_of_the_user,
    file_option,
    find_bearing,
    quantity,
)

if TYPE_CHECKING:
    from ambkit.cli.family import Factory
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.estimate import Estimate
    from ambkit.estimate.noise import FilterNoise
    from ambkit.judge.judgement import Judgement

HORIZONS = (1, 10)
ABSURD_NIS = 25.0
OUTSIDE = 0.01
"""An expert that is asked outside of its box in more than this part of the samples is noted."""


def filter_record(
    record: Annotated[
        Path, typer.Argument(metavar="RECORD", help="The recording: a record, or with --map a log.")
    ],
    bearing: Annotated[
        str,
        typer.Option("--bearing", metavar="BEARING", help="A preset's name, or a TOML file."),
    ],
    channel_map: MapFile = None,
    estimator: Annotated[
        str,
        typer.Option(
            callback=known, metavar="NAMES", help=f"One or several of {', '.join(NAMES)}."
        ),
    ] = "linear,adaptive,closed-law",
    expert: ExpertFile = None,
    begin: Annotated[
        float | None,
        typer.Option("--from", parser=quantity("s"), metavar="TIME", help="Where to begin."),
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", parser=quantity("s"), metavar="TIME", help="And to end.")
    ] = None,
    settling: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            metavar="TIME",
            help="Time at the start that does not count in the table.",
        ),
    ] = None,
    noise_y: Annotated[
        float | None,
        typer.Option(
            "--measurement-noise",
            parser=quantity("m^2"),
            metavar="VARIANCE",
            help='R, such as "225 µm^2", if not the bearing\'s.',
        ),
    ] = None,
    noise_d: Annotated[
        float | None,
        typer.Option(
            "--disturbance-noise",
            parser=quantity("N^2/s"),
            metavar="VARIANCE",
            help='How fast the load wanders, such as "1 N^2/s"; see --tune.',
        ),
    ] = None,
    tune: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            metavar="TIME",
            help="Find how fast the load wanders, as the first TIME of the record makes most "
            "likely; that time does not count in the table. Default with a measured record: its "
            "second quarter (the first is often a start), judged on the second half, and kept "
            "only if it fits that better than the untuned. With a simulated record nothing is "
            "tuned, and it is (2 m g)^2 a second.",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Also estimate each sample from the whole record, not only from what came before.",
        ),
    ] = False,
    out: Annotated[
        Path | None, file_option("Write the estimates: .csv or .parquet.", RECORDS, "--out")
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Run estimators along a record.

    And judge them: by their innovations, the load that they see, and against the truth if known.

    Without truth the judge is how well the measured position is predicted, beside holding its last
    value and beside what the rig logged itself (x_logged, v_logged).

    For example:
      ambkit filter run.csv --bearing zittau_axial --out estimates.csv --plot estimates.html
    """
    from dataclasses import replace

    from ambkit.cli import output
    from ambkit.cli.belonging import check_belongs
    from ambkit.cli.family import factories
    from ambkit.data.reading import load
    from ambkit.estimate.noise import FilterNoise
    from ambkit.judge.judgement import judge
    from ambkit.show import plots
    from ambkit.workflow.tuning import default_disturbance

    if tune is not None and noise_d is not None:
        raise AmbkitError("--tune finds what --disturbance-noise gives: use one of them")
    if tune is not None and not tune > 0:
        raise AmbkitError(f"--tune must be greater than 0 s, is {tune:g} s")
    chosen = names(estimator)
    model = find_bearing(bearing)
    log = load(record, channel_map)
    if begin is not None or end is not None:
        log = log.between(begin, end)
    check_belongs(record, log, model)
    span = float(log.t[-1] - log.t[0])
    if tune is not None and not tune < span:
        raise AmbkitError(
            f"--tune must be shorter than the record, {span:.4g} s, and leave time to judge by; "
            f"is {tune:g} s"
        )
    tune_from, by_itself = 0.0, False
    if tune is None and noise_d is None and not log.has_truth:
        tune = span / 2
        tune_from, by_itself = tune / 2, True
        first = log.t[0]
        output.note(
            f"tuned from {first + tune_from:.3g} to {first + tune:.3g} s, judged on the rest"
        )
    noise = FilterNoise(measurement=noise_y, disturbance=noise_d)
    late = max(settling or 0.0, tune or 0.0)
    built = factories(chosen, model, expert)
    assumed, judged, smoothed = {}, {}, {}
    with arguments_of_the_user(), output.progress("filtering", len(built)) as done:
        for name, build in built.items():
            assumed[name] = noise
            if tune is not None:
                assumed[name] = _tuned(name, build, noise, log, tune_from, tune)
            judged[name] = judge(build(assumed[name]), log, horizons=HORIZONS, settling=late)
            if tune is not None:
                plain = replace(noise, disturbance=default_disturbance(model))
                untuned = judge(build(plain), log, horizons=HORIZONS, settling=late)
                if _worse(judged[name], untuned):
                    output.note(_of_tuning(name, assumed[name], plain, by_itself))
                    if by_itself:
                        assumed[name], judged[name] = plain, untuned
            if smooth:
                smoothed[name] = build(assumed[name]).smooth(log)
            done()
    _warn(judged)
    _warn_of_lost_control(log)
    if "adaptive" in judged:
        _warn_of_the_box(judged["adaptive"], built["adaptive"](), log)
    figure = plots.filter_figure
    after = {name: _after(estimate, log, late) for name, estimate in smoothed.items()}
    data = {
        "record": str(record),
        "bearing": model.name,
        "estimators": {
            name: judgement.to_dict()
            | {"disturbance_noise": assumed[name].disturbance}
            | ({"smoothed": after[name]} if smooth else {})
            for name, judgement in judged.items()
        },
    }
    output.deliver(
        data,
        _tables(judged, assumed, after, f"{record.name}, {len(log)} samples, {model.name}"),
        [
            (out, lambda path: _estimates(judged, smoothed).save(path)),
            (plot, lambda path: plots.save_figure(figure(log, judged, smoothed), path)),
        ],
        as_json=json,
    )


def _worse(tuned: Judgement, untuned: Judgement) -> bool:
    """Whether what a filter was not tuned on is less likely to it than to the untuned one."""
    from ambkit.workflow.tuning import log_likelihood

    first = len(tuned.estimate.t) - tuned.samples
    return log_likelihood(tuned.estimate, first) < log_likelihood(untuned.estimate, first)


def _of_tuning(name: str, tuned: FilterNoise, untuned: FilterNoise, by_itself: bool) -> str:
    then = (
        "so the untuned one is used, chosen by what it is judged on"
        if by_itself
        else "so the tuning is the first suspect"
    )
    return (
        f"{name}: tuned load noise, {tuned.disturbance:.3g} N^2/s, fits the rest of the record "
        f"worse than the untuned, {untuned.disturbance:.3g} N^2/s (the load moved otherwise "
        f"there), {then}; --disturbance-noise sets it, --tune another stretch"
    )


def _warn(judged: Mapping[str, Judgement]) -> None:
    """Say so where a filter and the record have nothing to do with each other."""
    from ambkit.cli import output

    for name, judgement in judged.items():
        if judgement.nis > ABSURD_NIS:
            output.note(
                f"{name}: innovations are {judgement.nis**0.5:.0f} times what the filter expects; "
                "are the units, the signs and the bearing those of this record?"
            )


def _warn_of_lost_control(log: Record) -> None:
    """Say so where nobody knows what acted on the rotor: the filters do not know that."""
    import numpy as np

    from ambkit.cli import output

    lost = ~np.isfinite(log["u"])
    if lost.any():
        edges = np.flatnonzero(np.diff(np.r_[False, lost, False])).reshape(-1, 2)
        output.note(
            f"the control signal is missing in {lost.sum()} of {lost.size} samples, at most "
            f"{np.ptp(edges, axis=1).max()} in a row: the filters hold the last one, and are less "
            "sure for a while than they say"
        )


def _warn_of_the_box(judgement: Judgement, adaptive: Estimator, log: Record) -> None:
    """Say so where the expert was asked beyond the box that it was trained for."""
    import numpy as np

    from ambkit.cli import output
    from ambkit.cli.output import value
    from ambkit.fuzzy.expert import Expert

    expert, b = adaptive.source, adaptive.bearing
    if not isinstance(expert, Expert):  # a force map goes on as the law does
        return
    box = expert.current_range, expert.displacement_range
    asked = np.clip(b.amplifier.gain * log["u"], b.current_min, b.current_max), judgement.estimate.x
    # The ends may be off by a rounding; what is missing is not outside.
    slack = [1e-9 * (high - low) for low, high in box]
    outside = [
        (at < low - s) | (at > high + s)
        for at, (low, high), s in zip(asked, box, slack, strict=True)
    ]
    share = float(np.mean(outside[0] | outside[1]))
    if share > OUTSIDE:
        within = [
            f"{value(low, unit, 3)} to {value(high, unit, 3)} ({100 * np.mean(out):.2g} %)"
            for out, (low, high), unit in zip(outside, box, "Am", strict=True)
        ]
        output.note(
            f"adaptive: {100 * share:.2g} % of the samples lie outside of the expert's box, "
            f"current {within[0]}, displacement {within[1]}; there it answers as at the edge: "
            "train it on a larger one"
        )


def _tuned(
    name: str, build: Factory, noise: FilterNoise, log: Record, start: float, stop: float
) -> FilterNoise:
    """Return the noise under which a stretch of a record [s] is most likely."""
    from dataclasses import replace

    from ambkit.cli import output
    from ambkit.workflow.tuning import tune_disturbance

    stretch = log.between(log.t[0] + start, log.t[0] + stop)
    tuned = tune_disturbance(
        build().bearing, stretch, lambda growth: build(replace(noise, disturbance=growth))
    )
    if tuned.why:
        output.note(f"{name}: {tuned.why}")
    return replace(noise, disturbance=tuned.growth)


def _after(estimate: Estimate, log: Record, settling: float) -> dict[str, Any]:
    """Return what is told of a smoothed estimate: its load, and its errors where truth is known."""
    import numpy as np

    from ambkit.judge.comparison import JUDGED

    late = log.t - log.t[0] >= settling
    return {
        "rmse": {
            name: float(np.sqrt(np.mean((estimate[name] - log[name])[late] ** 2)))
            for name in JUDGED
            if name in log.truth
        },
        "disturbance_mean": float(estimate.f_d[late].mean()),
        "disturbance_std": float(estimate.f_d[late].std()),
    }


def _estimates(judged: Mapping[str, Judgement], smoothed: Mapping[str, Estimate]) -> Record:
    """Return the estimates as one record; of several estimators, each signal carries the name."""
    from ambkit.data.record import Record

    records = {name: judgement.estimate.to_record() for name, judgement in judged.items()}
    records |= {f"{name}_smoothed": estimate.to_record() for name, estimate in smoothed.items()}
    if len(records) == 1:
        return next(iter(records.values()))
    signals = {f"{n}_{s}": r[s] for n, r in records.items() for s in r}
    units = {f"{n}_{s}": r.units[s] for n, r in records.items() for s in r}
    t = next(iter(records.values())).t
    return Record(t, signals, units, {"estimators": list(records)})


def _tables(
    judged: Mapping[str, Judgement],
    assumed: Mapping[str, FilterNoise],
    after: Mapping[str, Any],
    title: str,
) -> list[Any]:
    from ambkit.cli.output import table, value
    from ambkit.judge.comparison import JUDGED

    judgements = list(judged.values())

    def row(what: str, entry: Any) -> list[str]:
        return [what, *(entry(judgement) for judgement in judgements)]

    one = judgements[0]
    flags = list(dict.fromkeys(flag for j in judgements for flag in j.status))
    rows = [
        row("measurements used", lambda j: f"{j.used} of {j.samples}"),
        *(row(f"  status: {flag}", lambda j, f=flag: str(j.status.get(f, 0))) for flag in flags),
        row("innovation, mean", lambda j: value(j.innovation_mean, "m")),
        row("innovation, std", lambda j: value(j.innovation_std, "m")),
        row("  std that the filter expects", lambda j: value(j.expected_std or None, "m")),
        row("  mean NIS (1: consistent)", lambda j: "–" if j.nis != j.nis else f"{j.nis:.3f}"),
        row("  lags within 95 % bound", _white),
        row("load, mean", lambda j: value(j.disturbance_mean, "N")),
        row("load, std", lambda j: value(j.disturbance_std, "N")),
    ]
    rows += [
        row(f"error of {name}, rms", lambda j, n=name: value(j.rmse[n], JUDGED[n]))
        for name in one.rmse
    ]
    if after:
        spreads = (value(s["disturbance_std"], "N") for s in after.values())
        rows.append(["load, std, smoothed", *spreads])
        rows += [
            [f"error of {name}, rms, smoothed"]
            + [value(s["rmse"][name], JUDGED[name]) for s in after.values()]
            for name in one.rmse
        ]
    growths = [noise.disturbance for noise in assumed.values() if noise.disturbance is not None]
    if growths:
        rows.append(["load, noise assumed", *(f"{growth:.3g} N^2/s" for growth in growths)])
    headers = ["", *(f"{ahead} step{'s' * (ahead > 1)} ahead" for ahead in HORIZONS)]
    ways = {name: judgement.prediction for name, judgement in judged.items()}
    ways |= {"last measurement held": one.held, **one.logged}
    errors = [[name, *(value(way[ahead], "m") for ahead in HORIZONS)] for name, way in ways.items()]
    return [
        table(title, ["", *judged], rows),
        table("Error of the predicted measurement, rms", headers, errors),
    ]


def _white(judgement: Judgement) -> str:
    white = judgement.whiteness
    return f"{100 * white.share_within:.0f} %" if white else "too few"
