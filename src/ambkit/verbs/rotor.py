"""What the rotor of a machine does over its speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Frequency, Machine, Record, Speed, Time

if TYPE_CHECKING:
    from ambkit.rotordynamics.campbell import Campbell
    from ambkit.rotordynamics.mode_shapes import ModeShapes
    from ambkit.rotordynamics.spectrogram import Waterfall
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
    from ambkit.assessment.arguments import machine_argument
    from ambkit.rotordynamics import campbell as of

    return of.campbell(machine_argument(machine), fastest, count=count)


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
    from ambkit.assessment.arguments import machine_argument
    from ambkit.rotordynamics import mode_shapes as of

    return of.mode_shapes(machine_argument(machine))


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
    from ambkit.assessment.arguments import machine_argument
    from ambkit.rotordynamics import unbalance_response as of

    return of.unbalance_response(machine_argument(machine), fastest, count=count)


def waterfall(
    record: Record,
    signal: str | None = None,
    *,
    window: Time | None = None,
    highest: Frequency | None = None,
) -> Waterfall:
    """Compute the spectrum of a rotor's motion over a run.

    Hann windows that overlap by three quarters; a line of a steady sine is as high as the sine.

    Parameters
    ----------
    record : Record, str or path
        With the signal, and the speed of rotation, as `ambkit simulate` writes it.
    signal : str, optional
        Such as s_A1; by default the displacement of the first axis.
    window : float or str, optional
        Length of a stretch [s]: longer tells frequencies apart better, shorter times. By default
        0.1 s, or a quarter of a short record.
    highest : float or str, optional
        Highest frequency [Hz]; by default four times the greatest speed, and 100 Hz at least.

    Returns
    -------
    Waterfall
        Amplitude spectra of stretches of the run.

    Raises
    ------
    AmbkitError
        The record has no such signal, or no speed of rotation.
    ValueError
        The window is not within the record's length and eight samples.

    Examples
    --------
    $ ambkit rotor waterfall run.csv --plot waterfall.png
    """
    from ambkit.assessment.arguments import record_argument
    from ambkit.rotordynamics import spectrogram

    return spectrogram.waterfall(record_argument(record), signal, window=window, highest=highest)
