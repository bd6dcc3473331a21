"""``ambkit export fmu``: an FMU around the library's own C, for FMI 2.0 and 3.0.

``c/`` is written by hand: a model is a table of variables and six functions (``model.h``), an
instance has modes, time and state (``instance.h``), and ``fmi2.c`` and ``fmi3.c`` translate the
standard's calls. ``standard/`` has the standard's headers.
"""

from ambkit.export.fmu.exporter import FmuExport, export_fmu, export_ssp

__all__ = ["FmuExport", "export_fmu", "export_ssp"]
