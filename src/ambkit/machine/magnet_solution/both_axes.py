"""Rows and figure of the two-axis map of a radial bearing."""

from __future__ import annotations

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.machine.magnetostatics.two_axis_map import POINTS, TwoAxisMap
from ambkit.result.report import Axis, Figure, Heatmap, Panel
from ambkit.result.row import Row, put

SECTION = ("both axes",)
PLACES = {"centre": 0.0, "half of the ranges": 0.5}
"""Operating points of the stiffnesses, over the maximum current and displacement."""


def both_axes_rows(m: TwoAxisMap) -> list[Row]:
    """Return direct and cross stiffnesses, inductances, and the coupling of the axes."""
    rows: list[Row] = []
    for of, share in PLACES.items():
        place = share * m.ranges
        (k_i, k_s), linked = m.stiffness_at(place), m.linkages_at(place)
        change = 1e-4 * m.ranges[0] * np.eye(4)[0]
        slope = (m.linkages_at(place + change) - m.linkages_at(place - change)) / (2 * change[0])
        values = [
            Row("k_ixx", "k_i, along x by current of x", float(k_i[0, 0]), "N/A"),
            Row("k_ixy", "k_i, along x by current of y", float(k_i[0, 1]), "N/A"),
            Row("k_sxx", "k_s, along x by displacement along x", float(k_s[0, 0]), "N/m"),
            Row("k_sxy", "k_s, along x by displacement along y", float(k_s[0, 1]), "N/m"),
            *(Row(f"flux_linkage_{key}", f"flux linkage of the coils at {side}", float(value), "Wb")
              for key, side, value in zip(("px", "py", "mx", "my"), ("+x", "+y", "-x", "-y"),
                                          linked, strict=True)),
            Row("inductance_xx", "inductance, +x by current of x", float(slope[0]), "H"),
            Row("inductance_yx", "inductance, +y by current of x", float(slope[1]), "H"),
        ]  # fmt: skip
        rows += put(values, section=SECTION, of=of)
    rows += put([Row("coupling_force", "greatest change of a force by the other axis", m.coupling,
                     "N")], section=("magnet",))  # fmt: skip
    error = Row(
        "both_axes_error", f"error of both axes, beside {POINTS} points fitted", m.error, "N"
    )
    return rows + put([error], section=("solution",))


_ALONG = np.array([1.0, 0.0, 1.0, 0.0])[:, None]


def both_axes_figure(name: str, m: TwoAxisMap) -> Figure:
    """Plot the change of the force along x by current and displacement of y."""
    i, y = (r * np.linspace(-1, 1, 61) for r in (m.ranges[1], m.ranges[3]))
    other = np.stack(np.meshgrid(i, y))
    panels = []
    for share in (0.5, 1.0):
        along = share * m.ranges[:, None, None] * np.ones_like(other[:1])
        place = np.stack([along[0], other[0], along[2], other[1]])
        change = m.force_at(place)[0] - m.force_at(place * _ALONG[:, None])[0]
        panels.append(Panel(
            Axis("control current of y", "A"), Axis("displacement along y", "mm", 1e3),
            [Heatmap(i, y, change, Axis("change of the force along x", "N"), diverging=True)],
            title=f"current and displacement of x at {share:.0%} of their range",
        ))  # fmt: skip
    return Figure(
        id="both_axes", title=f"Coupling of the axes of {markdown(name)}",
        caption="Change of the force along x by current and displacement of y.",
        panels=panels, panel_height=2.8,
    )  # fmt: skip
