"""The magnet from its drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Drawing

if TYPE_CHECKING:
    from ambkit.machine.magnet_solution.solution import MagnetSolution


def magnet(drawing: Drawing, both_axes: bool = False) -> MagnetSolution:
    """Solve the field of a magnet from its drawing.

    Nonlinear finite elements give the force over control current and displacement, flux linkage,
    stiffnesses and limits. A machine whose [magnet] has force_map = "drawing.toml" takes the same
    map. Solved maps are kept in the user's cache.

    Parameters
    ----------
    drawing : str or path
        TOML file with [geometry], [winding] and [iron].
    both_axes : bool
        Solve a radial bearing over the currents and displacements of both axes, too.

    Returns
    -------
    MagnetSolution
        Stiffnesses, load capacity, slew rate, coupling, errors of fitted force laws, and pictures
        of the field, the flux density along the gap, and the map.

    Raises
    ------
    AmbkitError
        Outlines overlap or do not close, or a value is out of range.

    Examples
    --------
    $ ambkit magnet drawing.toml --out map.csv --plot field.png
    """
    from ambkit.machine.forces.drawing import load_drawing
    from ambkit.machine.magnet_solution.solution import solve

    return solve(load_drawing(drawing), both_axes)
