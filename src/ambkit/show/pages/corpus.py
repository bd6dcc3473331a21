"""The report on many logs of a rig: each foretold by the others first, then what they say."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.result.report.blocks import Chapter, FigureBlock, Remark, Report, TableBlock
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Bars

if TYPE_CHECKING:
    from ambkit.identification.corpus.corpus import Corpus

KINDS = (
    ("error", "estimate", "model of the others"),
    ("alone", "series 3", "model, without later controls"),
    ("arx", "series 1", "ARX"),
    ("unmodelled", "series 2", "without a magnet"),
    ("held", "constant", "last measurement held"),
)


def corpus_figure(corpus: Corpus) -> Figure:
    """Show how each log is foretold by the others, beside what knows no magnet."""
    numbers = [str(k) for k in range(1, len(corpus.foretold) + 1)]
    panels = [
        Panel(
            Axis("log"), Axis(f"error {ahead} ahead", "µm rms", 1e6),
            [
                Bars(tuple(numbers), np.array([getattr(each, kind)[ahead] for each in
                     corpus.foretold]), signal=signal, label=label)
                for kind, signal, label in KINDS
            ],
        )
        for ahead in corpus.foretold[0].error
    ]  # fmt: skip
    said = ", ".join(f"{n}: {each.name}" for n, each in zip(numbers, corpus.foretold, strict=True))
    return Figure("corpus", "Each log, foretold by a model of the others", said, panels)


def corpus_report(corpus: Corpus) -> Report:
    """Put together how each log is foretold, what the logs say, and how they were cut."""
    from importlib.metadata import version

    ahead = list(corpus.foretold[0].error)
    heads = [f"{label}, {k} ahead [µm]" for k in ahead for _, _, label in KINDS]
    rows: list[list[str | float | None]] = [
        [
            markdown(each.name),
            *(1e6 * getattr(each, kind)[k] for k in ahead for kind, _, _ in KINDS),
            each.nis, 100 * each.white, 100 * each.left, "yes" if each.good else "no",
        ]
        for each in corpus.foretold
    ]  # fmt: skip
    pooled = corpus.pooled
    names = list(corpus.found)
    figures: list[list[str | float | None]] = []
    for k, p in enumerate(pooled.parameters):
        value, error, scatter = (float(v[k]) for v in (pooled.values, pooled.errors,
                                                       pooled.scatter))  # fmt: skip
        figures.append([
            p.name.replace("_", " "),
            engineering(value, p.unit, 4),
            engineering(error * (value if p.positive else 1), p.unit, 2, like=value),
            "none seen" if not scatter
            else f"{100 * scatter:.0f} %" if p.positive
            else engineering(scatter, p.unit, 2, like=value),
        ])  # fmt: skip
    alone: list[list[str | float | None]] = [
        [
            markdown(name),
            *(
                "–" if np.isnan(pooled.each[row, k])
                else f"{engineering(float(pooled.each[row, k]), p.unit, 3)} ± "
                + engineering(
                    float(pooled.each_error[row, k] * (pooled.each[row, k] if p.positive else 1)),
                    p.unit, 2, like=float(pooled.each[row, k]))
                for k, p in enumerate(pooled.parameters)
            ),
        ]
        for row, name in enumerate(names)
    ]  # fmt: skip
    cuts: list[list[str | float | None]] = [
        [markdown(name), s.kind, s.begin, s.end]
        for name, parts in corpus.stretches.items() for s in parts
    ]  # fmt: skip
    left = [Remark(markdown(name), why) for name, why in corpus.not_used]
    return Report(
        title=f"Identification of {corpus.model.bearing.name} from {len(names)} logs",
        subtitle=f"{len(corpus.foretold)} logs, each foretold by a model of the others",
        lead="Each log is identified alone; what they say is pooled with a scatter between logs. "
        "Each is then judged by a model that has not seen it.",
        version=version("ambkit"),
        chapters=[
            Chapter("foretold", "Each log by the others", [
                TableBlock(id="foretold_errors", title="Errors, rms", headers=[
                    "log", *heads, "NIS", "white [%]", "left [%]", "good"], rows=rows,
                    caption="ARX and the filter without a magnet are fitted to the other logs. "
                    "ARX knows no later control; so it is held against the model without these, "
                    "which expects what the loops of the others would do. "
                    "Left: what of the residuals their past foretells. Good: no baseline that "
                    "knows as much is better, NIS is near 1, and little is left."),
                FigureBlock(corpus_figure(corpus)),
            ]),
            Chapter("found", "What the logs say", [
                TableBlock(id="pooled", title="Together", headers=[
                    "", "found", "standard error", "scatter between logs"], rows=figures,
                    caption="Scatter: standard deviation between logs beyond their own errors."),
                TableBlock(id="alone", title="Each log alone", headers=[
                    "log", *(p.name.replace("_", " ") for p in pooled.parameters)], rows=alone,
                    caption="With standard errors; a dash where the log does not tell."),
            ]),
            Chapter("cut", "How the logs were cut", [
                *left,
                TableBlock(id="cuts", title="Stretches", headers=["log", "", "from [s]", "to [s]"],
                           rows=cuts, caption=""),
            ]),
        ],
    )  # fmt: skip


def write_corpus(path: str | os.PathLike[str], corpus: Corpus) -> None:
    """Write the report as one HTML page that needs no net."""
    from ambkit.result.report.page import write_page

    write_page(corpus_report(corpus), path)
