"""The estimators that a user can name, and the run that the commands start from."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli import output

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.noise import FilterNoise
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.forces.surface import ForceSurface
    from ambkit.machine.magnets import Precision, StiffnessSource
    from ambkit.simulation.scenario import PID, Scenario

NAMES = (
    "low-pass", "observer", "linear", "steady-state", "table", "adaptive", "closed-law", "extended",
    "square-root", "extended-k", "multiple-model", "unscented", "linear-adaptive-noise",
    "extended-adaptive-noise",
)  # fmt: skip
"""Those of :data:`ambkit.estimate.family.KINDS`, which takes longer to import."""


def estimator_option(choice: Iterable[str]) -> Any:
    """Return the option that takes a file with an expert, or one of these names."""
    return typer.Option(
        "--estimator",
        metavar="FILE",
        help="Expert of the adaptive filter, from 'ambkit train', or a force map (.csv); or a "
        "name: "
        f"{', '.join(choice)}. The linear filter without it.",
    )


class Factory(Protocol):
    """What builds an estimator."""

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build a fresh one; by default it assumes the bearing's own noise."""


def names(text: str) -> list[str]:
    """Split a list of estimators, such as ``linear,closed-law``; each counts once."""
    return list(dict.fromkeys(part.strip() for part in text.split(",")))


def known(text: str) -> str:
    """Check such a list, as the callback of an option.

    Raises
    ------
    BadParameter
        One is not in `NAMES`.
    """
    for name in names(text):
        if name not in NAMES:
            raise typer.BadParameter(f'there is no estimator "{name}"; known: {", ".join(NAMES)}')
    return text


def factories(
    chosen: Iterable[str], bearing: Bearing, expert: Path | None = None
) -> dict[str, Factory]:
    """Return what builds each of the chosen estimators, as often as asked.

    Parameters
    ----------
    chosen : iterable of str
        Some of `NAMES`.
    bearing : Bearing
        What is filtered.
    expert : Path, optional
        The expert of ``adaptive``; it is trained from the bearing's own law without it.

    Raises
    ------
    AmbkitError
        The expert cannot be read, or none of the chosen ones asks it.
    """
    from ambkit.estimate.family import KINDS

    chosen = list(chosen)
    if expert is not None and "adaptive" not in chosen:
        raise AmbkitError("--expert is for --estimator adaptive, which is not among those chosen")

    def factory(name: str) -> Factory:
        source = _source(name, bearing, expert)
        return lambda noise=None, **options: KINDS[name].make(
            bearing, source, noise=noise, **options
        )

    return {name: factory(name) for name in chosen}


class Chosen(NamedTuple):
    """A kind of estimator to export, and what it asks for k_i and k_s; None for the kind's own."""

    kind: str
    source: StiffnessSource | None


def exported(text: str | None, bearing: Bearing, choice: Iterable[str] = NAMES) -> Chosen:
    """Return the estimator that a user names, or the adaptive filter of the expert in a file.

    Parameters
    ----------
    text : str, optional
        One of `choice`, or a file from ``ambkit train``; the linear filter without it.
    bearing : Bearing
        What is filtered.
    choice : iterable of str
        Some of `NAMES`.

    Raises
    ------
    AmbkitError
        It is neither, or the file cannot be read.
    """
    if text is None or text in choice:
        return Chosen(text or "linear", _source(text or "linear", bearing, None))
    if text in NAMES:
        raise AmbkitError(f"--estimator: {text} cannot be exported yet; {', '.join(choice)} can")
    path = Path(text)
    if not (path.suffix or path.exists() or os.sep in text):
        near = difflib.get_close_matches(text, choice, 1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(choice)}"
        raise AmbkitError(f'--estimator: there is no estimator and no file "{text}"; {hint}')
    return Chosen("adaptive", read_expert(path, bearing))


def _source(name: str, bearing: Bearing, expert: Path | None) -> StiffnessSource | None:
    """Return what must be given to a kind; None where it knows by itself."""
    from ambkit.estimate.family import learned_source

    if name == "adaptive" and expert is not None:
        return read_expert(expert, bearing)
    if name == "adaptive":
        with output.progress("training the expert"):
            return learned_source(name, bearing)
    return learned_source(name, bearing)


def read_expert(path: Path, bearing: Bearing) -> Expert | ForceSurface:
    """Return the expert in a file, and note if it was trained for another bearing.

    Of a table of points of the force it is the surface through them.

    Raises
    ------
    AmbkitError
        It cannot be read.
    """
    from ambkit.fuzzy.expert import Expert

    if path.suffix.lower() in (".csv", ".parquet"):
        return surface_in(path, bearing)
    trained = Expert.load(path)
    if not trained.source.startswith(bearing.name):
        output.note(f"{path}: was trained for {trained.source}, not for {bearing.name}")
    return trained


def surface_in(path: Path, bearing: Bearing) -> ForceSurface:
    """Return the surface through the points of a force map.

    Raises
    ------
    AmbkitError
        It cannot be read, or is no force map of this bearing.
    """
    from ambkit.machine.forces.file import load_force_points
    from ambkit.machine.forces.surface import ForceSurface

    points = load_force_points(path)
    try:
        with output.progress("finding the force"):
            return ForceSurface(bearing, points)
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None


def scenario_of(
    bearing: Bearing,
    path: Path | None,
    *,
    duration: float | None,
    step: float | None,
    load: float | None,
    seed: int | None,
    reference: Path | None = None,
    from_estimate: bool = True,
) -> Scenario:
    """Return the scenario in a file, or a step and a load, with what the user changed in it.

    Parameters
    ----------
    bearing : Bearing
        The controller is tuned to it, as far as no file says otherwise.
    path : Path, optional
        A TOML file.
    duration, step, load : float, optional
        Length of the run [s]; step of the reference [m] after a tenth of it; load [N] after half.
    seed : int, optional
        Seed of the noise.
    reference : Path, optional
        A record whose ``r`` is the reference; without `duration` the run is as long as it.
    from_estimate : bool
        Whether the estimate is fed back, or the measurement, where no file says it.
    """
    from ambkit.simulation.scenario import Scenario
    from ambkit.simulation.waveforms import Step

    scenario = Scenario() if path is None else Scenario.load(path)
    controller = tuned(scenario.controller, bearing)
    if not from_estimate and "feedback" not in scenario.controller.model_fields_set:
        controller = controller.model_copy(update={"feedback": "measurement"})
    scenario = scenario.replace(controller=controller)
    if duration is not None:
        scenario = scenario.replace(duration=duration)
    if reference is not None:
        if step is not None:
            raise AmbkitError("give either --step or --reference")
        scenario = _along(reference, scenario, duration)
    if step is not None:
        stepping = Step(amplitude=step, time=0.1 * scenario.duration)
        scenario = scenario.replace(reference=stepping)
    if load is not None:
        disturbance = Step(amplitude=load, time=0.5 * scenario.duration)
        scenario = scenario.replace(disturbance=disturbance)
    return scenario if seed is None else scenario.replace(seed=seed)


def tuned(given: PID, bearing: Bearing) -> PID:
    """Return a controller with what was not given tuned to the bearing.

    The defaults of :class:`PID` are the paper's, and hold hardly another bearing.
    """
    from ambkit.simulation.scenario import PID

    said = {name: getattr(given, name) for name in given.model_fields_set}
    return PID.for_bearing(bearing).model_copy(update=said)


def _along(path: Path, scenario: Scenario, duration: float | None) -> Scenario:
    """Return a scenario whose reference is the signal r of a record."""
    from ambkit.data.record import Record
    from ambkit.simulation.waveforms import Recorded

    if duration is None:
        t = Record.load(path).t
        scenario = scenario.replace(duration=float(t[-1]))
    return scenario.replace(reference=Recorded(file=str(path), signal="r"))
