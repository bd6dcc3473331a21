"""``ambkit export fmu``: filter, plant or closed loop as a co-simulation FMU."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, estimator_option, to_export
from ambkit.cli.options import BearingOrFilter, Json, file_option

if TYPE_CHECKING:
    from ambkit.export.fmu.xml import Fmi


class Kind(StrEnum):
    """What the FMU models."""

    estimator = "estimator"
    plant = "plant"
    closed_loop = "closed-loop"


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
            help="Whose controller a closed loop has; the rest of a scenario is the FMU's inputs.",
        ),
    ] = None,
    fmi: Annotated[Version, typer.Option(help="Version of the FMI standard.")] = Version.three,
    json: Json = False,
) -> None:
    """Write filter, plant or closed loop as a co-simulation FMU.

    The library's own C in a binary for this platform, with its sources. Needs a C compiler.

    For example:
      ambkit export fmu zittau_axial --estimator expert.json --out filter.fmu
      ambkit export fmu zittau_axial --kind plant --fmi 2 --out plant.fmu
      ambkit export fmu zittau_axial --kind closed-loop --estimator closed-law --out loop.fmu
    """
    from ambkit.cli import output
    from ambkit.export import fmu
    from ambkit.simulation.scenario import Scenario

    if kind is Kind.plant and estimator is not None:
        raise AmbkitError("--estimator is for --kind estimator and closed-loop: a plant has none")
    if kind is not Kind.closed_loop and scenario is not None:
        raise AmbkitError("--scenario is for --kind closed-loop: only that has a controller")
    model, chosen = to_export(bearing, estimator)
    controller = None
    if scenario is not None:
        controller = Scenario.load(scenario).controller.completed(model)
    written = fmu.export_fmu(
        model,
        chosen.magnet,
        out,
        kind=kind.value,
        fmi=_VERSIONS[fmi],
        controller=controller,
        estimator=chosen.kind,
        filter_file=chosen.file,
    )
    data = {
        "path": str(written.path),
        "kind": written.kind,
        "fmi": f"{written.fmi}.0",
        "identifier": written.identifier,
        "token": written.token,
        "variables": list(written.variables),
    }
    output.deliver(data, [], as_json=json)
    output.note(f"wrote {written.path}, FMI {written.fmi}.0, {len(written.variables)} variables")
