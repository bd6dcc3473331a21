"""What is exported as C, and what follows from it: magnets, model, and the files of the core."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ambkit.estimate.registry import PAPER, InCore
from ambkit.export import core_sources
from ambkit.export.c import (
    c_literals,
    calibration,
    control,
    controller_test_cases,
    data_file,
    model,
)
from ambkit.export.c.c_literals import CPrecision, Kind

if TYPE_CHECKING:
    from ambkit._core import Magnet
    from ambkit.control.controller_states import Controller
    from ambkit.estimate.estimator import Estimator
    from ambkit.simulation.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Export:
    """What is exported, and what follows from it."""

    filter: Estimator
    name: str
    precision: CPrecision
    facts: dict[str, str]
    loops: bool | None = None
    editable: bool = False
    controller: Controller | None = None
    scenario: Scenario | None = None
    calibrated: bool = False
    framed: bool = False

    @property
    def several(self) -> bool:
        """Whether C takes arrays of readings and currents, and not a number each."""
        return self.filter.whole is not None

    @property
    def one(self) -> Controller | None:
        """The controller whose step goes through the interface."""
        return None if self.several else self.controller

    @property
    def beside(self) -> bool:
        """Whether a controller has files beside those of its filter."""
        return self.several and self.controller is not None

    @cached_property
    def magnets(self) -> list[Magnet]:
        """The magnets that the filter asks."""
        return data_file.magnets_of(self.filter)

    @cached_property
    def kinds(self) -> list[Kind]:
        """What each of them is in C."""
        return [Kind(*magnet.in_c) for magnet in self.magnets]

    @cached_property
    def in_core(self) -> InCore | None:
        """How the core calls the estimator; None of the paper's filter alone."""
        called = c_literals.called(self.filter)
        return None if called is PAPER and not self.several and not self.controller else called

    @property
    def given(self) -> bool:
        """Whether the paper's filter is given its constants, and asks no magnet."""
        return self.in_core is None and self.kinds[0].type == "amb_stiffness"

    @cached_property
    def speeds(self) -> tuple[float, float] | None:
        """The speeds that its model follows."""
        if self.scenario is None or not self.several:
            return None
        return controller_test_cases.speeds_of(self.filter.machine, self.scenario)

    @cached_property
    def of_model(self) -> model.CModel:
        """The model in C."""
        return model.c_model(self.filter, loops=self.loops, speeds=self.speeds)

    @cached_property
    def flown(self) -> dict[str, Any]:
        """What the templates say of a controller."""
        if self.controller is None or self.scenario is None:
            return {}
        return control.context(self.controller, self.scenario, self.name, self.precision)

    @cached_property
    def core_files(self) -> dict[str, str]:
        """The core's own files."""
        needed = ["src/kalman.c", "src/envelope.c", "src/equilibrium.c"]
        needed += ["include/ambkit/crc.h", "include/ambkit/root.h"]
        needed += [] if self.given else [f"src/{kind.source}.c" for kind in self.kinds]
        if self.in_core is not None:
            stems = ("estimator", self.in_core.source, *self.in_core.calls)
            needed += [f"src/{stem}.c" for stem in stems]
            inner = getattr(self.filter, "inner", None)
            needed += [] if inner is None else [f"src/{c_literals.called(inner).source}.c"]
        needed += self.of_model.sources
        needed += control.SOURCES if self.controller is not None else ()
        needed += calibration.SOURCES if self.calibrated else ()
        needed += ["src/telemetry.c"] if self.framed else []
        result = core_sources.closure(needed, instead=self.of_model.instead)
        return {f"core/{file}": text for file, text in result.items()}

    @property
    def sources(self) -> tuple[str, ...]:
        """What a controller compiles."""
        more = ("_telemetry",) if self.framed else ()
        changed = (*("_control",) * self.beside, *("_calibration",) * self.calibrated)
        own = (f"{self.name}{file}.c" for file in ("", *changed, "_data", *more))
        return (*own, *(file for file in self.core_files if file.endswith(".c")))

    @property
    def tests(self) -> tuple[str, ...]:
        """What its self-test compiles."""
        beside = ("control_selftest", "control_vectors") if self.beside else ()
        of_test = (f"{self.name}_{file}.c" for file in ("selftest", "vectors", *beside))
        return ("selftest/main.c", *(f"selftest/{file}" for file in of_test))
