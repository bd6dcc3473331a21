"""Pictures of single results: a run, an identification, a training, filters along a record.

Each function describes a :class:`ambkit.result.report.Figure`; `save_figure` draws it as ``.png``,
``.svg`` or, to zoom in, as ``.html``.
"""

from ambkit.show.plots.comparison import comparison_figure
from ambkit.show.plots.filters import filter_figure
from ambkit.show.plots.identification import identification_figure, lift_off_figure
from ambkit.show.plots.saving import ENDINGS, save_figure
from ambkit.show.plots.simulation import simulation_figure
from ambkit.show.plots.training import training_figure

__all__ = [
    "ENDINGS",
    "comparison_figure",
    "filter_figure",
    "identification_figure",
    "lift_off_figure",
    "save_figure",
    "simulation_figure",
    "training_figure",
]
