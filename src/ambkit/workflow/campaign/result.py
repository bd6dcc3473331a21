"""What a campaign came to: yield, worst machines, what drives them."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from ambkit.base.showing import Shown
from ambkit.workflow.campaign.counting import Counted
from ambkit.workflow.campaign.machines import Machines
from ambkit.workflow.campaign.statistics import Share
from ambkit.workflow.campaign.store import Folder

if TYPE_CHECKING:
    from ambkit.result.report.figure import Figure
    from ambkit.workflow.campaign.replaying import Replayed
    from ambkit.workflow.campaign.sensitivities import Indices


class Campaign(Shown, Machines):
    """The machines of a study that were simulated, and what is to be seen of them.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    plan : Plan
        The study.
    parts : tuple of int
        Those that count.
    """

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Campaign:
        """Return the campaign in a folder, finished or not.

        Parameters
        ----------
        folder : path
            Of ``ambkit campaign``.

        Raises
        ------
        AmbkitError
            There is none in it, or it is of another version of ambkit.
        """
        place = Folder.existing(folder)
        return cls(place.path, place.plan, Counted(place).counting())

    def __repr__(self) -> str:
        good = self.good
        return (
            f"<Campaign {self.plan.study.name}: {good.passed} of {good.of} machines are good, "
            f"{100 * good.low:.2f} to {100 * good.high:.2f} %>"
        )

    def replay(self, run: int) -> Replayed:
        """Simulate a run again, with all its samples.

        Parameters
        ----------
        run : int
            Its number.

        Raises
        ------
        AmbkitError
            There is no such run, or no such machine can be.
        """
        from ambkit.workflow.campaign.replaying import replay

        return replay(self.plan, run)

    def indices(self, figure: str | None = None) -> Indices:
        """Return what share of a figure's variance each quantity has, see `Indices`.

        Parameters
        ----------
        figure : str, optional
            By default as of `worst`.

        Raises
        ------
        AmbkitError
            SALib is not installed; there is no such figure; or nothing of it can be told.
        """
        from ambkit.workflow.campaign.sensitivities import indices

        return indices(self, figure or ("peak_S" if "peak_S" in self.columns else "tracking_peak"))

    def rare(self) -> list[str]:
        """Return what ``ambkit campaign rare`` found of rare failures, in sentences."""
        from ambkit.workflow.campaign.rare_file import told

        return told(self.folder)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "study": self.plan.study.name,
            "bearing" if self.plan.study.machine is None else "machine": self.plan.nominal.name,
            "folder": str(self.folder),
            "runs": len(self),
            "yield": _plain(self.good),
            "confidence": self.plan.study.confidence,
            "by_choice": {
                name: {value: _plain(share) for value, share in shares.items()}
                for name, shares in self.by_choice.items()
            },
            "fails": self.fails,
            "zones": self.zones,
            "quantiles": {
                name: {f"{q:g}": value for q, value in of.items()}
                for name, of in self.quantiles.items()
            },
            "worst": [each._asdict() for each in self.worst()],
        }

    def figure(self) -> Figure:
        """Return the cumulative curves of the figures as a picture."""
        from ambkit.workflow.campaign.pictures import cumulative

        return cumulative(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the report, a page of HTML.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        AmbkitError
            It cannot be written.
        """
        from ambkit.workflow.campaign.report import write

        write(self, path)


def _plain(share: Share) -> dict[str, Any]:
    return {"share": share.value, **share._asdict()}
