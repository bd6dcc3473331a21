"""Processor in the loop: the exported C flies the simulated machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Filter, Machine, Scenario

if TYPE_CHECKING:
    from ambkit.export.pil.result import Pil


def pil(
    machine: Machine,
    filter: Filter | None = None,
    scenario: Scenario | None = None,
    *,
    board: str | None = None,
    force: bool = False,
) -> Pil:
    """Run the exported controller on a simulated machine, on a Cortex-M4F in qemu.

    What the sensors of the simulated plant show goes there, sample by sample. The result states
    whether all bits are Python's, instructions, stack, flash, memory, and how the rotor flew. Exit
    code 1 where bits differ. Needs gcc-arm-none-eabi and qemu-system-arm.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    filter : str or path, optional
        A kind, a filter's file, or an expert (.json) or force map (.csv) of the adaptive filter; by
        default linear.
    scenario : Scenario, str or path, optional
        What happens, and whose controller flies; by default a second with the rotor in the middle.
    board : str, optional
        Flash, memory and stack for a board: stm32f4, whose own build runs in qemu, amdc or c2000.
    force : bool, optional
        Export it also where it is judged that it must not fly.

    Returns
    -------
    Pil
        Rows, pictures and the flight as a record, which is what is written as .csv.

    Raises
    ------
    AmbkitError
        A tool is missing, or machine and filter cannot be exported.

    Examples
    --------
    $ ambkit pil zittau_axial
    $ ambkit pil filter.toml --scenario scenario.toml --board stm32f4 --out pil.html
    $ ambkit pil tum_mlps --scenario mlps.toml
    """
    from ambkit.assessment.arguments import export_arguments, scenario_argument
    from ambkit.export import pil as loop

    model, chosen = export_arguments(machine, filter)
    return loop.pil(
        model, chosen.magnet, scenario=scenario_argument(scenario), kind=chosen.kind,
        filter_file=chosen.file, board=board, force=force,
    )  # fmt: skip
