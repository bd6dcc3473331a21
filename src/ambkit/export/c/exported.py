"""An export to C with derived data: magnets, model, and files of the core."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit._core import Magnet
from ambkit.base.arrays import Array
from ambkit.control.controller_states import Controller
from ambkit.data.input_scaling import Scaling
from ambkit.estimate.angle import angle_settings
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import PAPER, CoreKernel
from ambkit.export import core_sources
from ambkit.export.c import c_literals, calibration, control, controller_test_cases, model, rebuilt
from ambkit.export.c.c_literals import Constants, CPrecision, Crc, Kind, Name
from ambkit.judge.isolation.diagnosis import Distinction
from ambkit.machine.accessories import SENSORS
from ambkit.machine.magnets import core_module
from ambkit.simulation.scenario import Scenario

_ISOLATION = (
    "src/isolation.c", "src/isolation_sweep.c", "src/isolation_replay.c", "src/isolation_fit.c",
    "src/isolation_restart.c", "src/isolation_search.c",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Export:
    """An export with derived data."""

    filter: Estimator
    name: str
    facts: dict[str, str]
    loops: bool | None = None
    editable: bool = False
    controller: Controller | None = None
    scenario: Scenario | None = None
    calibrated: bool = False
    framed: bool = False
    rebuilt: bool = False
    distinction: Distinction | None = None  #: Distinguishable faults, with fault isolation.

    @property
    def precision(self) -> CPrecision:
        """Precision of its numbers."""
        return c_literals.precision_of(self.filter)

    @property
    def several(self) -> bool:
        """Whether C takes arrays of readings and currents instead of a number each."""
        return not self.filter.view.single

    @property
    def one(self) -> Controller | None:
        """The controller whose step uses the common interface."""
        return None if self.several else self.controller

    @property
    def beside(self) -> bool:
        """Whether a controller has files besides those of its filter."""
        return self.several and self.controller is not None

    @cached_property
    def magnets(self) -> list[Magnet]:
        """Magnet models of the filter."""
        return magnets_of(self.filter)

    @cached_property
    def kinds(self) -> list[Kind]:
        """Their kinds in C."""
        return [Kind(*magnet.in_c) for magnet in self.magnets]

    @cached_property
    def in_core(self) -> CoreKernel | None:
        """Core interface of the estimator; None for the paper's filter by itself."""
        called = c_literals.called(self.filter)
        usual = not (self.several or self.controller or self.rebuilt or self.distinction)
        return None if called is PAPER and usual else called

    @property
    def constant_stiffness(self) -> bool:
        """Whether the paper's filter has constant stiffnesses, without a magnet."""
        return self.in_core is None and self.kinds[0].type == "amb_stiffness"

    @cached_property
    def speeds(self) -> tuple[float, float] | None:
        """Speeds of its model."""
        if not self.several:
            return None
        return controller_test_cases.speeds_of(self.filter.machine, self.scenario)

    @cached_property
    def of_model(self) -> model.CModel:
        """Model in C."""
        return model.c_model(self.filter, loops=self.rebuilt or self.loops, speeds=self.speeds)

    @cached_property
    def controller_context(self) -> dict[str, Any]:
        """Template variables of the controller."""
        if self.controller is None or self.scenario is None:
            return {}
        return control.context(self.controller, self.scenario, self.name, self.precision)

    @property
    def kalman(self) -> dict[str, Any]:
        """Structs of the core's filter; settings only if C computes the rest."""
        parameters: dict[str, Any] = self.filter.core.parameters
        return parameters["set"] if self.editable else parameters | {"model": self.of_model.numbers}

    @cached_property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays of model and magnets by their names in C, in the order of the data file."""
        magnets = {
            self.array_names(k)[path]: values
            for k, magnet in enumerate(self.magnets)
            for path, values in c_literals.arrays_of(magnet.parameters).items()
        }
        return self.of_model.arrays | magnets

    def array_names(self, k: int) -> dict[str, str]:
        """Return the C names of the arrays of the k-th magnet, by the paths of their fields."""
        of, parameters = f"of_{k}_" if self.several else "", self.magnets[k].parameters
        return {path: of + path.replace(".", "_") for path in c_literals.arrays_of(parameters)}

    @cached_property
    def start(self) -> dict[str, Array]:
        """Start of a machine's filter, and its dependence on each reading."""
        constant, by_reading = self.filter.view.start_form(
            self.filter.states, self.filter.levitation_current
        )
        return {"start": constant, "start_by": by_reading.ravel()}

    @cached_property
    def core_files(self) -> dict[str, str]:
        """Files of the core."""
        needed = ["src/kalman.c", "src/envelope.c", "src/equilibrium.c"]
        needed += ["include/ambkit/crc.h", "include/ambkit/root.h"]
        needed += [] if self.constant_stiffness else [f"src/{kind.source}.c" for kind in self.kinds]
        if self.in_core is not None:
            stems = ("estimator", self.in_core.source, *self.in_core.calls)
            needed += [f"src/{stem}.c" for stem in stems]
            inner = getattr(self.filter, "inner", None)
            needed += [] if inner is None else [f"src/{c_literals.called(inner).source}.c"]
        needed += ["include/ambkit/law_error.h"] if self.filter.law_error.size else []
        needed += self.of_model.sources
        needed += [] if self.filter.machine.angle is None else ["src/angle.c"]
        needed += control.SOURCES if self.controller is not None else ()
        needed += calibration.SOURCES if self.calibrated else ()
        needed += ["src/telemetry.c"] if self.framed else []
        needed += _ISOLATION if self.distinction else ()
        needed += rebuilt.SOURCES if self.rebuilt else ()
        result = core_sources.closure(needed, instead=self.of_model.instead)
        return {f"core/{file}": text for file, text in result.items()}

    @property
    def sources(self) -> tuple[str, ...]:
        """Files that a controller compiles."""
        more = (*("_telemetry",) * self.framed, *("_rebuild",) * self.rebuilt)
        more += ("_faults",) if self.distinction else ()
        changed = (*("_control",) * self.beside, *("_calibration",) * self.calibrated)
        own = (f"{self.name}{file}.c" for file in ("", *changed, "_data", *more))
        return (*own, *(file for file in self.core_files if file.endswith(".c")))

    @property
    def tests(self) -> tuple[str, ...]:
        """Files that its self-test compiles."""
        beside = ("control_selftest", "control_vectors") if self.beside else ()
        of_test = (f"{self.name}_{file}.c" for file in ("selftest", "vectors", *beside))
        return ("selftest/main.c", *(f"selftest/{file}" for file in of_test))


def magnets_in_c(export: Export) -> list[dict[str, str]]:
    """Return type, methods and initialiser of each magnet."""
    return [
        {
            "type": kind.type,
            "methods": kind.methods,
            "text": c_literals.struct(magnet.parameters, export.precision, export.array_names(k)),
        }
        for k, (magnet, kind) in enumerate(zip(export.magnets, export.kinds, strict=True))
    ]


def several(export: Export) -> dict[str, Any]:
    """Return the parts of an export with several axes."""
    machine = export.filter.machine
    start = {name: c_literals.array(at, export.precision) for name, at in export.start.items()}
    return {
        "axes": machine.axis_names,
        "readings": [r.name for r in machine.readings],
        "headers": sorted({f"{kind.source}.h" for kind in export.kinds}),
        **start,
        "magnets": magnets_in_c(export),
    }


def raw(name: str, reading: Scaling, precision: CPrecision) -> dict[str, str] | None:
    """Return the conversion of a raw input; None if it is in SI."""
    if reading.gain == 1.0 and not reading.zero:
        return None
    sign = "-" if reading.zero < 0 else "+"
    zero = f" {sign} {abs(reading.zero):.9g}" if reading.zero else ""
    value = f"{reading.gain:.9g} * number{zero}"
    return {
        "gain": c_literals.number(reading.gain, precision),
        "zero": c_literals.number(reading.zero, precision),
        "unit": reading.unit,
        "said": f"{name} [{reading.si_unit}] = {value}, number in {reading.unit}",
    }


def levitation_current(filter: Estimator, precision: CPrecision) -> str:
    """Return the levitation current at x, as in `Estimator.equilibrium_state`."""
    middle, per_metre = (c_literals.number(value, precision) for value in filter.levitation_current)
    return f"{middle} + {per_metre} * x"


def magnets_of(filter: Estimator) -> list[Magnet]:
    """Return the core's magnets of an estimator, one for each axis."""
    held = filter.magnet.in_core(core_module(filter.precision))
    return held if isinstance(held, list) else [held]


def angle_structs(export: Export) -> dict[str, dict[str, Any]]:
    """Return the structs of the angle sensor by their names in C; none without one."""
    filter = export.filter
    if filter.machine.angle is None or export.speeds is None:
        return {}
    settings = angle_settings(filter.machine)
    kind = Name(f"AMB_ANGLE_{SENSORS[settings['sensor']].upper()}")
    error = filter.engine.synchronous_states() or {
        "state": -1, "noise": 0, "pair": [], "reverses": False
    }  # fmt: skip
    pairs = error.pop("pair")
    error |= {
        "pairs": len(pairs), "pair": Name("synchronous" if pairs else "NULL"),
        "std": Name(f"{export.name}_std"),
    }  # fmt: skip
    result = {
        f"{export.name}_angle": settings | {"sensor": kind}, f"{export.name}_speed_error": error
    }  # fmt: skip
    return result | {f"synchronous[{k}]": pair for k, pair in enumerate(pairs)}


def crc(export: Export) -> Crc:
    """Return the CRC of the data file, with its names."""
    filter, name, constants = export.filter, export.name, Constants(export.precision)
    for array_name, values in export.arrays.items():
        constants.array(array_name, values)
    kalman = f"{name}_settings" if export.editable else f"{name}_kalman"
    constants.fields(kalman, export.kalman, arrays=True)
    if export.editable:
        constants.array(f"&{name}_mass", np.array([filter.machine.rotor.mass]))
    if export.of_model.turning is not None:
        constants.fields(f"{name}_turning", export.of_model.turning, arrays=False)
        for key, fields in angle_structs(export).items():
            constants.fields(key, fields, arrays=False)
    constants.array(f"{name}_std", np.asarray(filter.default_std()))
    if filter.law_error.size:
        constants.array(f"{name}_law_error", filter.law_error)
    if export.several:
        for key, values in export.start.items():
            constants.array(f"{name}_{key}", values)
    for k, magnet in enumerate(export.magnets):
        place = f"magnet_{k}" if export.several else "magnet"
        place = f"{name}_stiffness" if export.constant_stiffness else place
        constants.fields(place, magnet.parameters, arrays=False)
    constants.fields("own", filter.core.own, arrays=True)
    if export.controller is not None:
        control.constants(export.controller, name, constants)
        if export.calibrated:
            calibration.constants(export.controller, name, constants)
    return constants.crc()
