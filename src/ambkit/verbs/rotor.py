"""What the rotor of a machine does over its speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Machine, Speed

if TYPE_CHECKING:
    from ambkit.rotordynamics.campbell import Campbell
    from ambkit.rotordynamics.mode_shapes import ModeShapes
    from ambkit.rotordynamics.unbalance_response import UnbalanceResponse


def campbell(machine: Machine, fastest: Speed | None = None, *, count: int = 121) -> Campbell:
    """Compute modes and critical speeds of a rotor over its speed.

    The rotor is held by the proportional and derivative gains that a simulation has, as if sensors
    and amplifiers were at once and without dead time; a flexible rotor also by the filters of the
    derivatives. Separation margins after API 617 are those of the closed loop, with its sensors,
    amplifiers, dead time and default controllers.

    Parameters
    ----------
    machine : Machine, str or path
        With a rotor that turns: a preset's name, or a TOML file.
    fastest : float or str, optional
        Up to where [rad/s]; by default twice the machine's speed, or 1000 rad/s.
    count : int, optional
        Number of speeds, from rest on.

    Returns
    -------
    Campbell
        Modes, critical speeds and the Campbell diagram.

    Raises
    ------
    AmbkitError
        The rotor does not turn, `fastest` is not greater than 0, or `count` is less than 2.

    Examples
    --------
    $ ambkit rotor ufu_flexible --fastest "12000 rpm" --plot campbell.png
    """
    from ambkit.assessment.arguments import given_machine
    from ambkit.rotordynamics import campbell as of

    return of.campbell(given_machine(machine), fastest, count=count)


def mode_shapes(machine: Machine) -> ModeShapes:
    """Compute the bending modes of a free rotor, as far as its model keeps them.

    Parameters
    ----------
    machine : Machine, str or path
        With a flexible rotor: a preset's name, or a TOML file.

    Returns
    -------
    ModeShapes
        Frequencies, damping, and the shapes with magnets and sensors marked.

    Raises
    ------
    AmbkitError
        The rotor is rigid.

    Examples
    --------
    $ ambkit rotor modes ufu_flexible --plot modes.png
    """
    from ambkit.assessment.arguments import given_machine
    from ambkit.rotordynamics import mode_shapes as of

    return of.mode_shapes(given_machine(machine))


def unbalance_response(
    machine: Machine, fastest: Speed | None = None, *, count: int = 400
) -> UnbalanceResponse:
    """Compute the steady synchronous motion of a rotor on its controllers.

    By the linear model of the Campbell diagram.

    Parameters
    ----------
    machine : Machine, str or path
        With unbalance: a preset's name, or a TOML file.
    fastest, count : optional
        As for `ambkit rotor`.

    Returns
    -------
    UnbalanceResponse
        The amplitude along each axis over the speed.

    Raises
    ------
    AmbkitError
        The machine has no unbalance, or `fastest` is not greater than 0.

    Examples
    --------
    $ ambkit rotor unbalance tum_mlps --fastest "6000 rpm" --plot response.png
    """
    from ambkit.assessment.arguments import given_machine
    from ambkit.rotordynamics import unbalance_response as of

    return of.unbalance_response(given_machine(machine), fastest, count=count)
