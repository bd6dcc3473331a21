"""The figures of each run of a comparison, as a table."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.data.files.tables import Table, write_table
from ambkit.judge.comparison.criteria import CRITERIA


@dataclass(frozen=True)
class PerRun:
    """A row for each case and run, columns by filter and criterion."""

    benches: Mapping[str, Any]  #: Of each case its `ambkit.judge.comparison.score.Bench`.

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write them as ``.csv`` or ``.parquet``."""
        columns: dict[str, list[Any]] = {"case": [], "run": []}
        units = {"case": "1", "run": "1"}
        for place, bench in enumerate(self.benches.values()):
            count = bench.runs - bench.stopped
            columns["case"].append(np.full(count, float(place)))
            columns["run"].append(np.arange(count, dtype=float))
            for how, scores in (("default", bench.default), ("tuned", bench.tuned)):
                for name, score in scores.items():
                    for criterion, values in score.figures.items():
                        key = f"{name}_{how}_{criterion}"
                        columns.setdefault(key, []).append(values)
                        units[key] = CRITERIA[criterion].si
        first = next(iter(self.benches.values()))
        meta = {"bearing": first.bearing.name, "cases": list(self.benches), "seed": first.seed}
        whole = {key: np.concatenate(parts) for key, parts in columns.items()}
        write_table(path, Table(whole, units, meta))
