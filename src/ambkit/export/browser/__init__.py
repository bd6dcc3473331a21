"""The workbench: an interactive page with the C core, without a server."""

from ambkit.export.browser.page import Workbench, workbench_of
from ambkit.export.browser.parameters import axis_parameters, left_out

__all__ = ["Workbench", "axis_parameters", "left_out", "workbench_of"]
