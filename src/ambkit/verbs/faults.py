"""Faults of sensor, control signal, amplifier and disturbance, injected into flights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Controller, Filters, Machine, Plant

if TYPE_CHECKING:
    from ambkit.judge.faults.fault_test import FaultCampaign


def inject_faults(
    machine: Machine,
    filter: Filters = "all",
    *,
    faults: Sequence[str] | None = None,
    reading: str | None = None,
    seeds: int = 1,
    first_seed: int = 0,
    samples: int = 50_000,
    precision: Literal["float64", "float32", "both"] = "float64",
    controller: Controller | None = None,
    plant: Plant | None = None,
) -> FaultCampaign:
    """Inject faults and measure recovery.

    Outages, stuck, late and erratic sensors, spikes, touchdown, saturation, NaN and huge values,
    and random mixtures. The rotor follows a slow sine under a disturbance force that is another.
    Each fault is injected beside the loop, where the controller is fed by the true measurement and
    every filter must recover, and in the loop, where it is fed by the estimate and levitation may
    be lost. A filter has recovered when its errors of position, velocity and disturbance force are
    within five times the 99 % quantile of its flight without faults, and stay so.

    Parameters
    ----------
    machine : Machine, str or path
        The plant, and what the filters know: a preset's name, or a TOML file.
    filter : Estimator, str, path, sequence or mapping of them, optional
        Kinds, files of filters or classes of your own. May be repeated.
    faults : sequence of str, optional
        Some of the faults, as the table names them. May be repeated. By default all.
    reading : str, optional
        Of several readings the one that the faults are of; by default the first.
    seeds : int, optional
        Number of campaigns, each with its own noise and draws.
    first_seed : int, optional
        Seed of the first.
    samples : int, optional
        Length of a flight through random mixtures of faults; 0: none.
    precision : {"float64", "float32", "both"}, optional
        Of the filters.
    controller : PID, Control, class, str or path, optional
        A scenario's TOML file with its controller, or a class of your own as file.py:Class.
    plant : class or str, optional
        A class of your own that flies in place of the machine, as file.py:Class.

    Returns
    -------
    FaultCampaign
        Rows, all flights, and a picture; as .csv or .parquet a line for each flight.

    Raises
    ------
    AmbkitError
        A fault, reading or kind is unknown, or a flight through mixtures has no room for one.

    Examples
    --------
    $ ambkit faults zittau_axial --filter linear --filter extended --plot faults.png
    $ ambkit faults tum_mlps --filter linear --reading Lb1
    """
    from ambkit.assessment.arguments import controller_argument, machine_argument
    from ambkit.judge.faults import fault_test

    described = machine_argument(machine)
    return fault_test.inject_faults(
        described, None if filter in ("all", ["all"]) else filter, reading=reading,
        faults=faults or None, seeds=range(first_seed, first_seed + seeds), steps=samples,
        precisions=("float64", "float32") if precision == "both" else (precision,),
        controller=controller_argument(described, controller)[0], plant=plant,
    )  # fmt: skip
