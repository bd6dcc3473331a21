"""Exports of a kind of filter of a machine, made as tests name it: magnet, kind or file."""

from pathlib import Path
from typing import Any

from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.registry import KINDS
from ambkit.export import c, fmu, mat
from ambkit.export import pil as loop
from ambkit.export.pil import Pil
from ambkit.export.stiffness_table import tabulate
from ambkit.workflow.diagnose import distinguished

CORE_PRECISION: dict[str, Any] = {"float": "float32", "double": "float64"}
OF_EXPORT = ("prefix", "loops", "editable", "scenario", "calibrated", "telemetry", "force")


def made(
    machine: Any, magnet: Any = None, *, kind: str | None = None, precision: str = "float",
    expert_form: str = "exact", force_bound: float | None = None,
    filter_file: FilterFile | None = None, **options: Any,
) -> Estimator:  # fmt: skip
    """The filter that is exported."""
    of: Any = CORE_PRECISION[precision]
    if filter_file is not None:
        return filter_file.make(precision=of, magnet=magnet)
    if expert_form == "tabulated":
        magnet = tabulate(magnet, machine, bound=force_bound, precision=of)
    usual = "linear" if magnet is None else "adaptive"
    return KINDS[kind or usual].make(machine, magnet, precision=of, **options)


def export_c(machine: Any, magnet: Any, out: Path | str, **options: Any) -> c.CExport:
    of_export = {name: options.pop(name) for name in OF_EXPORT if name in options}
    faults = options.pop("faults", False)
    filter = made(machine, magnet, **options)
    distinction = distinguished(machine, filter) if faults else None
    return c.export_c(machine, filter, out, distinction=distinction, **of_export)


def export_fmu(
    machine: Any, magnet: Any, out: Path | str, *, filter: str | None = None,
    precision: str = "double", **options: Any,
) -> fmu.FmuExport:  # fmt: skip
    return fmu.export_fmu(
        machine, made(machine, magnet, kind=filter, precision=precision), out, **options
    )


def export_ssp(
    machine: Any, magnet: Any, out: Path | str, **options: Any
) -> tuple[fmu.FmuExport, ...]:
    return fmu.export_ssp(machine, made(machine, magnet, precision="double"), out, **options)


def export_mat(machine: Any, expert: Any, out: Path | str, **options: Any) -> dict[str, Any]:
    return mat.export_mat(machine, made(machine, expert, precision="double"), out, **options)


def pil(machine: Any, *, filter_file: FilterFile | None = None, **options: Any) -> Pil:
    return loop.pil(machine, made(machine, filter_file=filter_file), **options)
