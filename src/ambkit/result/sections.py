"""What a verb returns states this: rows, series and figures. The tellers read nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from ambkit.result.row import Row

if TYPE_CHECKING:
    from ambkit.result.report import Figure


class Section(NamedTuple):
    """How the rows of a section are shown."""

    title: str
    across: bool = False  #: A line for each thing and a column for each figure, not turned.


class Part(NamedTuple):
    """A chapter of the page."""

    title: str
    lead: str = ""  #: Markdown.
    section: tuple[str, ...] | None = None  #: Its tables are of the sections that begin so.
    figures: Sequence[Figure] = ()  #: Those that are in `figures` too are shown here only.


class Stated:
    """What a result states, for the tellers."""

    __slots__ = ()

    signed: ClassVar[bool] = False
    """Whether its page is a verdict, to be signed off."""

    TITLE: ClassVar[str] = ""
    """What it is; ``{0.machine.name}`` stands for what the result itself says."""
    SECTIONS: ClassVar[Mapping[tuple[str, ...], Section]] = {}
    """How sections are shown; in their titles ``{0...}`` as in `TITLE`."""

    @property
    def title(self) -> str:
        """What it is, and of what."""
        return self.TITLE.format(self)

    @property
    def finding(self) -> str:
        """The main finding, in one sentence."""
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[Row]:
        """The figures of merit."""
        raise NotImplementedError

    @property
    def sections(self) -> Mapping[tuple[str, ...], Section]:
        """How each section of the rows is shown."""
        return {
            name: Section(title.format(self), across)
            for name, (title, across) in self.SECTIONS.items()
        }

    @property
    def chapters(self) -> Sequence[Part]:
        """Chapters of the page after the first, which has all that is in none of them."""
        return ()

    @property
    def facts(self) -> Mapping[str, str]:
        """What it holds for."""
        return {}

    @property
    def notes(self) -> Sequence[str]:
        """Sentences to be read with it."""
        return ()

    @property
    def series(self) -> Mapping[str, Any]:
        """All that is no figure of merit, as it stands in JSON."""
        return {}

    def figures(self) -> Sequence[Figure]:
        """Return its pictures, the main one first.

        Returns
        -------
        sequence of Figure
            Empty where there is nothing to see.
        """
        return ()


def by_section(rows: Sequence[Row]) -> Iterator[tuple[tuple[str, ...], list[Row]]]:
    """Yield the rows of each section, in the order of their first rows."""
    for name in dict.fromkeys(row.section for row in rows):
        yield name, [row for row in rows if row.section == name]
