"""Design: from a machine and its logs to exported C."""

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
    """Identify, tune, assess and export in one step.

    Writes machine.toml, scenario.toml (controllers), filter.toml, verdict.html, design.html (the
    filter to use, with reasons), c/ (the filter in C) and controller/ (filter and controllers). A
    design that was interrupted is resumed. Machines with several axes are not identified here: run
    `ambkit identify` first. The exit code is 1 if nothing was exported.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file; the prior of the identification.
    records : str, path or sequence of them, optional
        Closed-loop logs of any format. Without logs the filter is tuned in simulation.
    out : str or path
        Output folder.
    channels : str or path, optional
        Channel map of the logs (`ambkit read guess` proposes one).
    validate : sequence of str or path, optional
        Validation log.
    filter : str or sequence of str, optional
        Kind to try. By default linear, extended and adaptive.
    free : sequence of str, optional
        Parameter to identify. By default those usually identifiable.
    max_sensitivity : float, optional
        Limit of the sensitivity peak; 3 is the end of zone A, inf means no limit. If no filter
        keeps it, the one with the least error near the lowest peak is used.
    precision : {"float", "double"}, optional
        Precision of the C.
    prefix : str, optional
        Prefix of the C names. By default the machine's name.
    force : bool, optional
        Export even an inadequate filter or a loop outside zone A.
    seed : int, optional
        Random seed.

    Returns
    -------
    Design
        Results of each step, and the files.

    Raises
    ------
    AmbkitError
        As raised by identify, tune, assess and export.

    Examples
    --------
    $ ambkit design my.toml run.csv --out design/
    $ ambkit design my.toml log.mat --channels rig.toml --validate other.mat --out design/
    $ ambkit design tum_mlps --max-sensitivity 2 --out design/
    """
    import math

    from ambkit.arguments import machine_argument
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
