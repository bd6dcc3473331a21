"""Filters along a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Channels, Filters, Machine, Noise, Record, Time, Window

if TYPE_CHECKING:
    from ambkit.workflow.filter import Filtering


def filter(
    record: Record,
    filter: Filters = ("linear", "adaptive", "closed-law"),
    *,
    machine: Machine | None = None,
    channels: Channels | None = None,
    window: Window | None = None,
    settling: Time = 0.0,
    measurement_noise: Noise | None = None,
    disturbance_noise: Noise | None = None,
    smooth: bool = False,
) -> Filtering:
    """Run filters along a record.

    And judge them: by their innovations, the disturbance force that they see, and against the truth
    if it is known. Without truth the judge is how well the measured position is predicted, beside
    holding its last value and beside what the rig logged itself (x_logged, v_logged).

    Parameters
    ----------
    record : Record, str or path
        The recording: a record, or with a channel map a log. Where its mode says that the magnets
        have no current, it is left out.
    filter : Estimator, class, str, path, sequence or mapping of them, optional
        Kinds, linear+unbalance to estimate that too, experts (.json) or force maps (.csv) of the
        adaptive filter, or filters' files (.toml), whose inputs say what y and u of the log are.
        May be repeated.
    machine : Machine, str or path, optional
        A preset's name, or a TOML file; by default that of the first filter's file.
    channels : ChannelMap, str or path, optional
        Channel map: what is what in the log; `ambkit read guess` proposes one.
    window : str or tuple, optional
        Part of the record [s], such as "2 s,5 s".
    settling : float or str, optional
        Time at the start that does not count in the table [s].
    measurement_noise : float or str, optional
        R, such as "225 µm^2"; by default the machine's.
    disturbance_noise : float or str, optional
        Intensity of the disturbance force's random walk, such as "1 N^2/s". auto tunes it by
        likelihood on the second quarter of the record and keeps it if the second half is more
        likely with it; "auto 2 s" tunes it on the first 2 s, which do not count in the table. By
        default auto with a measured record; with a simulated one (2 m g)^2 a second.
    smooth : bool, optional
        Also estimate each sample from the whole record, not only from what came before.

    Returns
    -------
    Filtering
        Estimates and figures of each filter.

    Raises
    ------
    AmbkitError
        There is no such filter, the record lacks a signal, or a time is out of its range.
    RecordError
        The record cannot be of the machine, or it is damaged.

    Examples
    --------
    $ ambkit filter run.csv --machine zittau_axial --out estimates.csv --plot estimates.html
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import filter_record

    with progress("filtering") as done:
        return filter_record.filtered(
            record, filter, machine, channels, window, settling=settling,
            measurement=measurement_noise, disturbance=disturbance_noise, smooth=smooth,
            done=done,
        )  # fmt: skip
