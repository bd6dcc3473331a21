"""``ambkit export c``: a self-contained folder of C99; see ``README.md`` beside this."""

from ambkit.export.c.cost import CYCLES_PER_INSTRUCTION, Cost
from ambkit.export.c.exporter import CExport, FilterCost, export_c, filter_cost

__all__ = ["CYCLES_PER_INSTRUCTION", "CExport", "Cost", "FilterCost", "export_c", "filter_cost"]
