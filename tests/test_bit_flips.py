"""Bits that flip in memory: what an export keeps in RAM heals, in a loop that hovers.

``quick`` flips one bit of each word, the one that changes a float most; the study each single bit
of all that lies there, and of machines a part.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import flips
import pytest
from export_cases import BEARING, KINDS, PRECISIONS, export
from machine_cases import machine

from ambkit import Flight, KalmanFilter, Scenario
from ambkit.export.c import CExport, export_c
from ambkit.simulation.control import settling_of
from ambkit.simulation.scenario import PID
from ambkit.simulation.sequence import LiftOff
from ambkit.simulation.waveforms import Ramp

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

Case = tuple[CExport, str, int]
"""An export, the program of its campaign, and its settling time in samples."""


def of_kind(kind: str, precision: Any, out: Path) -> Case:
    editable = kind.startswith("editable ")
    options = {"editable": True} if editable else {}
    made = export(kind.removeprefix("editable "), out, prefix="rig", precision=precision, **options)
    pid = PID().completed(BEARING)
    macros: dict[str, Any] = {"KF": "rig_kalman", "BEGIN": "rig_init(s)"}
    if editable:
        macros = {"KF": "known", "BEGIN": "(void)rig_init(s); known = s->kf"}
    gains = {"KP": pid.kp, "KI": pid.ki, "KD": pid.kd, "T_F": pid.derivative_filter}
    text = "static amb_kalman known;\n" * editable + flips.FILTER
    source = flips.source(text, LOAD=0.5, **flips.magnets_of(made), **macros, **gains)
    settling = flips.settling_in(made)
    # Innovations after a flip are taken for noise, for a while.
    return made, source, 2 * settling if kind.endswith("adaptive-noise") else settling


def of_control(kind: str, precision: Any, out: Path) -> Case:
    pid = PID(feedback="measurement") if kind == "control by readings" else PID()
    scenario = Scenario(duration=0.1, sequence=LiftOff(), controller=pid)
    calibrated = kind == "calibrated"
    made = export_c(BEARING, None, out, prefix="rig", precision=precision, scenario=scenario,
                    calibrated=calibrated)  # fmt: skip
    macros: dict[str, Any] = {"KF": "rig_kalman", "LOAD": 0.5}
    if calibrated:
        macros |= {"NAME_STATE": "memory", "PLACE": "rig.filter", "header": "rig_calibration.h"}
    text = flips.AXIS + (flips.CALIBRATED if calibrated else flips.CONTROLLER)
    source = flips.source(text, **macros, **flips.magnets_of(made))
    return made, source, settling_of(KalmanFilter(BEARING))


def of_machine(kind: str, precision: Any, out: Path) -> Case:
    sequenced, turning = "sequence" in kind, "any speed" in kind
    flight = Flight(
        feedback="estimate", sequence=LiftOff() if sequenced else None,
        speed=Ramp(slope=600.0) if turning else None,
    )  # fmt: skip
    made = export_c(machine(speed=300.0), None, out, prefix="rig", precision=precision,
                    flight=flight)  # fmt: skip
    begin = "rig_control_take_over(s, nowhere, SPEED, middle)"
    source = flips.source(
        flips.MACHINE.replace("FLY", "true, " * sequenced), header="rig_control.h",
        NAME_STATE="rig_control_state", PLACE="filter.filter", KF="rig_kalman", LOAD=1.0,
        SPEED=300, BEGIN=begin if sequenced else "rig_control_init(s)",
        UP="now.mode == AMB_FLYING" if sequenced else "true", **flips.magnets_of(made),
    )  # fmt: skip
    return made, source, flips.settling_in(made)


def of_case(kind: str, precision: Any, out: Path) -> Case:
    if kind.startswith("machine"):
        return of_machine(kind, precision, out)
    if kind in CONTROLLERS:
        return of_control(kind, precision, out)
    return of_kind(kind, precision, out)


CONTROLLERS = ("control", "control by readings", "calibrated")
EDITABLE = ("editable linear", "editable extended")
MACHINES = ("machine", "machine, sequence", "machine, any speed", "machine, any speed, sequence")
QUICKLY = ("linear", "ud", "augmented", "multiple-model", "linear-adaptive-noise", *EDITABLE[:1],
           "control by readings", "calibrated")  # fmt: skip


def healed(found: flips.Found) -> None:
    """All flights came back: up, fed back, never wrong for long, and without a flag that stays."""
    assert found.lines[0].endswith("unfed 0 touched 0")
    assert (found.stuck, found.wrong, found.crashed, found.flagged) == (0, 0, 0, 0), found.lines


@pytest.mark.parametrize("kind", QUICKLY)
def test_a_word_that_a_bit_has_made_another_heals(kind: str, tmp_path: Path) -> None:
    made, program, settling = of_case(kind, "float", tmp_path / "c")
    found = flips.campaign(made, program, settling, before=800, after=600, first=30, every=32)
    assert found.flips > 20
    healed(found)


@pytest.mark.study
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", [*KINDS, *EDITABLE, *CONTROLLERS])
def test_each_single_bit_heals(kind: str, precision: Any, tmp_path: Path) -> None:
    made, program, settling = of_case(kind, precision, tmp_path / "c")
    healed(flips.campaign(made, program, settling))


@pytest.mark.study
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", MACHINES)
def test_bits_of_whole_machines_heal(kind: str, precision: Any, tmp_path: Path) -> None:
    made, program, settling = of_case(kind, precision, tmp_path / "c")
    healed(flips.campaign(made, program, settling, after=1500, every=37))
