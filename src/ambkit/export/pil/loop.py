"""Processor in the loop: the exported controller on a Cortex-M4F flies the simulated plant."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.data.telemetry import read_telemetry
from ambkit.estimate.registry import KINDS
from ambkit.export.c.exporter import export_c
from ambkit.export.c.model import states
from ambkit.export.pil import boards, build, path
from ambkit.export.pil.processor import ANSWER, Processor
from ambkit.machine.machine import Machine
from ambkit.simulation.control import Controller
from ambkit.simulation.run import Loop, simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.sequence import LiftOff, Mode

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.magnets import MagnetModel

OFTEN = 20
"""Every so many samples instructions are counted, and wherever mode or status is another."""

_NAME = "rig"


@dataclass(frozen=True)
class Pil:
    """What a processor in the loop gave.

    Attributes
    ----------
    record : Record
        The flight: what the plant did while the processor flew it.
    answers : ndarray (n,)
        All that the processor told, sample by sample, by the names in ``processor.ANSWER``.
    samples : int
        How many.
    unequal : int
        Numbers, of all that the processor told, that are not Python's to the last bit.
    frames : Record
        What its telemetry sent.
    unequal_frames : int
        Of the same numbers, how many are others there.
    unequal_flight : int
        Samples whose place is not the one of the flight that `simulate` gives; None where the
        rig's own numbers go to the processor, which round what the sensor shows.
    selftest : int
        What its self-test found wrong.
    modes : tuple of (float, str)
        When it began to do what [s].
    worst : float
        Largest distance from the reference while it flew, after its first tenth [m].
    rms : float
        Root mean square of that distance [m].
    touched : int
        Samples on a stop while it flew.
    instructions, most : int
        Of a step, in the median and the most seen.
    bound : Bound
        Of a step at most, along any path through what qemu runs.
    stack_seen : int
        Bytes that a step has used.
    state : int
        Bytes of an instance.
    board : str
        What the rest is for.
    built : Built
        Flash, memory and the most stack of the board's build.
    """

    record: Record
    answers: NDArray[np.void]
    samples: int
    unequal: int
    frames: Record
    unequal_frames: int
    unequal_flight: int | None
    selftest: int
    modes: tuple[tuple[float, str], ...]
    worst: float
    rms: float
    touched: int
    instructions: int
    most: int
    bound: path.Bound
    stack_seen: int
    state: int
    board: str
    built: build.Built

    @property
    def passed(self) -> bool:
        """Whether all bits are the same."""
        wrong = self.unequal + self.unequal_frames + self.selftest + (self.unequal_flight or 0)
        return wrong == 0

    def to_dict(self) -> dict[str, Any]:
        """Return all but the records and the answers."""
        left = ("record", "answers", "frames")
        told = {k: each for k, each in vars(self).items() if k not in left}
        told |= {"passed": self.passed, "built": self.built._asdict()}
        return told | {"bound": self.bound._asdict()}


def pil(
    bearing: Bearing | Machine,
    magnet: MagnetModel | None = None,
    *,
    scenario: Scenario | None = None,
    kind: str | None = None,
    filter_file: FilterFile | None = None,
    board: str | None = None,
) -> Pil:
    """Fly a simulated plant by the exported controller, on a Cortex-M4F in qemu.

    Parameters
    ----------
    bearing : Bearing
        The plant, and what the controller knows of it.
    magnet : optional
        What the filter asks of its magnet, as of :func:`ambkit.export.c.export_c`.
    scenario : Scenario, optional
        What happens, and whose controller flies. It begins at rest; lift-off and landing are as
        usual where it does not say.
    kind : str, optional
        Of estimator.
    filter_file : FilterFile, optional
        The filter, in the place of `kind` and `magnet`.
    board : str, optional
        For flash, memory and stack: a name in ``boards.BOARDS``; by default what runs in qemu.

    Raises
    ------
    AmbkitError
        Tools are missing; a machine of several axes; or the firmware fails.
    """
    if isinstance(bearing, Machine):
        raise AmbkitError(f"{bearing.name}: only one axis can be flown by a processor in the loop")
    if board is not None and board not in boards.BOARDS:
        raise AmbkitError(f'board must be one of {", ".join(boards.BOARDS)}, is "{board}"')
    for_board = boards.QEMU_BOARD if board is None else boards.BOARDS[board]
    boards.check(for_board)
    boards.check(boards.QEMU_BOARD)
    flown = _from_rest(scenario or Scenario(duration=1.0))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export = export_c(
            bearing, magnet, folder / "export", kind=kind, filter_file=filter_file, prefix=_NAME,
            scenario=flown, telemetry=True,
        ).folder  # fmt: skip
        estimator = _estimator(bearing, magnet, kind, filter_file)
        fields = [state.field for state in states(estimator.states)]
        image = build.firmware(export, _NAME, fields, boards.QEMU_BOARD, folder / "qemu")
        built = build.size(export, _NAME, for_board, folder / "board")
        # The state and the output; the first word of the state leads to what it works by.
        works_by = {(0, 0): f"{_NAME}_control"}
        bound = path.bound(image, f"{_NAME}_step", objects=0b101, points=works_by)
        (folder / "pipes").mkdir()
        with Processor(image, folder / "pipes") as processor:
            greeting = processor.greeting
            record, told = _fly(bearing, flown, estimator, processor)
        frames = read_telemetry(folder / "pipes" / "frames", export / "telemetry.json")
    return _judged(
        bearing, flown, estimator, record, told, greeting, for_board, built, bound, frames
    )


def _from_rest(scenario: Scenario) -> Scenario:
    update = {"start": "rest", "sequence": scenario.sequence or LiftOff()}
    return scenario.model_copy(update=update)


def _estimator(
    bearing: Bearing, magnet: MagnetModel | None, kind: str | None, file: FilterFile | None
) -> Estimator:
    """Return what is exported, in Python."""
    if file is not None:
        return file.make(precision="float32", magnet=magnet)
    name = kind or ("linear" if magnet is None else "adaptive")
    return KINDS[name].make(bearing, magnet, precision="float32")


def _fly(
    bearing: Bearing, scenario: Scenario, estimator: Estimator, processor: Processor
) -> tuple[Record, Any]:
    """Return the record, and what the processor told, sample by sample."""
    answers: list[np.void] = []
    numbers = estimator.inputs.y.numbers

    def elsewhere(y: float, r: float, fly: bool) -> tuple[float, float, bool, int]:
        last = answers[-1] if answers else None
        new = last is not None and len(answers) > 1 and (
            last["mode"] != answers[-2]["mode"] or last["status"] != answers[-2]["status"]
        )  # fmt: skip
        counted = bool(new) or len(answers) % OFTEN == 0
        said = processor.step(float(numbers(y)), r, fly=fly, counted=counted)
        answers.append(said)
        return float(said["iu"]), float(said["u"]), bool(said["on"]), int(said["mode"])

    run = Loop(bearing, scenario, estimator=estimator, elsewhere=elsewhere).run()
    return run.record, np.array(answers, ANSWER)


def _judged(
    bearing: Bearing,
    scenario: Scenario,
    estimator: Estimator,
    record: Record,
    told: Any,
    greeting: np.void,
    board: boards.Board,
    built: build.Built,
    bound: path.Bound,
    frames: Record,
) -> Pil:
    sequence = scenario.sequence
    assert sequence is not None
    controller = Controller(bearing, estimator, scenario.controller.completed(bearing), sequence)
    raw = estimator.inputs.y.numbers(record["y"]).astype("f4").astype(float)
    here = controller.run(raw, record["r"], sequence.fly(record.t))
    unequal = 0
    for name in ("iu", "u", "status", "mode", "on", "usable"):
        unequal += int((told[name] != here[name]).sum())
    unequal += int((told["coil"][:, : controller.coils] != here["coil"]).sum())
    columns = min(4, here["mean"].shape[1])
    unequal += int((told["mean"][:, :columns] != here["mean"][:, :columns]).sum())
    flight = None
    if estimator.inputs.y.gain == 1.0 and not estimator.inputs.y.zero:
        same = simulate_run(bearing, scenario, estimator=estimator).record
        flight = int((same["x"] != record["x"]).sum())
    mode = told["mode"].astype(int)
    begins = np.flatnonzero(np.diff(mode, prepend=-1))
    flying = np.flatnonzero(mode == Mode.FLYING)
    off = np.abs(record["x"] - record["r"])[flying[len(flying) // 10 :]]
    counted = told["instructions"][told["instructions"] > 0]
    travel = bearing.rotor.travel_limit
    return Pil(
        record=record,
        answers=told,
        samples=len(mode),
        unequal=unequal,
        unequal_flight=flight,
        selftest=int(greeting["unequal"] + greeting["wrong_status"] + greeting["wrong"]),
        modes=tuple((float(record.t[k]), Mode(mode[k]).name) for k in begins),
        worst=float(off.max()) if off.size else float("nan"),
        rms=float(np.sqrt((off**2).mean())) if off.size else float("nan"),
        touched=int((np.abs(record["x"][flying]) >= travel).sum()),
        instructions=int(np.median(counted)),
        most=int(counted.max()),
        bound=bound,
        frames=frames,
        unequal_frames=_others(told, frames, estimator),
        stack_seen=int(told["stack"].max()),
        state=int(greeting["state"]),
        board=board.about,
        built=built,
    )


def _others(told: Any, frames: Record, estimator: Estimator) -> int:
    """Return how many numbers the telemetry has otherwise than the answers."""
    if frames.t.size != len(told):
        return len(told)
    names = [state.name for state in estimator.states][:4]
    pairs = [(told["mean"][:, k], frames[name]) for k, name in enumerate(names)]
    pairs += [(told[name], frames[name]) for name in ("iu", "u", "status", "mode", "usable")]
    coils = sum(name.startswith("coil_") for name in frames.signals)
    pairs += [(told["coil"][:, k], frames[f"coil_{k}"]) for k in range(coils)]
    return sum(int((there != sent).sum()) for there, sent in pairs)
