"""``ambkit export c``: a folder of C99 that compiles alone.

The folder holds the core's own files (``core/``), one data file for this bearing and this filter
(``NAME_data.c``), the thin ``NAME.h`` and ``NAME.c`` with ``NAME_init``, ``NAME_step`` and
``NAME_reset``, a self-test, and what is needed to build and understand it. See ``README.md`` beside
this module for the layout.
"""

from ambkit.export.c.cost import CYCLES_PER_INSTRUCTION, Cost
from ambkit.export.c.exporter import CExport, FilterCost, export_c, filter_cost

__all__ = ["CYCLES_PER_INSTRUCTION", "CExport", "Cost", "FilterCost", "export_c", "filter_cost"]
