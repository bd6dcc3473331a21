"""A prepared study: from the number of a run to its machine."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base import files, units
from ambkit.base.arrays import Array
from ambkit.base.config.document import updated
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import json_text
from ambkit.campaigns import sampling
from ambkit.campaigns.distributions import ChoiceMarginal, Marginal
from ambkit.campaigns.keys import OF_RUN, Key, changed
from ambkit.campaigns.study import Study
from ambkit.campaigns.study_checks import key_of
from ambkit.campaigns.study_tables import UNITS
from ambkit.control.control import Control
from ambkit.control.controllers import TYPES, Controllers, controllers_of, relative_gains
from ambkit.control.default_control import is_default
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import FILTER_SUFFIX, default_name
from ambkit.machine.loading import load_machine
from ambkit.machine.parts import FILES
from ambkit.models.plant import Plant
from ambkit.simulation.plans import Planned
from ambkit.simulation.scenario import Scenario, control_of, settled_scenario, wrong_for

IN_PROPORTION = ("kp", "ki", "kd", "feed_forward")
"""PID gains that scale with those of amplifier and sensor."""


class SampledMachine(NamedTuple):
    """One machine of a study."""

    run: int  #: Number of the run.
    values: Mapping[str, Any]  #: Varied quantities by key: in SI, or the value of a choice.
    planned: Planned  #: Plant, scenario and estimator.
    wrong: str  #: Reason if the machine is impossible; else empty.


@dataclass(frozen=True, eq=False)
class Plan:
    """A study with its machine, distributions and everything common to all runs."""

    study: Study  #: Checked study.

    @cached_property
    def nominal(self) -> Any:
        """Nominal machine, for which controllers and estimators are designed."""
        return load_machine(self.study.machine)

    @property
    def several(self) -> bool:
        """Whether the machine has several axes."""
        return not self.nominal.single

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Keys of the varied quantities."""
        return tuple(item.what for item in self.study.vary)

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Their units, nominal values and limits."""
        study = self.study
        return tuple(key_of(item, self.nominal, study.scenario, self.filter) for item in study.vary)

    @cached_property
    def marginals(self) -> tuple[Marginal, ...]:
        """Their distributions."""
        pairs = zip(self.study.vary, self.keys, strict=True)
        return tuple(item.marginal(key) for item, key in pairs)

    @cached_property
    def levels(self) -> tuple[int, ...]:
        """Number of grid levels of each."""
        return tuple(
            len(of.values) if isinstance(of, ChoiceMarginal) else item.levels or 1
            for item, of in zip(self.study.vary, self.marginals, strict=True)
        )

    @cached_property
    def runs(self) -> int:
        """Maximum number of runs."""
        if self.study.sampling == "grid":
            return math.prod(self.levels) * self.study.repeats
        return self.study.runs or 0

    @property
    def parts(self) -> int:
        """Number of parts."""
        return -(-self.runs // self.study.part)

    def span(self, part: int) -> tuple[int, int]:
        """Return the first run of a part, and that after its last."""
        size = self.study.part
        return part * size, min((part + 1) * size, self.runs)

    @cached_property
    def correlation(self) -> Array | None:
        """Correlation matrix (k, k) of the normal scores; None without correlation."""
        if not self.study.correlation:
            return None
        matrix = np.eye(len(self.names))
        for item in self.study.correlation:
            i, j = (self.names.index(name) for name in item.between)
            matrix[i, j] = matrix[j, i] = item.coefficient
        return matrix

    @cached_property
    def scenario(self) -> Any:
        """Scenario, with the study's seed and the controllers of the nominal machine."""
        run = self.study.scenario.model_copy(update={"seed": self.study.seed})
        if "none" in self._estimator_names and run.feedback is None:
            run = run.fed("measurement")
        chosen = self._choices("controller")
        if self.several and chosen and "tuned" not in chosen and is_default(run.controller):
            plain = run.controller.model_copy(update={"type": "decentralised"})
            run = run.model_copy(update={"controller": plain})
        return settled_scenario(self.nominal, run)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything that determines the rows, including files named by the study."""
        named = [self.filter, *map(str, self._choices("estimator"))]
        of, files_of = self.nominal, {"magnet": {*FILES}}
        without: Any = {"bearings": {"__all__": files_of}, "rotor": {"file"}}
        named_there = [getattr(item.magnet, name) for item in of.bearings for name in FILES]
        named_there.append(getattr(of.rotor, "file", None))
        content = {
            "study": self.described.model_dump(
                mode="json", exclude={"name", "description", "stop", "machine"}
            ),
            "bearing": of.model_dump(mode="json", exclude=without),
            "filters": [files.sha256(name) for name in named if name.endswith(FILTER_SUFFIX)],
            "force_map": [files.sha256(item) for item in named_there if item is not None],
        }
        text = json_text(_without_folders(content), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def described(self) -> Study:
        """The study in the form of a file, with units."""
        study, passes = self.study, self.study.passes
        vary = tuple(item.in_units(key) for item, key in zip(study.vary, self.keys, strict=True))
        at_most = {
            name: units.engineering(limit, UNITS[name], digits=None)
            if type(limit) is float and UNITS[name] != "1" else limit
            for name, limit in passes.at_most.items()
        }  # fmt: skip
        criteria = passes.model_copy(update={"at_most": at_most})
        return study.model_copy(update={"vary": vary, "passes": criteria})

    def _choices(self, what: str) -> tuple[Any, ...]:
        of = dict(zip(self.names, self.marginals, strict=True)).get(what)
        return of.values if isinstance(of, ChoiceMarginal) else ()

    def points(self, first: int, stop: int) -> Array:
        """Return the values of each quantity in some runs (n, k), in SI, for choices indices."""
        return sampling.values(self, sampling.uniforms(self, first, stop))

    def noise(self, first: int, stop: int) -> NDArray[np.uint64]:
        """Return the numbers (n,) of the noise of runs."""
        # Independent, except within a group of Saltelli's points, whose runs differ in the varied
        # quantities only.
        run = np.arange(first, stop, dtype=np.uint64)
        if self.study.sampling == "saltelli":
            return run // np.uint64(len(self.marginals) + 2)
        return run

    def machines(
        self, points: Array, noise: NDArray[np.uint64], first: int
    ) -> Iterator[SampledMachine]:
        """Yield the machines at points."""
        # points (n, k); noise (n,)
        allowed = self.allowed(points)
        for at, row in enumerate(points):
            values = {  # in SI, or the value of a choice
                name: of.values[int(value)] if isinstance(of, ChoiceMarginal) else float(value)
                for name, of, value in zip(self.names, self.marginals, row, strict=True)
            }
            yield self._sampled(first + at, values, int(noise[at]), bool(allowed[at]))

    def allowed(self, points: Array) -> NDArray[np.bool_]:
        """Return at which points (n, k) all numbers are within the limits of their keys (n,)."""
        allowed = np.ones(len(points), bool)
        for place, (key, of) in enumerate(zip(self.keys, self.marginals, strict=True)):
            if not isinstance(of, ChoiceMarginal) and key.unit:
                column = points[:, place]
                if key.above is not None:
                    allowed &= column > key.above
                if key.at_least is not None:
                    allowed &= column >= key.at_least
        return allowed

    def _sampled(
        self, run: int, values: Mapping[str, Any], noise: int, allowed: bool
    ) -> SampledMachine:
        scenario = self._scenario(values)
        estimator = self.estimators[str(values.get("estimator", self.filter))]
        own = {
            name: value for name, value in values.items()
            if name not in ("estimator", "controller") and not name.startswith(OF_RUN)
        }  # fmt: skip
        wrong = "" if allowed else self.beyond(values)
        plant = self.nominal
        if own and not wrong:
            plant = changed(plant, own)
            wrong = next(iter(plant.contradictions(self.nominal)), "")
        return SampledMachine(run, values, self._planned(plant, scenario, estimator, noise), wrong)

    def beyond(self, values: Mapping[str, Any]) -> str:
        """Return which value is out of its range."""
        for name, key in zip(self.names, self.keys, strict=True):
            if isinstance(values[name], float) and not key.allows(values[name]):
                return f"{name} is {values[name]:.4g} {key.unit}"
        return "a value is out of its range"

    @cached_property
    def _of_run(self) -> tuple[str, ...]:
        return tuple(n for n in self.names if n == "controller" or n.startswith(OF_RUN))

    def _scenario(self, values: Mapping[str, Any]) -> Any:
        """Return the scenario; if nothing in it varies, always the same object."""
        run_values = tuple((name, values[name]) for name in self._of_run)
        return self._scenarios(run_values) if run_values else self.scenario

    @cached_property
    def _scenarios(self) -> Any:
        @lru_cache(maxsize=256)
        def made(run_values: tuple[tuple[str, Any], ...]) -> Any:
            values, run = dict(run_values), self.scenario
            chosen = values.pop("controller", None)
            if chosen is not None:
                run = run.model_copy(update={"controller": self.controllers[str(chosen)]})
            of_run = {name.removeprefix(OF_RUN): value for name, value in values.items()}
            return changed(run, of_run)

        return made

    @cached_property
    def controllers(self) -> dict[str, Control]:
        """The controllers of the study, designed for the nominal machine."""
        nominal, run, tuned = self.nominal, self.scenario, self.scenario.controller
        pids = {axis.name: PID.textbook(nominal[axis.name]) for axis in nominal.axes}
        known = {
            "tuned": tuned,
            "textbook": Control.textbook(nominal) if nominal.single else Control(pid=pids),
            **{name: Control.model_validate({"type": name}) for name in TYPES},
            **self.study.controllers,
        }
        made = dict[str, Control]()
        for name in map(str, self._choices("controller")):
            fed = "estimate" if known[name].needs_estimate else tuned.feedback or "estimate"
            chosen = known[name].fed_by(known[name].feedback or fed)
            made[name] = control_of(nominal, run.model_copy(update={"controller": chosen}))
        return made

    def _planned(
        self, plant: Any, run: Scenario, estimator: Estimator | None, noise: int
    ) -> Planned:
        """Return a run whose controllers use the nominal gains of amplifiers and sensor."""
        # The simulated controllers divide by the plant's gains; the ratio is a factor on theirs.
        if self.several or run.controller.type == "lqg":
            ratio = relative_gains(plant, self.nominal)
            made = self._made(run, estimator).scaled(ratio)
            return Planned(plant, run, estimator, number=noise, controllers=made)
        pid, gain = run.controller, plant.amplifier.gain / self.nominal.amplifier.gain
        if pid.feedback == "measurement":
            gain *= plant.sensor.gain / self.nominal.sensor.gain
        if gain != 1:
            changes = {name: gain * getattr(pid, name) for name in IN_PROPORTION}
            run = updated(run, {"controller": updated(pid, changes)})
        return Planned(plant, run, estimator, number=noise)

    @cached_property
    def _controllers_made(self) -> dict[Any, Controllers]:
        return {}

    def _made(self, run: Scenario, estimator: Estimator | None) -> Controllers:
        key, known = (id(estimator), run.controller.model_dump_json()), self._controllers_made
        if key not in known:
            fed = estimator if run.feedback == "estimate" else None
            known[key] = controllers_of(Plant(self.nominal), run.controller, fed)
        return known[key]

    @property
    def filter(self) -> str:
        """Name of the filter where it does not vary."""
        return self.study.estimator or default_name(self.nominal)

    @property
    def _estimator_names(self) -> list[str]:
        return [str(name) for name in self._choices("estimator") or (self.filter,)]

    @cached_property
    def estimators(self) -> dict[str, Estimator | None]:
        """The estimators by name, designed for the nominal machine; None for ``"none"``."""
        from ambkit.estimate.named import factories

        names = self._estimator_names
        kinds = [name for name in names if name != "none"]
        built = factories(kinds, self.nominal)
        made: dict[str, Estimator | None] = {name: make() for name, make in built.items()}
        return made | ({"none": None} if "none" in names else {})

    def __getstate__(self) -> dict[str, Any]:
        """Exclude what another process can recompute; no file is needed there."""
        return {name: getattr(self, name) for name in ("study", "nominal", "estimators")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)

    def with_design(self, estimator: Estimator, controller: Control | None) -> Plan:
        """Return the plan with another filter and, if given, another controller."""
        made: dict[str, Any] = {"estimators": {self.filter: estimator}}
        if controller is not None:
            made["scenario"] = self.scenario.model_copy(update={"controller": controller})
        other = type(self)(self.study)
        vars(other).update(nominal=self.nominal, marginals=self.marginals, keys=self.keys, **made)
        return other

    def check(self) -> None:
        """Build everything common to all runs, which reports errors before the first run."""
        if wrong := list(wrong_for(self.scenario, self.nominal)):
            raise AmbkitError(f"{self.study.name}: scenario.{'; scenario.'.join(wrong)}")
        if "none" in self.estimators and self.scenario.feedback == "estimate":
            raise AmbkitError(
                f"{self.study.name}: the controller is fed by the estimate, so the estimator "
                'cannot be none; say feedback = "measurement"'
            )
        chosen = self._choices("controller")
        for estimator in self.estimators.values():
            for values in [{"controller": name} for name in chosen] or [{}]:
                run = self._scenarios(tuple(values.items())) if values else self.scenario
                self._planned(self.nominal, run, estimator, 0)
        self.points(0, 1)


def _without_folders(data: Any) -> Any:
    """Return plain data with file names without folders: a study may move with its files."""
    if isinstance(data, dict):
        return {key: _without_folders(item) for key, item in data.items()}
    if isinstance(data, list):
        return [_without_folders(item) for item in data]
    is_file = isinstance(data, str) and data.endswith(FILTER_SUFFIX)
    return PurePath(data).name if is_file else data
