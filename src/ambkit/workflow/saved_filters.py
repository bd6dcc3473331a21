"""Filters that a comparison tuned, and their files."""

from __future__ import annotations

import logging
import os
from typing import TYPE_CHECKING

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.estimate.filter_saving import NoFile, made_by, origin_of, preset_of
from ambkit.estimate.registry import KINDS
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.comparison.comparison import TRAINING

if TYPE_CHECKING:
    from ambkit.estimate.estimator import Estimator
    from ambkit.judge.adequacy_criteria import Finding
    from ambkit.judge.comparison.study import Study


NOTES = logging.getLogger("ambkit")


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
    if not result.bench.tuned:
        return {}
    return {
        name: judge_adequacy(made, nis=result.bench.tuned[name].mean("nis"))
        for name, made in tuned_filters(result).items()
    }


def save_filters(result: Study, folder: str | os.PathLike[str]) -> dict[str, str]:
    """Write the filters that a comparison tuned, a file for each kind: ``FOLDER/KIND.toml``."""
    made, known, bearing = tuned_filters(result), result.bench.bearing, result.machine_file
    place = files.make_folder(folder)
    if bearing is None and preset_of(known) is None:
        bearing = place / "bearing.toml"
        known.save(bearing)
    left_out = {}
    for name, estimator in made.items():
        try:
            magnet = result.magnet_files.get(name)
            estimator.save(place / f"{name}.toml", bearing=bearing, magnet=magnet)
        except NoFile as error:
            left_out[name] = str(error)
            NOTES.warning("note: %s", error)
    for kind, findings in adequacy_of(result).items():
        for text in sentences(findings):
            NOTES.warning("%s: %s", kind, text)
    return left_out
