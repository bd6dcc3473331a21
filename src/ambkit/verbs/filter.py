"""Filters along a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Channels, Filters, Machine, Noise, Record, Time, Window

if TYPE_CHECKING:
    from ambkit.workflow.filter import Filtering


def filter(
    record: Record,
    filter: Filters | None = None,
    *,
    machine: Machine | None = None,
    channels: Channels | None = None,
    window: Window | None = None,
    settling: Time = 0.0,
    measurement_noise: Noise | None = None,
    disturbance_noise: Noise | None = None,
    smooth: bool = False,
) -> Filtering:
    """Run filters along a record and evaluate them.

    With known truth by their errors; otherwise by their innovations and by the prediction of the
    measured position, compared with the last value and with the rig's own estimates (x_logged,
    v_logged). Parts of the record in which the mode is off are skipped.

    Parameters
    ----------
    record : Record, str or path
        Record, or log with a channel map.
    filter : Estimator, class, str, path, sequence or mapping of them, optional
        Kind (linear+unbalance also estimates the unbalance), expert (.json) or force map (.csv) of
        the adaptive filter, or filter file (.toml), which defines the units of y and u. By default
        linear, adaptive and closed-law, with the unbalance and runout that the machine states.
    machine : Machine, str or path, optional
        Preset name or TOML file. By default that of the first filter file.
    channels : ChannelMap, str or path, optional
        Channel map of the log (`ambkit read guess` proposes one).
    window : str or tuple, optional
        Part of the record [s], such as "2 s,5 s".
    settling : float or str, optional
        Time at the start that is excluded from the table [s].
    measurement_noise : float or str, optional
        Measurement noise variance R, such as "225 µm^2". By default the machine's.
    disturbance_noise : float or str, optional
        Process noise intensity of the disturbance force, such as "1 N^2/s". auto: maximum
        likelihood on the second quarter of the record, kept if it makes the second half more
        likely; "auto 2 s": on the first 2 s, which are excluded from the table. By default auto for
        measured and the default of FilterNoise for simulated records.
    smooth : bool, optional
        Add a smoother, which uses the whole record for each sample.

    Returns
    -------
    Filtering
        Estimates and figures of each filter.

    Raises
    ------
    AmbkitError
        A filter is unknown, the record lacks a signal, or a time is out of range.
    RecordError
        The record is damaged or cannot belong to the machine.

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
