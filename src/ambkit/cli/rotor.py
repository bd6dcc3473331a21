"""``ambkit rotor``: what a whole machine's rotor does over its speed, in pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import PICTURES, Json, file_option, find_machine, quantity


def rotor(
    machine: Annotated[
        str, typer.Argument(metavar="MACHINE", help="A preset or a TOML file of a machine.")
    ],
    fastest: Annotated[
        float | None,
        typer.Option(
            parser=quantity("rad/s"),
            metavar="SPEED",
            help="Up to where; twice the machine's speed if not given.",
        ),
    ] = None,
    campbell: Annotated[
        Path | None, file_option("The Campbell diagram.", PICTURES, "--campbell")
    ] = None,
    modes: Annotated[
        Path | None,
        file_option("Bending modes, with magnets and sensors marked.", PICTURES, "--modes"),
    ] = None,
    unbalance: Annotated[
        Path | None, file_option("The unbalance response.", PICTURES, "--unbalance")
    ] = None,
    json: Json = False,
) -> None:
    """Compute modes and critical speeds of a rotor over its speed.

    Of the rotor on its controllers: Campbell diagram and critical speeds, bending modes, and the
    response to its unbalance.

    For example:
      ambkit rotor ufu_flexible --fastest "12000 rpm" --campbell campbell.png --modes modes.png
    """
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.campbell import campbell as campbell_of
    from ambkit.workflow.mode_shapes import mode_shapes
    from ambkit.workflow.reduction import reduction
    from ambkit.workflow.separation import sentence, separations
    from ambkit.workflow.unbalance_response import unbalance_response

    one = find_machine(machine)
    if one.rotor.type == "mass":
        raise AmbkitError(f"{machine}: its rotor is a mass that does not turn")
    if fastest is not None and not fastest > 0:
        raise AmbkitError(f"--fastest must be greater than 0, is {fastest:g} rad/s")
    found = campbell_of(one, fastest)
    apart, compared = separations(one), reduction(one)
    data: dict[str, Any] = found.to_dict() | {"separation": [each.to_dict() for each in apart]}
    if compared is not None:
        data["modes_left_out"] = compared.to_dict()
    shapes = None if one.bending is None and modes is None else mode_shapes(one)
    if shapes is not None:
        data["bending"] = shapes.to_dict()
    pictures: list[tuple[Path | None, Any]] = [
        (campbell, lambda path: plots.save_figure(found.figure(), path))
    ]
    if shapes is not None:
        pictures.append((modes, lambda path: plots.save_figure(shapes.figure(), path)))
    if unbalance is not None:
        response = unbalance_response(one, fastest)
        data["unbalance_response"] = response.to_dict()
        pictures.append((unbalance, lambda path: plots.save_figure(response.figure(), path)))
    said = [sentence(apart, one.speed)] if one.speed else []
    said += [compared.text()] if compared is not None else []
    output.deliver(data, [_table(data), *said], pictures, as_json=json)


def _table(data: dict[str, Any]) -> Any:
    from ambkit.base.units import engineering
    from ambkit.cli.output import table

    def rpm(speed: float) -> str:
        return engineering(speed * 30 / math.pi, "rpm", digits=4)

    def hertz(rate: float) -> str:
        creeps = rate < 1e-6 * data["fastest"]
        return "creeps" if creeps else engineering(rate / (2 * math.pi), "Hz", digits=4)

    end = rpm(data["fastest"])
    rows = [[mode["whirl"], *map(hertz, mode["frequency"])] for mode in data["modes"]]
    critical = ", ".join(map(rpm, data["critical"])) or f"none up to {end}"
    rows.append(["critical speeds", critical, ""])
    return table(f"Modes of {data['machine']}", ["whirl", "at rest", f"at {end}"], rows)
