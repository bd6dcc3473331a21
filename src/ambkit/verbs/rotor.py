"""Rotor dynamics over speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Frequency, Machine, Record, Speed, Time

if TYPE_CHECKING:
    from ambkit.rotordynamics.campbell import Campbell
    from ambkit.rotordynamics.mode_shapes import ModeShapes
    from ambkit.rotordynamics.spectrogram import Waterfall
    from ambkit.rotordynamics.unbalance_response import UnbalanceResponse


def campbell(machine: Machine, fastest: Speed | None = None, *, count: int = 121) -> Campbell:
    """Compute modes and critical speeds of a rotor over speed.

    The rotor is supported by the proportional and derivative gains of its controllers, without the
    dynamics of sensors, amplifiers and dead time; a flexible rotor also by the derivative filters.
    Separation margins (API 617) are those of the complete closed loop.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file, with a speed of rotation.
    fastest : float or str, optional
        Maximum speed [rad/s]. By default twice the machine's, or 1000 rad/s.
    count : int, optional
        Number of speeds, including 0.

    Returns
    -------
    Campbell
        Modes, critical speeds and the Campbell diagram.

    Raises
    ------
    AmbkitError
        The rotor does not rotate, `fastest` is not positive, or `count` is less than 2.

    Examples
    --------
    $ ambkit rotor ufu_flexible --fastest "12000 rpm" --plot campbell.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.rotordynamics import campbell as of

    return of.campbell(machine_argument(machine), fastest, count=count)


def mode_shapes(machine: Machine) -> ModeShapes:
    """Compute the free bending modes of a rotor, as kept in its model.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file, with a flexible rotor.

    Returns
    -------
    ModeShapes
        Frequencies, damping, and mode shapes with magnets and sensors marked.

    Raises
    ------
    AmbkitError
        The rotor is rigid.

    Examples
    --------
    $ ambkit rotor modes ufu_flexible --plot modes.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.rotordynamics import mode_shapes as of

    return of.mode_shapes(machine_argument(machine))


def unbalance_response(
    machine: Machine, fastest: Speed | None = None, *, count: int = 400
) -> UnbalanceResponse:
    """Compute the unbalance response of a rotor over speed.

    The model is that of the Campbell diagram.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file, with unbalance.
    fastest, count : optional
        As for `ambkit rotor`.

    Returns
    -------
    UnbalanceResponse
        Amplitude along each axis over speed.

    Raises
    ------
    AmbkitError
        The machine has no unbalance, or `fastest` is not positive.

    Examples
    --------
    $ ambkit rotor unbalance tum_mlps --fastest "6000 rpm" --plot response.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.rotordynamics import unbalance_response as of

    return of.unbalance_response(machine_argument(machine), fastest, count=count)


def waterfall(
    record: Record,
    signal: str | None = None,
    *,
    window: Time | None = None,
    highest: Frequency | None = None,
) -> Waterfall:
    """Compute the spectrum of the rotor motion over time.

    Hann windows with 75 % overlap; the height of a line is the amplitude of the sine.

    Parameters
    ----------
    record : Record, str or path
        Record of a displacement and the speed of rotation, as written by `ambkit simulate`.
    signal : str, optional
        Signal, such as s_A1. By default the displacement of the first axis.
    window : float or str, optional
        Window length [s]: longer resolves frequency, shorter resolves time. By default 0.1 s, or a
        quarter of a short record.
    highest : float or str, optional
        Maximum frequency [Hz]. By default four times the maximum speed, at least 100 Hz.

    Returns
    -------
    Waterfall
        Amplitude spectra over time.

    Raises
    ------
    AmbkitError
        The record lacks the signal or the speed of rotation.
    ValueError
        The window is shorter than eight samples or longer than the record.

    Examples
    --------
    $ ambkit rotor waterfall run.csv --plot waterfall.png
    """
    from ambkit.arguments import record_argument
    from ambkit.rotordynamics import spectrogram

    return spectrogram.waterfall(record_argument(record), signal, window=window, highest=highest)
