"""What else the paper prints: where its training starts, and what its own tables contradict."""

from __future__ import annotations

from typing import Final, NamedTuple

INITIAL_WIDTH: Final = 0.4
"""Width of every rule before training, an ampere weighing as much as a millimetre (Table 6)."""


class Misprint(NamedTuple):
    """An entry of a table that the table itself contradicts."""

    table: str
    row: int
    column: int
    printed: float
    meant: float
    why: str


MISPRINTS: Final = (
    Misprint(
        table="table4",
        row=4,
        column=3,
        printed=8.45,
        meant=8.47,
        why="the force law is symmetric: F(-iu, -x) = -F(iu, x), so (0.5 mm, 0.75 A) has the "
        "k_i of its mirror image (-0.5 mm, -0.75 A), 8.47 N/A",
    ),
)
