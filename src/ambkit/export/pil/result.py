"""What a processor in the loop gave: bits, cost and flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.units import engineering
from ambkit.control.lift_off_sequence import Mode
from ambkit.data.record import Record
from ambkit.export.c.cost import CLOCK, CYCLES_PER_INSTRUCTION
from ambkit.export.pil import build
from ambkit.result.report import Axis, Figure, Panel, Points
from ambkit.result.result import Result
from ambkit.result.row import Row, put
from ambkit.result.sections import Section
from ambkit.result.signal_styles import TIME
from ambkit.simulation.run import Run
from ambkit.simulation.run_figure import simulation_figure


@dataclass(frozen=True, eq=False, repr=False)
class Pil(Result):
    """What a processor in the loop gave."""

    record: Record  #: Its record: what the plant did.
    answers: NDArray[np.void]  #: (n,) `Processor.answer`, sample by sample.
    samples: int  #: How many.
    unequal: int  #: Numbers, of all that the processor told, that are not Python's to the last bit.
    frames: Record  #: What its telemetry sent.
    unequal_frames: int  #: Of the same numbers, how many are others there.
    selftest: int  #: What its self-test found wrong.
    modes: tuple[tuple[float, str], ...]  #: (float, str) When it began to do what [s].
    worst: float  #: Largest distance from the reference while it flew, after its first tenth [m].
    rms: float  #: Root mean square of that distance [m].
    touched: int  #: Samples on a stop while it flew.
    instructions: int  #: Of a step, in the median and the most seen.
    most: int
    stack_seen: int  #: Bytes that a step has used.
    state: int  #: Bytes of an instance.
    run: Run  #: The simulation that it answered to.
    board: str  #: What the rest is for.
    built: build.Built  #: Flash, memory and the most stack of the board's build.

    @property
    def passed(self) -> bool:
        """Whether all bits are the same."""
        return self.unequal + self.unequal_frames + self.selftest == 0

    TITLE = "{0.run.machine.name} flown by a processor"

    def file(self) -> Record:
        return self.record

    @property
    def finding(self) -> str:
        verdict = "all values equal those of Python to the last bit"
        if not self.passed:
            wrong = self.unequal + self.unequal_frames + self.selftest
            verdict = f"{wrong} values differ from those of Python"
        return f"{self.title}, {self.samples:,} samples: {verdict}."

    @property
    def rows(self) -> list[Row]:
        built, clock = self.built, engineering(CLOCK, "Hz")
        modes = ", ".join(f"{name} {engineering(t, 's', 4)}" for t, name in self.modes)
        time = self.most * CYCLES_PER_INSTRUCTION / CLOCK
        return [
            Row("samples", "samples", self.samples),
            Row("unequal", "values that differ from Python's", self.unequal, below=1),
            Row("unequal_frames", "  in the telemetry", self.unequal_frames, below=1),
            Row("selftest", "  in its self-test", self.selftest, below=1),
            Row("modes", "modes", modes, detail=True),
            Row("worst", "greatest tracking error while levitated", self.worst, "m", 3),
            Row("rms", "  rms", self.rms, "m", 3),
            Row("touched", "samples in contact while levitated", self.touched),
            Row("instructions", "instructions per step, median", self.instructions),
            Row("most", "  maximum observed", self.most),
            Row("time", "  time of the maximum", time, "s", 3, below=self.record.sampling_time,
                note=f"at {clock}, {CYCLES_PER_INSTRUCTION} cycles an instruction assumed"),
            Row("stack_seen", "stack per step, maximum observed [byte]", self.stack_seen),
            Row("state", "memory of an instance [byte]", self.state),
            *put([
                Row("compiler", "compiler", built.compiler, detail=True),
                Row("code", "code [byte]", built.code),
                Row("constants", "constants [byte]", built.constants),
                Row("variables", "other memory [byte]", built.variables),
                Row("stack", "stack per step, bound from the call graph [byte]", built.stack),
            ], section=("built",)),
        ]  # fmt: skip

    SECTIONS = {(): Section("Processor in the loop"),
            ("built",): Section("Built for: {0.board}")}  # fmt: skip

    @property
    def series(self) -> dict[str, Any]:
        return {"modes": self.modes, "board": self.board, "passed": self.passed}

    def figures(self) -> list[Figure]:
        counted = self.answers["instructions"]
        return [simulation_figure(self.run),
                instructions_figure(self.record.t, counted)]  # fmt: skip


def unequal_frames(answers: NDArray[np.void], frames: Record, names: list[str], coils: bool) -> int:
    """Return how many numbers the telemetry has otherwise than the answers."""
    # told (n,)
    if frames.t.size != len(answers):
        return len(answers)
    pairs = [(answers["mean"][:, k], frames[name]) for k, name in enumerate(names)]
    pairs.append((answers["status"], frames["status"]))
    if coils:
        pairs += [(answers[name].ravel(), frames[name]) for name in ("iu", "u", "mode", "usable")]
        sent = sum(name.startswith("coil_") for name in frames.signals)
        pairs += [(answers["coil"][:, 0, k], frames[f"coil_{k}"]) for k in range(sent)]
    return sum(int((there != sent).sum()) for there, sent in pairs)


def compare_bits(
    answers: NDArray[np.void],
    greeting: np.void,
    *,
    off: Array,
    moved: Array,
    travel: Array,
    **details: Any,
) -> Pil:
    """Return what the answers say of flight and cost, with what else there is."""
    # told (n,); off (n, axes) [m]; moved (n, axes) [m]; travel (axes,) [m]
    mode = answers["mode"].astype(int)
    begins = np.flatnonzero(np.diff(mode, prepend=-1))
    flying = np.flatnonzero(mode == Mode.FLYING)
    settled = off[flying[len(flying) // 10 :]]
    counted = answers["instructions"][answers["instructions"] > 0]
    return Pil(
        answers=answers,
        samples=len(answers),
        selftest=int(greeting["unequal"] + greeting["wrong_status"] + greeting["wrong"]),
        modes=tuple((float(details["record"].t[k]), Mode(mode[k]).name) for k in begins),
        worst=float(np.abs(settled).max()) if settled.size else float("nan"),
        rms=float(np.sqrt((settled**2).mean())) if settled.size else float("nan"),
        touched=int((np.abs(moved[flying]) >= travel).any(axis=1).sum()),
        instructions=int(np.median(counted)),
        most=int(counted.max()),
        stack_seen=int(answers["stack"].max()),
        state=int(greeting["state"]),
        **details,
    )


def instructions_figure(t: NDArray[np.float64], instructions: NDArray[np.uint32]) -> Figure:
    """Show the instructions."""
    # t (n,) [s]; instructions (n,)
    counted = instructions > 0
    counts = instructions[counted].astype(float)
    points = Points(t[counted], counts, signal="estimate", label="counted")
    caption = "Counted in some of the samples."
    panel = Panel(TIME, Axis("instructions of a step"), [points])
    return Figure(id="instructions", title="Instructions", caption=caption, panels=[panel])
