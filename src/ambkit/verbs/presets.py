"""The machines that come with ambkit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Preset

if TYPE_CHECKING:
    from ambkit.result.document import Document


def presets(name: Preset | None = None) -> Document:
    """List the preset machines, or print one as TOML.

    Those that come with ambkit; as TOML they are ready to be edited.

    Parameters
    ----------
    name : str, optional
        Print this preset's TOML as it is.

    Returns
    -------
    Document
        The list, or the text.

    Raises
    ------
    AmbkitError
        There is no such preset.

    Examples
    --------
    $ ambkit presets zittau_axial > my.toml
    """
    from ambkit.workflow import presets as collection

    return collection.listing() if name is None else collection.document(name)
