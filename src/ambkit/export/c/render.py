"""The text of each file: the core's own, the data, the thin interface and the self-test."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base import escaping
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.registry import PAPER, InCore
from ambkit.export import core
from ambkit.export.c import (
    calibration,
    control,
    data,
    machine_control,
    machine_scenes,
    model,
    proof,
    telemetry,
    unseen,
    vectors,
)
from ambkit.export.c.crc import Constants, Crc
from ambkit.export.c.data import MAGNETS, CPrecision, Kind
from ambkit.machine.bearing import FILES
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.simulation.control import bound_of, settling_of

if TYPE_CHECKING:
    from ambkit._core import Magnet
    from ambkit.data.rig_units import Scaling
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing
    from ambkit.simulation.control import Controller
    from ambkit.simulation.flight import Flight

_BOUNDS: dict[CPrecision, str] = {"float": "1e-3", "double": "1e-9"}
_PROVED = (
    "Whatever NAME_step and NAME_reset are given, NaN and infinities included, and however often: "
    "no access beyond an object, no read of what was not written, no division by zero, no "
    "overflow, no other undefined behaviour of C99; and every number in the estimates is finite. "
    "Shown by abstract interpretation (Frama-C Eva), for these constants."
)
_CONTAINED = _PROVED.replace(
    "no division by zero, no overflow, no other undefined behaviour of C99",
    "no undefined behaviour of C99 with the arithmetic of IEEE 754",
)
_BOUND_OF_MACHINES = "2e-2"  # in float: more is added up; a tenth is still seen


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
    flight: Flight | None = None,
    calibrated: bool = False,
    framed: bool = False,
) -> Content:
    """Write all texts.

    Parameters
    ----------
    estimator : Estimator
        What is exported; of the core's build for this precision.
    name : str
        Prefix of all its names.
    precision : {"float", "double"}
        Of its numbers.
    facts : dict
        What the README says of it besides, line by line.
    loops : bool, optional
        Whether the model is computed by loops over its arrays; by default where it is large.
    editable : bool
        Whether the data file has each number once, and the rest is computed at init; of the paper's
        axis alone.
    controller : Controller, optional
        That flies this estimator; the export is then the whole of it.
    flight : Flight, optional
        Of a whole machine: its controllers are written beside the filter, and one step for both.
    calibrated : bool
        Whether numbers of such a controller can be changed while it runs.
    framed : bool
        Whether a ring of telemetry frames is written too.

    Raises
    ------
    AmbkitError
        Another model is to be editable.
    """
    if editable and not estimator.engine.built_in:
        raise AmbkitError(
            "editable is for the paper's axis: of other models C has the matrices, and not what "
            "they were made from"
        )
    magnets = magnets_of(estimator)
    magnet, kinds = magnets[0], [MAGNETS[type(each).__name__] for each in magnets]
    kind = kinds[0]
    called = data.called(estimator)
    whole = estimator.whole is not None
    # Whose step goes through the interface.
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
    if flight is not None and estimator.whole is not None:
        speeds = machine_scenes.speeds_of(estimator.whole.machine, flight)
    of_model = model.in_c(estimator, loops=loops, speeds=speeds)
    needed += [*of_model.sources, *(control.SOURCES if controller is not None else ())]
    needed += calibration.SOURCES if calibrated else ()
    needed += telemetry.SOURCES if framed else ()
    sequenced = flight is not None and flight.sequence is not None
    flown = {}
    if flight is not None:
        flown = machine_control.context(estimator, flight, name, precision, bound_of(estimator))
        needed += machine_control.SOURCES
        needed += machine_control.OF_SEQUENCE if sequenced else ()
    found = core.closure(needed, instead=of_model.instead)
    core_files = {f"core/{file}": text for file, text in found.items()}
    c_files = tuple(file for file in core_files if file.endswith(".c"))
    more = ("_control", "_control_data") if flown else ()
    more = (*more, "_telemetry") if framed else more
    changed = ("_calibration",) if calibrated else ()
    sources = (*(f"{name}{file}.c" for file in ("", *changed, "_data", *more)), *c_files)
    of_test = ("selftest", "vectors", *(("control_selftest",) if flown else ()))
    selftest = tuple(f"selftest/{name}_{file}.c" for file in of_test)
    settling, bound = settling_of(estimator), bound_of(estimator)
    if controller is None:
        tested = vectors.make(estimator, magnets, settling=settling, bound=bound)
        told = _selftest_context(tested, estimator, precision)
    else:
        told = control.context(controller, name, precision)
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
        "several": _several(estimator, magnets, kinds, precision) if whole else None,
        "y_given": "const amb_real y[AMB_SENSORS]" if whole else "amb_real y",
        "u_given": "const amb_real u[AMB_CONTROLS]" if whole else "amb_real u",
        "sources": sources,
        "bit_headers": _bit_headers(core_files, alone=controller is None),
        "cast_sources": _casts(
            kind,
            in_core,
            given,
            calibrated=calibrated,
            flown=controller is not None or sequenced,
        ),
        "selftest_sources": ("selftest/main.c", *selftest),
        "bound": _BOUND_OF_MACHINES if whole and precision == "float" else _BOUNDS[precision],
        **{key: told[key] for key in told if key != "arrays"},
        "flown": told if controller is not None else None,
        "base_of_calibration": None,
        "misra_defines": "-DFLT_MANT_DIG=24" if precision == "float" else "-DDBL_MANT_DIG=53",
        "given": given,
        "in_core": in_core,
        "built_in": estimator.engine.built_in,
        "strict": in_core is None and estimator.engine.built_in,
        "magnet_header": f"{kind.source}.h",
        "magnet_about": _about(kinds),
        "sampled": _sampled(estimator),
        "assumed": _assumed(estimator),
        "inputs": {
            "y": _raw("y", estimator.inputs.y, precision),
            "u": _raw("u", estimator.inputs.u, precision),
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
        "states": model.states(estimator.states, "" if whole else _hover(estimator, precision)),
        "diagonal": vectors.diagonal(len(estimator.states)),
        "shown": _first(estimator, "sensor"),
        "load": _first(estimator, "disturbance force"),
        **_of_roles(estimator),
        **_stops(estimator, precision),
        "base": base,
        "covariance": (in_core.covariance if in_core else "") or f"{base}cov",
        **_data_context(estimator, magnet, kind, precision, of_model, editable=editable),
        "controlled": bool(flown),
        "sequenced": sequenced,
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
        "crc": _crc(
            estimator,
            name,
            precision,
            of_model,
            editable=editable,
            flown=controller,
            calibrated=calibrated,
        ),
        "proof_sentence": _PROVED.replace("NAME", name),
        "contained_sentence": _CONTAINED.replace("NAME", name),
    }
    context["proof"] = _proof(estimator, context, core_files)
    for each, si in (("y", "m"), ("u", "V")):
        context[f"{each}_unit"] = context["inputs"][each]["unit"] if context["inputs"][each] else si
    context["inputs_text"] = repr(context["inputs"])
    if calibrated and controller is not None:
        context["base_of_calibration"] = calibration.context(controller, name, precision)
    context["configuration"] = _configuration(estimator, context, core_files)
    context["frame"] = telemetry.frame(
        estimator.states,
        context["states"],
        context["several"]["readings"] if whole else (),
        None if controller is None else controller.coils,
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
        f"proof/{name}_proof.c": "proof.c",
        "proof/prove.sh": "prove.sh",
        "proof/README.md": "PROOF.md",
        "core/include/ambkit/precision.h": "precision.h",
        "CMakeLists.txt": "CMakeLists.txt",
        "README.md": "README.md",
        "misra.txt": "misra.txt",
    }
    if controller is not None:
        more_files = calibration.TEMPLATES if calibrated else {}
        named = {**control.TEMPLATES, **more_files}
        made |= {file.format(name): template for file, template in named.items()}
        if calibrated:
            described = calibration.described(controller, name, precision)
            core_files |= {"calibration.json": described}
    if framed:
        made |= {file.format(name): template for file, template in telemetry.TEMPLATES.items()}
        T = estimator.bearing.sampling_time
        of_frame = (name, context["configuration"], T, context["frame"])
        core_files |= {"telemetry.json": telemetry.described(*of_frame)}
    if flown:
        files = machine_control.FILES
        made |= {file.format(name=name): template for file, template in files.items()}
    templates = _templates()
    texts = core_files | {
        file: templates.get_template(f"{template}.j2").render(context)
        for file, template in made.items()
    }
    visited = templates.get_template("COVERAGE.md.j2")
    texts["selftest/COVERAGE.md"] = visited.render(context | _unseen(estimator, context, texts))
    return Content(dict(sorted(texts.items())), sources, context["configuration"])


def _unseen(
    estimator: Estimator, context: dict[str, Any], texts: dict[str, str]
) -> dict[str, list[tuple[str, str]]]:
    """Return what the self-test is known not to see, and not to run; of the linear filter alone."""
    if not estimator.name.startswith("linear"):
        return {"unseen": [], "not_run": []}
    flying = {name: text for name, text in texts.items() if not name.startswith(("self", "proof"))}
    one, controlled = estimator.whole is None, context["flown"] is not None
    said = unseen.told(flying, unseen.lists(not one, controlled))
    has = None if one else machine_has(estimator, context)
    return {"unseen": said, "not_run": [] if has is None else unseen.not_run(flying, has)}


def machine_has(estimator: Estimator, context: dict[str, Any]) -> unseen.Has:
    """Return what decides which lines of a machine's export run.

    Parameters
    ----------
    estimator : Estimator
        Of a whole machine.
    context : dict
        What the templates say.
    """
    direct = any(array["name"] == "model_B_u_column" for array in context["arrays"]) and bool(
        estimator.engine.model.B_u.any()
    )
    rising = bool(np.any(estimator.core.parameters["set"]["rise"]))
    plain = unseen.Has(len(estimator.states), direct, rising)
    if not context["controlled"]:
        return plain
    gains = any(context["matrices"][f"gain_{k}"] != "NULL" for k in range(3))
    alone = context["kind"] == "decentralised" and not gains and context["let_turn"] is None
    return plain._replace(
        controlled=True, alone=alone, fed=context["fed"], gains=gains,
        let_turn=context["let_turn"] is not None,
        turning=context["matrices"]["turning"] != "NULL", tracking=context["tracking"],
    )  # fmt: skip


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


def _selftest_context(
    tested: vectors.Vectors, estimator: Estimator, precision: CPrecision
) -> dict[str, Any]:
    """Return what the self-test's files say."""
    starts = tested.starts.tolist()
    marks = tested.feed_back.copy()
    marks[starts] += 2
    return {
        "steps": len(tested.y),
        "columns": tested.expected.shape[1],
        "y": data.array(_with_stand_ins(tested.y, precision), precision),
        "u": data.array(_with_stand_ins(tested.u, precision), precision),
        "told": data.array(tested.expected, precision),
        "status": data.array(tested.status, precision),
        "health": data.array(tested.health, precision),
        "marks": data.array(marks, precision),
        "runs": list(zip(tested.runs, np.diff([*starts, len(tested.y)]).tolist(), strict=True)),
        "coverage": vectors.coverage(tested, estimator),
    }


def _proof(
    estimator: Estimator, context: dict[str, Any], core_files: dict[str, str]
) -> dict[str, Any]:
    """Return what the files of the proof say."""
    several = context["several"]
    axes, sensors = (len(several["axes"]), len(several["readings"])) if several else (0, 0)
    fields = [state.field for state in context["states"]]
    asked = {name: text for name, text in core_files.items() if name.endswith(".c")}
    uses = {
        called: any(f"{called}(" in text for text in asked.values())
        for called in ("amb_exp_negative", "amb_root")
    }
    contracts = [called for called, used in uses.items() if used]
    by_contract = f" -eva-use-spec {','.join(contracts)}" if contracts else ""
    models = estimator.core.own.get("n", 0)  # their number is data, no constant that Eva sees
    by_model = f" -eva-min-loop-unroll {models + 1}" if models else ""
    return {
        "outputs": proof.outputs(fields, axes, sensors),
        "options": proof.OPTIONS.format(tag=context["tag"]) + by_model + by_contract,
        "recorded": proof.recorded(
            estimator, context["precision"], editable=bool(context["editable"])
        ),
        "uses_exponential": uses["amb_exp_negative"],
        "uses_root": uses["amb_root"],
    }


def _of_roles(estimator: Estimator) -> dict[str, Any]:
    """Return which states the self-test of a machine asks for.

    `plain`: its state is the Kalman filter's own, whose covariance the self-test can spoil.
    """
    roles = [state.role for state in estimator.states]
    return {
        "plain": estimator.whole is not None and estimator.name.startswith("linear"),
        "positions": [i for i, role in enumerate(roles) if role == "position"],
        "moving": [
            str(role in ("position", "velocity", "disturbance force")).lower() for role in roles
        ],
        "reads": [str(role == "sensor").lower() for role in roles],
        "loads": [str(role == "disturbance force").lower() for role in roles],
    }


def _first(estimator: Estimator, role: str) -> int:
    """Return the place of the first state of a role; -1 where there is none."""
    return next((i for i, state in enumerate(estimator.states) if state.role == role), -1)


def _stops(estimator: Estimator, precision: CPrecision) -> dict[str, str]:
    """Return readings that may be a rotor on its stops, and ones that may not, on both sides."""
    settings = estimator.core.parameters["set"]
    gain, travel, var_y = (np.asarray(settings[k], float) for k in ("K_sen", "travel", "var_y"))
    shown, noise = np.abs(gain) * travel, np.sqrt(var_y)
    places = {"between": shown + 3.8 * noise, "beyond": shown + 4.2 * noise}
    sides = {name: np.array([-each, each], float) for name, each in places.items()}
    if estimator.whole is None:
        read = estimator.inputs.y.numbers
        return {name: data.array(read(at.ravel()), precision, "") for name, at in sides.items()}
    return {
        name: ", ".join("{" + data.array(row, precision, "") + "}" for row in at)
        for name, at in sides.items()
    }


def _with_stand_ins(values: NDArray[np.float64], precision: CPrecision) -> NDArray[np.float64]:
    """Return numbers, and what the vectors have in the place of what C has no literal for."""
    most = float(np.finfo(np.float32 if precision == "float" else np.float64).max)
    return np.nan_to_num(values, nan=most, posinf=most / 2, neginf=-most / 2)


def _crc(
    estimator: Estimator,
    name: str,
    precision: CPrecision,
    of_model: model.InC,
    *,
    editable: bool,
    flown: Controller | None,
    calibrated: bool,
) -> Crc:
    """Return the CRC of the data file, with its names."""
    constants = Constants(precision)
    several = estimator.whole is not None
    for path, values in of_model.arrays.items():
        constants.array(path, values)
    magnets = magnets_of(estimator)
    for k, magnet in enumerate(magnets):
        names = _names(magnet, k if several else None)
        for path, values in data.arrays_of(magnet.parameters).items():
            constants.array(names[path], values)
    kalman = estimator.core.parameters | {"model": of_model.numbers}
    if editable:
        constants.fields(f"{name}_settings", kalman["set"], arrays=True)
        constants.array(f"&{name}_mass", np.array([estimator.bearing.rotor.mass]))
    else:
        constants.fields(f"{name}_kalman", kalman, arrays=True)
    if of_model.turning is not None:
        constants.fields(f"{name}_turning", of_model.turning, arrays=False)
    constants.array(f"{name}_std", np.asarray(estimator.default_std()))
    if estimator.whole is not None:
        start, by_reading = estimator.whole.start_form(estimator.states, estimator.hover)
        constants.array(f"{name}_start", start)
        constants.array(f"{name}_start_by", by_reading.ravel())
        for k, magnet in enumerate(magnets):
            constants.fields(f"magnet_{k}", magnet.parameters, arrays=False)
    else:
        (magnet,) = magnets
        paper = data.called(estimator) is PAPER and flown is None
        given = paper and type(magnet).__name__ == "Constant"
        place = f"{name}_stiffness" if given else "magnet"
        constants.fields(place, magnet.parameters, arrays=False)
    constants.fields("own", estimator.core.own, arrays=True)
    if flown is not None:
        control.constants(flown, name, constants)
        if calibrated:
            calibration.constants(flown, name, constants)
    return constants.crc()


def _sampled(estimator: Estimator) -> str:
    """Say which model of a sample it predicts with."""
    if type(estimator.core).__name__ == "LowPass":
        return "no model: exponential averages"
    if estimator.engine.as_printed:
        return "position held (eq. 19 as the paper prints it): estimates are ahead of the rotor"
    return "force held, all else exact"


def _assumed(estimator: Estimator) -> dict[str, str]:
    """Say what it assumes of the noise, and where each number came from."""
    shown = {
        "measurement": ("noise of the measurement, R", "m^2"),
        "control": ("noise of the control signal", "V^2"),
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


def _raw(name: str, reading: Scaling, precision: CPrecision) -> dict[str, str] | None:
    """Return what is done with a raw input; None where it comes in SI."""
    if reading.gain == 1.0 and not reading.zero:
        return None
    sign = "-" if reading.zero < 0 else "+"
    zero = f" {sign} {abs(reading.zero):.9g}" if reading.zero else ""
    value = f"{reading.gain:.9g} * number{zero}"
    return {
        "gain": data.number(reading.gain, precision),
        "zero": data.number(reading.zero, precision),
        "unit": reading.unit,
        "said": f"{name} [{reading.si_unit}] = {value}, number in {reading.unit}",
    }


def _data_context(
    estimator: Estimator,
    magnet: Magnet,
    kind: Kind,
    precision: CPrecision,
    of_model: model.InC,
    *,
    editable: bool,
) -> dict[str, Any]:
    """Return what the data file says: the structs that the core holds, as initialisers."""
    fields = magnet.parameters
    arrays = data.arrays_of(fields)
    names = _names(magnet, None)
    named = of_model.arrays | {names[path]: values for path, values in arrays.items()}
    if estimator.whole is not None:
        named = dict(of_model.arrays)
        for k, each in enumerate(magnets_of(estimator)):
            own = data.arrays_of(each.parameters)
            named |= {_names(each, k)[path]: values for path, values in own.items()}
    kalman = estimator.core.parameters | {"model": of_model.numbers}
    if editable:
        kalman = kalman["set"]
    return {
        "kalman": data.struct_with_arrays(kalman, precision),
        "std": data.array(np.asarray(estimator.default_std()), precision),
        "magnet": data.struct(fields, precision, names),
        "magnet_type": kind.type,
        "magnet_methods": kind.methods,
        "arrays": data.declared(named, precision),
    }


def magnets_of(estimator: Estimator) -> list[Magnet]:
    """Return the core's magnets that an estimator asks, one for each axis."""
    held = estimator.magnet.in_core(core_module(estimator.precision))
    return held if isinstance(held, list) else [held]


def _about(kinds: list[Kind]) -> str:
    return ", ".join(dict.fromkeys(kind.about for kind in kinds))


def _several(
    estimator: Estimator, magnets: list[Magnet], kinds: list[Kind], precision: CPrecision
) -> dict[str, Any]:
    """Return what only the export of a whole machine has."""
    whole = estimator.whole
    assert whole is not None
    constant, by_reading = whole.start_form(estimator.states, estimator.hover)
    return {
        "axes": [axis.name for axis in whole.machine.axes],
        "readings": [r.name for r in whole.machine.readings],
        "headers": sorted({f"{kind.source}.h" for kind in kinds}),
        "start": data.array(constant, precision),
        "start_by": data.array(by_reading.ravel(), precision),
        "magnets": [
            {
                "type": kind.type,
                "methods": kind.methods,
                "text": data.struct(each.parameters, precision, _names(each, k)),
            }
            for k, (each, kind) in enumerate(zip(magnets, kinds, strict=True))
        ],
    }


def _names(magnet: Magnet, k: int | None) -> dict[str, str]:
    """Return the C names of the arrays of the k-th magnet, by the paths of their fields."""
    of = "" if k is None else f"of_{k}_"
    return {path: of + path.replace(".", "_") for path in data.arrays_of(magnet.parameters)}


def _hover(estimator: Estimator, precision: CPrecision) -> str:
    """Return the current that holds the rotor at x, as `Estimator.at_rest` has it."""
    middle, per_metre = (data.number(value, precision) for value in estimator.hover)
    return f"{middle} + {per_metre} * x"


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
    if context["flown"]:
        parts += [repr(context["flown"])]
    if context["several"]:
        parts.append(repr(context["several"]))
    parts += [array["text"] for array in context["arrays"]]
    if context["controlled"]:
        parts += [array["text"] for array in context["control_arrays"]]
        parts += [repr(context[key]) for key in ("pids", "kind", "sequence", "turning")]
    for part in (*parts, *core_files.values()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]


def _described(bearing: Bearing | Machine) -> str:
    """Return the description of a bearing or a machine without the folders of its files."""
    text = bearing.to_toml()
    of = bearing.bearing if isinstance(bearing, Machine) else (bearing,)
    for path in filter(None, (getattr(each.magnet, key) for each in of for key in FILES)):
        text = text.replace(path, Path(path).name)
    return text


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
