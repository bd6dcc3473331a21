"""Design: from what is known of a machine, and its records, to what flies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Filters, Folder, Log, Machine, MapFile

if TYPE_CHECKING:
    from ambkit.workflow.designed import Design


def design(
    machine: Machine,
    records: Log | Sequence[Log] = (),
    *,
    out: Folder,
    channels: MapFile | None = None,
    validate: Sequence[Log] = (),
    filter: Filters | None = None,
    free: Sequence[str] | None = None,
    max_sensitivity: float = 3.0,
    precision: Literal["float", "double"] = "float",
    prefix: str | None = None,
    force: bool = False,
    seed: int = 0,
) -> Design:
    """Design controller and filter from logs: identify, tune, assess, export.

    A machine with one axis is identified from its logs; of several `ambkit identify` comes before.
    Controllers are chosen on the margins of the loop, and a filter is tuned in it. The folder gets
    machine.toml, scenario.toml with the controllers, filter.toml, verdict.html, design.html, which
    says which filter to fly and why, the filter as C in c/, and with its controllers in
    controller/. A second call goes on where the first was interrupted. Exit code 1 where nothing
    was exported.

    Parameters
    ----------
    machine : Machine, str or path
        What is known already: a preset's name, or a TOML file.
    records : str, path or sequence of them, optional
        Closed-loop runs, in any format. Without any the filter is tuned on simulated runs.
    out : str or path
        The folder for all of it; an older design goes on.
    channels : str or path, optional
        Channel map of the records; `ambkit read guess` proposes one.
    validate : sequence of str or path, optional
        Judge by this record. May be repeated.
    filter : str or sequence of str, optional
        Kinds that are tried. May be repeated. By default linear, extended and adaptive.
    free : sequence of str, optional
        What is identified. May be repeated. By default what a record usually tells.
    max_sensitivity : float, optional
        Limit of the peak of |S| in the loop, 3 is the end of zone A; inf: no limit.
    precision : {"float", "double"}, optional
        Of the exported C.
    prefix : str, optional
        Of the C's names; by default the machine's name.
    force : bool, optional
        Export also what is worse than the raw sensor, far from the bound, out of zone A, or what
        must not fly.
    seed : int, optional
        Random seed.

    Returns
    -------
    Design
        Rows and what was made.

    Raises
    ------
    AmbkitError
        As the stages: identify, tune, assess, export.

    Examples
    --------
    $ ambkit design my.toml run.csv --out design/
    $ ambkit design my.toml log.mat --channels rig.toml --validate other.mat --out design/
    $ ambkit design tum_mlps --max-sensitivity 2 --out design/
    """
    import math

    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.base.quantity_arguments import names_in
    from ambkit.workflow import design

    with progress("designing") as done:
        return design.design(
            machine_argument(machine), names_in(records=records), out, channels=channels,
            validate=validate, kinds=None if filter is None else names_in(filter=filter), free=free,
            max_sensitivity=max_sensitivity if math.isfinite(max_sensitivity) else None,
            precision=precision, prefix=prefix, anyway=force, seed=seed, note=done,
        )  # fmt: skip
