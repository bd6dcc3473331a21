"""``ambkit excite``: the experiment that identifies a bearing, and what it will tell."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.excite_sensitivity import DURATION, deliver_injections
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import (
    RECORDS,
    BearingName,
    Json,
    Plot,
    file_option,
    find_machine,
    isolated,
    quantity,
    read_quantities,
)

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine


class Purpose(StrEnum):
    """What an experiment is for."""

    parameters = "parameters"
    sensitivity = "sensitivity"


def excite(
    bearing: BearingName,
    purpose: Annotated[
        Purpose,
        typer.Option(
            "--for",
            help="What is to be found: parameters of the bearing, by its reference; or the "
            "sensitivity of its loop, by a signal that is added to its measurement.",
        ),
    ] = Purpose.parameters,
    kind: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="multisine, prbs or stepped-sine; for sensitivity always a multisine.",
            show_default="stepped-sine",
        ),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What is to be identified: magnet_constant,air_gap,...; as for 'ambkit identify'.",
        ),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml", help="Controller, duration and disturbance; else one is tuned."
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(parser=quantity("s"), metavar="TIME", help='Such as "2 s".')
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(
            metavar="FROM,TO", help='Frequencies: "5 Hz,100 Hz"; else the best are found.'
        ),
    ] = None,
    limit_current: Annotated[
        float | None,
        typer.Option(
            parser=quantity("A"),
            metavar="CURRENT",
            help="Greatest control current; else 80 % of what it can be.",
        ),
    ] = None,
    limit_displacement: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="LENGTH",
            help="Greatest displacement from the centre; else half of the travel, and for "
            "sensitivity a twentieth of the air gap beyond where it is held.",
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"),
            metavar="FORCE",
            help="By how much the load wanders in a second, rms; else 1 % of the weight.",
        ),
    ] = None,
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            "--filter",
            callback=lambda text: text if text in (None, "none") else known(text),
            metavar="NAME",
            help=f"For sensitivity, whose estimate feeds the controller: none, {', '.join(NAMES)}, "
            "or a filter's file (.toml).",
            show_default="linear; of a machine none",
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Of several axes, whose parameters are asked for; or at which a signal is added, "
            "one experiment each, or all.",
            show_default="for sensitivity that which decides the zone",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, metavar="N", help="Seed of the noise.")] = None,
    out: Annotated[
        Path | None,
        file_option(
            "Write the reference, t and r, or t and injected: .csv or .parquet.", RECORDS, "--out"
        ),
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Design an experiment and predict the errors of its results.

    An excitation for the reference of the controller, as large as the limits on current and
    displacement allow in the simulated loop, in the band that tells most; and the standard errors
    that identification will have from it.

    For example:
      ambkit excite my.toml --duration "1 s" --out excitation.csv --plot excitation.png
      ambkit simulate my.toml --reference excitation.csv --out run.csv
      ambkit excite my.toml --for sensitivity --out injection.csv
      ambkit simulate my.toml --injection injection.csv --out injected.csv
      ambkit assess log injected.csv --machine my.toml
      ambkit excite tum_mlps --axis A1 --out excitation.csv
      ambkit excite tum_mlps --for sensitivity --axis all --out injection.csv
    """
    from ambkit.cli import output
    from ambkit.identification.excitation import Limits, design
    from ambkit.workflow.injecting import design_injection
    from ambkit.workflow.simulating import experiment_duration, scenario_for

    machine, ends = find_machine(bearing), _ends(band)
    only = {"--kind": kind, "--parameters": parameters, "--load": load}
    if purpose is Purpose.parameters:
        only = {"--estimator": estimator}
    for option, given in only.items():
        if given is not None:
            raise AmbkitError(f"{option} is not for --for {purpose.value}")
    said: dict[str, Any] = {"seed": seed, "from_estimate": estimator != "none"}
    if purpose is Purpose.sensitivity:
        duration = duration or (DURATION if scenario is None else None)
        happening = scenario_for(machine, scenario, duration=duration, **said)
        if not machine.single and estimator is not None:
            fed = "measurement" if estimator == "none" else "estimate"
            happening = happening.replace(feedback=fed)
        with output.progress("trying amplitudes"):
            injections = [
                design_injection(
                    machine, happening, None if estimator == "none" else estimator, axis=at,
                    current=limit_current, displacement=limit_displacement, band=ends,
                )
                for at in _axes(machine, axis)
            ]  # fmt: skip
        deliver_injections(injections, out, plot, json)
        return
    plant = isolated(machine, axis)
    if duration is None and scenario is None:
        duration = experiment_duration(plant)
    happening = scenario_for(plant, scenario, duration=duration, **said)
    free = [part.strip() for part in parameters.split(",")] if parameters else None
    with output.progress("comparing bands") as step:
        found = design(
            plant,
            happening,
            kind=kind or "stepped-sine",
            free=free,
            limits=Limits.of(plant, limit_current, limit_displacement),
            band=ends,
            load=load,
            done=lambda text: step(f"comparing bands: {text}"),
        )
    reference = (out, found.file(axis or "").save)
    output.deliver_result(found, [reference], as_json=json, plot=plot)


def _axes(machine: Machine, named: str | None) -> list[str | None]:
    """Return at which axes a signal is added; None: at that which decides the zone."""
    from ambkit.machine.axes import axis_named

    if named == "all":
        return [each.name for each in machine.axes]
    return [None] if named is None else [axis_named(machine, one) for one in names(named)]


def _ends(band: str | None) -> tuple[float, float] | None:
    if band is None:
        return None
    low, high = read_quantities(band, "Hz", "--band", count=2)
    return low, high
