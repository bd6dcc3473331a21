"""Result of a design: controllers and filter, with reasons."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.assessment.assessment import Assessment
from ambkit.assessment.loop import AssessedLoop
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering, percent
from ambkit.control.control import Control
from ambkit.control.control_candidates import name_of
from ambkit.control.pid import GAINS, PID
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS
from ambkit.export.c import CExport
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.criteria import EVALUATED
from ambkit.judge.evaluation import evaluate, filter_figure
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Bars, Figure, Item, Panel, Rule
from ambkit.result.result import Result
from ambkit.result.row import Part, Row, Section, put
from ambkit.workflow.design_candidates import TunedCandidate
from ambkit.workflow.tuning_tasks import AHEAD, JUDGED

UNITS = {"kp": "A/m", "ki": "A/(m s)", "kd": "A s/m", "derivative_filter": "s", "anti_windup": "s"}
"""Of gains; the others have none."""


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """Controllers and filter of a design, with reasons."""

    folder: Path  #: Output folder.
    machine: Machine  #: Machine, as identified if there were logs of its axis.
    control: Control  #: Controllers, with all gains.
    candidates: tuple[TunedCandidate, ...]  #: Candidate filters.
    chosen: TunedCandidate  #: Selected candidate.
    #: Loop with the selected filter, and loop with the same controllers on the measurement.
    assessed: Assessment
    overshoot: float  #: Largest overshoot of a reference step over all axes [1].
    objections: tuple[str, ...]  #: Objections to using it; empty if there are none.
    exported: CExport | None  #: The exported C; None if objections prevented it.
    made: Mapping[str, str]  #: Files in the folder, with descriptions.
    remarks: tuple[str, ...] = ()  #: Remarks on the identified parameters.
    adequacy: tuple[Finding, ...] = ()  #: Whether the selected filter is adequate.
    record: Record | None = None  #: Last log.

    @property
    def passed(self) -> bool:
        """Whether it was exported."""
        return self.exported is not None

    @property
    def loop(self) -> AssessedLoop:
        """The loop with the selected filter."""
        return self.assessed.loops[self.chosen.kind]

    TITLE = "A filter for {0.machine.name}"

    @property
    def finding(self) -> str:
        structure = name_of(self.control.model_copy(update={"pid": {}}))
        return (
            f"Use the {KINDS[self.chosen.kind].label} with {structure} control: the "
            f"peak of |S| is {self.loop.peak:.4g}, zone {self.loop.zone} of ISO 14839-3, and a "
            f"step overshoots by {percent(max(0.0, self.overshoot))}."
        )

    @property
    def notes(self) -> list[str]:
        objections = [f"Objection: {objection}" for objection in self.objections]
        if not self.passed:
            objections.append("Nothing was exported: --force exports nevertheless.")
        return [*objections, *self.remarks]

    @property
    def rows(self) -> list[Row]:
        results: list[Row] = []
        for name, pid in self.control.pid.items():
            results += put(_of_gains(pid), section=("controllers",), of=name)
        for candidate in self.candidates:
            results += put(_of_candidate(candidate), section=("candidates",), of=candidate.kind)
        for name, loop in self.assessed.loops.items():
            if loop.stable:
                results += put([
                    Row("zone", "zone", loop.zone),
                    Row("peak", "peak of |S|", loop.peak, "|S|"),
                    Row("largest_singular_value", "largest singular value", loop.largest[0]),
                    Row("current_noise", "current noise, rms", loop.current_noise, "A", 3),
                ], section=("loops",), of=f"fed by {name}")  # fmt: skip
        return results

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        title = "Candidate filters, on validation data"
        return {
            ("controllers",): Section(f"Controllers of {self.machine.name}", across=True),
            ("candidates",): Section(title),
            ("loops",): Section("The loop with these controllers", across=True),
        }

    @property
    def chapters(self) -> list[Part]:
        files = "\n".join(f"- `{name}`: {what}" for name, what in self.made.items())
        made = Part("Files", f"All files are in {markdown(self.folder)}.\n\n{files}")
        if self.record is None:
            return [made]
        of = {KINDS[c.kind].name: evaluate(Estimator.load(c.file), self.record)
              for c in self.candidates}  # fmt: skip
        return [Part("Along the record", "", None, [filter_figure(self.record, of)]), made]

    @property
    def series(self) -> dict[str, Any]:
        control = self.control
        return {
            "folder": str(self.folder),
            "machine": self.machine.name,
            "chosen": self.chosen.kind,
            "objections": list(self.objections),
            "peak": self.loop.peak,
            "zone": self.loop.zone,
            "overshoot": self.overshoot,
            "control": {"type": control.type, "cross_feedback": control.cross_feedback,
                        "gain_scheduling": control.gain_scheduling},
            "raw_sensor": self.chosen.raw,
            "controllers": {},
            "exported": self.exported is not None,
            "files": list(self.made),
            "candidates": {
                c.kind: {"file": str(c.file), "by": c.by, "unseen": dict(c.unseen), "load": c.load}
                for c in self.candidates
            },
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        chosen, kinds = self.chosen, [c.kind for c in self.candidates]

        def bars(signal: str) -> list[Item]:
            return [Bars(kinds, np.array([c.errors[signal] for c in self.candidates]), label="")]

        raw = engineering(chosen.raw, "m", 3)
        panels = [
            Panel(Axis(""), Axis("error of position", "µm rms", 1e6),
                  [*bars("x"), Rule(chosen.raw, signal="limit", label="raw sensor")]),
            Panel(Axis(""), Axis("error of disturbance force", "N rms"), bars("f_d")),
        ]  # fmt: skip
        title = f"Errors of the candidates (chosen: {chosen.kind}; raw sensors: {raw})"
        caption = "In simulated runs of the machine."
        return [Figure("design", title, caption, panels, columns=2)]


def _of_gains(pid: PID) -> list[Row]:
    main_gains = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight")
    return [
        Row(key, key.replace("_", " "), getattr(pid, key), UNITS.get(key, "1"), 3,
            detail=key not in main_gains)
        for key in (*main_gains, *sorted(GAINS - set(main_gains)))
    ]  # fmt: skip


def _of_candidate(of: TunedCandidate) -> list[Row]:
    ahead = [
        Row(f"ahead_{n}", f"{n} step{'s' * (n > 1)} ahead", of.unseen[name], "m", 3)
        for n, name in AHEAD.items() if name in of.unseen
    ]  # fmt: skip
    likelihood = of.unseen.get(JUDGED["likelihood"], math.nan)
    return [
        Row("kept", "tuned", of.kept),
        *ahead,
        Row("log_likelihood", "log-likelihood per sample", -likelihood, detail=True),
        Row("nis", "mean NIS", of.unseen.get("nis"), detail=True),
        Row("raw_sensors", "error of the raw sensors", of.raw, "m", 3),
        *(Row(name, f"error of {name}, simulated", of.errors[name], unit, 3)
          for name, unit in EVALUATED.items()),
        Row("load", "  under a step of f_d of", of.load, "N", 3),
        Row("excess", "error of x above the Cramér-Rao bound", of.excess, "%"),
        Row("peak", "peak of |S|", of.peak, "|S|"),
    ]  # fmt: skip
