"""What was found of a rare failure, kept beside the rows."""

from __future__ import annotations

import json
from pathlib import Path

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import json_text
from ambkit.base.units import engineering
from ambkit.workflow.campaign.parts import UNITS
from ambkit.workflow.campaign.rare import Rare


def keep(folder: Path, figure: str, above: float, found: Rare) -> None:
    """Write it into a campaign's folder."""
    data = {"figure": figure, "above": above} | found._asdict()
    files.write_text(folder / f"rare-{figure}.json", json_text(data, indent=2) + "\n")


def told(folder: Path) -> list[str]:
    """Return what was found of rare failures, in sentences."""
    found = []
    for path in sorted(folder.glob("rare-*.json")):
        try:
            data = json.loads(files.read_text(path))
            rare = Rare(**{name: data[name] for name in Rare._fields})
            found.append(sentence(data["figure"], data["above"], rare))
        except (ValueError, KeyError, TypeError) as error:
            raise AmbkitError(f"{path}: is damaged: {error}") from None
    return found


def sentence(figure: str, above: float, found: Rare) -> str:
    """Say how likely a failure is."""
    unit = UNITS[figure]
    limit = f"{above:g}" if unit == "1" else engineering(above, unit)
    return (
        f"{figure} is at or above {limit} with a probability of {found.probability:.3g} "
        f"({found.low:.2g} to {found.high:.2g}), by subset simulation over "
        f"{len(found.thresholds)} levels, {found.runs:,} runs."
    )
