"""Identification of a machine's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.base.progress import progress
from ambkit.verbs import words

if TYPE_CHECKING:
    from ambkit.identification.coil import CoilFit
    from ambkit.identification.online.comparison import OnlineComparison
    from ambkit.workflow.identified import Identified
    from ambkit.workflow.identify import IdentifiedCorpus
    from ambkit.workflow.lift_off import LiftedOff


def identify(
    machine: words.Machine,
    records: words.Records,
    *,
    axis: words.Axis | None = None,
    channels: words.Channels | None = None,
    window: words.Window | None = None,
    free: Sequence[str] | None = None,
    validate: Sequence[words.Record] = (),
    rest: words.Rest | None = None,
    initial_disturbance: words.Force | None = None,
    nodes: words.Rules | None = None,
) -> Identified:
    """Identify machine parameters, with standard errors.

    Maximum likelihood: all closed-loop records are fitted by one model. Parameters that the records
    do not determine are listed and keep their value.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file; the prior.
    records : Record, str, path or sequence of them
        Closed-loop record or log (.csv, .parquet, .mat).
    axis : str, optional
        Axis, if the machine has several.
    channels : ChannelMap, str or path, optional
        Channel map of the logs (`ambkit read guess` proposes one).
    window : str or tuple, optional
        Part of the records [s], such as "2 s,5 s".
    free : sequence of str, optional
        Parameter to identify: magnet_constant or mass, air_gap, saturation, sensor_lag, delay,
        current_lag, position_offset, current_offset, sensor_gain, amplifier_gain,
        measurement_noise, position_noise, control_noise, disturbance_noise. By default those
        usually identifiable.
    validate : sequence of Record, str or path, optional
        Validation record.
    rest : Record, str or path, optional
        Record at standstill, for the noise of each signal and its correlation; RECORD@MAP.toml
        names another channel map.
    initial_disturbance : float or str, optional
        Standard deviation of the initial disturbance force [N]. By default the weight.
    nodes : tuple of 2 int or str, optional
        Nodes of the force map along current and displacement. By default 5x5 to 9x9, if a force map
        is written.

    Returns
    -------
    Identified
        Machine, filter, standard errors and validation.

    Raises
    ------
    AmbkitError
        An axis or parameter is unknown, a record is used for identification and validation, or the
        search has no valid start.
    TypeError
        An argument has the wrong type.

    Examples
    --------
    $ ambkit identify my.toml run.csv --out found.toml --out filter=filter.toml
    $ ambkit identify my.toml logs/0.mat logs/1.mat --channels rig.toml --out rig.html
    """
    from ambkit.workflow import identify as work

    with progress("identifying") as done:
        return work.by_likelihood(
            machine, records, axis, channels, window, free=free, validate=validate, rest=rest,
            load_std=initial_disturbance, nodes=nodes, note=done,
        )  # fmt: skip


def identify_corpus(
    machine: words.Machine,
    records: words.Log | Sequence[words.Log],
    *,
    axis: words.Axis | None = None,
    channels: words.Channels | None = None,
    window: words.Window | None = None,
    free: Sequence[str] | None = None,
    rest: words.Rest | None = None,
    initial_disturbance: words.Force | None = None,
) -> IdentifiedCorpus:
    """Identify a machine from many logs, with the scatter between them.

    Each log is fitted separately. The results are pooled with random effects, and each log is
    predicted by a model of the others.

    Parameters
    ----------
    machine, axis, channels, window, free, rest, initial_disturbance : optional
        As for `ambkit identify`.
    records : sequence of str or path
        At least three closed-loop logs (.csv, .parquet, .mat).

    Returns
    -------
    IdentifiedCorpus
        Machine, filter, and the prediction of each log.

    Raises
    ------
    AmbkitError
        The axis is unknown, there are fewer than three logs, or two have the same name.

    Examples
    --------
    $ ambkit identify corpus my.toml logs/a.mat logs/b.mat logs/c.mat --channels rig.toml
    """
    from ambkit.arguments import machine_argument
    from ambkit.workflow import identify as work

    known, noise = machine_argument(machine), work.standstill(rest, channels)
    start = work.starting_model(known, axis, rest=noise, load_std=initial_disturbance)
    with progress("identifying") as done:
        return work.by_corpus(known, start, records, channels, window, free=free, note=done)


def identify_online(
    machine: words.Machine,
    record: words.Record,
    *,
    axis: words.Axis | None = None,
    channels: words.Channels | None = None,
    window: words.Window | None = None,
    method: Literal["all", "adaline", "rls", "augmented"] = "all",
    initial: words.Constant | None = None,
    disturbance: words.KnownForce | None = None,
) -> OnlineComparison:
    """Identify the magnet constant sample by sample, as a controller would.

    Methods: ADALINE, recursive least squares, and the extended Kalman filter with k as a state.
    A record determines the ratio of k to the mass. An unknown constant load biases ADALINE only.

    Parameters
    ----------
    machine, axis, channels, window : optional
        As for `ambkit identify`.
    record : Record, str or path
        Closed-loop record or log (.csv, .parquet, .mat).
    method : {"all", "adaline", "rls", "augmented"}, optional
        Method whose machine is returned; all compares the three and returns no machine.
    initial : float or str, optional
        Initial magnet constant [N m^2/A^2]. By default the machine's.
    disturbance : float, str or array, optional
        Known disturbance force [N], or the name of its signal, such as f_d.

    Returns
    -------
    OnlineComparison
        Result of each method.

    Raises
    ------
    AmbkitError
        The axis is unknown, or a value is out of range.

    Examples
    --------
    $ ambkit identify online my.toml run.csv --plot online.png
    $ ambkit identify online my.toml run.csv --method adaline --disturbance f_d --out found.toml
    """
    from ambkit.workflow import identify as work

    with progress("identifying"):
        return work.online(
            machine, record, axis, channels, window, method=method, initial=initial,
            disturbance=disturbance,
        )  # fmt: skip


def identify_lift_off(
    machine: words.Machine,
    records: words.Log | Sequence[words.Log],
    *,
    axis: words.Axis | None = None,
    channels: words.MapFile | None = None,
    gap: words.Gap | None = None,
    operating_point: words.Length | None = None,
) -> LiftedOff:
    """Identify a one-sided magnet from the currents at which the rotor lifts off.

    Parameters
    ----------
    machine, axis : optional
        As for `ambkit identify`.
    records : str, path or sequence of them
        Table of lift-off points (.csv); or, with a channel map for distance z and coil current i,
        one log of a rising current for each point.
    channels : str or path, optional
        Channel map of the logs.
    gap : str or tuple, optional
        Range of distances to fit [m], such as "4 mm,16 mm".
    operating_point : float or str, optional
        Distance at x = 0 [m]; determines air gap and bias current.

    Returns
    -------
    LiftedOff
        Fitted law, and with an operating point the machine.

    Raises
    ------
    AmbkitError
        The magnet is two-sided, a file is not valid, or the points do not determine the law.

    Examples
    --------
    $ ambkit identify lift-off inteco_ml points.csv --operating-point "10 mm" --out found.toml
    """
    from ambkit.workflow.lift_off import lift_off

    with progress("reading") as done:
        return lift_off(
            machine, records, axis, channels, gap=gap, operating_point=operating_point, note=done
        )


def identify_coil(
    machine: words.Machine,
    records: words.Log | Sequence[words.Log],
    *,
    axis: words.Axis | None = None,
    channels: words.Channels | None = None,
    window: words.Window | None = None,
    operating_point: words.Length | None = None,
) -> CoilFit:
    """Identify a coil from steps of the control signal with the rotor fixed.

    Parameters
    ----------
    machine, axis, channels, window : optional
        As for `ambkit identify`.
    records : str, path or sequence of them
        Log of control signal u, coil current i and distance z.
    operating_point : float or str, optional
        Distance [m] for which the time constant is reported and the machine written.

    Returns
    -------
    CoilFit
        Gain, dead zone, time constant and delay, with standard errors.

    Raises
    ------
    AmbkitError
        A log lacks a signal, or the logs do not determine the coil.

    Examples
    --------
    $ ambkit identify coil inteco_ml steps/0.mat steps/1.mat steps/2.mat --channels coil.toml
    """
    from ambkit.workflow import identify as work

    with progress("fitting") as done:
        return work.coil(
            machine, records, axis, channels, window, operating_point=operating_point, note=done
        )
