"""Processor in the loop: an exported controller on a Cortex-M4F flies the simulated plant."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Index
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.control.lift_off_sequence import LiftOff, Mode
from ambkit.data.signals import signal
from ambkit.data.telemetry import read_telemetry
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile
from ambkit.export.c.control import controller_of
from ambkit.export.c.exporter import export_c, made
from ambkit.export.c.model import states
from ambkit.export.pil import build
from ambkit.export.pil.processor import Processor
from ambkit.export.pil.result import Pil, compare_bits, unequal_frames
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.scenario import Scenario

Expected = dict[str, NDArray[Any]]


def pil(
    bearing: Machine,
    magnet: MagnetModel | None = None,
    *,
    scenario: Scenario | None = None,
    kind: str | None = None,
    filter_file: FilterFile | None = None,
    board: str | None = None,
    force: bool = False,
) -> Pil:
    """Fly a simulated plant by the exported controller, on a Cortex-M4F in qemu."""
    # The plant is simulated with the controller here, and what its sensors show goes to the
    # processor, sample by sample. Where that answers the same bits each time, which is what is
    # judged, the rotor would have moved no otherwise with the processor's own currents.
    if board is not None and board not in build.BOARDS:
        raise AmbkitError(f'board must be one of {", ".join(build.BOARDS)}, is "{board}"')
    for_board = build.QEMU_BOARD if board is None else build.BOARDS[board]
    build.check(for_board)
    build.check(build.QEMU_BOARD)
    plant = bearing.short
    several = not plant.single
    base_scenario = scenario or Scenario(duration=1.0)
    of_type(Scenario, scenario=base_scenario)
    sequence = base_scenario.sequence or LiftOff()
    lift_scenario = base_scenario.model_copy(update={"start": "landed", "sequence": sequence})
    filter = made(kind, plant, magnet, filter_file, {"precision": "float32"})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        export = export_c(
            plant, magnet, folder / "export", kind=kind, filter_file=filter_file,
            prefix=build.PREFIX, telemetry=True, force=force, scenario=lift_scenario,
        ).folder  # fmt: skip
        fields = [state.field for state in states(filter.states)]
        runs = build.in_qemu(for_board)
        image = build.firmware(export, fields, runs, folder / "qemu", several)
        built = build.size(export, for_board, folder / "board", several)
        run = simulate_run(plant, lift_scenario, estimator=filter)
        machine, record = run.machine, run.record
        measurement = np.column_stack([record[signal("y", r.name)] for r in machine.readings])
        y = filter.inputs.y.numbers(measurement)
        r = np.column_stack([record[signal("r", name)] for name in run.axes])
        flies, speed = sequence.fly(record.t), record.signals.get("speed", np.zeros(len(y)))
        (folder / "pipes").mkdir()
        sizes = y.shape[1], r.shape[1], len(fields)
        with Processor(image, folder / "pipes", *sizes) as processor:
            for k in range(len(y)):
                processor.step(y[k], r[k], fly=flies[k] > 0, speed=speed[k])
            greeting, answers = processor.greeting, processor.answers
        frames = read_telemetry(folder / "pipes" / "frames", export / "telemetry.json")
    others = _others(answers, _expected(run, filter, lift_scenario, y, r, flies), run)
    s = np.column_stack([record[run.displacement(name)] for name in run.axes])
    travel = np.array([axis.bearing.clearance for axis in machine.axes])
    names = [state.name for state in filter.states]
    return compare_bits(
        answers, greeting, off=s - r, moved=s, travel=travel, record=record, run=run,
        unequal=int(others.sum()), frames=frames,
        unequal_frames=unequal_frames(answers, frames, names, coils=not several),
        board=for_board.about, built=built,
    )  # fmt: skip


def _expected(
    run: Run, filter: Estimator, scenario: Scenario, y: Array,
    r: Array, flies: Array,
) -> Expected:  # fmt: skip
    """Return what the processor is to answer: as simulated, or along a rig's rounded numbers."""
    record = run.record
    if run.machine.single and (filter.inputs.y.gain != 1 or filter.inputs.y.zero):
        controller = controller_of(filter, scenario)
        rounded = y[:, 0].astype("f4").astype(float)
        return controller.run(rounded, r[:, 0], flies)
    assert run.estimate is not None
    assert run.usable is not None
    u = np.column_stack([record[signal("u", name)] for name in run.axes])
    return {"u": u, "mode": record["mode"], "status": run.status, "usable": run.usable,
            "mean": run.estimate.mean}  # fmt: skip


def _others(answers: NDArray[np.void], expected: Expected, run: Run) -> Index:
    """Return how many numbers of each sample are others than expected (n,)."""
    axes, single = run.machine.axes, np.float32
    n = len(answers)
    gain = np.array([axis.bearing.amplifier.gain for axis in axes], single)
    magnets = [axis.bearing.magnet for axis in axes]
    on = np.isin(expected["mode"], (Mode.LIFTING, Mode.FLYING, Mode.LANDING))
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
