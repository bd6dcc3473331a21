"""The fuzzy expert for k_i and k_s."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Axis, File, Force, Length, Machine, MapFile, Rules, Source

if TYPE_CHECKING:
    from ambkit.workflow.training import TrainedExpert


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
    """Train the fuzzy expert for k_i and k_s.

    A fuzzy basis function network that the adaptive filter evaluates at every sample, trained on
    the force law of the machine.

    Parameters
    ----------
    machine : Machine, StiffnessMap, str or path
        Whose law is learned, over all currents: a preset's name, or a TOML file; in Python also
        stiffnesses, a rule for each node.
    axis : str, optional
        Name of the axis whose magnet is learned, of a machine with several.
    rules : tuple of 2 int or str, optional
        Rules along current and displacement.
    reach : float or str, optional
        How far out the law is learned, either way [m]; by default half of the clearance.
    method : {"least-squares", "widths", "steepest-gradient"}, optional
        By least squares the rules' widths and conclusions, or the widths only; or as the paper.
    plain : bool, optional
        Eq. 33 as printed, not normalised.
    scaling : {"grid", "unit"}, optional
        How an ampere and a millimetre compare; grid: a step of the grid weighs alike, unit: 1 A
        weighs as 1 mm.

    Returns
    -------
    TrainedExpert
        The network as expert, its errors, and the filter that asks it.

    Raises
    ------
    AmbkitError
        There is no such axis, or an argument is out of its range.

    Examples
    --------
    $ ambkit train zittau_axial --out expert.json --plot expert.png
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.machine.stiffness import StiffnessMap
    from ambkit.workflow import expert

    known = machine_argument(machine, StiffnessMap)
    with progress("training the expert") as done:
        return expert.trained(
            known, axis, rules, reach=reach, method=method, plain=plain,
            scaling=scaling, source=machine, note=done,
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
    """Train the expert on a measured force.

    The points correct the force law of the machine; where nothing was measured the law stays. Law,
    surface through the points and network are compared at points that are left out.

    Parameters
    ----------
    machine, axis, method, plain, scaling : optional
        As for `ambkit train`.
    force : str or path
        Points iu [A], x [m] and f_mag [N], a row for each, on a grid or not; f_std [N], its
        standard error, weighs them.
    rules : tuple of 2 int or str, optional
        Rules along current and displacement; auto: as many as the points carry, by
        cross-validation.
    channels : str or path, optional
        What its columns mean, where they have other names: [signals.iu], [signals.x] and
        [signals.f_mag], each with column and unit.
    law_error : float or str, optional
        By how much the law may be wrong where nothing was measured [N]; by default as the points
        show.
    model : {"network", "surface", "law"}, optional
        What the filter knows: the network, the surface through the points, or the law, refitted
        where that is better; by default what points left out prefer.

    Returns
    -------
    TrainedExpert
        As of `ambkit train`, with the surface and the comparison of the models.

    Raises
    ------
    AmbkitError
        The points do not tell enough, one is beyond the air gap, or an argument is out of its
        range.

    Examples
    --------
    $ ambkit train map found.toml force.csv --rules auto --out filter=filter.toml
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.workflow import expert

    with progress("training the expert") as done:
        return expert.trained_on_map(
            machine_argument(machine), force, axis, rules, channels=channels, law_error=law_error,
            method=method, plain=plain, scaling=scaling, take=model, source=machine, note=done,
        )  # fmt: skip
