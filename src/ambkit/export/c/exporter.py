"""Write the folder: the core's files, the data, the thin interface and the self-test."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ambkit import files
from ambkit.errors import AmbkitError
from ambkit.estimators import AdaptiveKalmanFilter, KalmanFilter
from ambkit.export import core
from ambkit.export.c import cost, data, vectors
from ambkit.export.c.cost import Cost
from ambkit.export.c.data import CPrecision
from ambkit.export.tabulate import TabulatedExpert, tabulate
from ambkit.fuzzy import Expert
from ambkit.magnets import Precision, core_module
from ambkit.units import engineering

if TYPE_CHECKING:
    from ambkit._core import Magnet
    from ambkit.bearing import Bearing
    from ambkit.magnets import StiffnessSource

LONGEST_PREFIX = 16
"""Within 31 characters, which C99 promises to tell apart, every exported name stays distinct."""

_CORE_PRECISION: dict[CPrecision, Precision] = {"float": "float32", "double": "float64"}
_BOUNDS: dict[CPrecision, str] = {"float": "1e-3", "double": "1e-9"}
_SUMS = "SHA256SUMS"


class _Kind(NamedTuple):
    """How a magnet of the core is called in C."""

    type: str
    methods: str
    source: str
    about: str


MAGNETS = {
    "Constant": _Kind("amb_stiffness", "amb_constant_magnet", "magnet", "constant stiffnesses"),
    "Law": _Kind("amb_law", "amb_law_magnet", "magnet", "the closed force law"),
    "Table": _Kind("amb_table", "amb_table_magnet", "table", "bilinear stiffness tables"),
    "Fuzzy": _Kind("amb_fuzzy", "amb_fuzzy_magnet", "fuzzy", "the fuzzy expert"),
}
"""The core's magnets by the names of their bindings."""


@dataclass(frozen=True)
class CExport:
    """What was written.

    Attributes
    ----------
    folder : Path
        Where.
    name : str
        Prefix of all its names.
    precision : {"float", "double"}
        Of its numbers.
    files : tuple of str
        Its files, relative to the folder, in alphabetical order.
    sources : tuple of str
        Those that a controller compiles.
    configuration : str
        Hash of all that the estimator was made from.
    table : TabulatedExpert or None
        The table, where the expert is tabulated: its nodes, bound and error.
    cost : Cost or None
        What it costs on a Cortex-M4F, which computes in float and not in double.
    """

    folder: Path
    name: str
    precision: CPrecision
    files: tuple[str, ...]
    sources: tuple[str, ...]
    configuration: str
    table: TabulatedExpert | None
    cost: Cost | None


def export_c(
    bearing: Bearing,
    source: StiffnessSource | None,
    out: str | Path,
    *,
    precision: CPrecision = "float",
    prefix: str | None = None,
    expert_form: Literal["exact", "tabulated"] = "exact",
    force_bound: float | None = None,
    **options: Any,
) -> CExport:
    """Write a folder of C99 that compiles alone.

    Parameters
    ----------
    bearing : Bearing
        What is filtered.
    source : Expert, StiffnessMap, ClosedLaw, ConstantStiffness or None
        What the filter asks for k_i and k_s; None exports the linear filter.
    out : path
        The folder; an older export in it is replaced, anything else in it is not touched.
    precision : {"float", "double"}
        Of the exported numbers.
    prefix : str, optional
        Of all its names; by default the bearing's name.
    expert_form : {"exact", "tabulated"}
        The expert as it is, or as a table, bilinear between its nodes.
    force_bound : float, optional
        How far the table's force may be from the expert's [N]; by default 0.1 % of its largest.
    **options
        Of :class:`ambkit.KalmanFilter`: noise, gravity, frozen_limit.

    Raises
    ------
    AmbkitError
        A prefix that is no C identifier, a folder with other files of the same names, a folder that
        cannot be written; a bound that no table keeps, or that nothing needs.
    """
    name = _checked_prefix(prefix, bearing)
    options["precision"] = _CORE_PRECISION[precision]
    table = None
    if expert_form == "tabulated":
        if not isinstance(source, Expert):
            raise AmbkitError("only an expert can be tabulated; give one, or export the exact form")
        table = tabulate(source, bearing, bound=force_bound, precision=options["precision"])
        source = table
    elif force_bound is not None:
        raise AmbkitError("force_bound is for an expert in tabulated form")
    estimator = (
        KalmanFilter(bearing, **options)
        if source is None
        else AdaptiveKalmanFilter(bearing, source, **options)
    )
    spent = _cost(estimator) if precision == "float" else None
    content = _render(estimator, name, precision, _facts(source, precision) | _cost_facts(spent))
    folder = _write(Path(out), content.files)
    return CExport(
        folder,
        name,
        precision,
        tuple(content.files),
        content.sources,
        content.configuration,
        table,
        spent,
    )


def _facts(source: StiffnessSource | None, precision: CPrecision) -> dict[str, str]:
    """Return what the README says of the filter, line by line."""
    facts: dict[str, str] = {"numbers": precision}
    if isinstance(source, Expert):
        facts["expert"] = f"{len(source.rules)} rules, from {source.source}"
    elif isinstance(source, TabulatedExpert):
        rows, columns = source.k_i.shape
        facts |= {
            "table": f"{rows} x {columns} nodes, displacement x current",
            "bound on its force error": engineering(source.bound, "N"),
            "largest error found": engineering(source.error, "N", digits=3),
        }
    return facts


def _cost(estimator: KalmanFilter) -> Cost:
    magnet = estimator.source.magnet(core_module(estimator.precision))
    return cost.of(type(magnet).__name__, magnet.parameters)


def _cost_facts(spent: Cost | None) -> dict[str, str]:
    """Return what the README says of the cost."""
    if spent is None:
        return {}
    return {
        "instructions a step (Cortex-M4F, in qemu)": f"{spent.instructions}, at most {spent.most}",
        "flash": f"{spent.code} bytes of code, {spent.constants} bytes of constants",
        "memory": f"{spent.state} bytes an instance, {spent.stack} bytes of stack",
        "compiled by": f"{spent.compiler}",
    }


class _Content(NamedTuple):
    files: dict[str, str]
    sources: tuple[str, ...]
    configuration: str


def _render(
    estimator: KalmanFilter, name: str, precision: CPrecision, facts: dict[str, str]
) -> _Content:
    """Return the text of each file by its name."""
    magnet: Magnet = estimator.source.magnet(core_module(estimator.precision))
    kind = MAGNETS[type(magnet).__name__]
    given = kind is MAGNETS["Constant"]  # constants are given, no magnet is asked
    needed = ["src/kalman.c", *([] if given else [f"src/{kind.source}.c"])]
    core_files = {f"core/{file}": text for file, text in core.closure(needed).items()}
    c_files = tuple(file for file in core_files if file.endswith(".c"))
    sources = (f"{name}.c", f"{name}_data.c", *c_files)
    selftest = tuple(f"selftest/{file}" for file in (f"{name}_selftest.c", f"{name}_vectors.c"))
    tested = vectors.make(estimator)
    bearing = estimator.bearing
    context: dict[str, Any] = {
        "name": name,
        "guard": name.upper(),
        "title": f"{estimator.name} for {bearing.name}",
        "bearing": bearing.name,
        "version": version("ambkit"),
        "precision": precision,
        "sampling_time": engineering(bearing.sampling_time, "s"),
        "sources": sources,
        "selftest_sources": ("selftest/main.c", *selftest),
        "bound": _BOUNDS[precision],
        "steps": vectors.STEPS,
        "state_reals": 16,
        "given": given,
        "magnet_header": f"{kind.source}.h",
        "magnet_about": kind.about,
        "facts": {"magnet": kind.about, **facts},
        **_data_context(estimator, magnet, kind, precision),
        "y": data.array(tested.y, precision),
        "u": data.array(tested.u, precision),
        "mean": data.array(tested.estimate.mean, precision),
        "status": data.array(tested.estimate.status, precision),
    }
    context["configuration"] = _configuration(estimator, context, core_files)
    made = {
        f"{name}.h": "filter.h",
        f"{name}.c": "filter.c",
        f"{name}_data.h": "data.h",
        f"{name}_data.c": "data.c",
        f"selftest/{name}_selftest.h": "selftest.h",
        f"selftest/{name}_selftest.c": "selftest.c",
        f"selftest/{name}_vectors.c": "vectors.c",
        "selftest/main.c": "main.c",
        "core/include/ambkit/precision.h": "precision.h",
        "CMakeLists.txt": "CMakeLists.txt",
        "README.md": "README.md",
    }
    templates = _templates()
    texts = core_files | {
        file: templates.get_template(f"{template}.j2").render(context)
        for file, template in made.items()
    }
    return _Content(dict(sorted(texts.items())), sources, context["configuration"])


def _data_context(
    estimator: KalmanFilter, magnet: Magnet, kind: _Kind, precision: CPrecision
) -> dict[str, Any]:
    """Return what the data file says: the structs that the core holds, as initialisers."""
    fields = magnet.parameters
    arrays = data.arrays_of(fields)
    names = {path: path.replace(".", "_") for path in arrays}
    return {
        "kalman": data.struct(estimator.core.parameters, precision, {}),
        "std": data.array(np.asarray(estimator._default_std()), precision),
        "magnet": data.struct(fields, precision, names),
        "magnet_type": kind.type,
        "magnet_methods": kind.methods,
        "arrays": [
            {
                "name": names[path],
                "type": "amb_stiffness" if values.ndim == 2 else "amb_real",
                "length": len(values),
                "text": data.array(values, precision),
            }
            for path, values in arrays.items()
        ],
    }


def _configuration(
    estimator: KalmanFilter, context: dict[str, Any], core_files: dict[str, str]
) -> str:
    """Return 16 hexadecimal digits that change with all that the estimator was made from."""
    digest = hashlib.sha256()
    numbers = ("version", "precision", "kalman", "std", "magnet_type", "magnet")
    parts = [estimator.bearing.to_toml(), *(context[key] for key in numbers)]
    parts += [array["text"] for array in context["arrays"]]
    for part in (*parts, *core_files.values()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]


def _checked_prefix(prefix: str | None, bearing: Bearing) -> str:
    if prefix is None:
        prefix = re.sub(r"\W", "_", bearing.name, flags=re.ASCII)[:LONGEST_PREFIX]
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        raise AmbkitError(f'prefix must be a C identifier, a letter first, is "{prefix}"')
    if len(prefix) > LONGEST_PREFIX:
        raise AmbkitError(
            f'prefix must have at most {LONGEST_PREFIX} characters, "{prefix}" has {len(prefix)}'
        )
    if prefix.startswith("amb_"):
        raise AmbkitError('prefix must not start with "amb_", as the names of the core do')
    return prefix


def _templates() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,
    )


def _write(folder: Path, texts: dict[str, str]) -> Path:
    """Write all files, and take away those of an older export that are no longer there."""
    files.make_folder(folder)
    sums = folder / _SUMS
    older = _named_in(files.read_text(sums)) if sums.exists() else set()
    foreign = [name for name in texts if name not in older and (folder / name).exists()]
    if foreign:
        raise AmbkitError(f"{folder / foreign[0]} is there already, and not from an export")
    for name, text in texts.items():
        files.make_folder((folder / name).parent)
        files.write_text(folder / name, text)
    lines = [f"{hashlib.sha256(text.encode()).hexdigest()}  {name}" for name, text in texts.items()]
    files.write_text(sums, "\n".join(lines) + "\n")
    for name in older - set(texts):
        (folder / name).unlink(missing_ok=True)
    return folder


def _named_in(sums: str) -> set[str]:
    """Return the files that a list of checksums names; none that leads out of its folder."""
    names = {line.partition("  ")[2] for line in sums.splitlines()}
    return {n for n in names if n and not Path(n).is_absolute() and ".." not in Path(n).parts}
