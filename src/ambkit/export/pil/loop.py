"""Processor in the loop: an exported controller on a Cortex-M4F with the simulated plant."""

from __future__ import annotations

import os
import select
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array, Index
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.base.units import engineering
from ambkit.control.control import WITH_CURRENT, LiftOff, Mode
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.data.telemetry import read_telemetry
from ambkit.estimate.estimator import Estimator
from ambkit.export.c.control import controller_of
from ambkit.export.c.cost import CLOCK, CYCLES_PER_INSTRUCTION
from ambkit.export.c.exporter import export_c
from ambkit.export.c.model import states
from ambkit.export.pil import build
from ambkit.export.pil.build import QEMU, qemu_command
from ambkit.machine.accessories import rotation_signal
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Panel, Points
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.result.signal_styles import TIME
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.run_figure import simulation_figure
from ambkit.simulation.scenario import Scenario, energised, fly_command

OFTEN = 20  #: Samples between two counts of instructions.
PATIENCE = 60.0  #: Timeout of an answer, which takes less than one second.

GREETING = np.dtype(
    [(name, "<u4") for name in ("unequal", "wrong_status", "wrong", "selftest", "state")]
)
_END = 2


class Processor:
    """A running firmware."""

    def __init__(self, image: Path, folder: Path, sensors: int, axes: int, states: int) -> None:
        # Inputs and outputs of a sample: ``c/samples.h``.
        self.sample = np.dtype([
            ("y", "<f4", (sensors,)), ("r", "<f4", (axes,)), ("rotation", "<f4"), ("fly", "<u4"),
            ("failed", "<u4"), ("counted", "<u4"),
        ])  # fmt: skip
        self.answer = np.dtype([
            ("coil", "<f4", (axes, 2)), ("iu", "<f4", (axes,)), ("u", "<f4", (axes,)),
            ("mean", "<f4", (states,)), ("status", "<u4"), ("mode", "<u4"), ("on", "<u4"),
            ("usable", "<u4"), ("instructions", "<u4"), ("stack", "<u4"),
        ])  # fmt: skip
        self._answers: list[np.void] = []
        self._pipes = []
        for name in ("samples", "answers"):
            os.mkfifo(folder / name)
            # For both directions: opening does not wait for the other end.
            self._pipes.append(os.open(folder / name, os.O_RDWR))
        self._process = subprocess.Popen(
            qemu_command(image), cwd=folder,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self.greeting = self._take(GREETING)
        except AmbkitError:
            self.close()
            raise

    def step(
        self, y: ArrayLike, r: ArrayLike, *, fly: bool, rotation: float = 0.0, failed: bool = False
    ) -> np.void:
        """Process one sample, before which the power may have failed, and return the answer."""
        # Instructions are counted every so many samples, and after changes of mode or status. y
        # (sensors,); r (axes,) [m]; rotation: the reading of the angle's sensor, or the speed
        last = self._answers[-2:]
        new = len(last) == 2 and any(last[0][name] != last[1][name] for name in ("mode", "status"))
        counted = new or len(self._answers) % OFTEN == 0
        self._send(y, r, rotation, fly, failed, counted)
        self._answers.append(self._take(self.answer))
        return self._answers[-1]

    @property
    def answers(self) -> NDArray[np.void]:
        """All answers, sample by sample (n,)."""
        return np.array(self._answers, self.answer)

    def close(self) -> None:
        """End it."""
        if self._process.poll() is None:
            self._send(0.0, 0.0, 0.0, False, False, _END)
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        for pipe in self._pipes:
            os.close(pipe)
        self._pipes = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, *values: Any) -> None:
        frame = np.zeros((), self.sample)
        for name, value in zip(self.sample.names or (), values, strict=True):
            frame[name] = value
        os.write(self._pipes[0], frame.tobytes())

    def _take(self, what: np.dtype[np.void]) -> np.void:
        got, until = b"", time.monotonic() + PATIENCE
        while len(got) < what.itemsize:
            if select.select([self._pipes[1]], [], [], 0.5)[0]:
                got += os.read(self._pipes[1], what.itemsize - len(got))
                until = time.monotonic() + PATIENCE
            elif self._process.poll() is not None or time.monotonic() > until:
                message = ""
                if self._process.poll() is not None and self._process.stdout is not None:
                    message = ": " + self._process.stdout.read().decode(errors="replace").strip()
                raise AmbkitError(f"the firmware in {QEMU} does not answer{message}")
        answer: np.void = np.frombuffer(got, what)[0]
        return answer


Expected = dict[str, NDArray[Any]]


def pil(
    machine: Machine,
    filter: Estimator,
    *,
    scenario: Scenario | None = None,
    board: str | None = None,
    force: bool = False,
) -> Pil:
    """Run the exported controller with a filter in float in qemu, with a simulated plant."""
    # The plant is simulated here with the controller, and its measurements go to the processor
    # sample by sample. If the answers have the same bits, which is checked, the rotor would have
    # moved identically with the processor's own currents.
    if board is not None and board not in build.BOARDS:
        raise AmbkitError(f'board must be one of {", ".join(build.BOARDS)}, is "{board}"')
    for_board = build.QEMU_BOARD if board is None else build.BOARDS[board]
    build.check(for_board)
    build.check(build.QEMU_BOARD)
    plant, several = machine, not machine.single
    base_scenario = scenario or Scenario(duration=1.0)
    of_type(Scenario, scenario=base_scenario)
    sequence = base_scenario.sequence or LiftOff()
    lift_scenario = base_scenario.model_copy(update={"start": "landed", "sequence": sequence})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export = export_c(
            plant, filter, folder / "export", prefix=build.PREFIX, telemetry=True, force=force,
            scenario=lift_scenario,
        ).folder  # fmt: skip
        fields = [state.field for state in states(filter.states)]
        runs = build.in_qemu(for_board)
        image = build.firmware(export, fields, runs, folder / "qemu", several)
        built = build.size(export, for_board, folder / "board", several)
        run = simulate_run(plant, lift_scenario, estimator=filter)
        record = run.record
        measurement = np.column_stack([record[signal("y", r.name)] for r in plant.readings])
        y = filter.inputs.y.numbers(measurement)
        r = np.column_stack([record[signal("r", name)] for name in run.axes])
        rotation = record.signals.get(rotation_signal(plant.angle), np.zeros(len(y)))
        on = energised(lift_scenario.off, lift_scenario.on, record.t, machine.sampling_time)
        fly, failed = fly_command(sequence, record.t, on), np.r_[False, on[:-1] <= 0]
        (folder / "pipes").mkdir()
        sizes = y.shape[1], r.shape[1], len(fields)
        with Processor(image, folder / "pipes", *sizes) as processor:
            for k in range(len(y)):
                processor.step(y[k], r[k], fly=fly[k] > 0, rotation=rotation[k], failed=failed[k])
            greeting, answers = processor.greeting, processor.answers
        frames = read_telemetry(folder / "pipes" / "frames", export / "telemetry.json")
    others = _others(answers, _expected(run, filter, lift_scenario, y, r, fly, on), run)
    s = np.column_stack([record[run.displacement(name)] for name in run.axes])
    travel = np.array([axis.bearing.clearance for axis in plant.axes])
    names = [state.name for state in filter.states]
    return compare_bits(
        answers, greeting, off=s - r, moved=s, travel=travel, record=record, run=run,
        unequal=int(others.sum()), frames=frames,
        unequal_frames=unequal_frames(answers, frames, names, coils=not several),
        board=for_board.about, built=built,
    )  # fmt: skip


def _expected(
    run: Run, filter: Estimator, scenario: Scenario, y: Array,
    r: Array, fly: Array, on: Array,
) -> Expected:  # fmt: skip
    """Return the expected answers: as simulated, or along a rig's rounded numbers."""
    record = run.record
    if filter.inputs.y.gain != 1 or filter.inputs.y.zero:  # of one axis
        controller = controller_of(filter, scenario)
        rounded = y[:, 0].astype("f4").astype(float)
        return controller.run(rounded, r[:, 0], fly, energised=on)
    assert run.estimate is not None
    assert run.usable is not None
    u = np.column_stack([record[signal("u", name)] for name in run.axes])
    return {"u": u, "mode": record["mode"], "status": run.status, "usable": run.usable,
            "mean": run.estimate.mean}  # fmt: skip


def _others(answers: NDArray[np.void], expected: Expected, run: Run) -> Index:
    """Return the number of differing values in each sample (n,)."""
    axes, single = run.machine.axes, np.float32
    n = len(answers)
    gain = np.array([axis.bearing.amplifier.gain for axis in axes], single)
    magnets = [axis.bearing.magnet for axis in axes]
    on = np.isin(expected["mode"], WITH_CURRENT)
    bias = np.where(on[:, None], np.array([m.bias_current for m in magnets], single), 0)
    pairs = [m.type == "two-sided" for m in magnets]
    coil = np.stack([bias + answers["iu"], np.where(pairs, bias - answers["iu"], 0)], axis=2)
    others = (answers["on"] != on).astype(int)
    for name in ("mode", "status", "usable"):
        others += answers[name] != expected[name]
    others += (answers["u"] != expected["u"].reshape(n, -1)).sum(1)
    others += (answers["u"] != answers["iu"] / gain).sum(1)
    others += (answers["coil"] != coil.astype(single)).sum((1, 2))
    others += (answers["mean"] != expected["mean"]).sum(1)
    return np.asarray(others)


@dataclass(frozen=True, eq=False, repr=False)
class Pil(Result):
    """Result of a processor in the loop."""

    record: Record  #: Record of the plant.
    answers: NDArray[np.void]  #: (n,) `Processor.answer` of each sample.
    samples: int  #: Number of samples.
    unequal: int  #: Number of values from the processor that differ from Python's.
    frames: Record  #: Received telemetry.
    unequal_frames: int  #: Number of differing values in it.
    selftest: int  #: Errors of its self-test.
    modes: tuple[tuple[float, str], ...]  #: (float, str) Start of each mode [s].
    #: Largest distance from the reference during levitation, after its first tenth [m].
    worst: float
    rms: float  #: Root mean square of that distance [m].
    touched: int  #: Samples in contact during levitation.
    instructions: int  #: Instructions of a step, median and maximum observed.
    most: int
    stack_seen: int  #: Observed stack of a step [bytes].
    state: int  #: Memory of an instance [bytes].
    run: Run  #: Simulation.
    board: str  #: Board of the remaining figures.
    built: build.Built  #: Flash, memory and maximum stack of the board's build.

    @property
    def passed(self) -> bool:
        """Whether all bits are equal."""
        return self.unequal + self.unequal_frames + self.selftest == 0

    TITLE = "{0.run.machine.name} on an emulated processor"

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
            Row("worst", "maximum tracking error while levitated", self.worst, "m", 3),
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
        counts = self.answers["instructions"]
        t, counts = self.record.t[counts > 0], counts[counts > 0].astype(float)
        points = Points(t, counts, signal="estimate", label="counted")
        panel = Panel(TIME, Axis("instructions of a step"), [points])
        caption = "Counted in some of the samples."
        return [simulation_figure(self.run),
                Figure("instructions", "Instructions", caption, [panel])]  # fmt: skip


def unequal_frames(answers: NDArray[np.void], frames: Record, names: list[str], coils: bool) -> int:
    """Return the number of telemetry values that differ from the answers."""
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
    """Return the results from the answers: levitation and cost, with further ones."""
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
