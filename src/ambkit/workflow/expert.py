"""The expert, and the filter that asks it, as ``ambkit train`` writes them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import shown_in_notebooks
from ambkit.base.quantity_arguments import Given, in_si, of_type
from ambkit.estimate.filter_saving import made_by
from ambkit.estimate.kalman import AdaptiveKalmanFilter
from ambkit.fuzzy.cross_validation import LAW, NETWORK, REFITTED, SURFACE, choose_model
from ambkit.fuzzy.training import train as train_network
from ambkit.machine.axes import isolated
from ambkit.machine.forces.force_file import load_force_points
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import StiffnessMap
from ambkit.workflow.training import RULES, how_to_train, measured_force, stiffness_of_law

if TYPE_CHECKING:
    from ambkit.fuzzy.expert import Expert, Method
    from ambkit.fuzzy.rule_selection import Shape
    from ambkit.workflow.training import TrainedExpert


@shown_in_notebooks("training the expert", by="note")
def train(
    source: Machine | StiffnessMap,
    rules: Shape | None = RULES,
    *,
    axis: str | None = None,
    reach: Given | None = None,
    force_map: ForcePoints | str | os.PathLike[str] | None = None,
    channels: str | os.PathLike[str] | None = None,
    law_error: Given | None = None,
    method: Method = "least-squares",
    weights: bool | None = None,
    normalised: bool = True,
    scaling: Literal["grid", "unit"] = "grid",
    note: Callable[[str], None] = lambda _text: None,
    **details: Any,
) -> Expert:
    """Train the expert for k_i and k_s, as ``ambkit train`` does, and return what it writes.

    Parameters
    ----------
    source : Bearing, Machine or StiffnessMap
        Whose law is learned, over all currents; or the nodes to learn, one
        for each rule.
    rules : tuple of 2 int, optional
        Along current and displacement; None: as many as the points of `force_map` carry. Of a
        stiffness map as many as it has nodes.
    axis : str, optional
        Name of the axis whose magnet is learned, of a machine with several.
    reach : float or str, optional
        How far out the law is learned, either way [m]; by default half of the travel. A force map
        reaches as far as it has points.
    force_map : path or ForcePoints, optional
        A measured or computed force, which corrects the law: points of iu, x and f_mag.
    channels : path, optional
        What its columns mean, where they have other names.
    law_error : float or str, optional
        By how much the law may be wrong where nothing was measured [N]; by default as found.
    method : {"least-squares", "steepest-gradient"}
        Better than the paper, or as it does it.
    weights : bool, optional
        Whether the rules' conclusions are trained as well as their widths; by default with least
        squares.
    normalised : bool
        False is eq. 33 as printed.
    scaling : {"grid", "unit"}
        How an ampere and a millimetre compare.
    note : callable
        Told what is done next.
    **details
        Of :func:`ambkit.fuzzy.training.train`: `widths`, `epochs`, `learning_rate`, `samples`.

    Returns
    -------
    Expert
        The network, with its learning curves in ``training``. Where points of a `force_map` that
        were left out prefer the law or the surface, a warning says so, with the errors;
        `ambkit.workflow.training.train_expert` returns them, and takes what is better.

    Raises
    ------
    AmbkitError
        The options contradict each other, or the points do not tell enough.
    ValueError
        A point is beyond the air gap.

    Examples
    --------
    >>> from ambkit import Bearing, train
    >>> len(train(Bearing.preset("zittau_axial"), rules=(3, 3)).rules)
    9
    """
    of_type(Machine, StiffnessMap, source=source)
    how = how_to_train(method, weights, normalised=normalised, scaling=scaling) | details
    if force_map is None:
        for name, value in (("channels", channels), ("law_error", law_error)):
            if value is not None:
                raise AmbkitError(f"{name} is of points that were measured: give a force_map")
        if rules is None:
            raise AmbkitError("rules = None asks points that were measured: give a force_map")
    if isinstance(source, StiffnessMap):
        if reach is not None:
            raise AmbkitError("reach is of a bearing's law, and source has nodes of its own")
        if force_map is not None:
            raise AmbkitError("a force_map corrects a bearing's law, and source is no bearing")
        return train_network(source, **how)
    source = isolated(source, axis)
    if force_map is None:
        far = in_si("reach", reach, "m")
        return train_network(stiffness_of_law(source, rules or RULES, far), **how)
    if reach is not None:
        raise AmbkitError("reach is of a law; a force_map reaches as far as it has points")
    points = (
        force_map if isinstance(force_map, ForcePoints) else load_force_points(force_map, channels)
    )
    off = in_si("law_error", law_error, "N")
    options = {name: how[name] for name in ("method", "weights", "normalised", "scaling")}
    measured = measured_force(source, points, rules, law_error=off, note=note, **options)
    stiffness = measured.stiffness
    shape = (stiffness.current.size, stiffness.displacement.size)
    models = choose_model(source, measured.surface, shape, note, **how)
    if models is not None and (warning := models.against(NETWORK)):
        warnings.warn(warning, stacklevel=3)  # beyond what shows the progress
    return train_network(stiffness, **how)


def save_filter(
    result: TrainedExpert,
    path: str | os.PathLike[str],
    *,
    bearing: str | os.PathLike[str] | None = None,
    written: str | os.PathLike[str] | None = None,
) -> None:
    """Write the filter that knows what was written of a training."""
    made = filter_of(result)
    if result.taken in (LAW, REFITTED):
        made.save(path, bearing=written or (bearing if result.taken == LAW else None))
        return
    made.save(path, bearing=bearing, magnet=written)


def filter_of(result: TrainedExpert) -> AdaptiveKalmanFilter:
    """Return the filter that knows what is taken of a training."""
    law, magnet = result.model
    made = AdaptiveKalmanFilter(law, magnet)
    part = "bearing.file" if result.taken in (LAW, REFITTED) else "magnet.file"
    made.origin = {part: made_by("train", result.expert.source)}
    return made


FORMS = {
    NETWORK: (".json",), SURFACE: (".csv", ".parquet"), LAW: (".toml",), REFITTED: (".toml",),
}  # fmt: skip
"""What each model is written as: the expert, the points that its surface goes through, a law."""
