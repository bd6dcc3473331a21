"""``ambkit identify LOG LOG LOG...``: many logs of a rig, each foretold by what the others say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli import output
from ambkit.cli.output import value

if TYPE_CHECKING:
    from ambkit.cli.identify_likelihood import Options
    from ambkit.identification.corpus.corpus import Corpus
    from ambkit.machine.machine import Bearing

LEAST = 3
"""Logs from which on they are a corpus, and not one sample."""


def by_corpus(options: Options, known: Bearing) -> None:
    """Cut, identify each, pool, foretell each by the others, and deliver."""
    from ambkit.cli.identify_likelihood import refuse_parts
    from ambkit.cli.logs import load_log
    from ambkit.data.reading import load
    from ambkit.identification.corpus.corpus import identify_corpus
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.show import plots
    from ambkit.show.pages.corpus import corpus_figure, write_corpus
    from ambkit.workflow.identifying import corpus_filter, noise_at_rest, starting_model

    refuse_parts(options)
    rest = {} if options.rest is None else noise_at_rest(load(options.rest, options.rest_map))
    start = starting_model(known, rest=rest, load_std=options.load_std)
    free = None if options.free is None else options.free.replace(" ", "").split(",")
    names = [path.name for path in options.records]
    if len(set(names)) < len(names):
        raise AmbkitError("two logs of a corpus have the same name")
    with output.progress("identifying") as done:
        done("reading the logs")
        records = {
            path.name: load_log(path, options.channel_map, options.begin, options.end)
            for path in options.records
        }
        corpus = identify_corpus(records, start, free, note=done)
    bearing, made = corpus.bearing, corpus_filter(corpus)
    adequacy = output.say_adequacy(judge_adequacy(made))
    output.deliver(
        corpus.to_dict() | {"bearing": known.name, "adequacy": adequacy},
        _tables(corpus),
        [
            (options.out, bearing.save),
            (options.filter, lambda path: made.save(path, bearing=options.out)),
            (options.report, lambda path: write_corpus(path, corpus)),
            (options.plot, lambda path: plots.save_figure(corpus_figure(corpus), path)),
        ],
        as_json=options.json,
    )


def _tables(corpus: Corpus) -> list[Any]:
    kinds = {
        "error": "error",
        "alone": "alone",
        "arx": "ARX",
        "unmodelled": "velocity",
        "held": "held",
    }
    columns = [
        (kind, k) for k in corpus.foretold[0].error for kind in kinds if k > 1 or kind != "alone"
    ]  # a sample ahead no later control acts
    rows = [
        [
            each.name,
            *(value(getattr(each, kind)[k], "m", 3, like=1e-5) for kind, k in columns),
            f"{each.nis:.2f}", f"{100 * each.white:.0f} %", f"{100 * each.left:.1f} %",
            "yes" if each.good else "no",
        ]
        for each in corpus.foretold
    ]  # fmt: skip
    heads = [f"{kinds[kind]} {k}" for kind, k in columns]
    shown: list[Any] = [
        output.table(
            "Each log, foretold by a model of the others",
            ["", *heads, "NIS", "white", "left", "good"], rows,
        ),
        "Errors are rms, so many samples ahead, with the controls since. Alone is the model with "
        "the controls that the past lets expect; ARX knows no other, velocity is a Kalman filter "
        "without a magnet. All three are fitted to the other logs. Left is what of the residuals "
        "their past foretells. Good: no baseline that knows as much is better, NIS is near 1, and "
        "little is left.",
        output.table(
            f"{corpus.model.bearing.name}: {len(corpus.found)} logs together",
            ["", "found", "std. error", "scatter between logs"],
            [
                [name.replace("_", " "), value(at, unit), value(error, unit, 2, like=at), scatter]
                for name, at, error, unit, scatter in figures_of(corpus)
            ],
        ),
    ]  # fmt: skip
    if corpus.weakened is not None:
        shown.append(
            output.table(
                "The magnet in flight, the gap as described",
                ["", "amplitude of the current", "described over found", "std. error"],
                [
                    [name, value(one.amplitude, "A", 2), f"{one.factor:.3g}",
                     f"{one.factor * one.error:.2g}"]
                    for name, one in corpus.weakened.flights.items()
                ],
            )
        )  # fmt: skip
        said = corpus.weakened.text
        shown.append(f"{said[0].upper()}{said[1:]}.")
    shown += [
        f"A line at {value(h.frequency, 'Hz')} in the position, of "
        f"{value(h.amplitude, 'm', 2)}, in more than half of the logs."
        for h in corpus.model.bearing.sensor.hum
    ]
    if corpus.not_used:
        left = [[name, why] for name, why in corpus.not_used]
        shown.append(output.table("Left out", ["", ""], left, wide=True))
    cuts = [
        [name, "; ".join(f"{s.kind} {s.begin:.3g} to {s.end:.3g} s" for s in parts[:8])
         + ("; ..." if len(parts) > 8 else "")]
        for name, parts in corpus.stretches.items()
    ]  # fmt: skip
    return [*shown, output.table("How the logs were cut", ["", ""], cuts, wide=True)]


def figures_of(corpus: Corpus) -> list[tuple[str, float, float, str, str]]:
    """Return name, value and standard error [SI], unit, and scatter in words, of each parameter."""
    pooled, found = corpus.pooled, []
    for k, p in enumerate(pooled.parameters):
        at, error, scatter = (float(v[k]) for v in (pooled.values, pooled.errors, pooled.scatter))
        said = f"{100 * scatter:.0f} %" if p.positive else value(scatter, p.unit, 2, like=at)
        found.append((p.name, at, error * (at if p.positive else 1.0), p.unit,
                      said if scatter else "none seen"))  # fmt: skip
    return found
