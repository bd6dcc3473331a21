"""A machine's parameters from records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import (
    Axis,
    Channels,
    Constant,
    Force,
    Gap,
    KnownForce,
    Length,
    Log,
    Machine,
    MapFile,
    Record,
    Records,
    Rest,
    Rules,
    Window,
)

if TYPE_CHECKING:
    from ambkit.workflow.identification import IdentifiedCoil, IdentifiedCorpus, IdentifiedOnline
    from ambkit.workflow.identify import Identified, LiftedOff


def identify(
    machine: Machine,
    records: Records,
    *,
    axis: Axis | None = None,
    channels: Channels | None = None,
    window: Window | None = None,
    free: Sequence[str] | None = None,
    validate: Sequence[Record] = (),
    rest: Rest | None = None,
    initial_disturbance: Force | None = None,
    nodes: Rules | None = None,
) -> Identified:
    """Identify the parameters of a machine, with their standard errors.

    From records of the closed loop, jointly, by maximum likelihood. What a record cannot determine
    is named, and stays as it was.

    Parameters
    ----------
    machine : Machine, str or path
        What is known already: a preset's name, or a TOML file.
    records : Record, str, path or sequence of them
        Runs in closed loop: .csv, .parquet or .mat.
    axis : str, optional
        Name of the axis, of a machine with several.
    channels : ChannelMap, str or path, optional
        Channel map of the records; `ambkit read guess` proposes one.
    window : str or tuple, optional
        Part of the records [s], such as "2 s,5 s".
    free : sequence of str, optional
        What is identified: magnet_constant or mass, air_gap, sensor_lag, delay, current_lag,
        position_offset, current_offset, sensor_gain, amplifier_gain, measurement_noise,
        position_noise, control_noise, disturbance_noise. May be repeated. By default what a record
        usually determines.
    validate : sequence of Record, str or path, optional
        Judge the result on this record. May be repeated.
    rest : Record, str or path, optional
        A record at rest: noise and its colour, each signal; with another channel map
        RECORD@MAP.toml.
    initial_disturbance : float or str, optional
        Standard deviation of the disturbance force at the start of a record [N]; by default the
        weight.
    nodes : tuple of 2 int or str, optional
        Map the force at so many nodes along current and displacement; by default, where a force map
        is written, 5x5 to 9x9 as the records fill them.

    Returns
    -------
    Identified
        The machine, its filter, standard errors, validation.

    Raises
    ------
    AmbkitError
        There is no such axis or parameter, a record is both identified from and validated on, or
        the search cannot begin.
    TypeError
        One of the arguments is of another type.

    Examples
    --------
    $ ambkit identify my.toml run.csv --out found.toml --out filter=filter.toml
    $ ambkit identify my.toml logs/0.mat logs/1.mat --channels rig.toml --out rig.html
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import identification

    with progress("identifying") as done:
        return identification.by_likelihood(
            machine, records, axis, channels, window, free=free, validate=validate, rest=rest,
            load_std=initial_disturbance, nodes=nodes, note=done,
        )  # fmt: skip


def identify_corpus(
    machine: Machine,
    records: Log | Sequence[Log],
    *,
    channels: Channels | None = None,
    window: Window | None = None,
    free: Sequence[str] | None = None,
    rest: Rest | None = None,
    initial_disturbance: Force | None = None,
) -> IdentifiedCorpus:
    """Identify a machine with one axis from many logs.

    Each log is identified alone, they are pooled with a scatter between them, and each is predicted
    by a model of the others.

    Parameters
    ----------
    machine, channels, window, free, rest, initial_disturbance : optional
        As for `ambkit identify`.
    records : sequence of str or path
        Three runs in closed loop or more: .csv, .parquet or .mat.

    Returns
    -------
    IdentifiedCorpus
        The machine, its filter, and how each log is predicted.

    Raises
    ------
    AmbkitError
        The machine has several axes, there are fewer than three logs, or two have the same name.

    Examples
    --------
    $ ambkit identify corpus my.toml logs/a.mat logs/b.mat logs/c.mat --channels rig.toml
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import identification

    with progress("identifying") as done:
        return identification.by_corpus(
            machine, records, channels, window, free=free, rest=rest,
            load_std=initial_disturbance, note=done,
        )  # fmt: skip


def identify_online(
    machine: Machine,
    record: Record,
    *,
    channels: Channels | None = None,
    window: Window | None = None,
    method: Literal["all", "adaline", "rls", "augmented"] = "all",
    initial: Constant | None = None,
    disturbance: KnownForce | None = None,
) -> IdentifiedOnline:
    """Identify the magnet constant as a controller would, sample by sample.

    By ADALINE, recursive least squares, and the extended Kalman filter with k as a state.

    Parameters
    ----------
    machine : Machine, str or path
        What is known already, with one axis: a preset's name, or a TOML file.
    record : Record, str or path
        A run in closed loop: .csv, .parquet or .mat.
    channels, window : optional
        As for `ambkit identify`.
    method : {"all", "adaline", "rls", "augmented"}, optional
        Whose machine is the result; all shows the three beside each other and prefers none.
    initial : float or str, optional
        Magnet constant to begin with [N m^2/A^2]; by default the machine's.
    disturbance : float, str or array, optional
        Disturbance force that is known [N], or a signal of the record, f_d.

    Returns
    -------
    IdentifiedOnline
        What each method learned.

    Raises
    ------
    AmbkitError
        The machine has several axes, or a value is out of its range.

    Examples
    --------
    $ ambkit identify online my.toml run.csv --plot online.png
    $ ambkit identify online my.toml run.csv --method adaline --disturbance f_d --out found.toml
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import identification

    with progress("identifying"):
        return identification.online(
            machine, record, channels, window, method=method, initial=initial,
            disturbance=disturbance,
        )  # fmt: skip


def identify_lift_off(
    machine: Machine,
    records: Log | Sequence[Log],
    *,
    axis: Axis | None = None,
    channels: MapFile | None = None,
    gap: Gap | None = None,
    operating_point: Length | None = None,
) -> LiftedOff:
    """Identify a one-sided magnet from the points at which its rotor lifts off.

    Parameters
    ----------
    machine : Machine, str or path
        What is known already: a preset's name, or a TOML file.
    records : str, path or sequence of them
        The points as a table (.csv); or, with a channel map that names distance z and coil current
        i, recordings of a rotor that lifts off as the current rises, one each.
    axis : str, optional
        Name of the axis, of a machine with several.
    channels : str or path, optional
        Channel map of the recordings.
    gap : str or tuple, optional
        Fit the points within [m], such as "4 mm,16 mm".
    operating_point : float or str, optional
        Distance at x = 0 [m]; gives air gap and bias current.

    Returns
    -------
    LiftedOff
        The law through the points, and with an operating point the machine.

    Raises
    ------
    AmbkitError
        The magnet is two-sided, a file is not valid, or the points do not determine the law.

    Examples
    --------
    $ ambkit identify lift-off inteco_ml points.csv --operating-point "10 mm" --out found.toml
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import identification

    with progress("reading") as done:
        return identification.lift_off(
            machine, records, axis, channels, gap=gap, operating_point=operating_point, note=done
        )


def identify_coil(
    machine: Machine,
    records: Log | Sequence[Log],
    *,
    axis: Axis | None = None,
    channels: Channels | None = None,
    window: Window | None = None,
    operating_point: Length | None = None,
) -> IdentifiedCoil:
    """Identify a coil from steps of its control signal, the rotor held.

    Parameters
    ----------
    machine : Machine, str or path
        What is driven through it: a preset's name, or a TOML file.
    records : str, path or sequence of them
        Logs with control u, coil current i and distance z.
    axis, channels, window : optional
        As for `ambkit identify`.
    operating_point : float or str, optional
        Distance [m] at which the lag is wanted, and for which the machine is written.

    Returns
    -------
    IdentifiedCoil
        Gain, dead zone, time constant and delay, with standard errors.

    Raises
    ------
    AmbkitError
        A log lacks a signal, or the logs do not determine the coil.

    Examples
    --------
    $ ambkit identify coil inteco_ml steps/0.mat steps/1.mat steps/2.mat --channels coil.toml
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import identification

    with progress("fitting") as done:
        return identification.coil(
            machine, records, axis, channels, window, operating_point=operating_point, note=done
        )
