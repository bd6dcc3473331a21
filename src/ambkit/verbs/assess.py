"""Stability margins: of a loop, over speed, over amplitude, and from a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.verbs import words

if TYPE_CHECKING:
    from ambkit.assessment.amplitude_sweep import Sweep
    from ambkit.assessment.assess_log import AssessedLog
    from ambkit.assessment.assessment import Assessment
    from ambkit.assessment.speed_sweep import OverSpeed


def assess(
    machine: words.Machine,
    filter: words.Filters | None = None,
    controller: words.Controller | None = None,
    *,
    position: words.Length = 0.0,
    disturbance: words.Force = 0.0,
    orbit: words.Orbit | None = None,
    beside: Sequence[Literal["lqg", "hinf"]] = (),
) -> Assessment:
    """Compute the stability margins of a loop with its filter.

    Sensitivity and zones of ISO 14839-3, gain, phase, delay and disk margins, noise and load
    capacity of the sampled linear loop: dead time, amplifier, sensor, controller and filter at the
    operating point. Current and voltage limits, quantisation and coloured noise are not included.
    Each axis is assessed with all others closed; the worst one decides the zone. The same
    controller fed by the measurement is shown for comparison.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name, or TOML file of a machine or a filter.
    filter : Estimator, str, path, sequence or mapping of them, optional
        Kind, filter file, or none. By default the filter of the file, else as for `ambkit
        simulate`; none if the controller uses the measurement.
    controller : PID, Control, str or path, optional
        Scenario file, decentralised, 'translation and tilt', or lqg. Omitted settings are tuned
        automatically.
    position : float or str, optional
        Position of the operating point [m], on all axes.
    disturbance : float, str or mapping, optional
        Constant disturbance force there [N], on the first axis; in Python also by axis.
    orbit : float or str, optional
        Linearise along an orbit, with stiffnesses averaged over a revolution: own (the unbalance
        orbit at the machine's speed) or a half axis [m].
    beside : sequence of {"lqg", "hinf"}, optional
        Baseline controllers: LQG with minimum control effort; H-infinity mixed sensitivity (needs
        ambkit[hinf]).

    Returns
    -------
    Assessment
        Margins and limits of each loop, series and figures; the page is a report for signature.

    Raises
    ------
    AmbkitError
        The filter is unknown, has another sampling time or no steady-state gain; the rotor has no
        equilibrium at the operating point; slycot is not installed.

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
    from ambkit.arguments import loop_arguments, orbit_argument
    from ambkit.assessment import assess

    return assess.assess(
        loop_arguments(machine, filter, controller, position, disturbance),
        lqg="lqg" in beside, hinf="hinf" in beside, orbit=orbit_argument(orbit),
    )  # fmt: skip


def assess_sweep(
    machine: words.Machine,
    filter: words.Filter | None = None,
    controller: words.Controller | None = None,
    *,
    amplitudes: Sequence[words.Length] | None = None,
    kind: Literal["multisine", "stepped-sine"] = "multisine",
    axis: words.Axis | None = None,
    position: words.Length = 0.0,
    disturbance: words.Force = 0.0,
    orbit: words.Orbit | None = None,
) -> Sweep:
    """Measure the sensitivity of the simulated loop over the amplitude.

    A test signal is added to the measurement of one axis, without noise, with nonlinear magnets and
    all limits; the linear loop is shown for comparison. The response to runout and unbalance is
    subtracted. A multisine gives the best linear approximation, a stepped sine the first harmonic.
    A controller in Python, file.py:Class, has no linear loop.

    Parameters
    ----------
    machine, filter, controller, position, disturbance, orbit : optional
        As for `ambkit assess`.
    amplitudes : sequence of float or str, optional
        Amplitude of the test signal [m]. By default 0.1, 1 and 3 % of the air gap.
    kind : {"multisine", "stepped-sine"}, optional
        Test signal.
    axis : str, optional
        Axis. By default the one that decides the zone; without a linear loop, the first.

    Returns
    -------
    Sweep
        Rows, series and a figure.

    Raises
    ------
    AmbkitError
        An amplitude is not positive, the axis is unknown, the loop is unstable, or as for
        `ambkit.assess`.

    Examples
    --------
    $ ambkit assess sweep my.toml --amplitudes "1 um" --amplitudes "20 um" --plot sweep.png
    """
    from ambkit.arguments import loop_arguments, orbit_argument
    from ambkit.assessment import amplitude_sweep

    loop = loop_arguments(machine, filter, controller, position, disturbance).one()
    with progress("sweeping"):
        return amplitude_sweep.sweep(
            loop, amplitudes=amplitudes or None, kind=kind, axis=axis, orbit=orbit_argument(orbit)
        )


def assess_speed(
    machine: words.Machine,
    filter: words.Filter | None = None,
    controller: words.Controller | None = None,
    *,
    fastest: words.Speed | None = None,
    count: int = 41,
    disturbance: words.Force = 0.0,
    orbit: Literal["own"] | None = None,
) -> OverSpeed:
    """Assess a loop over the speed of rotation.

    Sensitivity of each axis with all others closed, poles of the closed loop, and displacement,
    current and voltage for unbalance and runout during a slow run-up. The filter is scheduled with
    the speed.

    Parameters
    ----------
    machine, filter, controller, disturbance : optional
        As for `ambkit assess`.
    fastest : float or str, optional
        Maximum speed [rad/s]. By default twice the machine's, or 1000 rad/s.
    count : int, optional
        Number of speeds, including 0.
    orbit : {"own"}, optional
        Linearise along the unbalance orbit at each speed.

    Returns
    -------
    OverSpeed
        Rows, series and figures.

    Raises
    ------
    AmbkitError
        The rotor does not rotate, `fastest` is not positive or reaches half a revolution per
        sample, `count` is less than 2, or as for `ambkit.assess`.

    Examples
    --------
    $ ambkit assess speed tum_mlps --fastest "30000 rpm" --plot over-speed.png
    """
    from ambkit.arguments import loop_arguments
    from ambkit.assessment import speed_sweep

    loop = loop_arguments(machine, filter, controller, 0.0, disturbance).one()
    with progress("looking at one speed after the other"):
        return speed_sweep.assess_over_speed(
            loop, fastest=fastest, count=count, orbit=orbit is not None
        )


def assess_log(
    record: words.Record,
    machine: words.Machine | None = None,
    filter: words.Filters | None = None,
    controller: words.Controller | None = None,
    *,
    channels: words.Channels | None = None,
    window: words.Window | None = None,
    logged: Literal["after", "before"] = "after",
    position: words.Length = 0.0,
    disturbance: words.Force = 0.0,
) -> AssessedLog:
    """Compute the sensitivity of a loop from a record with an injected signal.

    Parameters
    ----------
    record : Record, str or path
        Record of y [m] and injected [m]; of a machine with several axes, y_SENSOR and
        injected_AXIS.
    machine, filter, controller, position, disturbance : optional
        Model for comparison, as for `ambkit assess`.
    channels : ChannelMap, str or path, optional
        Channel map of a log (`ambkit read guess` proposes one).
    window : tuple or str, optional
        Part of the record [s], such as "2 s,5 s"; either end may be omitted.
    logged : {"after", "before"}, optional
        Whether y was logged after or before the signal is added.

    Returns
    -------
    AssessedLog
        Rows, series and a figure.

    Raises
    ------
    RecordError
        The record does not determine the sensitivity.
    AmbkitError
        As for `ambkit.assess`.

    Examples
    --------
    $ ambkit assess log injected.csv --machine my.toml --plot measured.png
    """
    from ambkit.arguments import loop_arguments, record_argument
    from ambkit.assessment import assess_log

    log_record = record_argument(record, channels, window)
    if machine is None and not (filter is None and controller is None):
        raise AmbkitError("filter and controller need a machine")
    loop = None if machine is None else loop_arguments(
        machine, filter, controller, position, disturbance
    )  # fmt: skip
    return assess_log.assess_log(log_record, loop, logged)
