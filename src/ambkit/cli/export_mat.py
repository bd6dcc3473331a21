"""``ambkit export mat``: model, noise, tables and expert as a MAT-file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import exported
from ambkit.cli.options import BearingName, Json, file_option, find_bearing


def export_mat(
    bearing: BearingName,
    out: Annotated[Path, file_option("The MAT-file to write.", (".mat",), "--out")],
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            metavar="FILE",
            help="Expert from 'ambkit train', or adaptive, which trains one: its rules, and its "
            "tables, go along.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write model, noise, stiffness tables and expert as a MAT-file.

    For MATLAB: A, B, C, D, E, Q, R, P0 of the discrete model, and structs, in SI units.

    For example:
      ambkit export mat zittau_axial --estimator expert.json --out bearing.mat
    """
    from ambkit.cli import output
    from ambkit.export import mat
    from ambkit.fuzzy.expert import Expert

    model = find_bearing(bearing)
    chosen = None if estimator is None else exported(estimator, model, ("adaptive",)).magnet
    if chosen is not None and not isinstance(chosen, Expert):
        raise AmbkitError(
            "--estimator: a MAT-file holds an expert; a force map goes into the bearing, as its "
            "force_map, and its tables along"
        )
    expert = chosen
    written = mat.export_mat(model, expert, out)
    output.deliver({"path": str(out), "variables": list(written)}, [], as_json=json)
    output.note(f"wrote {out}, {len(written)} variables")
