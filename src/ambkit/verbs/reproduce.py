"""Reproduction of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Folder

if TYPE_CHECKING:
    from ambkit.workflow.reproduction import Reproduction


def reproduce(out: Folder = "out", *, seed: int = 0, open: bool = False) -> Reproduction:
    """Reproduce the paper.

    Writes report.html, figures/, tables/ and summary.json, and prints the verdicts.

    Parameters
    ----------
    out : str or path, optional
        Output folder.
    seed : int, optional
        First random seed of the noise.
    open : bool, optional
        Open the report in the browser.

    Returns
    -------
    Reproduction
        The verdicts and the folder.

    Raises
    ------
    AmbkitError
        The folder cannot be written.

    Examples
    --------
    $ ambkit reproduce --out out --open
    """
    from ambkit.base.files import module_beside
    from ambkit.base.progress import progress

    with progress("reproducing the paper") as done:
        work = module_beside("docs", "paper.reproduction")
        outcome: Reproduction = work.reproduce(out, seed=seed, progress=done)
    if open:
        import webbrowser

        webbrowser.open(outcome.path.absolute().as_uri())
    return outcome
