"""Chapter 3: the LSM machine (paper, eq. 26-31, Fig. 3, 7, Tables 4 and 5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from ambkit.identification.online.adaline import Adaline
from ambkit.machine import paper
from ambkit.machine.stiffness import ForceFunction, stiffness_map
from ambkit.result.report import Axis, Figure, Heatmap, Panel
from ambkit.result.report.blocks import Chapter, Equation, FigureBlock, TableBlock, Text
from paper.printed import MISPRINTS
from paper.study import CURRENT, POSITION, SEEDS, Part, Study, agrees, row
from paper.tables import stiffness_csv

Array = NDArray[np.float64]

LIMIT = 0.01  # in the paper's units, N/A and N/mm: one digit of its last place


def lsm(study: Study) -> Part:
    """Identify the 25 operating points, and put them beside Tables 4 and 5."""
    result = study.map
    off_i = _deviation(result.k_i, paper.table4(), "table4")
    off_s = _deviation(result.k_s, paper.table5(), "table5") / 1e3
    wrong = MISPRINTS[0]
    ours_there = float(result.k_i[wrong.row, wrong.column])

    # The same machine on what was identified, and on a measured map instead of a law.
    (off_k,) = study.over_seeds(lambda seed: (_identified(study, seed),))
    from_table = stiffness_map(study.bearing, force=_force_table(study))
    off_table = 100 * float(np.max(np.abs(from_table.k_i / result.k_i - 1)))
    return Part(
        Chapter(
            id="lsm",
            title="The LSM machine: stiffnesses at 25 operating points",
            lead="Around each operating point the force is evaluated nine times, and a plane "
            "through the origin is fitted to the values.",
            blocks=[
                FigureBlock(_figure_force(study)),
                Text("The paper's Fig. 7 shows the data flow: the identified k gives the "
                     "force law, which is evaluated at an operating point and one step around "
                     "it, and two stiffnesses are fitted to these values by least squares."),
                Equation(r"\theta = (A^T A)^{-1} A^T Y", "eq. 31"),
                Text("The columns of A are the absolute currents and displacements of the nine "
                     "points, and there is no column of ones. So k_i and k_s are not the slopes of "
                     "the force: along the ray through the origin they give the force itself, "
                     "across it the slope. That is what a filter without an affine term needs "
                     "(eq. 17), and it is why the tables are not symmetric about their middle."),
                _table("table4", "Identified $k_i$ [N/A]", result.k_i, paper.table4(), 1.0),
                _table("table5", "Identified $k_s$ [N/mm]", result.k_s, paper.table5(), 1e3),
                Text("The machine accepts any force function. With the k that ADALINE "
                     "identifies under noise, all stiffnesses have the relative error of k: "
                     f"{np.sqrt(np.mean(off_k**2)):.2f} % rms over {SEEDS} seeds, "
                     f"{np.abs(off_k).max():.2f} % in the worst case. With the force taken "
                     "from a table of 13 x 13 measured points instead of the law, they differ "
                     f"by {off_table:.2f} % at most."),
            ],
        ),
        [
            row("table4.deviation", "Tables 4 and 5: k_i, greatest deviation",
                0.0,
                off_i, "N/A", agrees(off_i <= LIMIT)),
            row("table5.deviation", "Tables 4 and 5: k_s, greatest deviation",
                0.0, off_s,
                "N/mm", agrees(off_s <= LIMIT)),
            row("table4.misprint", "Tables 4 and 5: k_i at 0.5 mm, 0.75 A",
                wrong.printed, ours_there,
                "N/A", "misprint"),
        ],
        {
            "table4.csv": stiffness_csv(result.current, result.displacement, result.k_i),
            "table5.csv": stiffness_csv(result.current, result.displacement, result.k_s / 1e3),
        },
    )  # fmt: skip


def _identified(study: Study, seed: int) -> float:
    """Error of the k that ADALINE finds from half of it [%]."""
    truth = study.bearing.magnet.magnet_constant
    record = study.run(study.scenario(0.5e-3, seed=seed)).record
    return 100 * (Adaline(study.bearing, start=0.5 * truth).run(record).magnet_constant / truth - 1)


def _deviation(ours: Array, printed: Array, table: str) -> float:
    """Largest difference from the paper's table, the misprinted entries left out."""
    off = np.abs(ours - printed)
    for wrong in MISPRINTS:
        if wrong.table == table:
            off[wrong.row, wrong.column] = 0.0
    return float(off.max())


def _table(id: str, title: str, ours: Array, printed: Array, unit: float) -> TableBlock:
    """Ours and the paper's, entry by entry."""
    rows = [
        [f"{x * 1e3:g}", *(f"{a / unit:.2f} ({p / unit:.2f})" for a, p in zip(o, q, strict=True))]
        for x, o, q in zip(paper.DISPLACEMENTS, ours, printed, strict=True)
    ]
    return TableBlock(
        id=id,
        title=f"{title}, in brackets as the paper prints it",
        headers=["$x$ [mm] \\ $i_u$ [A]", *(f"{i:g}" for i in paper.CURRENTS)],
        rows=rows,
        highlight={(m.row, m.column + 1): m.why for m in MISPRINTS if m.table == id},
        source=f"paper, Table {id[-1]}",
    )


def _force_table(study: Study) -> ForceFunction:
    """A map as a rig would give it: the force at 13 x 13 points, a little beyond the box."""
    iu = np.linspace(study.map.current[0] - 0.05, study.map.current[-1] + 0.05, 13)
    x = 1.05 * np.linspace(study.map.displacement[0], study.map.displacement[-1], 13)
    currents, displacements = np.meshgrid(iu, x)
    forces = study.law.force(currents, displacements)
    grid = RegularGridInterpolator(
        (x, iu), forces, method="cubic", bounds_error=False, fill_value=None
    )
    return lambda iu, x: grid((x, iu))


def _figure_force(study: Study) -> Figure:
    iu = np.linspace(study.map.current[0], study.map.current[-1], 61)
    x = np.linspace(study.map.displacement[0], study.map.displacement[-1], 41)
    currents, displacements = np.meshgrid(iu, x)
    force = study.law.force(currents, displacements)
    straight = study.constant.k_i * currents + study.constant.k_s * displacements
    return Figure(
        id="fig03",
        title="The nonlinear force of the magnet, and the error of its linearisation",
        source="paper, Fig. 3 and eq. 6",
        caption="Left: the force law over the box. Right: the error of the constant "
                "stiffnesses of the origin. It is zero in the middle, and a third of the "
                "force in the corners where current and displacement have the same sign.",
        panels=[
            Panel(CURRENT, POSITION, [
                Heatmap(iu, x, force, Axis("force", "N"), diverging=True)], title="force"),
            Panel(CURRENT, POSITION, [
                Heatmap(iu, x, straight - force, Axis("error", "N"), diverging=True, zero=False)],
                title="constant linearisation less force"),
        ],
        columns=2,
    )  # fmt: skip
