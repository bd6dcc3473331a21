"""``ambkit export mat``: model, noise, tables and expert as a MAT-file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import axis_to_export
from ambkit.cli.parameters import BearingOrFilter, Force, Json, file_option


def export_mat(
    bearing: BearingOrFilter,
    out: Annotated[Path, file_option("The MAT-file to write.", (".mat",), "--out")],
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            "--filter",
            metavar="FILE",
            help="A linear or adaptive filter's file (.toml), expert from 'ambkit train', or "
            "adaptive, which trains one: its rules, and its tables, go along.",
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write model, noise, stiffness tables and expert as a MAT-file.

    For MATLAB: A, B, C, D, E, Q, R, P0 of the discrete model, and structs, in SI units.

    For example:
      ambkit export mat zittau_axial --estimator expert.json --out bearing.mat
    """
    from ambkit.cli import printing
    from ambkit.export import mat
    from ambkit.fuzzy.expert import Expert

    model, result = axis_to_export(bearing, estimator, ("linear", "adaptive"))
    chosen = result.magnet if result.kind == "adaptive" else None
    if chosen is not None and not isinstance(chosen, Expert):
        raise AmbkitError(
            "--estimator: a MAT-file holds an expert; a force map goes into the bearing, as its "
            "force_map, and its tables along"
        )
    expert = chosen
    written = mat.export_mat(model, expert, out, filter_file=result.file, force=force)
    printing.deliver({"path": str(out), "variables": list(written)}, [], as_json=json)
    printing.note(f"wrote {out}, {len(written)} variables")
