"""Processor in the loop with a whole machine."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.signals import signal
from ambkit.data.telemetry import read_telemetry
from ambkit.export.c.exporter import export_c
from ambkit.export.c.model import states
from ambkit.export.pil import build
from ambkit.export.pil.boards import QEMU_BOARD, Board
from ambkit.export.pil.build import PREFIX
from ambkit.export.pil.processor import Processor
from ambkit.export.pil.result import Pil, judged, others_sent
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.sequence import LiftOff

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.flight import Flight
    from ambkit.simulation.run import Run


def fly_whole(
    machine: Machine, estimator: Estimator, flight: Flight, board: Board, **of_filter: Any
) -> Pil:
    """Fly a machine by its exported controllers, on a Cortex-M4F in qemu."""
    # The machine is simulated with the controllers here, and what its sensors show goes to the
    # processor, sample by sample. Where that answers the same bits each time, which is what is
    # judged, the machine would have moved no otherwise with the processor's own currents.
    sequence = flight.sequence or LiftOff()
    flown = flight.model_copy(update={"start": "rest", "sequence": sequence})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export = export_c(
            machine, out=folder / "export", prefix=PREFIX, flight=flown, telemetry=True, **of_filter
        ).folder
        fields = [state.field for state in states(estimator.states)]
        image = build.firmware(export, "whole", fields, QEMU_BOARD, folder / "qemu")
        built = build.size(export, f"{PREFIX}_control", board, folder / "board")
        run = simulate_machine(machine, flown, estimator=estimator)
        y = np.column_stack([run.record[signal("y", r.name)] for r in machine.readings])
        r = np.column_stack([run.record[signal("r", axis.name)] for axis in machine.axes])
        fly, speed = sequence.fly(run.record.t) > 0, run.record["speed"]
        (folder / "pipes").mkdir()
        sizes = y.shape[1], r.shape[1], len(fields)
        with Processor(image, folder / "pipes", *sizes) as processor:
            greeting = processor.greeting
            for k in range(len(y)):
                processor.step(y[k], r[k], fly=bool(fly[k]), speed=speed[k])
            told = processor.answers
        frames = read_telemetry(folder / "pipes" / "frames", export / "telemetry.json")
    others = _others(run, told)
    s = np.column_stack([run.record[signal("s", axis.name)] for axis in machine.axes])
    travel = np.array([axis.bearing.travel_limit for axis in machine.axes])
    names = [state.name for state in estimator.states]
    return judged(
        told, greeting, off=s - r, moved=s, travel=travel, record=run.record, run=run,
        unequal=int(others.sum()), unequal_flight=int((others > 0).sum()), frames=frames,
        unequal_frames=others_sent(told, frames, names, coils=False),
        board=board.about, built=built,
    )  # fmt: skip


def _others(run: Run, told: NDArray[np.void]) -> NDArray[np.intp]:
    """Return how many numbers are others than flew here, of each sample (n,)."""
    record, axes = run.record, run.machine.axes
    single = np.float32
    u = np.column_stack([record[signal("u", axis.name)] for axis in axes])
    gain = np.array([axis.bearing.amplifier.gain for axis in axes], single)
    magnets = [axis.bearing.magnet for axis in axes]
    bias = np.where(told["on"][:, None] > 0, np.array([m.bias_current for m in magnets], single), 0)
    away = [m.type == "two-sided" for m in magnets]
    coil = np.stack([bias + told["iu"], np.where(away, bias - told["iu"], 0)], axis=2)
    assert run.estimate is not None
    others = (told["mode"] != record["mode"]).astype(int)
    others += (told["status"] != run.status).astype(int) + (told["usable"] != run.usable)
    others += (told["u"] != u).sum(1) + (told["u"] != told["iu"] / gain).sum(1)
    others += (told["coil"] != coil.astype(single)).sum((1, 2))
    others += (told["mean"] != run.estimate.mean).sum(1)
    return np.asarray(others)
