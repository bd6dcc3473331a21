"""Processor in the loop: the exported controller on a Cortex-M4F flies the simulated plant."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.data.telemetry import read_telemetry
from ambkit.export.c.exporter import export_c, made
from ambkit.export.c.model import states
from ambkit.export.pil import boards, build
from ambkit.export.pil.build import AXIS_STATES, PREFIX
from ambkit.export.pil.processor import Processor
from ambkit.export.pil.result import Pil, judged, others_sent
from ambkit.export.pil.whole import fly_whole
from ambkit.machine.machine import Machine
from ambkit.simulation.control import Controller
from ambkit.simulation.flight import Flight
from ambkit.simulation.run import Loop, simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.sequence import LiftOff

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.magnets import MagnetModel


def pil(
    bearing: Bearing | Machine,
    magnet: MagnetModel | None = None,
    *,
    scenario: Scenario | Flight | None = None,
    kind: str | None = None,
    filter_file: FilterFile | None = None,
    board: str | None = None,
    force: bool = False,
) -> Pil:
    """Fly a simulated plant by the exported controller, on a Cortex-M4F in qemu."""
    if board is not None and board not in boards.BOARDS:
        raise AmbkitError(f'board must be one of {", ".join(boards.BOARDS)}, is "{board}"')
    for_board = boards.QEMU_BOARD if board is None else boards.BOARDS[board]
    boards.check(for_board)
    boards.check(boards.QEMU_BOARD)
    if isinstance(bearing, Machine):
        flight = scenario or Flight(duration=1.0)
        if not isinstance(flight, Flight):
            raise AmbkitError(f"{bearing.name}: a machine flies a Flight, this is a Scenario")
        estimator = made(kind, bearing, magnet, filter_file, {"precision": "float32"})
        return fly_whole(
            bearing, estimator, flight, for_board,
            magnet=magnet, kind=kind, filter_file=filter_file, force=force,
        )  # fmt: skip
    scenario = scenario or Scenario(duration=1.0)
    if not isinstance(scenario, Scenario):
        raise AmbkitError(f"{bearing.name}: one axis flies a Scenario, this is a Flight")
    flown = _from_rest(scenario)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export = export_c(
            bearing, magnet, folder / "export", kind=kind, filter_file=filter_file, prefix=PREFIX,
            scenario=flown, telemetry=True, force=force,
        ).folder  # fmt: skip
        estimator = made(kind, bearing, magnet, filter_file, {"precision": "float32"})
        fields = [state.field for state in states(estimator.states)][:AXIS_STATES]
        image = build.firmware(export, "axis", fields, boards.QEMU_BOARD, folder / "qemu")
        built = build.size(export, PREFIX, for_board, folder / "board")
        (folder / "pipes").mkdir()
        with Processor(image, folder / "pipes", 1, 1, AXIS_STATES) as processor:
            greeting = processor.greeting
            record = _fly(bearing, flown, estimator, processor)
            told = processor.answers
        frames = read_telemetry(folder / "pipes" / "frames", export / "telemetry.json")
    return _judged(bearing, flown, estimator, record, told, greeting, for_board, built, frames)


def _from_rest(scenario: Scenario) -> Scenario:
    update = {"start": "rest", "sequence": scenario.sequence or LiftOff()}
    return scenario.model_copy(update=update)


def _fly(
    bearing: Bearing, scenario: Scenario, estimator: Estimator, processor: Processor
) -> Record:
    numbers = estimator.inputs.y.numbers

    def elsewhere(y: float, r: float, fly: bool) -> tuple[float, float, bool, int]:
        said = processor.step(numbers(y), r, fly=fly)
        return float(said["iu"][0]), float(said["u"][0]), bool(said["on"]), int(said["mode"])

    return Loop(bearing, scenario, estimator=estimator, elsewhere=elsewhere).run().record


def _judged(
    bearing: Bearing,
    scenario: Scenario,
    estimator: Estimator,
    record: Record,
    told: NDArray[np.void],
    greeting: np.void,
    board: boards.Board,
    built: build.Built,
    frames: Record,
) -> Pil:
    sequence = scenario.sequence
    assert sequence is not None
    pid = scenario.controller.completed(bearing)
    controller = Controller.of_axis(bearing, estimator, pid, sequence)
    raw = estimator.inputs.y.numbers(record["y"]).astype("f4").astype(float)
    here = controller.run(raw, record["r"], sequence.fly(record.t))
    unequal = 0
    for name in ("iu", "u", "status", "mode", "on", "usable"):
        unequal += int((told[name].ravel() != here[name]).sum())
    unequal += int((told["coil"][:, 0, : controller.coils] != here["coil"]).sum())
    columns = min(AXIS_STATES, here["mean"].shape[1])
    unequal += int((told["mean"][:, :columns] != here["mean"][:, :columns]).sum())
    flight = None
    if estimator.inputs.y.gain == 1.0 and not estimator.inputs.y.zero:
        same = simulate_run(bearing, scenario, estimator=estimator).record
        flight = int((same["x"] != record["x"]).sum())
    names = [state.name for state in estimator.states][:AXIS_STATES]
    x = record["x"][:, None]
    return judged(
        told, greeting, off=x - record["r"][:, None], moved=x, travel=bearing.rotor.travel_limit,
        record=record, run=None, unequal=unequal, unequal_flight=flight, frames=frames,
        unequal_frames=others_sent(told, frames, names, coils=True),
        board=board.about, built=built,
    )  # fmt: skip
