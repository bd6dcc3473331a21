"""The report on an identification, in one HTML file, and the bearing with its uncertainties."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering, interval, typeset, with_error
from ambkit.machine.stiffness import work_points
from ambkit.result.report.blocks import (
    Block,
    Chapter,
    FigureBlock,
    Remark,
    Report,
    TableBlock,
    Text,
)
from ambkit.show.plots import maximum_likelihood as figures

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.identification.maximum_likelihood.loop_model import LoopModel
    from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
    from ambkit.identification.maximum_likelihood.validation import Validation
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine


def write_identification(
    path: str | os.PathLike[str],
    found: MaximumLikelihood,
    checks: Sequence[Validation],
    shown: Record,
) -> None:
    """Write the report as one HTML page that needs no net."""
    from ambkit.result.report.page import write_page

    write_page(identification_report(found, checks, shown), path)


def identification_report(
    found: MaximumLikelihood, checks: Sequence[Validation], shown: Record
) -> Report:
    """Put together what was found, how surely, and whether it holds on other records."""
    from importlib.metadata import version

    first = checks[0]
    prediction = figures.prediction_figure(found.model, shown, first.farthest, first.name)
    return Report(
        title=f"Identification of {found.bearing.name}",
        subtitle=f"{found.samples} measurements, {len(found.parameters)} parameters",
        lead="By maximum likelihood: the parameters under which the Kalman filter's innovations "
        "are least surprising. Errors are those of Fisher's information along the records.",
        version=version("ambkit"),
        chapters=[
            Chapter("found", "What was found", _found(found)),
            Chapter("stiffness", "Stiffness at work points", _stiffness(found)),
            Chapter(
                "holds",
                "Whether it holds",
                [
                    *(Remark(check.name, check.verdict) for check in checks),
                    _fits(checks),
                    FigureBlock(figures.fit_figure(checks)),
                    FigureBlock(prediction),
                    FigureBlock(figures.residual_figure(checks)),
                ],
            ),
        ],
    )


def annotated_toml(
    found: MaximumLikelihood,
    folder: str | os.PathLike[str] | None = None,
    machine: Machine | None = None,
) -> str:
    """Return the bearing as TOML, each value that was found with its standard error beside it."""
    # What is of the log and not of the bearing (offsets, load, a delay that cannot be told from
    # none) stands above in comments, with the lines of a channel map that take it out. Files that
    # it names are seen from `folder`, where it will lie.
    several = None if machine is None or machine.single else machine
    in_bearing = {"current_lag": ("amplifier", "bandwidth")}
    if found.delay_counts:
        in_bearing["delay"] = ("", "delay")
    places = {in_bearing.get(p.name, tuple(p.place.split("__"))): p for p in found.parameters}
    lines = [f"# Identified by maximum likelihood from {found.samples} measurements."]
    for p in found.parameters:
        of_log = "__" not in p.place and p.name not in in_bearing
        if of_log or several:
            of = "log" if of_log else f"axis {found.bearing.name}"
            lines.append(f"# Of the {of}: {p.name} = {_with_error(found, p.name)}.")
    lines += [f"# Not found: {name}: {why}." for name, why in found.held.items()]
    carried = carried_over(found.model, delay=not found.delay_counts, offsets=found.offsets_count)
    lines += [f"# {line}".rstrip() for line in carried]
    table = ""
    if several:
        return "\n".join(lines) + "\n" + several.to_toml(folder)
    for line in found.bearing.to_toml(folder).splitlines():
        if line.startswith("["):
            table = line.strip("[]")
        place = table, line.partition(" = ")[0]
        if place in places:
            p = places[place]
            error = engineering(found.standard_error(p.name), p.unit, 2, like=found[p.name])
            line += f"  # found, standard error {error}"
            if p.name == "current_lag":
                line += f" of its lag, {engineering(found[p.name], p.unit, 4)}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def carried_over(model: LoopModel, *, delay: bool = True, offsets: bool = True) -> list[str]:
    """Say how what is of the log gets into a channel map, and into ``ambkit filter``."""
    # With these lines a record is read as `LoopModel.corrected` gives it, but for the lag of the
    # current, which is the bearing's.
    volts = model.current_offset / model.bearing.amplifier.gain
    of_y = [f'offset = "{engineering(-model.position_offset, "m", 6)}"']
    of_u = [f'offset = "{engineering(volts, "V", 6)}"']
    if not (model.position_offset and offsets):
        of_y = []
    if not (volts and offsets):
        of_u = []
    if model.delay and delay:
        # Of u and not of y: what is held is averaged over the sample, y would be interpolated.
        of_u.append(f'delay = "{engineering(-model.delay, "s", 6)}"  # it acts later than logged')
    lines = []
    for name, those in zip(model.signals, (of_y, of_u), strict=True):
        if those:
            lines += [f"[signals.{name}]", *those]
    if lines:
        lines = [
            "To filter this log, put into its channel map (to an offset or a delay that is there, "
            "add):",
            *(f"  {line}" for line in lines),
        ]
    known = _known_to_filters(model.late_bearing(delay=not delay))
    if known:
        lines.append(f"{known} A map needs none.")
    growth = f"{model.load_growth:.4g} N^2/s"
    return [*lines, f'The load, as it wandered: ambkit filter ... --disturbance-noise "{growth}"']


def _known_to_filters(bearing: Bearing) -> str:
    """Say what of the loop is the bearing's, in a sentence; nothing where there is none."""
    known = [
        f"{what} of {engineering(value, unit, 4)}"
        for what, value, unit in (
            ("a delay", bearing.delay, "s"),
            ("an amplifier", bearing.amplifier.bandwidth, "Hz"),
        )
        if value is not None
    ]
    return f"The bearing has {' and '.join(known)}, which its filters know." if known else ""


def _with_error(found: MaximumLikelihood, name: str) -> str:
    p = next(p for p in found.parameters if p.name == name)
    error = engineering(found.standard_error(name), p.unit, 2, like=found[name])
    return f"{engineering(found[name], p.unit, 4)} (standard error {error})"


def _found(found: MaximumLikelihood) -> list[Block]:
    gain = found.log_likelihood - found.start_log_likelihood
    rows: list[list[str | float | None]] = []
    for p in found.parameters:
        at = found[p.name]
        errors = [found.standard_error(p.name, robust=robust) for robust in (False, True)]
        texts = (
            engineering(p.of(found.start), p.unit, 4, like=at),
            engineering(at, p.unit, 4),
            *(engineering(error, p.unit, 2, like=at) for error in errors),
            interval(*found.interval(p.name), p.unit, 4, like=at),
        )
        rows.append([f"{p.name.replace('_', ' ')} ${p.symbol}$", *map(typeset, texts)])
    blocks: list[Block] = [
        TableBlock(
            id="parameters",
            title="Parameters",
            headers=["", "start", "found", "standard error", "robust", "95 % interval"],
            rows=rows,
            caption="Robust: as the scores scatter over blocks (White 1982). The standard error is "
            "the larger of it and of what the likelihood's curvature says.",
        ),
        FigureBlock(figures.estimates_figure(found)),
        FigureBlock(figures.correlation_figure(found)),
    ]
    given = [
        f"- **{p.name}**: {engineering(found.model.known[p.name][0], p.unit, 3)} ± "
        f"{engineering(found.model.known[p.name][1], p.unit, 2)}; the records tell "
        f"{100 * found.told[i]:.0f} % of what the found value rests on."
        for i, p in enumerate(found.parameters)
        if p.name in found.model.known
    ]
    if given:
        blocks.append(Remark("Taken to be known beforehand", "\n".join(given)))
    if found.touched:
        blocks.append(Remark("Limits", "\n".join(f"- {said}." for said in found.touched)))
    if found.remarks:
        blocks.append(Remark("Records", "\n".join(f"- {said}." for said in found.remarks)))
    if found.held:
        said = "\n".join(f"- **{name}**: {why}." for name, why in found.held.items())
        blocks.append(Remark("Not found", said))
    known = _known_to_filters(found.bearing)
    if known:
        blocks.append(Remark("In the bearing", known))
    how = "ended at a maximum" if found.converged else "did not end at a maximum"
    blocks.append(
        Text(
            f"The search began from {found.begun_from} and {how} after {found.steps} steps; the "
            f"log likelihood rose by {gain:.1f}."
        )
    )
    return blocks


def _stiffness(found: MaximumLikelihood) -> list[Block]:
    points = work_points(found.bearing)
    blocks: list[Block] = []
    for name, (values, errors) in found.stiffness_map(*points).items():
        unit, shown = ("N/A", 1.0) if name == "k_i" else ("N/mm", 1e3)
        blocks.append(
            TableBlock(
                id=name,
                title=f"${name}$ [{unit}]",
                headers=["x", *(f"{_signed(iu)} A" for iu in points[0])],
                rows=[
                    [f"{_signed(1e3 * x)} mm", *map(_plus_minus, row / shown, error / shown)]
                    for x, row, error in zip(points[1], values, errors, strict=True)
                ],
                caption="Tangents of the law that was found, with their standard errors. Where the "
                "records have not been, they trust the law.",
            )
        )
    return blocks


def _signed(value: float) -> str:
    return f"{value:+.3g}".replace("-", "−") if value else "0"


def _plus_minus(value: float, error: float) -> str:
    return typeset(with_error(value, error))


def _fits(checks: Sequence[Validation]) -> TableBlock:
    rows: list[list[str | float | None]] = []
    for check in checks:
        k = check.farthest
        rows.append([
            markdown(check.name), check.fit[k], check.of_start.get(k), check.held[k],
            1e6 * check.error[k], 100 * check.residual.share_within,
            100 * check.cross.share_within, check.nis,
        ])  # fmt: skip
    k = checks[0].farthest
    return TableBlock(
        id="fits",
        title=f"Prediction {k} samples ahead, and residuals",
        headers=["record", "fit [%]", "start [%]", "held [%]", "error [µm rms]", "white lags [%]",
                 "free of control [%]", "mean NIS"],
        rows=rows,
        digits=["", ".2f", ".2f", ".2f", ".2f", ".0f", ".0f", ".2f"],
        caption="Right: 95 % of the lags within the bounds, and a mean NIS of 1.",
    )  # fmt: skip
