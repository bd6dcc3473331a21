"""How each of many logs of a rig is predicted by the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.result.report import Axis, Bars, Figure, Panel

KINDS = (
    ("error", "estimate", "model of the others"),
    ("without_later_controls", "series 3", "model, without later controls"),
    ("arx", "series 1", "ARX"),
    ("without_a_magnet", "series 2", "without a magnet"),
    ("held", "constant", "last measurement held"),
)


def corpus_figure(corpus: Any) -> Figure:
    """Show how each log is predicted by the others, beside what knows no magnet."""
    numbers = [str(k) for k in range(1, len(corpus.predictions) + 1)]
    panels = [
        Panel(
            Axis("log"), Axis(f"error {ahead} ahead", "µm rms", 1e6),
            [
                Bars(tuple(numbers), np.array([getattr(prediction, kind)[ahead] for prediction in
                     corpus.predictions]), signal=signal, label=label)
                for kind, signal, label in KINDS
            ],
        )
        for ahead in corpus.predictions[0].error
    ]  # fmt: skip
    said = ", ".join(
        f"{n}: {prediction.name}" for n, prediction in zip(numbers, corpus.predictions, strict=True)
    )
    return Figure(
        "corpus", "Cross-validation: each log predicted by a model of the others", said, panels
    )
