"""``ambkit export fmu`` and ``ambkit export ssp``: co-simulation FMUs, one or three wired."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, axis_to_export, estimator_option, to_export
from ambkit.cli.parameters import BearingOrFilter, Force, Json, file_option

if TYPE_CHECKING:
    from ambkit.export.fmu.xml import Fmi


class Kind(StrEnum):
    """What the FMU models."""

    estimator = "estimator"
    plant = "plant"
    closed_loop = "closed-loop"
    controller = "controller"
    whole_controller = "whole-controller"


class Precision(StrEnum):
    """What it computes in."""

    double = "double"
    single = "float"


class Version(StrEnum):
    """Of the FMI standard."""

    two = "2"
    three = "3"


_VERSIONS: dict[Version, Fmi] = {Version.two: 2, Version.three: 3}


def export_fmu(
    bearing: BearingOrFilter,
    out: Annotated[Path, file_option("The FMU to write.", (".fmu",), "--out")],
    estimator: Annotated[str | None, estimator_option(NAMES)] = None,
    kind: Annotated[Kind, typer.Option(help="What it models.")] = Kind.estimator,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Whose controller, lift-off and start it has; the rest is the FMU's inputs.",
        ),
    ] = None,
    fmi: Annotated[Version, typer.Option(help="Version of the FMI standard.")] = Version.three,
    precision: Annotated[
        Precision, typer.Option(help="Of estimator and whole controller: float is what flies.")
    ] = Precision.double,
    everywhere: Annotated[
        bool,
        typer.Option(
            "--everywhere", help="Also binaries of platforms that a cross compiler is here for."
        ),
    ] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write filter, plant, closed loop or controller as an FMU.

    The library's own C in a binary for this platform, with its sources. Needs a C compiler.

    For example:
      ambkit export fmu zittau_axial --estimator expert.json --out filter.fmu
      ambkit export fmu zittau_axial --kind plant --fmi 2 --out plant.fmu
      ambkit export fmu zittau_axial --kind closed-loop --estimator closed-law --out loop.fmu
      ambkit export fmu zittau_axial --kind whole-controller --scenario lqg.toml --out flown.fmu
      ambkit export fmu tum_mlps --out filter.fmu
    """
    from ambkit.cli import printing
    from ambkit.export import fmu
    from ambkit.simulation.scenario import Scenario

    if kind is Kind.plant and estimator is not None:
        raise AmbkitError("--estimator is for the other kinds: a plant has none")
    if kind in (Kind.estimator, Kind.plant) and scenario is not None:
        raise AmbkitError(
            "--scenario is for --kind closed-loop, controller and whole-controller: only these "
            "have a controller"
        )
    model, chosen = to_export(bearing, estimator)
    written = fmu.export_fmu(
        model,
        chosen.magnet,
        out,
        kind=kind.value,
        fmi=_VERSIONS[fmi],
        scenario=None if scenario is None else Scenario.load(scenario),
        estimator=chosen.kind,
        filter_file=chosen.file,
        precision=precision.value,
        everywhere=everywhere,
        force=force,
    )
    data = {
        "path": str(written.path),
        "kind": written.kind,
        "fmi": f"{written.fmi}.0",
        "identifier": written.identifier,
        "token": written.token,
        "variables": list(written.variables),
    }
    printing.deliver(data, [], as_json=json)
    printing.note(f"wrote {written.path}, FMI {written.fmi}.0, {len(written.variables)} variables")


def export_ssp(
    bearing: BearingOrFilter,
    out: Annotated[Path, file_option("The system to write.", (".ssp",), "--out")],
    estimator: Annotated[str | None, estimator_option(NAMES)] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Whose controller and lift-off it has; what else happens is the system's inputs.",
        ),
    ] = None,
    fmi: Annotated[Version, typer.Option(help="Version of the FMI standard.")] = Version.two,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write plant, estimator and controller as three FMUs, wired: a system (SSP 1.0).

    With a scenario that lifts off, estimator and controller are one. Needs a C compiler.

    For example:
      ambkit export ssp zittau_axial --estimator closed-law --out loop.ssp
    """
    from ambkit.cli import printing
    from ambkit.export import fmu
    from ambkit.simulation.scenario import Scenario

    model, chosen = axis_to_export(bearing, estimator)
    made = fmu.export_ssp(
        model,
        chosen.magnet,
        out,
        fmi=_VERSIONS[fmi],
        scenario=None if scenario is None else Scenario.load(scenario),
        estimator=chosen.kind,
        filter_file=chosen.file,
        force=force,
    )
    data = {"path": str(out), "fmus": {one.kind: list(one.variables) for one in made}}
    printing.deliver(data, [], as_json=json)
    printing.note(f"wrote {out}, {len(made)} FMUs of FMI {fmi.value}.0")
