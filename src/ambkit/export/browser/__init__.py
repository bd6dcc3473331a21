"""The workbench: a machine in a page that moves, without a server, and computes with the C core."""

from ambkit.export.browser.axis import axis_parameters, left_out
from ambkit.export.browser.page import Workbench, workbench_of

__all__ = ["Workbench", "axis_parameters", "left_out", "workbench_of"]
