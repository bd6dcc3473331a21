"""From a bearing and what its filter knows of its magnet to a folder of C."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.registry import KINDS
from ambkit.export.c import calibration, cost, data_file, folder, render
from ambkit.export.c.cost import CLOCK, CYCLES_PER_INSTRUCTION, Cost
from ambkit.export.c.data import CPrecision, called
from ambkit.export.c.prefix import checked
from ambkit.export.tabulate import MOST_NODES, TabulatedExpert, tabulate
from ambkit.fuzzy.expert import Expert
from ambkit.judge.adequacy import require_adequate
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.magnets import MagnetModel
    from ambkit.simulation.control import Controller
    from ambkit.simulation.flight import Flight
    from ambkit.simulation.scenario import Scenario

MOST_COUNTED = 65535
"""What an unsigned int of 16 bits holds, as a TI C2000 has."""

_CORE_PRECISION: dict[CPrecision, Precision] = {"float": "float32", "double": "float64"}


@dataclass(frozen=True)
class CExport:
    """What was written.

    Attributes
    ----------
    folder : Path
        Where.
    name : str
        Prefix of all its names.
    precision : {"float", "double"}
        Of its numbers.
    files : tuple of str
        Its files, relative to the folder, in alphabetical order.
    sources : tuple of str
        Those that a controller compiles.
    configuration : str
        Hash of all that the estimator was made from.
    table : TabulatedExpert or None
        The table, where the expert is tabulated: its nodes, bound and error.
    cost : Cost or None
        What it costs on a Cortex-M4F, which computes in float and not in double; None also where
        that was not measured: a kind with another magnet than its own.
    """

    folder: Path
    name: str
    precision: CPrecision
    files: tuple[str, ...]
    sources: tuple[str, ...]
    configuration: str
    table: TabulatedExpert | None
    cost: Cost | None


def export_c(
    bearing: Bearing | Machine,
    magnet: MagnetModel | None,
    out: str | Path,
    *,
    kind: str | None = None,
    precision: CPrecision = "float",
    prefix: str | None = None,
    expert_form: Literal["exact", "tabulated"] = "exact",
    force_bound: float | None = None,
    loops: bool | None = None,
    filter_file: FilterFile | None = None,
    editable: bool = False,
    scenario: Scenario | None = None,
    flight: Flight | None = None,
    calibrated: bool = False,
    telemetry: bool = False,
    force: bool = False,
    **options: Any,
) -> CExport:
    """Write a folder of C99 that compiles alone.

    Parameters
    ----------
    bearing : Bearing or Machine
        What is filtered; of a machine, readings and control signals are arrays.
    magnet : Expert, StiffnessMap, ClosedLaw, ConstantStiffness or None
        What the filter asks for k_i and k_s; None exports the linear filter.
    out : path
        The folder: new, empty, or with an older export, which is replaced; what else lies beside
        that is not touched.
    kind : str, optional
        Of estimator, by its name in ``ambkit.estimate.registry.KINDS``, such as ``"extended"``;
        by default the paper's filter, linear or adaptive by its magnet.
    precision : {"float", "double"}
        Of the exported numbers.
    prefix : str, optional
        Of all its names; by default the bearing's name.
    expert_form : {"exact", "tabulated"}
        The expert as it is, or as a table, bilinear between its nodes.
    force_bound : float, optional
        How far the table's force may be from the expert's [N]; by default 0.1 % of its largest.
    loops : bool, optional
        Whether the model is computed by loops over its arrays and not by straight-line code; by
        default from more than a dozen states on. The paper's axis has none.
    filter_file : FilterFile, optional
        The filter, in the place of `kind` and `options`; `magnet` is what it says, and `bearing`
        what it is to fly on. Its inputs are then the rig's own numbers.
    editable : bool
        Whether each number stands once in the data file, where it can be edited, and what follows
        from it is computed at init into the state: more memory and flash. Of the paper's axis.
    scenario : Scenario, optional
        Whose controller is exported with the estimator, lift-off and landing: the whole of what
        flies, from readings to currents; what the scenario's sequence does not say is as usual. Of
        one axis.
    flight : Flight, optional
        Of a whole machine: its controllers are written too, and estimator and controllers together
        as one step from readings to currents, equal to the last bit to what the simulation flies.
    calibrated : bool
        Whether noise, gate, mass, magnet constant and gains of a scenario's controller can be
        changed while it runs. Of one axis.
    telemetry : bool
        Whether a small ring of frames is written too: states, innovations and status of each
        sample, which :func:`ambkit.read_telemetry` reads as they were sent.
    force : bool
        Export it also where it is judged that it must not fly.
    **options
        Of the kind; of :class:`ambkit.KalmanFilter` noise, gravity, frozen_limit, gate,
        outlier_limit, as_printed.

    Raises
    ------
    AmbkitError
        A filter that must not fly, without `force`.
        A kind or a model that cannot be exported so, a prefix that is no C identifier or taken,
        a limit or a table beyond 16 bits; a bound that no table keeps, or that nothing needs;
        a folder with other files, or that cannot be written.
    """
    flown_on, bearing = bearing, bearing if filter_file is None else filter_file.plant
    name = checked(prefix, bearing.name)
    for limit in ("frozen_limit", "outlier_limit"):
        if options.get(limit, 0) > MOST_COUNTED:
            raise AmbkitError(
                f"{limit} must be at most {MOST_COUNTED}, what an unsigned int holds everywhere; "
                f"is {options[limit]}"
            )
    options["precision"] = _CORE_PRECISION[precision]
    table = None
    if expert_form == "tabulated":
        if not isinstance(magnet, Expert) or isinstance(bearing, Machine):
            raise AmbkitError(
                "only an expert can be tabulated, and of one axis; give one, or export the exact "
                "form"
            )
        table = tabulate(magnet, bearing, bound=force_bound, precision=options["precision"])
        magnet = table
    elif force_bound is not None:
        raise AmbkitError("force_bound is for an expert in tabulated form")
    estimator = made(kind, bearing, magnet, filter_file, options)
    wrong = require_adequate(estimator, flown_on, scenario or flight, force=force)
    _check_nodes(estimator)
    spent = cost.of(estimator) if precision == "float" and not editable else None
    controller = None
    if scenario is not None:
        controller, spent = _controller(estimator, scenario, editable=editable), None
    if calibrated:
        if isinstance(bearing, Machine):
            raise AmbkitError(
                f"{bearing.name}: calibration is of the whole controller of one axis; "
                "this is a machine"
            )
        if controller is None:
            raise AmbkitError("calibration is for a whole controller; give a scenario")
        calibration.check(controller)
    facts = _facts(magnet, precision) | _cost_facts(spent)
    if wrong:
        facts = {"MUST NOT FLY": "; ".join(wrong)} | facts
    if estimator.description:
        facts = {"for": estimator.description} | facts
    content = render.render(
        estimator,
        name,
        precision,
        facts,
        loops=loops,
        editable=editable,
        controller=controller,
        flight=flight,
        calibrated=calibrated,
        framed=telemetry,
    )
    if wrong and calibrated:  # which an A2L file is made from later
        told = json.loads(content.files["calibration.json"]) | {"must_not_fly": wrong}
        content.files["calibration.json"] = json.dumps(told, indent=2) + "\n"
    written = folder.write(Path(out), content.files)
    return CExport(
        written,
        name,
        precision,
        tuple(content.files),
        content.sources,
        content.configuration,
        table,
        spent,
    )


def made(
    kind: str | None,
    bearing: Bearing | Machine,
    magnet: MagnetModel | None,
    filter_file: FilterFile | None,
    options: dict[str, Any],
) -> Estimator:
    """Return the estimator that is exported.

    Parameters
    ----------
    kind : str or None
        See `export_c`.
    bearing : Bearing or Machine
        What is filtered.
    magnet : optional
        What it asks of its magnet.
    filter_file : FilterFile or None
        The filter, in the place of `kind` and all options but the ``precision``.
    options : dict
        Of the kind.

    Raises
    ------
    AmbkitError
        There is no such kind, or it is of one axis, or is more than the core has room for.
    """
    if filter_file is not None:
        estimator = filter_file.make(precision=options["precision"], magnet=magnet)
        called(estimator)
        return estimator
    if kind is None:
        kind = "linear" if magnet is None else "adaptive"
    if not isinstance(kind, str) or kind not in KINDS:
        raise AmbkitError(f'there is no kind of estimator "{kind}"; known: {", ".join(KINDS)}')
    try:
        estimator = KINDS[kind].make(bearing, magnet, **options)
    except ValueError as error:  # a kind of one axis, or more than the core has room for
        raise AmbkitError(str(error)) from error
    called(estimator)
    return estimator


def _controller(estimator: Estimator, scenario: Scenario, *, editable: bool) -> Controller:
    from ambkit.simulation.control import Controller
    from ambkit.simulation.sequence import LiftOff

    bearing = estimator.bearing
    if isinstance(bearing, Machine):
        raise AmbkitError(
            f"{bearing.name}: the whole controller is exported of one axis; this is a machine"
        )
    if editable:
        raise AmbkitError("editable is for a filter alone, and not for the whole controller")
    pid = scenario.controller.completed(bearing)
    return Controller(bearing, estimator, pid, scenario.sequence or LiftOff())


def _facts(magnet: MagnetModel | None, precision: CPrecision) -> dict[str, str]:
    """Return what the README says of the filter, line by line."""
    facts: dict[str, str] = {"numbers": precision}
    if isinstance(magnet, Expert):
        facts["expert"] = f"{len(magnet.rules)} rules, from {magnet.source}"
    elif isinstance(magnet, TabulatedExpert):
        rows, columns = magnet.k_i.shape
        facts |= {
            "table": f"{rows} x {columns} nodes, displacement x current",
            "bound on its force error": engineering(magnet.bound, "N"),
            "largest error found": engineering(magnet.error, "N", digits=3),
        }
    return facts


def _check_nodes(estimator: Estimator) -> None:
    """Refuse a table whose nodes an int of 16 bits cannot count."""
    for magnet in data_file.magnets_of(estimator):
        rows, columns = (magnet.parameters.get(key, 0) for key in ("rows", "columns"))
        if rows * columns > MOST_NODES:
            raise AmbkitError(
                f"the table has {rows} x {columns} nodes, and an int of 16 bits counts at most "
                f"{MOST_NODES}; take a coarser one"
            )


def _cost_facts(spent: Cost | None) -> dict[str, str]:
    """Return what the README says of the cost."""
    if spent is None:
        return {}
    facts = {
        "instructions a step (Cortex-M4F, in qemu)": (
            f"{spent.instructions}, the most seen {spent.most}; on no path more than {spent.bound}"
        )
    }
    if spent.trusted is not None:
        facts["of the step that trusts its input"] = f"{spent.trusted}"
    if spent.selftest is not None:
        time = 1e3 * spent.selftest * CYCLES_PER_INSTRUCTION / CLOCK
        facts["self-test (Cortex-M4F, in qemu)"] = (
            f"about {spent.selftest / 1e6:.1f} million instructions: at 168 MHz, without wait "
            f"states, {time:.0f} ms"
        )
    return facts | {
        "flash": (
            f"{spent.code} bytes of code, {spent.constants} bytes of constants, by {spent.compiler}"
        ),
        "memory": f"{spent.state} bytes an instance, {spent.stack} bytes of stack seen",
    }
