"""``ambkit excite --for sensitivity``: what is printed of experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from ambkit.workflow.injection import Injection

DURATION = 5.0
"""Of an experiment for the sensitivity, where nobody says it [s]."""


def deliver_injections(
    found: list[Injection], out: Path | None, plot: Path | None, json: bool
) -> None:
    """Print experiments, and write each; of several with the name of its axis in the file's."""
    from functools import partial

    from ambkit.cli import output
    from ambkit.show.plots import save_figure

    def named(path: Path | None, one: Injection) -> Path | None:
        if path is None or len(found) == 1:
            return path
        return path.with_name(f"{path.stem}_{one.axis}{path.suffix}")

    def drawn(one: Injection, path: Path) -> None:
        save_figure(one.figure(), path)

    files: list[Any] = [(named(out, one), one.file().save) for one in found]
    files += [(named(plot, one), partial(drawn, one)) for one in found]
    data = found[0].to_dict() if len(found) == 1 else {one.axis: one.to_dict() for one in found}
    output.deliver(data, (each for one in found for each in output.told(one)), files, as_json=json)
