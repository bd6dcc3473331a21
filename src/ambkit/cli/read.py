"""``ambkit read``: a rig's log into a record, with an account of its faults."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import RECORDS, Json, MapFile, Plot, file_option, quantity

if TYPE_CHECKING:
    from ambkit.data.reading import Refused


def read(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="The log: .csv, .txt, .parquet, .mat, .h5, .mf4 and the like."
        ),
    ],
    channel_map: MapFile = None,
    guess: Annotated[
        bool, typer.Option("--guess", help="Propose a channel map, on stdout, and read no record.")
    ] = False,
    resample: Annotated[
        bool,
        typer.Option(
            "--resample", help="Put signals of several clocks, or of an uneven one, on one grid."
        ),
    ] = False,
    sampling_time: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            metavar="TIME",
            help="With --resample: the grid's step, if not the clock's own.",
        ),
    ] = None,
    segment: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Of a clock that jumps, read the part number N."),
    ] = None,
    missing: Annotated[
        str,
        typer.Option(
            metavar="KINDS", help="Take as missing: saturated, frozen, spike; several with commas."
        ),
    ] = "",
    out: Annotated[
        Path | None, file_option("Write the record: .csv or .parquet.", RECORDS, "--out")
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Read a rig's log and report its faults.

    Rate, jitter, gaps and jumps of its clock; missing, saturated, frozen and coarse stretches and
    spikes of its channels; and what was done about each. Nothing is dropped or resampled unless
    asked for.
    Of a log that is refused, --plot shows where the trouble is.

    For example:
      ambkit read log.csv --guess > map.toml
      ambkit read log.csv --channels map.toml --out log.parquet --plot log.png
    """
    from ambkit.cli import printing
    from ambkit.data.reading.reader import read as read_log
    from ambkit.data.reading.rejections import Refused

    if guess:
        if channel_map or out or plot:
            raise AmbkitError("--guess proposes a map and reads no record: use it alone")
        _print_guess(file, as_json=json)
        return
    if sampling_time is not None and not resample:
        raise AmbkitError("--sampling-time is the step to resample to: add --resample")
    kinds = [kind.strip() for kind in missing.split(",") if kind.strip()]
    try:
        with printing.progress(f"reading {file.name}") as done:
            reading = read_log(
                file,
                channel_map,
                resample=resample,
                sampling_time=sampling_time,
                segment=segment,
                missing=kinds,
                progress=done,
            )
    except Refused as error:
        if plot is None:
            raise
        _draw_refused(error, plot)
        raise typer.Exit(2) from None
    printing.deliver_result(reading, [(out, reading.record.save)], as_json=json, plot=plot)


def _draw_refused(error: Refused, plot: Path) -> None:
    """Say why a log is refused, and draw where."""
    from ambkit.cli import printing
    from ambkit.data.reading.rejected_log_figure import refused_figure
    from ambkit.result.saving import save_figure

    printing.note(f"ambkit: {error}")
    figure = refused_figure(error)
    if figure is None:
        printing.note(f"{plot} is not written: there is nothing to be drawn")
        return
    save_figure(figure, plot)
    printing.note(
        f"wrote {plot}: what could be read, and where the trouble is; no record is written"
    )


def _print_guess(file: Path, *, as_json: bool) -> None:
    from ambkit.cli import printing
    from ambkit.data.reading.propose import guess

    with printing.progress(f"reading {file.name}") as done:
        result = guess(file, progress=done)
    if as_json:
        printing.deliver({"map": result}, [], as_json=True)
    else:
        print(result, end="")
    if "\n[signals.t]\n" not in result:
        printing.note(
            f"{file}: the map has no time: fill in its sampling_time before a log is read by it"
        )
