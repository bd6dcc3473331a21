"""``ambkit identify LOG LOG LOG...``: many logs of a rig, each predicted by what the others say."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.cli import printing

if TYPE_CHECKING:
    from ambkit.cli.identify_likelihood import Options
    from ambkit.machine.machine import Bearing

LEAST = 3
"""Logs from which on they are a corpus, and not one sample."""


def by_corpus(options: Options, known: Bearing) -> None:
    """Cut, identify each, pool, predict each by the others, and deliver."""
    from ambkit.cli.identify_likelihood import refuse_parts
    from ambkit.cli.record_arguments import load_log
    from ambkit.data.reading import load
    from ambkit.identification.corpus.corpus import identify_corpus
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.workflow.identify import corpus_filter, noise_at_rest, starting_model

    refuse_parts(options)
    rest = {} if options.rest is None else noise_at_rest(load(options.rest, options.rest_map))
    start = starting_model(known, rest=rest, load_std=options.load_std)
    free = None if options.free is None else options.free.replace(" ", "").split(",")
    names = [path.name for path in options.records]
    if len(set(names)) < len(names):
        raise AmbkitError("two logs of a corpus have the same name")
    with printing.progress("identifying") as done:
        done("reading the logs")
        records = {
            path.name: load_log(path, options.channel_map, options.begin, options.end)
            for path in options.records
        }
        corpus = identify_corpus(records, start, free, note=done)
    bearing, made = corpus.bearing, corpus_filter(corpus)
    adequacy = printing.say_adequacy(judge_adequacy(made))
    printing.deliver_result(
        corpus,
        [
            (options.out, bearing.save),
            (options.filter, lambda path: made.save(path, bearing=options.out)),
        ],
        as_json=options.json,
        plot=options.plot,
        report=options.report,
        more={"bearing": known.name, "adequacy": adequacy},
    )
