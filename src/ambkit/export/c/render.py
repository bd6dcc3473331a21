"""The text of each file: the core's own, the data, the thin interface and the self-test."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ambkit.base import escaping
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.registry import PAPER, InCore
from ambkit.export import core
from ambkit.export.c import (
    calibration,
    control,
    control_scenes,
    data,
    data_file,
    model,
    proof,
    selftest,
    telemetry,
    vectors,
)
from ambkit.export.c.data import MAGNETS, CPrecision, Kind
from ambkit.machine.bearing import FILES
from ambkit.machine.machine import Machine
from ambkit.simulation.control import bound_of, settling_of

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.simulation.control import Controller
    from ambkit.simulation.scenario import Scenario

_BOUNDS: dict[CPrecision, str] = {"float": "1e-3", "double": "1e-9"}
_PROVED = (
    "Whatever NAME_step and NAME_reset are given, NaN and infinities included, and however often: "
    "no access beyond an object, no read of what was not written, no division by zero, no "
    "overflow, no other undefined behaviour of C99; and every number in the estimates is finite. "
    "Shown by abstract interpretation (Frama-C Eva), for these constants."
)
_BOUNDS_OF_MACHINES: dict[CPrecision, str] = {"float": "2e-2", "double": "1e-7"}
"""More is added up: 36 states make 8e-9 of what gcc and clang round otherwise by contraction."""


class Content(NamedTuple):
    """An export before it is written."""

    files: dict[str, str]  # text of each file by its name
    sources: tuple[str, ...]  # what a controller compiles
    configuration: str  # hash of all that it was made from


def render(
    estimator: Estimator,
    name: str,
    precision: CPrecision,
    facts: dict[str, str],
    *,
    loops: bool | None = None,
    editable: bool = False,
    controller: Controller | None = None,
    scenario: Scenario | None = None,
    calibrated: bool = False,
    framed: bool = False,
) -> Content:
    """Write all texts."""
    if editable and not estimator.engine.built_in:
        raise AmbkitError(
            "editable is for the paper's axis: of other models C has the matrices, and not what "
            "they were made from"
        )
    magnets = data_file.magnets_of(estimator)
    magnet, kinds = magnets[0], [MAGNETS[type(each).__name__] for each in magnets]
    kind = kinds[0]
    called = data.called(estimator)
    whole = estimator.whole is not None
    # Whose step goes through the interface.
    one = None if whole else controller
    in_core = None if called is PAPER and not whole and controller is None else called
    # The paper's filter is given its constants, and asks no magnet.
    given = in_core is None and kind is MAGNETS["Constant"]
    needed = ["src/kalman.c", "src/envelope.c", "src/at_rest.c"]
    needed += ["include/ambkit/crc.h", "include/ambkit/root.h"]
    needed += [] if given else [f"src/{each.source}.c" for each in kinds]
    if in_core is not None:
        needed += [f"src/{stem}.c" for stem in ("estimator", in_core.source, *in_core.calls)]
        inner = getattr(estimator, "inner", None)
        if inner is not None:
            needed += [f"src/{data.called(inner).source}.c"]
    speeds = None
    if scenario is not None and estimator.whole is not None:
        speeds = control_scenes.speeds_of(estimator.whole.machine, scenario)
    of_model = model.in_c(estimator, loops=loops, speeds=speeds)
    needed += [*of_model.sources, *(control.SOURCES if controller is not None else ())]
    needed += calibration.SOURCES if calibrated else ()
    needed += telemetry.SOURCES if framed else ()
    flown: dict[str, Any] = {}
    if controller is not None and scenario is not None:
        flown = control.context(controller, scenario, name, precision)
    found = core.closure(needed, instead=of_model.instead)
    core_files = {f"core/{file}": text for file, text in found.items()}
    c_files = tuple(file for file in core_files if file.endswith(".c"))
    more = ("_telemetry",) if framed else ()
    changed = ("_calibration",) if calibrated else ("_control",) if whole and flown else ()
    sources = (*(f"{name}{file}.c" for file in ("", *changed, "_data", *more)), *c_files)
    beside = ("control_selftest", "control_vectors") if whole and flown else ()
    of_test = ("selftest", "vectors", *beside)
    tests = tuple(f"selftest/{name}_{file}.c" for file in of_test)
    settling, bound = settling_of(estimator), bound_of(estimator)
    if one is None:
        tested = vectors.make(estimator, magnets, settling=settling, bound=bound)
        told = selftest.context(tested, estimator, precision)
    else:
        told = {key: flown["in_flight"][key] for key in ("runs", "coverage")}
    bearing = estimator.bearing
    base = "" if in_core is None else in_core.base
    context: dict[str, Any] = {
        "name": name,
        "guard": name.upper(),
        "title": f"{estimator.name} for {bearing.name}",
        "bearing": bearing.name,
        "version": version("ambkit"),
        "precision": precision,
        "sampling_time": engineering(bearing.sampling_time, "s"),
        "several": data_file.several(estimator, magnets, kinds, precision) if whole else None,
        "y_given": "const amb_real y[AMB_SENSORS]" if whole else "amb_real y",
        "u_given": "const amb_real u_previous[AMB_CONTROLS]" if whole else "amb_real u_previous",
        "sources": sources,
        "calibrated": calibrated,
        "bit_headers": _bit_headers(core_files, alone=one is None),
        "cast_sources": _casts(
            kind,
            in_core,
            given,
            calibrated=calibrated,
            flown=controller is not None,
        ),
        "selftest_sources": ("selftest/main.c", *tests),
        "bound": (_BOUNDS_OF_MACHINES if whole else _BOUNDS)[precision],
        **{key: told[key] for key in told if key != "arrays"},
        "flown": None if one is None else flown,
        "controller": None,
        "base_of_calibration": None,
        "misra_defines": "-DFLT_MANT_DIG=24" if precision == "float" else "-DDBL_MANT_DIG=53",
        "given": given,
        "in_core": in_core,
        "built_in": estimator.engine.built_in,
        "single": estimator.machine.single,
        "strict": in_core is None and estimator.engine.built_in,
        "magnet_header": f"{kind.source}.h",
        "magnet_about": _about(kinds),
        "sampled": _sampled(estimator),
        "assumed": _assumed(estimator),
        "inputs": {
            "y": data_file.raw("y", estimator.inputs.y, precision),
            "u": data_file.raw("u", estimator.inputs.u, precision),
        },
        "facts": {
            **_assumed(estimator),
            "magnet": _about(kinds),
            "between samples": _sampled(estimator),
            **facts,
        },
        "room": of_model.room,
        "symbols": core.external_names(),
        "tag": precision[0] + core.hashed(*map(str, of_model.instead.values()), str(of_model.room)),
        "states": model.states(
            estimator.states, "" if whole else data_file.hover(estimator, precision)
        ),
        "diagonal": vectors.diagonal(len(estimator.states)),
        "shown": selftest.first(estimator, "sensor"),
        "load": selftest.first(estimator, "disturbance force"),
        **selftest.of_roles(estimator),
        **selftest.stops_in_c(estimator, precision),
        "base": base,
        "covariance": (in_core.covariance if in_core else "") or f"{base}cov",
        **data_file.data_context(estimator, magnet, kind, precision, of_model, editable=editable),
        "controlled": whole and bool(flown),
        "turning": _turning(of_model, speeds, precision),
        "speed_own": data.number(bearing.speed, precision) if whole else "",
        **flown,
        "editable": editable,
        "framed": framed,
        "as_printed": estimator.engine.as_printed,
        "mass": "" if whole else data.number(bearing.rotor.mass, precision),
        "own": "" if in_core is None else data.own(estimator, precision),
        "settling": settling,
        "bound_of_output": f"{bound:.1f}",
        "crc": data_file.crc(
            estimator,
            name,
            precision,
            of_model,
            editable=editable,
            flown=controller,
            calibrated=calibrated,
        ),
        "proof_sentence": _PROVED.replace("NAME", name)
        if one is None
        else _PROVED.replace("NAME_reset", "NAME_take_over")
        .replace("the estimates", "the output")
        .replace("NAME", name),
    }
    # Of machines nothing is proved, nor of what can be calibrated; and nothing is said.
    shown = not whole and not calibrated
    context["proof"] = proof.context(estimator, context, core_files, one) if shown else None
    context["control_unit"] = estimator.machine.control_unit
    for each, si in (("y", "m"), ("u", context["control_unit"])):
        context[f"{each}_unit"] = context["inputs"][each]["unit"] if context["inputs"][each] else si
    context["inputs_text"] = repr(context["inputs"])
    if calibrated and one is not None:
        context["base_of_calibration"] = calibration.context(one, name, precision)
    context["configuration"] = _configuration(estimator, context, core_files)
    context["frame"] = telemetry.frame(
        estimator.states,
        context["states"],
        context["several"]["readings"] if whole else (),
        None if one is None else one.coils,
        context["control_unit"],
    )
    made = {
        f"{name}.h": "filter.h",
        f"{name}.c": "filter.c" if in_core is None else "estimator.c",
        f"{name}_data.h": "data.h",
        f"{name}_data.c": "data.c",
        f"selftest/{name}_selftest.h": "selftest.h",
        f"selftest/{name}_selftest.c": "selftest.c",
        f"selftest/{name}_vectors.c": "vectors.c",
        "selftest/main.c": "main.c",
        "core/include/ambkit/precision.h": "precision.h",
        "CMakeLists.txt": "CMakeLists.txt",
        "README.md": "README.md",
        "misra.txt": "misra.txt",
        "selftest/COVERAGE.md": "COVERAGE.md",
    }
    if shown:
        made |= {file.format(name): template for file, template in proof.TEMPLATES.items()}
    if controller is not None:
        more_files = calibration.TEMPLATES if calibrated else {}
        of = f"{name}_control" if whole else name
        made |= {file.format(of): template for file, template in control.TEMPLATES.items()}
        made |= {file.format(name): template for file, template in more_files.items()}
        made |= {} if whole else {"README.md": "control.md"}
        if calibrated and one is not None:
            described = calibration.described(one, name, precision)
            core_files |= {"calibration.json": described}
    if framed:
        made |= {file.format(name): template for file, template in telemetry.TEMPLATES.items()}
        T = estimator.bearing.sampling_time
        of_frame = (name, context["configuration"], T, context["frame"])
        core_files |= {"telemetry.json": telemetry.described(*of_frame)}
    templates = _templates()
    texts = core_files | {
        file: templates.get_template(f"{template}.j2").render(context)
        for file, template in made.items()
    }
    return Content(dict(sorted(texts.items())), sources, context["configuration"])


def _turning(
    of_model: model.InC, speeds: tuple[float, float] | None, precision: CPrecision
) -> dict[str, Any] | None:
    """Return what the files say of a model that follows the speed of rotation."""
    fields = of_model.turning
    if fields is None or speeds is None:
        return None
    slowest, fastest = (f"{each:.6g}" for each in speeds)
    return {
        "numbers": fields["numbers"],
        "text": data.struct(fields, precision, {}),
        "slowest": slowest,
        "fastest": fastest,
    }


def _sampled(estimator: Estimator) -> str:
    """Say which model of a sample it predicts with."""
    if estimator.engine.as_printed:
        return "position held (eq. 19 as the paper prints it): estimates are ahead of the rotor"
    return estimator.predicts


def _assumed(estimator: Estimator) -> dict[str, str]:
    """Say what it assumes of the noise, and where each number came from."""
    shown = {
        "measurement": ("noise of the measurement, R", "m^2"),
        "control": ("noise of the control signal", f"{estimator.machine.control_unit}^2"),
        "disturbance": ("growth of the disturbance force's variance, Q", "N^2/s"),
    }
    said = {}
    for name, value in estimator.variances._asdict().items():
        what, unit = shown[name]
        origin = estimator.origin.get(f"noise.{name}")
        values = value if isinstance(value, tuple) else (value,)
        shown_values = ", ".join(dict.fromkeys(f"{each:.6g}" for each in values))
        said[what] = f"{shown_values} {unit}" + (f" ({origin})" if origin else "")
    return said


def _about(kinds: list[Kind]) -> str:
    return ", ".join(dict.fromkeys(kind.about for kind in kinds))


def _casts(
    kind: Kind, in_core: InCore | None, given: bool, *, flown: bool, calibrated: bool
) -> tuple[str, ...]:
    """Return the files that cast from ``void *``, which MISRA C advises against."""
    stems = [] if given else [kind.source]
    if in_core is not None:
        stems += ["estimator", *in_core.casts, *(["control"] if flown else [])]
        stems += ["calibration"] if calibrated else []
    return tuple(f"core/src/{stem}.c" for stem in sorted(stems))


def _bit_headers(core_files: dict[str, str], *, alone: bool) -> list[str]:
    """Return the headers in flight that look at a number's bits; `alone`: of a filter alone."""
    # A filter tells standard deviations; of a controller perhaps its self-test alone takes a root.
    root = alone or any('"ambkit/root.h"' in text for text in core_files.values())
    names = ("/exponential.h", "/crc.h", *(["/root.h"] if root else []))
    return [file for file in core_files if file.endswith(names) and "/include/" in file]


def _configuration(
    estimator: Estimator, context: dict[str, Any], core_files: dict[str, str]
) -> str:
    """Return 16 hexadecimal digits that change with all that the estimator was made from."""
    digest = hashlib.sha256()
    numbers = (
        "version", "precision", "inputs_text", "kalman", "std", "magnet_type", "magnet", "own",
        "title",
    )  # fmt: skip
    parts = [_described(estimator.bearing), *(context[key] for key in numbers)]
    if context["several"]:
        parts.append(repr(context["several"]))
    parts += [array["text"] for array in context["arrays"]]
    if context["controller"]:
        parts += [repr(context[key]) for key in ("controller", "times", "turning", "in_flight")]
    for part in (*parts, *core_files.values()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]


def _described(bearing: Machine) -> str:
    """Return the description of a bearing or a machine without the folders of its files."""
    text = bearing.to_toml()
    of = bearing.bearings
    for path in filter(None, (getattr(each.magnet, key) for each in of for key in FILES)):
        text = text.replace(path, Path(path).name)
    return text


@cache
def _templates() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # that is for HTML; what others wrote passes a filter
    )
    environment.filters |= escaping.FILTERS
    return environment
