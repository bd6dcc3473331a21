"""What flies, for the controller and for other tools."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import File, Filter, Folder, Frequency, Machine, Scenario, TableError

if TYPE_CHECKING:
    from ambkit.export.c import CExport, FilterCost
    from ambkit.result.document import Statement


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
    calibration: bool = False,
    telemetry: bool = False,
    force: bool = False,
) -> CExport:
    """Write a filter as a folder of C99 that compiles alone.

    The library's own C, with the data of this machine and this filter.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    filter : str or path, optional
        A kind, linear+unbalance to estimate that too, a filter's file, or an expert (.json) or
        force map (.csv) of the adaptive filter; by default linear.
    out : str or path
        The folder to write: new, empty, or of an older export.
    controller : Scenario, str or path, optional
        Export the whole controller of this scenario: from readings to coil currents.
    precision : {"float", "double"}, optional
        Of its numbers.
    prefix : str, optional
        Of its names; by default the machine's name.
    table_error : float or str, optional
        Export a table in place of the expert's rules, which is no further off than this [N]; auto
        chooses it.
    editable : bool, optional
        Each number once in the data file; what follows is computed at init.
    calibration : bool, optional
        Noise, gate, mass, k and gains of a controller can be changed while it runs.
    telemetry : bool, optional
        Also a ring of frames: states, innovations and status of each sample.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    CExport
        The files, and what they were made from.

    Raises
    ------
    AmbkitError
        It must not fly, the folder holds something else, or the options contradict each other.

    Examples
    --------
    $ ambkit export c zittau_axial --filter expert.json --out out/
    $ ambkit export c filter.toml --precision double --out out/
    $ ambkit export c filter.toml --controller scenario.toml --out out/
    $ ambkit export c tum_mlps --controller mlps.toml --out out/
    """
    from ambkit.assessment.arguments import export_arguments, scenario_argument, table_options
    from ambkit.export import c

    model, chosen = export_arguments(machine, filter)
    return c.export_c(
        model, chosen.magnet, out, kind=chosen.kind, filter_file=chosen.file, precision=precision,
        prefix=prefix, editable=editable, scenario=scenario_argument(controller),
        calibrated=calibration, telemetry=telemetry, force=force,
        **table_options(table_error), **chosen.options,
    )  # fmt: skip


def export_cost(
    machine: Machine,
    filter: Filter | None = None,
    *,
    table_error: TableError | None = None,
    clock: Frequency = "168 MHz",
) -> FilterCost:
    """Report what a filter in C costs on a Cortex-M4F.

    Instructions, flash and memory, measured in qemu, in single precision; of a whole controller
    `ambkit pil` measures them.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    filter, table_error : optional
        As for `ambkit export c`.
    clock : float or str, optional
        Of the processor [Hz].

    Returns
    -------
    FilterCost
        What a step costs.

    Raises
    ------
    AmbkitError
        It was not measured of this filter, or the clock is not greater than 0.

    Examples
    --------
    $ ambkit export cost zittau_axial --filter extended
    """
    from ambkit.assessment.arguments import export_arguments, table_options
    from ambkit.export import c

    model, chosen = export_arguments(machine, filter)
    return c.filter_cost(
        model, chosen.magnet, kind=chosen.kind, filter_file=chosen.file, clock=clock,
        **table_options(table_error), **chosen.options,
    )  # fmt: skip


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
    """Write filter, plant, closed loop or controller as an FMU.

    The library's own C in a binary for this platform, with its sources. Needs a C compiler.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    filter : str or path, optional
        As for `ambkit export c`.
    out : str or path
        The FMU to write, .fmu.
    kind : str, optional
        What it models: estimator, plant, closed-loop, controller or whole-controller.
    scenario : Scenario, str or path, optional
        Whose controller, lift-off and start it has; the rest is the FMU's inputs.
    fmi : {2, 3}, optional
        Version of the FMI standard.
    precision : {"double", "float"}, optional
        Of estimator and whole controller: float is what flies.
    everywhere : bool, optional
        Also binaries of platforms that a cross compiler is here for.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    Statement
        What was written, with the names of its variables.

    Raises
    ------
    AmbkitError
        There is no compiler, it must not fly, or the kind has no such filter or scenario.

    Examples
    --------
    $ ambkit export fmu zittau_axial --filter expert.json --out filter.fmu
    $ ambkit export fmu zittau_axial --kind plant --fmi 2 --out plant.fmu
    $ ambkit export fmu zittau_axial --kind closed-loop --filter closed-law --out loop.fmu
    $ ambkit export fmu zittau_axial --kind whole-controller --scenario lqg.toml --out flown.fmu
    $ ambkit export fmu tum_mlps --out filter.fmu
    """
    from ambkit.assessment.arguments import export_arguments, scenario_argument
    from ambkit.base.errors import AmbkitError
    from ambkit.export import fmu

    if kind == "plant" and filter is not None:
        raise AmbkitError("filter is for the other kinds: a plant has none")
    if kind in ("estimator", "plant") and scenario is not None:
        raise AmbkitError(
            "scenario is for the kinds closed-loop, controller and whole-controller: only these "
            "have a controller"
        )
    model, chosen = export_arguments(machine, filter)
    if chosen.synchronous:
        raise AmbkitError(f"filter: {filter} is exported as C only; an FMU takes {chosen.kind}")
    return fmu.export_fmu(
        model, chosen.magnet, out, kind=kind, fmi=fmi, scenario=scenario_argument(scenario),
        filter=chosen.kind, filter_file=chosen.file, precision=precision, everywhere=everywhere,
        force=force,
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
    """Write plant, estimator and controller as three FMUs, wired: a system (SSP 1.0).

    With a scenario that lifts off, estimator and controller are one. Needs a C compiler.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter, with one axis.
    filter : str or path, optional
        As for `ambkit export c`.
    out : str or path
        The system to write, .ssp.
    scenario : Scenario, str or path, optional
        Whose controller and lift-off it has; what else happens is the system's inputs.
    fmi : {2, 3}, optional
        Version of the FMI standard.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    Statement
        What was written, with the names of the variables.

    Raises
    ------
    AmbkitError
        There is no compiler, it must not fly, or the machine has several axes.

    Examples
    --------
    $ ambkit export ssp zittau_axial --filter closed-law --out loop.ssp
    """
    from ambkit.assessment.arguments import axis_to_export, scenario_argument
    from ambkit.export import fmu
    from ambkit.result.document import Statement

    model, chosen = axis_to_export(machine, filter)
    made = fmu.export_ssp(
        model, chosen.magnet, out, fmi=fmi, scenario=scenario_argument(scenario),
        filter=chosen.kind, filter_file=chosen.file, force=force,
    )  # fmt: skip
    fmus = {one.kind: list(one.variables) for one in made}
    return Statement(f"{out}: {len(made)} FMUs of FMI {fmi}.0.", {"path": str(out), "fmus": fmus})


def export_a2l(
    folder: Folder, *, elf: File, out: File, symbol: str = "calibration", force: bool = False
) -> Statement:
    """Write an A2L file (ASAP2 1.6) for the calibration of an exported controller.

    The addresses are those of the firmware's ELF file. Needs readelf.

    Parameters
    ----------
    folder : str or path
        An export with a controller and with calibration.
    elf : str or path
        The firmware that was linked with it, ELF.
    out : str or path
        The file to write, .a2l.
    symbol : str, optional
        The firmware's variable of type amb_calibration.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    Statement
        What was written, with the address of the variable.

    Raises
    ------
    AmbkitError
        The folder is no such export, the firmware has no such variable, or readelf is missing.

    Examples
    --------
    $ ambkit export a2l rig/ --elf firmware.elf --symbol calibration --out rig.a2l
    """
    from pathlib import Path

    from ambkit.export import a2l
    from ambkit.result.document import Statement

    at = a2l.symbol(Path(elf), symbol)
    written = a2l.export_a2l(folder, elf, symbol, out, force=force)
    return Statement(
        f"{written}: {symbol} at 0x{at.address:08X}.",
        {"path": str(written), "address": at.address},
    )


def export_mat(
    machine: Machine, filter: Filter | None = None, *, out: File, force: bool = False
) -> Statement:
    """Write model, noise, stiffness tables and expert as a MAT-file.

    For MATLAB: A, B, C, D, E, Q, R, P0 of the discrete model, and structs, in SI units.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter, with one axis.
    filter : str or path, optional
        A linear or adaptive filter's file (.toml), an expert (.json), or adaptive, which trains
        one: its rules, and its tables, go along.
    out : str or path
        The MAT-file to write, .mat.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    Statement
        What was written, with the names of its variables.

    Raises
    ------
    AmbkitError
        The filter is of another kind, it must not fly, or the machine has several axes.

    Examples
    --------
    $ ambkit export mat zittau_axial --filter expert.json --out axis.mat
    """
    from ambkit.assessment.arguments import axis_to_export
    from ambkit.base.errors import AmbkitError
    from ambkit.export import mat
    from ambkit.fuzzy.expert import Expert
    from ambkit.result.document import Statement

    model, result = axis_to_export(machine, filter, ("linear", "adaptive"))
    chosen = result.magnet if result.kind == "adaptive" else None
    if chosen is not None and not isinstance(chosen, Expert):
        raise AmbkitError(
            "filter: a MAT-file holds an expert; a force map goes into the machine, as its "
            "force_map, and its tables along"
        )
    written = mat.export_mat(model, chosen, out, filter_file=result.file, force=force)
    return Statement(
        f"{out}: {len(written)} variables.", {"path": str(out), "variables": list(written)}
    )
