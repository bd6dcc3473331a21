"""``ambkit export fmu``: an FMU around the library's own C, for FMI 2.0 and 3.0.

``c/`` holds what is written by hand: a model is a table of variables and six functions
(``model.h``), an instance of it knows modes, time and state (``instance.h``), and ``fmi2.c`` and
``fmi3.c`` translate the standard's calls. ``standard/`` holds the standard's own headers.
"""

from ambkit.export.fmu.exporter import FmuExport, export_fmu
from ambkit.export.fmu.ssp import export_ssp

__all__ = ["FmuExport", "export_fmu", "export_ssp"]
