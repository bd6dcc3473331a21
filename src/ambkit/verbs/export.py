"""Export to controllers and other tools."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.base.errors import AmbkitError
from ambkit.verbs.words import File, Filter, Folder, Frequency, Machine, Scenario, TableError

if TYPE_CHECKING:
    from ambkit.export.c import CExport, FilterCost
    from ambkit.result.result import Statement


def export_c(
    machine: Machine,
    filter: Filter | None = None,
    *,
    out: Folder,
    controller: Scenario | None = None,
    precision: Literal["float", "double"] = "float",
    prefix: str | None = None,
    table_error: TableError | None = None,
    editable: bool = False,
    add: Sequence[Literal["calibration", "telemetry", "faults"]] = (),
    force: bool = False,
) -> CExport:
    """Export a filter, or a controller with its filter, as C99.

    The folder has the C core of ambkit, the data of machine and filter, and a self-test.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name, or TOML file of a machine or a filter.
    filter : str or path, optional
        Kind (linear+unbalance also estimates the unbalance), filter file, or expert (.json) or
        force map (.csv) of the adaptive filter. By default as for `ambkit
        simulate`.
    out : str or path
        Output folder: new, empty, or of an older export.
    controller : Scenario, str or path, optional
        Scenario whose controller is exported with the filter: from measurements to coil currents.
    precision : {"float", "double"}, optional
        Precision.
    prefix : str, optional
        Prefix of the C names. By default the machine's name.
    table_error : float or str, optional
        Replace the expert's rules by a table with at most this force error [N]; auto chooses it.
    editable : bool, optional
        Let physical parameters be changed: derived numbers are computed on the controller.
    add : sequence of {"calibration", "telemetry", "faults"}, optional
        Calibration: noise, gate, mass, k and controller gains can be changed at run time.
        Telemetry: a ring buffer with states, innovations and status of each sample. Faults: the
        controller names its fault, as `ambkit diagnose` does.
    force : bool, optional
        Export even an inadequate filter.

    Returns
    -------
    CExport
        The files and their sources.

    Raises
    ------
    AmbkitError
        The filter is inadequate, the folder has other content, or options exclude each other.

    Examples
    --------
    $ ambkit export c zittau_axial --filter expert.json --out out/
    $ ambkit export c filter.toml --precision double --out out/
    $ ambkit export c filter.toml --controller scenario.toml --out out/
    $ ambkit export c tum_mlps --controller mlps.toml --out out/
    """
    from ambkit.arguments import filter_to_export, scenario_argument
    from ambkit.export import c
    from ambkit.workflow.diagnose import distinguished

    plant, estimator = filter_to_export(machine, filter, precision, table_error)
    return c.export_c(
        plant, estimator, out, prefix=prefix, editable=editable,
        scenario=scenario_argument(controller), calibrated="calibration" in add,
        telemetry="telemetry" in add,
        distinction=distinguished(plant, estimator) if "faults" in add else None, force=force,
    )  # fmt: skip


def export_cost(
    machine: Machine,
    filter: Filter | None = None,
    *,
    table_error: TableError | None = None,
    clock: Frequency = "168 MHz",
) -> FilterCost:
    """Report the cost of a filter on a Cortex-M4F.

    Instructions, flash and memory of the kinds of filter for an axis without lags and dead time, in
    single precision, measured in qemu. `ambkit pil` measures any controller.

    Parameters
    ----------
    machine, filter, table_error : optional
        As for `ambkit export c`.
    clock : float or str, optional
        Clock frequency [Hz].

    Returns
    -------
    FilterCost
        Cost of a step.

    Raises
    ------
    AmbkitError
        There is no measurement for this filter, or the clock is not positive.

    Examples
    --------
    $ ambkit export cost zittau_axial --filter extended
    """
    from ambkit.arguments import filter_to_export
    from ambkit.export import c

    return c.filter_cost(filter_to_export(machine, filter, table_error=table_error)[1], clock)


def export_fmu(
    machine: Machine,
    filter: Filter | None = None,
    *,
    out: File,
    kind: Literal[
        "estimator", "plant", "closed-loop", "controller", "whole-controller"
    ] = "estimator",
    scenario: Scenario | None = None,
    fmi: Literal[2, 3] = 3,
    precision: Literal["double", "float"] = "double",
    everywhere: bool = False,
    force: bool = False,
) -> Statement:
    """Export filter, plant, closed loop or controller as an FMU.

    The FMU has the C core as a binary for this platform, and its sources. A C compiler is required.

    Parameters
    ----------
    machine, filter, force : optional
        As for `ambkit export c`.
    out : str or path
        FMU to write (.fmu).
    kind : str, optional
        estimator, plant, closed-loop, controller, or whole-controller (with its filter).
    scenario : Scenario, str or path, optional
        Scenario with controller, lift-off and start; everything else is an input of the FMU.
    fmi : {2, 3}, optional
        FMI version.
    precision : {"double", "float"}, optional
        Precision of estimator and whole-controller; float equals the exported C.
    everywhere : bool, optional
        Also build for other platforms with an installed cross compiler.

    Returns
    -------
    Statement
        The file and its variables.

    Raises
    ------
    AmbkitError
        There is no compiler, the filter is inadequate, or the kind has no filter or scenario.

    Examples
    --------
    $ ambkit export fmu zittau_axial --filter expert.json --out filter.fmu
    $ ambkit export fmu zittau_axial --kind plant --fmi 2 --out plant.fmu
    $ ambkit export fmu zittau_axial --kind closed-loop --filter closed-law --out loop.fmu
    $ ambkit export fmu zittau_axial --kind whole-controller --scenario lqg.toml --out flown.fmu
    $ ambkit export fmu tum_mlps --out filter.fmu
    """
    from ambkit.arguments import filter_to_export, scenario_argument
    from ambkit.export import fmu

    if kind == "plant" and filter is not None:
        raise AmbkitError("filter is for the other kinds: a plant has none")
    if kind in ("estimator", "plant") and scenario is not None:
        raise AmbkitError(
            "scenario is for the kinds closed-loop, controller and whole-controller: only these "
            "have a controller"
        )
    return fmu.export_fmu(
        *filter_to_export(machine, filter, precision), out, kind=kind, fmi=fmi,
        scenario=scenario_argument(scenario), everywhere=everywhere, force=force,
    ).stated()  # fmt: skip


def export_ssp(
    machine: Machine,
    filter: Filter | None = None,
    *,
    out: File,
    scenario: Scenario | None = None,
    fmi: Literal[2, 3] = 2,
    force: bool = False,
) -> Statement:
    """Export plant, filter and controller as connected FMUs (SSP 1.0).

    With lift-off in the scenario, estimator and controller are one FMU. A C compiler is required.

    Parameters
    ----------
    machine, filter, scenario, fmi, force : optional
        As for `ambkit export fmu`.
    out : str or path
        System to write (.ssp).

    Returns
    -------
    Statement
        The file and its variables.

    Raises
    ------
    AmbkitError
        There is no compiler, or the filter is inadequate.

    Examples
    --------
    $ ambkit export ssp zittau_axial --filter closed-law --out loop.ssp
    """
    from ambkit.arguments import filter_to_export, scenario_argument
    from ambkit.export import fmu
    from ambkit.result.result import Statement

    made = fmu.export_ssp(
        *filter_to_export(machine, filter, "double"), out, fmi=fmi,
        scenario=scenario_argument(scenario), force=force,
    )  # fmt: skip
    fmus = {one.kind: list(one.variables) for one in made}
    return Statement(f"{out}: {len(made)} FMUs of FMI {fmi}.0.", {"path": str(out), "fmus": fmus})


def export_a2l(
    folder: Folder, *, elf: File, out: File, symbol: str = "calibration", force: bool = False
) -> Statement:
    """Write the A2L file (ASAP2 1.6) of an exported controller.

    The addresses are read from the firmware's ELF file; readelf is required.

    Parameters
    ----------
    folder : str or path
        Export with controller and calibration.
    elf : str or path
        Firmware linked with the export (ELF).
    out : str or path
        File to write (.a2l).
    symbol : str, optional
        Firmware variable of type amb_calibration.
    force : bool, optional
        Export even an inadequate filter.

    Returns
    -------
    Statement
        The file and the address of the variable.

    Raises
    ------
    AmbkitError
        The folder is not such an export, the firmware has no such variable, or readelf is missing.

    Examples
    --------
    $ ambkit export a2l rig/ --elf firmware.elf --symbol calibration --out rig.a2l
    """
    from pathlib import Path

    from ambkit.export import a2l
    from ambkit.result.result import Statement

    at = a2l.symbol(Path(elf), symbol)
    written = a2l.export_a2l(folder, elf, symbol, out, force=force)
    return Statement(
        f"{written}: {symbol} at 0x{at.address:08X}.", {"path": str(written), "address": at.address}
    )


def export_mat(
    machine: Machine, filter: Filter | None = None, *, out: File, force: bool = False
) -> Statement:
    """Export model, noise, stiffness tables and expert as a MAT-file.

    A, B, C, D, E, Q, R and P0 of the discrete model, and structs for MATLAB, in SI units. With
    several axes, tables.NAME and expert.NAME are those of an axis.

    Parameters
    ----------
    machine, force : optional
        As for `ambkit export c`.
    filter : str or path, optional
        File of a linear or adaptive filter (.toml), an expert (.json), or adaptive (trains one).
        Rules and tables of the expert are included.
    out : str or path
        MAT-file to write (.mat).

    Returns
    -------
    Statement
        The file and its variables.

    Raises
    ------
    AmbkitError
        The filter is of another kind, or inadequate.

    Examples
    --------
    $ ambkit export mat zittau_axial --filter expert.json --out axis.mat
    """
    from ambkit.arguments import filter_to_export
    from ambkit.export import mat
    from ambkit.result.result import Statement

    written = mat.export_mat(
        *filter_to_export(machine, filter, "double", choice=("linear", "adaptive")), out,
        force=force,
    )  # fmt: skip
    return Statement(
        f"{out}: {len(written)} variables.", {"path": str(out), "variables": list(written)}
    )
