"""The workbench."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Machine

if TYPE_CHECKING:
    from ambkit.export.browser import Workbench


def workbench(machine: Machine | None = None, *, open: bool = False) -> Workbench:
    """Show an interactive simulation of a machine in the browser.

    The page needs neither a server nor a network, and computes with the C of ambkit: for the same
    seed its results are bit-identical to `ambkit simulate`. Notebooks display it inline.

    Parameters
    ----------
    machine : Machine, str or path, optional
        Preset name or TOML file: one axis, or a rigid or flexible rotor. By default all presets.
    open : bool, optional
        Open it in the browser.

    Returns
    -------
    Workbench
        The page.

    Raises
    ------
    AmbkitError
        The machine cannot be read, or is larger than the page takes.

    Examples
    --------
    $ ambkit workbench zittau_axial --out bench.html
    """
    from ambkit.arguments import machine_argument
    from ambkit.export.browser import workbench_of

    page = workbench_of(None if machine is None else machine_argument(machine))
    if open:
        page.open()
    return page
