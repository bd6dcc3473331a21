"""Views of an object in a notebook: a card, or its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ambkit.result.card import Card


class Drawn:
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
            Draw into these: into one the panel that `panel` names, into several the first panels
            in their order.
        panel : int or str
            Number of the panel, or a part of its name such as ``"force"``; for `ax`.
        static : bool
            Draw a figure of matplotlib, rather than an interactive one.

        Returns
        -------
        plotly Figure, matplotlib axes or ndarray of such (panels,)
            The interactive figure; `ax` where it is given; else the axes of the figure that was
            made. Where plotly is not installed, a figure of matplotlib.

        Raises
        ------
        AmbkitError
            There is no such panel, or `ax` is no axes.
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


class Shown(Described, Drawn):
    """An object with a table and a figure in notebooks."""

    __slots__ = ()

    def figure(self) -> Any:
        """Return its figure."""
        return self._card().figure
