"""Which fault a record shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Channels, Filter, Machine, Record, Window

if TYPE_CHECKING:
    from ambkit.judge.isolation.diagnosis import Diagnosis, Distinction


def diagnose(
    record: Record,
    filter: Filter | None = None,
    *,
    machine: Machine | None = None,
    channels: Channels | None = None,
    window: Window | None = None,
) -> Diagnosis:
    """Name the faults that a record shows.

    Each fault (magnet, coil, amplifier, gap, dead time, sensor, mass, clock, line noise) is tested
    by its effect on the innovations of a filter, for any time of onset, alone and in pairs.

    Parameters
    ----------
    record : Record, str or path
        Record, or log with a channel map.
    filter : Estimator, str or path, optional
        Kind, or filter file (.toml). By default extended, with the unbalance and runout that the
        machine states. Process noise of the disturbance force: that of the file; otherwise maximum
        likelihood on the first quarter of the record.
    machine : Machine, str or path, optional
        Preset name or TOML file: the machine without fault. By default that of the filter file.
    channels : ChannelMap, str or path, optional
        Channel map of the log (`ambkit read guess` proposes one).
    window : str or tuple, optional
        Part of the record [s], such as "2 s,5 s".

    Returns
    -------
    Diagnosis
        Likelihood ratio, size and onset of each fault.

    Raises
    ------
    AmbkitError
        The filter is unknown or has no model of the machine, or the record lacks a signal.
    RecordError
        The record is damaged.

    Examples
    --------
    $ ambkit diagnose run.csv --machine zittau_axial --plot faults.html
    """
    from ambkit.workflow.diagnose import diagnosed

    return diagnosed(record, filter, machine, channels, window)


def diagnose_limits(machine: Machine, filter: Filter | None = None) -> Distinction:
    """List the smallest faults of a machine that can be detected and distinguished.

    From the Fisher information of each fault in simulated runs, at rest and with steps of a tenth
    of the clearance: nine in ten faults of that size raise an alarm, and exclude all others. The
    onset is taken as known, so these are lower limits.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file.
    filter : Estimator, str or path, optional
        Kind, or filter file (.toml). By default as for `ambkit diagnose`.

    Returns
    -------
    Distinction
        Smallest size of each fault, and the faults confused with it.

    Raises
    ------
    AmbkitError
        The filter is unknown or has no model of the machine.

    Examples
    --------
    $ ambkit diagnose limits zittau_axial
    """
    from ambkit.workflow.diagnose import distinguished

    return distinguished(machine, filter)
