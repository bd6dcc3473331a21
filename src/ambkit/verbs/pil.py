"""Processor in the loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Filter, Machine, Scenario

if TYPE_CHECKING:
    from ambkit.export.pil.loop import Pil


def pil(
    machine: Machine,
    filter: Filter | None = None,
    scenario: Scenario | None = None,
    *,
    board: str | None = None,
    force: bool = False,
) -> Pil:
    """Run the exported controller on an emulated Cortex-M4F.

    The plant is simulated; the controller runs in qemu, sample by sample. The result compares every
    bit with the simulation, and lists instructions, stack, flash and memory. The exit code is 1 if
    bits differ. gcc-arm-none-eabi and qemu-system-arm are required.

    Parameters
    ----------
    machine, filter, force : optional
        As for `ambkit export c`.
    scenario : Scenario, str or path, optional
        Scenario and its controller. By default 1 s with the rotor centred.
    board : str, optional
        Report flash, memory and stack for this board: stm32f4 (its build runs in qemu), amdc or
        c2000.

    Returns
    -------
    Pil
        Rows, figures, and the run as a record (.csv).

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
    from ambkit.arguments import filter_to_export, scenario_argument
    from ambkit.export import pil as loop

    return loop.pil(
        *filter_to_export(machine, filter), scenario=scenario_argument(scenario), board=board,
        force=force,
    )  # fmt: skip
