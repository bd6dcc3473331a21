"""Preset machines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Preset

if TYPE_CHECKING:
    from ambkit.result.result import Document


def presets(name: Preset | None = None) -> Document:
    """List the preset machines, or print one as TOML.

    Parameters
    ----------
    name : str, optional
        Preset to print.

    Returns
    -------
    Document
        The list, or the TOML file.

    Raises
    ------
    AmbkitError
        The preset is unknown.

    Examples
    --------
    $ ambkit presets zittau_axial > my.toml
    """
    from ambkit.workflow import check

    return check.preset_listing() if name is None else check.preset_document(name)
