"""Filters that a comparison tuned, and their files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.estimate.filter_saving import NoFile, made_by, origin_of, preset_of
from ambkit.estimate.registry import KINDS
from ambkit.judge.adequacy import judge_adequacy
from ambkit.judge.comparison.comparison import TRAINING

if TYPE_CHECKING:
    from ambkit.estimate.estimator import Estimator
    from ambkit.judge.adequacy_criteria import Finding
    from ambkit.judge.comparison.study import Study


def tuned_filters(result: Study) -> dict[str, Estimator]:
    """Return the filters that a comparison tuned, each with where its numbers are from."""
    bench = result.bench
    if not bench.tuned:
        raise AmbkitError("nothing was tuned: give the tuning a number of evaluations")
    origin = made_by(
        "compare",
        f"errors in {TRAINING} simulated runs of {bench.bearing.name}, case {bench.case.name}",
    )
    made = {}
    for name, score in bench.tuned.items():
        tuning = score.tuning
        if name not in KINDS or tuning is None:
            continue
        better = tuning.objective < tuning.default
        estimator: Estimator = result.field[name].build(**(tuning.values if better else {}))
        if better:
            estimator.origin = origin_of(tuning.values, origin)
        made[name] = estimator
    return made


def adequacy_of(result: Study) -> dict[str, list[Finding]]:
    """Return by kind whether the filters that a comparison tuned may fly."""
    return {
        name: judge_adequacy(made, nis=result.bench.tuned[name].mean("nis"))
        for name, made in tuned_filters(result).items()
    }


def save_filters(
    result: Study,
    folder: str | os.PathLike[str],
    *,
    bearing: str | os.PathLike[str] | None = None,
    magnets: Mapping[str, str | os.PathLike[str]] | None = None,
) -> dict[str, str]:
    """Write the filters that a comparison tuned, a file for each kind: ``FOLDER/KIND.toml``."""
    made, known = tuned_filters(result), result.bench.bearing
    place = files.make_folder(folder)
    if bearing is None and preset_of(known) is None:
        bearing = place / "bearing.toml"
        known.save(bearing)
    left_out = {}
    for name, estimator in made.items():
        try:
            magnet = (magnets or {}).get(name)
            estimator.save(place / f"{name}.toml", bearing=bearing, magnet=magnet)
        except NoFile as error:
            left_out[name] = str(error)
    return left_out
