"""Fault injection: sensor, control signal, amplifier and disturbance force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Controller, Filters, Machine, Plant, Seeds

if TYPE_CHECKING:
    from ambkit.judge.faults.fault_test import FaultCampaign


def inject_faults(
    machine: Machine,
    filter: Filters = "all",
    *,
    faults: Sequence[str] | None = None,
    reading: str | None = None,
    seeds: Seeds = 1,
    samples: int = 50_000,
    precision: Literal["float64", "float32", "both"] = "float64",
    controller: Controller | None = None,
    plant: Plant | None = None,
) -> FaultCampaign:
    """Inject faults and measure recovery.

    Outages, stuck, late and erratic sensors, outliers, contact, saturation, NaN and huge values,
    and random mixtures, while the rotor follows a slow sine under a varying disturbance force.
    Open-loop: the controller uses the true measurement, so every filter must recover. Closed-loop:
    the controller uses the estimate, so levitation may be lost. A filter has recovered when its
    errors of position, velocity and disturbance force stay within five times their 99 % quantile
    without faults.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file; plant and model of the filters.
    filter : Estimator, str, path, sequence or mapping of them, optional
        Kind, filter file, or a class of yours.
    faults : sequence of str, optional
        Fault, as named in the table. By default all.
    reading : str, optional
        Sensor with the faults. By default the first.
    seeds : int, range or str, optional
        Number of campaigns, each with its own noise and draws; FIRST is the first seed, else 0.
    samples : int, optional
        Length of the run with random mixtures of faults; 0 omits it.
    precision : {"float64", "float32", "both"}, optional
        Precision of the filters.
    controller : PID, Control, class, str or path, optional
        Scenario file, or a class of yours as file.py:Class.
    plant : class or str, optional
        Class that replaces the simulated machine, as file.py:Class.

    Returns
    -------
    FaultCampaign
        Rows, all runs, and a figure; as .csv or .parquet one line per run.

    Raises
    ------
    AmbkitError
        A fault, sensor or kind is unknown, or `samples` is too few for a fault.

    Examples
    --------
    $ ambkit faults zittau_axial --filter linear --filter extended --plot faults.png
    $ ambkit faults tum_mlps --filter linear --reading Lb1
    """
    from ambkit.arguments import controller_argument, machine_argument
    from ambkit.base.quantity_arguments import seeds_in
    from ambkit.judge.faults import fault_test

    described = machine_argument(machine)
    return fault_test.inject_faults(
        described, None if filter in ("all", ["all"]) else filter, reading=reading,
        faults=faults or None, seeds=seeds_in(seeds), steps=samples,
        precisions=("float64", "float32") if precision == "both" else (precision,),
        controller=controller_argument(described, controller)[0], plant=plant,
    )  # fmt: skip
