"""Bits that flip in memory: what an export keeps in RAM heals, in a loop that hovers.

``quick`` flips one bit of each word, the one that changes a float most; the study each single bit
of all that lies there, and of machines a part.
"""

import shutil

import flips
import pytest
from export_cases import BEARING, KINDS, PRECISIONS, export
from exporting import export_c
from machine_cases import machine

from ambkit import KalmanFilter, Scenario
from ambkit.control.control import Control, LiftOff
from ambkit.control.controller_states import settling_of
from ambkit.control.pid import PID
from ambkit.estimate.registry import learned_magnet
from ambkit.export.c import CExport
from ambkit.simulation.waveforms import Ramp

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

Case = tuple[CExport, str, int]
"""An export, the program of its campaign, and its settling time in samples."""


def of_kind(kind, precision, out):
    editable = kind.startswith("editable ")
    options = {"editable": True} if editable else {}
    made = export(kind.removeprefix("editable "), out, prefix="rig", precision=precision, **options)
    pid = PID().completed(BEARING)
    macros = {"KF": "rig_kalman", "BEGIN": "rig_init(s)"}
    if editable:
        macros = {"KF": "known", "BEGIN": "(void)rig_init(s); known = s->kf"}
    gains = {"KP": pid.kp, "KI": pid.ki, "KD": pid.kd, "T_F": pid.derivative_filter}
    text = "static amb_kalman known;\n" * editable + flips.FILTER
    source = flips.source(text, LOAD=0.5, **flips.magnets_of(made), **macros, **gains)
    return made, source, flips.settling_in(made)


def of_control(kind, precision, out):
    what, _, of = kind.partition(" ")
    pid = LAWS.get(of, PID())
    scenario = Scenario(duration=0.1, sequence=LiftOff(), controller=pid)
    calibrated = what == "calibrated"
    made = export("linear" if of in LAWS else of, out, prefix="rig", precision=precision,
                  scenario=scenario, calibrated=calibrated)  # fmt: skip
    macros = {"KF": "rig_kalman", "LOAD": 0.5}
    if calibrated:
        macros |= {"NAME_STATE": "memory", "PLACE": "rig.filter", "header": "rig_calibration.h"}
    text = flips.AXIS + (flips.CALIBRATED if calibrated else flips.CONTROLLER)
    source = flips.source(text, **macros, **flips.magnets_of(made))
    return made, source, settling_of(KalmanFilter(BEARING))


def of_machine(kind, precision, out):
    of, turning = kind.split()[1].strip(","), "any speed" in kind
    flight = Scenario(
        controller={"feedback": "estimate"}, speed=Ramp(slope=600.0) if turning else None
    )
    run = machine(speed=300.0)
    magnet = None if of == "linear" else learned_magnet(of, run)
    made = export_c(run, magnet, out, kind=of, prefix="rig", precision=precision,
                    scenario=flight)  # fmt: skip
    source = flips.source(
        flips.SEVERAL + flips.CONTROLLER, header="rig_control.h", NAME_STATE="rig_control_state",
        PLACE="filter.filter", KF="rig_kalman", LOAD=1.0, SPEED=300, **flips.magnets_of(made),
    )  # fmt: skip
    return made, source, flips.settling_in(made)


def of_case(kind, precision, out):
    if kind.startswith("machine"):
        return of_machine(kind, precision, out)
    if kind.startswith(("control", "calibrated")):
        return of_control(kind, precision, out)
    return of_kind(kind, precision, out)


LAWS = {"by readings": Control(feedback="measurement"), "lqg": Control(type="lqg")}
EDITABLE = tuple(f"editable {kind}" for kind in KINDS if kind != "constant-velocity")
CONTROLLERS = tuple(f"control {of}" for of in (*KINDS, *LAWS))
CALIBRATED = tuple(f"calibrated {of}" for of in ("linear", "adaptive", "closed-law", "extended",
                                                 "tabulated"))  # fmt: skip
AXES = (*KINDS, *EDITABLE, *CONTROLLERS, *CALIBRATED)
MACHINES = (
    *(f"machine {kind}" for kind in KINDS if kind not in ("low-pass", "observer", "tabulated")),
    "machine linear, any speed",
)  # fmt: skip
QUICKLY = (*KINDS[::2], "editable linear", "control by readings", "control observer",
           "calibrated linear")  # fmt: skip
AT = (2000, 2013, 2500)
"""Samples before the flip: a window, a filter's phase and the noise are others."""


def healed(found):
    """All flights came back: up, fed back, never wrong for long, and without a flag that stays."""
    assert found.lines[0].endswith("unfed 0 touched 0")
    assert (found.stuck, found.wrong, found.crashed, found.flagged) == (0, 0, 0, 0), found.lines


@pytest.mark.parametrize("kind", QUICKLY)
def test_a_word_that_a_bit_has_made_another_heals(kind, tmp_path):
    made, program, settling = of_case(kind, "float", tmp_path / "c")
    found = flips.campaign(made, program, settling, before=2013, after=1500, first=30, every=32)
    assert found.flips >= 20
    healed(found)


def test_noise_is_not_learned_from_what_a_bit_has_made_wrong(tmp_path):
    """A correlation 256 times as large: fed back wrong for 276 samples, were it learned."""
    made, program, settling = of_case("linear-adaptive-noise", "float", tmp_path / "c")
    healed(flips.campaign(made, program, settling, before=2013, after=1500, every=3))


@pytest.mark.study
@pytest.mark.parametrize("before", AT)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", AXES)
def test_each_single_bit_heals(kind, precision, before, tmp_path):
    made, program, settling = of_case(kind, precision, tmp_path / "c")
    healed(flips.campaign(made, program, settling, before=before))


@pytest.mark.study
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", AXES)
def test_bits_that_flip_together_heal(kind, precision, tmp_path):
    """Up to eight at once. Of a controller they may end the flight: each word stands thrice."""
    made, program, settling = of_case(kind, precision, tmp_path / "c")
    found = flips.campaign(made, program, settling, many=8)
    if kind in KINDS + EDITABLE:
        healed(found)
    else:
        assert (found.wrong, found.flagged) == (0, 0), found.lines
        # Of the smallest state the controller's words are the largest share.
        assert found.stuck + found.crashed < 0.015 * found.flips, found.lines


@pytest.mark.study
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", MACHINES)
def test_bits_of_whole_machines_heal(kind, precision, tmp_path):
    made, program, settling = of_case(kind, precision, tmp_path / "c")
    healed(flips.campaign(made, program, settling, after=1500, every=37))
