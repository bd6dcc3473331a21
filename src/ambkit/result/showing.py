"""Views of an object in a notebook: a card, or its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ambkit.result.card import Card


class Plotted:
    """An object with a figure."""

    __slots__ = ()

    def figure(self) -> Any:
        """Return its figure."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        """Return the notebook's view."""
        from ambkit.result.card import image

        return image(self.figure())

    def plot(self, *, ax: Any = None, panel: int | str = 0, static: bool = False) -> Any:
        """Plot it: interactive in a notebook, or with matplotlib for further use.

        Parameters
        ----------
        ax : matplotlib axes, or a sequence of such; optional
            Axes to draw into: one for the panel named by `panel`, several for the first panels.
        panel : int or str
            Number of the panel, or part of its name such as ``"force"``; for `ax`.
        static : bool
            Draw with matplotlib instead of an interactive figure.

        Returns
        -------
        plotly Figure, matplotlib axes or ndarray of such (panels,)
            The interactive figure; `ax` if given; otherwise the axes of a new matplotlib figure,
            also if plotly is not installed.

        Raises
        ------
        AmbkitError
            The panel does not exist, or `ax` is not axes.
        """
        figure = self.figure()
        if ax is None and not static:
            from ambkit.result.report.screen import described

            try:
                from plotly.graph_objects import Figure as Interactive
            except ImportError:
                return figure.plot()
            return Interactive(described(figure))
        return figure.plot(ax=ax, panel=panel)


class Described:
    """An object with a card in notebooks; one from a file by its settings."""

    __slots__ = ()

    def _card(self) -> Card:
        """Return the notebook's view."""
        from ambkit.result.card import settings_card

        return settings_card(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return self._card().html()


class Shown(Described, Plotted):
    """An object with a table and a figure in notebooks."""

    __slots__ = ()

    def figure(self) -> Any:
        return self._card().figure
