"""Training of the stiffness network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ambkit.base.progress import progress
from ambkit.verbs.words import Axis, File, Force, Length, Machine, MapFile, Rules, Source

if TYPE_CHECKING:
    from ambkit.workflow.trained_expert import TrainedExpert


def train(
    machine: Source,
    *,
    axis: Axis | None = None,
    rules: Rules = "5x5",
    reach: Length | None = None,
    method: Literal["least-squares", "widths", "steepest-gradient"] = "least-squares",
    plain: bool = False,
    scaling: Literal["grid", "unit"] = "grid",
) -> TrainedExpert:
    """Train the stiffness network (fuzzy expert for k_i and k_s).

    The adaptive filter evaluates this fuzzy basis function network at every sample.

    Parameters
    ----------
    machine : Machine, StiffnessMap, str or path
        Preset name or TOML file, whose force law is learned; in Python also a stiffness map, with
        one rule per node.
    axis : str, optional
        Axis, if the machine has several.
    rules : tuple of 2 int or str, optional
        Rules along current and displacement.
    reach : float or str, optional
        Range of displacement in either direction [m]. By default half of the clearance.
    method : {"least-squares", "widths", "steepest-gradient"}, optional
        Fit widths and conclusions, or widths only, by least squares; or use the paper's steepest
        gradient.
    plain : bool, optional
        Use eq. 33 as printed, without normalisation.
    scaling : {"grid", "unit"}, optional
        Scale distances by the grid spacing, or take 1 A as 1 mm.

    Returns
    -------
    TrainedExpert
        The network, its errors, and its adaptive filter.

    Raises
    ------
    AmbkitError
        The axis is unknown, or an argument is out of range.

    Examples
    --------
    $ ambkit train zittau_axial --out expert.json --plot expert.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.machine.stiffness import StiffnessMap
    from ambkit.workflow import training

    known = machine_argument(machine, StiffnessMap)
    with progress("training the expert"):
        return training.trained(
            known, axis, rules, reach=reach, method=method, plain=plain, scaling=scaling,
            source=machine,
        )  # fmt: skip


def train_map(
    machine: Machine,
    force: File,
    *,
    axis: Axis | None = None,
    rules: Rules = "5x5",
    channels: MapFile | None = None,
    law_error: Force | None = None,
    method: Literal["least-squares", "widths", "steepest-gradient"] = "least-squares",
    plain: bool = False,
    scaling: Literal["grid", "unit"] = "grid",
    model: Literal["network", "surface", "law"] | None = None,
) -> TrainedExpert:
    """Train the stiffness network on measured forces.

    The points correct the machine's force law, which remains in effect where there are none. Law,
    surface through the points, and network are compared by cross-validation.

    Parameters
    ----------
    machine, axis, method, plain, scaling : optional
        As for `ambkit train`.
    force : str or path
        Table of iu [A], x [m] and f_mag [N], on a grid or scattered; f_std [N], the standard error,
        weights the points.
    rules : tuple of 2 int or str, optional
        Rules along current and displacement; auto selects them by cross-validation.
    channels : str or path, optional
        Channel map for other column names: [signals.iu], [signals.x] and [signals.f_mag], each with
        column and unit.
    law_error : float or str, optional
        Standard deviation of the law's error away from the points [N]. By default estimated from
        the points.
    model : {"network", "surface", "law"}, optional
        Model of the filter: network, surface through the points, or law (refitted if better). By
        default the best in cross-validation.

    Returns
    -------
    TrainedExpert
        As returned by `ambkit.train`, with the surface and the comparison of the models.

    Raises
    ------
    AmbkitError
        There are too few points, one is beyond the air gap, or an argument is out of range.

    Examples
    --------
    $ ambkit train map found.toml force.csv --rules auto --out filter=filter.toml
    """
    from ambkit.arguments import machine_argument
    from ambkit.workflow import training

    with progress("training the expert") as done:
        return training.trained_on_map(
            machine_argument(machine), force, axis, rules, channels=channels, law_error=law_error,
            method=method, plain=plain, scaling=scaling, take=model, source=machine, note=done,
        )  # fmt: skip
