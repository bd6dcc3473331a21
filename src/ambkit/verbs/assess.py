"""Margins of stability: of a loop, over its speed, simulated, and in a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.base.errors import AmbkitError
from ambkit.verbs.words import (
    Axis,
    Channels,
    Controller,
    Filter,
    Filters,
    Force,
    Length,
    Machine,
    Orbit,
    Record,
    Speed,
    Window,
)

if TYPE_CHECKING:
    from ambkit.assessment.amplitude_sweep import Sweep
    from ambkit.assessment.assess_log import AssessedLog
    from ambkit.assessment.assessment import Assessment
    from ambkit.assessment.speed_sweep import OverSpeed


def assess(
    machine: Machine,
    filter: Filters | None = None,
    controller: Controller | None = None,
    *,
    position: Length = 0.0,
    disturbance: Force = 0.0,
    orbit: Orbit | None = None,
    beside: Sequence[Literal["lqg", "hinf"]] = (),
) -> Assessment:
    """Assess the stability margins of a closed loop, with the filter in it.

    The loop is broken at the measurement, as ISO 14839-3 does it, and linearised at its operating
    point: sampled, with dead time, amplifier, sensor, controller and filter, which is fed with the
    control signal that goes out. Beside it stands the same controller on the measurement. Limits of
    current and voltage, quantisation and coloured noise are not in it. Each axis is assessed with
    all others closed; the worst decides. The page is a verdict to be signed off.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    filter : Estimator, str, path, sequence or mapping of them, optional
        In the loop: a kind, a file of `ambkit tune`, or none. May be repeated. By default that of
        the machine's file, the linear one, or none where the controller is fed by the measurement.
    controller : PID, Control, str or path, optional
        A scenario's TOML file with its controller, or decentralised, 'translation and tilt', lqg.
        Settings that are omitted are tuned automatically.
    position : float or str, optional
        Displacement along the axes at which the rotor is held [m].
    disturbance : float, str or mapping, optional
        Constant disturbance force there [N], on the first axis; in Python also by axis.
    orbit : float or str, optional
        Linearise along the orbit that the unbalance makes at the machine's speed, own, or along one
        of this half axis [m], with the mean stiffnesses of a turn.
    beside : sequence of {"lqg", "hinf"}, optional
        Other controllers that are assessed too: the linear-quadratic-Gaussian one of least control
        effort; that of H-infinity mixed sensitivities, which needs slycot (ambkit[hinf]).

    Returns
    -------
    Assessment
        Rows, series and pictures.

    Raises
    ------
    AmbkitError
        There is no such filter, it has another sampling time or does not settle to a gain; nothing
        holds the rotor at the operating point; slycot is not installed.

    References
    ----------
    ISO 14839-3, Mechanical vibration: Vibration of rotating machinery equipped with active magnetic
    bearings, Part 3: Evaluation of stability margin.

    Examples
    --------
    $ ambkit assess zittau_axial --filter linear --filter observer --plot margins.png
    $ ambkit assess tum_mlps --out verdict.html
    $ ambkit assess filter.toml --disturbance "5 N" --json
    """
    from ambkit.assessment import assess
    from ambkit.assessment.arguments import given_orbit, loop_given

    loop = loop_given(machine, filter, controller, position, disturbance)
    return assess.assess(
        loop.machine, loop.filters, loop.controller, x=loop.position, load=loop.disturbance,
        lqg="lqg" in beside, hinf="hinf" in beside, orbit=given_orbit(orbit),
    )  # fmt: skip


def assess_sweep(
    machine: Machine,
    filter: Filter | None = None,
    controller: Controller | None = None,
    *,
    amplitudes: Sequence[Length] | None = None,
    kind: Literal["multisine", "stepped-sine"] = "multisine",
    axis: Axis | None = None,
    position: Length = 0.0,
    disturbance: Force = 0.0,
    orbit: Orbit | None = None,
) -> Sweep:
    """Sweep the simulated loop, with its nonlinear magnets and limits, beside the linear one.

    A signal is added to the measurement of one axis, with all others closed, without noise. Of a
    rotor that turns, what runout and unbalance do alone is subtracted. A multisine gives the best
    linear approximation at its amplitude, a stepped sine the first harmonic of each sine.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter.
    amplitudes : sequence of float or str, optional
        Amplitude of the added signal [m]. May be repeated. By default 0.1, 1 and 3 % of the air
        gap.
    kind : {"multisine", "stepped-sine"}, optional
        The added signal.
    axis : str, optional
        Which axis is swept; by default that which decides the zone.
    filter, controller, position, disturbance, orbit : optional
        As for `ambkit assess`; one filter.

    Returns
    -------
    Sweep
        Rows, series and a picture.

    Raises
    ------
    AmbkitError
        An amplitude is not greater than 0, there is no such axis, the loop is not stable, or as for
        `ambkit.assess`.

    Examples
    --------
    $ ambkit assess sweep my.toml --amplitudes "1 um" --amplitudes "20 um" --plot sweep.png
    """
    from ambkit.assessment import amplitude_sweep
    from ambkit.assessment.arguments import given_orbit, loop_given
    from ambkit.base.progress import progress

    loop = loop_given(machine, filter, controller, position, disturbance).one()
    with progress("sweeping"):
        return amplitude_sweep.sweep(
            loop.machine, loop.filters, loop.controller, amplitudes=amplitudes or None, kind=kind,
            axis=axis, x=loop.position, load=loop.disturbance, orbit=given_orbit(orbit),
        )  # fmt: skip


def assess_speed(
    machine: Machine,
    filter: Filter | None = None,
    controller: Controller | None = None,
    *,
    fastest: Speed | None = None,
    count: int = 41,
    disturbance: Force = 0.0,
    orbit: Literal["own"] | None = None,
) -> OverSpeed:
    """Assess a loop over the speed of rotation, whose gyroscopics change it.

    Sensitivity of each axis with all others closed, poles of the closed loop, and the displacement,
    current and voltage that unbalance and runout demand in a slow run-up. The unbalance is that
    which the machine has at its own speed. The filter knows the speed.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or the TOML file of a machine or of a filter, with a rotor that turns.
    fastest : float or str, optional
        The greatest speed [rad/s]; by default twice the machine's, or 1000 rad/s.
    count : int, optional
        Number of speeds, from rest on.
    filter, controller, disturbance : optional
        As for `ambkit assess`; one filter.
    orbit : {"own"}, optional
        Linearise along the orbit of the unbalance at each speed.

    Returns
    -------
    OverSpeed
        Rows, series and pictures.

    Raises
    ------
    AmbkitError
        `fastest` is not greater than 0 or turns half a revolution within a sample, `count` is less
        than 2, the rotor does not turn, or as for `ambkit.assess`.

    Examples
    --------
    $ ambkit assess speed tum_mlps --fastest "30000 rpm" --plot over-speed.png
    """
    from ambkit.assessment import speed_sweep
    from ambkit.assessment.arguments import loop_given
    from ambkit.base.progress import progress

    loop = loop_given(machine, filter, controller, 0.0, disturbance).one()
    with progress("looking at one speed after the other"):
        return speed_sweep.assess_over_speed(
            loop.machine, loop.filters, loop.controller, fastest=fastest, count=count,
            load=loop.disturbance, orbit=orbit is not None,
        )  # fmt: skip


def assess_log(
    record: Record,
    machine: Machine | None = None,
    filter: Filters | None = None,
    controller: Controller | None = None,
    *,
    channels: Channels | None = None,
    window: Window | None = None,
    logged: Literal["after", "before"] = "after",
    position: Length = 0.0,
    disturbance: Force = 0.0,
) -> AssessedLog:
    """Assess a loop by a record in which a signal was added to its measurement.

    Parameters
    ----------
    record : Record, str or path
        With y [m] and injected [m]; of a machine with y_NAME of each reading, and injected_NAME of
        the axis at whose summing point the signal was added.
    machine : Machine, str or path, optional
        Whose model is laid over: a preset's name, or the TOML file of a machine or of a filter.
    filter, controller, position, disturbance : optional
        Of the model, as for `ambkit assess`.
    channels : ChannelMap, str or path, optional
        Channel map of the record; `ambkit read guess` proposes one.
    window : tuple or str, optional
        The part of the record that is used, such as "2 s,5 s"; either may be left out.
    logged : {"after", "before"}, optional
        Whether y was logged after the signal was added to it, or before.

    Returns
    -------
    AssessedLog
        Rows, series and a picture.

    Raises
    ------
    RecordError
        The record does not tell a sensitivity.
    AmbkitError
        As for `ambkit.assess`.

    Examples
    --------
    $ ambkit assess log injected.csv --machine my.toml --plot measured.png
    """
    from ambkit.assessment import assess_log
    from ambkit.assessment.arguments import loop_given, record_argument

    log_record = record_argument(record, channels, window)
    if machine is None:
        if filter is not None or controller is not None:
            raise AmbkitError("machine says what filter and controller are of: give it too")
        return assess_log.assess_log(log_record, logged=logged)
    loop = loop_given(machine, filter, controller, position, disturbance)
    return assess_log.assess_log(
        log_record, loop.machine, loop.filters, loop.controller, logged=logged, x=loop.position,
        load=loop.disturbance,
    )  # fmt: skip
