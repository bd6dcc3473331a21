"""Text of each file: the core's own, the data, the thin interface and the self-test."""

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ambkit.base import escaping
from ambkit.base.units import engineering
from ambkit.control.controller_states import bound_of, settling_of
from ambkit.estimate.estimator import Estimator
from ambkit.export import core_sources
from ambkit.export.c import (
    c_literals,
    calibration,
    control,
    exported,
    faults,
    model,
    proof,
    rebuilt,
    telemetry,
    test_vectors,
)
from ambkit.export.c.c_literals import CPrecision
from ambkit.export.c.exported import Export
from ambkit.machine.machine import Machine
from ambkit.machine.parts import FILES

_BOUNDS: dict[CPrecision, str] = {"float": "1e-3", "double": "1e-9"}
_PROVED = (
    "Whatever NAME_step and NAME_reset are given, NaN and infinities included, and however often: "
    "no access beyond an object, no read of what was not written, no division by zero, no "
    "overflow, no other undefined behaviour of C99; and every number in the estimates is finite. "
    "Shown by abstract interpretation (Frama-C Eva), for these constants."
)
_BOUNDS_OF_MACHINES: dict[CPrecision, str] = {"float": "2e-2", "double": "1e-7"}
"""Sums are longer: with 36 states contraction of gcc and clang differs by 8e-9."""


class Content(NamedTuple):
    """Content of an export before it is written."""

    files: dict[str, str]  # text of each file by name
    sources: tuple[str, ...]  # files that a controller compiles
    configuration: str  # hash of everything that determines it


def render(export: Export) -> Content:
    """Render all texts."""
    context = _context(export)
    described = {}
    if export.calibrated and export.controller is not None:
        calibration_json = calibration.described(export.controller, export.name, export.precision)
        described["calibration.json"] = calibration_json
    if export.framed:
        T = export.filter.machine.sampling_time
        of_frame = (export.name, context["configuration"], T, context["frame"])
        described["telemetry.json"] = telemetry.described(*of_frame)
    templates = escaping.templates(Path(__file__).parent / "templates")
    texts = (
        export.core_files
        | described
        | {
            file: templates.get_template(f"{template}.j2").render(context)
            for file, template in _made(export).items()
        }
    )
    return Content(dict(sorted(texts.items())), export.sources, context["configuration"])


def _made(export: Export) -> dict[str, str]:
    """Return the files to write, and their templates."""
    name = export.name
    made = {
        f"{name}.h": "filter.h",
        f"{name}.c": "filter.c" if export.in_core is None else "estimator.c",
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
    # Nothing is proved with changes by another task.
    more = [] if export.calibrated or export.rebuilt else [(name, proof.TEMPLATES)]
    if export.controller is not None:
        more.append((f"{name}_control" if export.several else name, control.TEMPLATES))
        more += [(name, calibration.TEMPLATES)] if export.calibrated else []
        more += [] if export.several else [(name, {"README.md": "control.md"})]
    more += [(name, telemetry.TEMPLATES)] if export.framed else []
    more += [(name, rebuilt.TEMPLATES)] if export.rebuilt else []
    more += [(name, faults.TEMPLATES)] if export.distinction else []
    for of, templates in more:
        made |= {file.format(of): template for file, template in templates.items()}
    return made


def _context(export: Export) -> dict[str, Any]:
    """Return the template variables."""
    filter, name, precision, one = export.filter, export.name, export.precision, export.one
    context = {
        "controller": None,
        "base_of_calibration": None,
        "flown": None if one is None else export.controller_context,
        **_names(export),
        **_tested(export),
        **_numbers(export),
        **export.controller_context,
        "controlled": export.beside,
        "crc": exported.crc(export),
    }  # fmt: skip
    changes = export.calibrated or export.rebuilt
    context["proof"] = None if changes else proof.context(export, context)
    context["isolation"] = faults.context(export) if export.distinction else None
    context["rebuilt"] = rebuilt.context(export) if export.rebuilt else None
    context["keeps"] = bool(context["turning"] or export.rebuilt)
    own = f"&{name}_kalman"
    context["kalman_at"] = (
        "&state->kf" if export.editable or context["turning"]
        else f"(state->by != NULL) ? state->by->kf : {own}" if export.rebuilt
        else own
    )  # fmt: skip
    if export.calibrated and export.controller is not None:
        context["base_of_calibration"] = calibration.context(export.controller, name, precision)
    context["configuration"] = _configuration(filter, context, export.core_files)
    context["frame"] = telemetry.frame(export, context["states"])
    return context


def _names(export: Export) -> dict[str, Any]:
    """Return words and files for the templates."""
    filter, name, in_core = export.filter, export.name, export.in_core
    machine, several, base = filter.machine, export.several, in_core.base if in_core else ""
    assumed = _assumed(filter)
    magnets = ", ".join(dict.fromkeys(kind.about for kind in export.kinds))
    sampled = filter.predicts
    if filter.engine.as_printed:
        sampled = "position held (eq. 19 as the paper prints it): estimates are ahead of the rotor"
    proved = _PROVED
    if export.controller is not None:
        proved = _PROVED.replace("NAME_reset", "NAME_transfer")
        proved = proved.replace("the estimates", "the output")
    if export.beside:
        proved = proved.replace("NAME_", "NAME_control_")
    of_files = [*map(str, export.of_model.instead.values()), str(export.of_model.room)]
    return {
        "name": name,
        "guard": name.upper(),
        "title": f"{filter.name} for {machine.name}",
        "bearing": machine.name,
        "version": version("ambkit"),
        "y_given": "const amb_real y[AMB_SENSORS]" if several else "amb_real y",
        "u_given": "const amb_real u_previous[AMB_CONTROLS]" if several else "amb_real u_previous",
        "sources": export.sources,
        "calibrated": export.calibrated,
        "bit_headers": _bit_headers(export.core_files, filter_only=export.one is None),
        "cast_sources": _sources_with_casts(export),
        "selftest_sources": export.tests,
        "constant_stiffness": export.constant_stiffness,
        "in_core": in_core,
        "built_in": filter.engine.built_in,
        "strict": in_core is None and filter.engine.built_in,
        "magnet_header": f"{export.kinds[0].source}.h",
        "magnet_about": magnets,
        "sampled": sampled,
        "assumed": assumed,
        "facts": assumed | {"magnet": magnets, "between samples": sampled} | export.facts,
        "symbols": core_sources.external_names(),
        "tag": export.precision[0] + core_sources.hashed(*of_files),
        "base": base,
        "covariance": (in_core.covariance if in_core else "") or f"{base}cov",
        "editable": export.editable,
        "framed": export.framed,
        "as_printed": filter.engine.as_printed,
        "proof_sentence": proved.replace("NAME", name),
    }


def _tested(export: Export) -> dict[str, Any]:
    """Return the template variables of the self-test."""
    filter, precision = export.filter, export.precision
    settling, bound = settling_of(filter), bound_of(filter)
    searched = None
    if export.one is None:
        more = [faults.test_case(filter)] if export.distinction else []
        tested = test_vectors.make(
            filter, export.magnets, settling=settling, bound=bound, more=more
        )
        test_data = test_vectors.context(tested, filter, precision)
        searched = faults.tested(export, tested.si) if export.distinction else None
    else:
        test_data = {
            key: export.controller_context["levitated"][key] for key in ("runs", "coverage")
        }
        searched = faults.of_controller(export) if export.distinction else None
    return {
        "bound": (_BOUNDS_OF_MACHINES if export.several else _BOUNDS)[precision],
        **test_data,
        "searched": searched,
        "diagonal": test_vectors.diagonal(len(filter.states)),
        "shown": test_vectors.first(filter, "sensor"),
        "load": test_vectors.first(filter, "disturbance force"),
        **test_vectors.of_roles(filter),
        **test_vectors.stops_in_c(filter, precision),
        "stiff": test_vectors.stiff(filter, export.magnets[0]),
        "settling": settling,
        "bound_of_output": f"{bound:.1f}",
    }


def _numbers(export: Export) -> dict[str, Any]:
    """Return the constants, and the units of the inputs."""
    filter, precision, several = export.filter, export.precision, export.several
    machine, unit = filter.machine, filter.machine.control_unit
    magnet = exported.magnets_in_c(export)[0]
    inputs = {item: exported.raw(item, getattr(filter.inputs, item), precision) for item in "yu"}
    units = {"y": "m", "u": unit} | {item: of["unit"] for item, of in inputs.items() if of}
    current_text = "" if several else exported.levitation_current(filter, precision)
    return {
        "precision": precision,
        "sampling_time": engineering(machine.sampling_time, "s"),
        "several": exported.several(export) if several else None,
        "misra_defines": " ".join(
            ["-DFLT_MANT_DIG=24"] * (precision == "float")
            + ["-DDBL_MANT_DIG=53"] * (precision == "double" or export.rebuilt)
        ),
        "inputs": inputs,
        "inputs_text": repr(inputs),
        "control_unit": unit,
        **{f"{item}_unit": of for item, of in units.items()},
        "room": export.of_model.room,
        "states": model.states(filter.states, current_text),
        "kalman": c_literals.struct_with_arrays(export.kalman, precision),
        "std": c_literals.array(np.asarray(filter.default_std()), precision),
        "law_terms": filter.law_error.size,
        "law_error": filter.law_error.size and c_literals.array(filter.law_error, precision),
        "magnet": magnet["text"],
        "magnet_type": magnet["type"],
        "magnet_methods": magnet["methods"],
        "arrays": c_literals.declared(export.arrays, precision),
        "turning": _turning(export.of_model, export.speeds, precision),
        "angle_sensor": _angle_sensor(export),
        "speed_own": c_literals.number(machine.speed, precision) if several else "",
        "mass": "" if several else c_literals.number(machine.rotor.mass, precision),
        "own": "" if export.in_core is None else c_literals.own(filter, precision),
    }  # fmt: skip


def _turning(
    of_model: model.CModel, speeds: tuple[float, float] | None, precision: CPrecision
) -> dict[str, Any] | None:
    """Return the template variables of a model that follows the speed of rotation."""
    fields = of_model.turning
    if fields is None or speeds is None:
        return None
    text = c_literals.struct(fields, precision)
    ends = dict(zip(("slowest", "fastest"), (f"{speed:.6g}" for speed in speeds), strict=True))
    return {"numbers": fields["numbers"], "text": text} | ends


def _angle_sensor(export: Export) -> dict[str, Any] | None:
    """Return the template variables of the angle sensor."""
    angle = export.filter.machine.angle
    structs = exported.angle_structs(export)
    if angle is None or not structs:
        return None
    readings = {
        "pulses": "the time since a pulse came within the last sample [s]",
        "encoder": "the angle of the encoder [rad]", "speed": "the measured speed [rad/s]",
    }  # fmt: skip
    settings, error, *pairs = (c_literals.struct(at, export.precision) for at in structs.values())
    limits = [f"{speed:.6g}" for speed in export.speeds or ()]
    return {
        "range": limits,
        "angle": settings,
        "error": error,
        "pairs": pairs,
        "reading": readings[angle.type],
    }


def _assumed(filter: Estimator) -> dict[str, str]:
    """Return the assumed noise, and the origin of each number, in words."""
    labels = {
        "measurement": ("noise of the measurement, R", "m^2"),
        "control": ("noise of the control signal", f"{filter.machine.control_unit}^2"),
        "disturbance": ("process noise intensity of the disturbance force, Q", "N^2/s"),
    }
    assumptions = {}
    for name, value in filter.variances._asdict().items():
        what, unit = labels[name]
        origin = filter.origin.get(f"noise.{name}")
        values = value if isinstance(value, tuple) else (value,)
        shown_values = ", ".join(dict.fromkeys(f"{item:.6g}" for item in values))
        assumptions[what] = f"{shown_values} {unit}" + (f" ({origin})" if origin else "")
    return assumptions


def _sources_with_casts(export: Export) -> tuple[str, ...]:
    """Return the files that cast from ``void *``, which MISRA C advises against."""
    stems = [] if export.constant_stiffness else [export.kinds[0].source]
    if export.in_core is not None:
        stems += ["estimator", *export.in_core.casts]
        stems += ["control"] if export.controller is not None else []
        stems += ["calibration", "scaled"] if export.calibrated else []
    return tuple(f"core/src/{stem}.c" for stem in sorted(stems))


def _bit_headers(core_files: dict[str, str], *, filter_only: bool) -> list[str]:
    """Return the headers in use that access a number's bits; `filter_only`: no controller."""
    # A filter computes standard deviations; of a controller possibly only its self-test needs a
    # root.
    root = filter_only or any('"ambkit/root.h"' in text for text in core_files.values())
    names = ("/exponential.h", "/crc.h", *(["/root.h"] if root else []))
    return [file for file in core_files if file.endswith(names) and "/include/" in file]


def _configuration(filter: Estimator, context: dict[str, Any], core_files: dict[str, str]) -> str:
    """Return 16 hexadecimal digits, a hash of everything that determines the estimator."""
    digest = hashlib.sha256()
    numbers = (
        "version", "precision", "inputs_text", "kalman", "std", "magnet_type", "magnet", "own",
        "title",
    )  # fmt: skip
    parts = [_described(filter.machine), *(context[key] for key in numbers)]
    if context["several"]:
        parts.append(repr(context["several"]))
    parts += [array["text"] for array in context["arrays"]]
    if context["controller"]:
        parts += [repr(context[key]) for key in ("controller", "times", "turning", "levitated")]
    for part in (*parts, *core_files.values()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]


def _described(machine: Machine) -> str:
    """Return the description of a machine without the folders of its files."""
    text = machine.to_toml()
    of = machine.bearings
    for path in (getattr(item.magnet, key) for item in of for key in FILES):
        if path:
            text = text.replace(path, Path(path).name)
    return text
