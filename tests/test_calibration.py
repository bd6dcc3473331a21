"""Calibration on the running rig: checked, taken over between two samples, read back; A2L."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import flips
import numpy as np
import pytest
from export_cases import INCLUDES, SAME_BITS, STRICT, program

from ambkit import Bearing, FilterNoise, KalmanFilter, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.cli.main import main
from ambkit.control.control import Control
from ambkit.control.controller_states import Controller
from ambkit.control.lift_off_sequence import LiftOff
from ambkit.export import a2l
from ambkit.export.c import CExport, export_c
from ambkit.export.c.calibration import PARAMETERS
from ambkit.simulation.run import simulate

BEARING = Bearing.preset("zittau_axial")
TIMES = LiftOff(wait=2e-3, lift=0.02, land=0.02)
SCENARIO = Scenario(duration=0.08, start="landed", sequence=TIMES, controller=Control())
SWAP = 400  # sample at which other numbers fly, in flight

PROGRAM = """#include "rig_calibration.h"
#include <stdio.h>
amb_calibration calibration;
static rig_state rig;
static const float y[] = {%(y)s};
static const float wanted[] = {%(wanted)s};
int main(void)
{
  rig_output out;
  rig_init(&rig);
  rig_cal_init(&calibration);
  for (int k = 0; k < %(n)d; k++) {
    if (k == %(swap)d) {
      for (int i = 0; i < AMB_PARAMETERS; i++)
        calibration.wanted[i] = wanted[i];
      calibration.request++;
    }
    rig_calibrate(&calibration, &rig);
    (void)rig_step(&rig, y[k], 0.0F, true, &out);
    printf("%%.9g %%.9g\\n", (double)out.iu, (double)out.f_d);
  }
  printf("%%u %%u %%u", calibration.answered, calibration.refused, calibration.flying);
  for (int i = 0; i < AMB_PARAMETERS; i++)
    printf(" %%.9g", (double)calibration.in_use[i]);
  return 0;
}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> CExport:
    out = tmp_path_factory.mktemp("calibrated") / "rig"
    return export_c(BEARING, None, out, prefix="rig", scenario=SCENARIO, calibrated=True)


@pytest.fixture(scope="module")
def y() -> Any:
    return simulate(BEARING, SCENARIO, estimator=KalmanFilter(BEARING, precision="float32"))["y"]


def exported(made: CExport) -> dict[str, float]:
    import json

    told = json.loads((made.folder / "calibration.json").read_text())
    return {each["name"]: each["exported"] for each in told["parameters"]}


def flown(
    made: CExport, place: Path, y: Any, wanted: dict[str, float], swap: int = SWAP
) -> tuple[Any, list[int], list[float]]:
    """Fly through readings; what was told, the counts, and what is in use in the end."""
    numbers = {
        "y": ", ".join(f"{value:.9g}F" if value % 1 else f"{value:.1f}F" for value in y),
        "wanted": ", ".join(f"(float){value:.17g}" for value in wanted.values()),
        "n": len(y), "swap": swap,
    }  # fmt: skip
    source, program = place / "main.c", place / "main"
    source.write_text(PROGRAM % numbers)
    files = [made.folder / file for file in made.sources]
    flags = [flag for flag in STRICT if flag != "-Wdouble-promotion"]
    command = ["gcc", "-std=c99", *flags, *SAME_BITS, *INCLUDES]
    words = [*command, source, *files, "-lm", "-o", program]
    done = subprocess.run(words, cwd=made.folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    rows = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split("\n")
    told = np.array([row.split() for row in rows[:-1]], np.float32).astype(float)
    last = rows[-1].split()
    return told, [int(word) for word in last[:3]], [float(word) for word in last[3:]]


def test_what_is_as_exported_flies_the_same_bits(made: CExport, y: Any, tmp_path: Path) -> None:
    told, counts, in_use = flown(made, tmp_path, y, exported(made), swap=0)
    assert counts == [1, 0, 1]
    estimator = KalmanFilter(BEARING, precision="float32")
    here = Controller.of_axis(
        BEARING, estimator, SCENARIO.controller.completed(BEARING), TIMES
    ).run(y, np.zeros(len(y)), np.ones(len(y)))
    np.testing.assert_array_equal(told[:, 0], here["iu"])
    np.testing.assert_array_equal(told[:, 1], here["mean"][:, 2])
    np.testing.assert_allclose(in_use, list(exported(made).values()), rtol=1e-7)


def test_other_noise_and_gains_fly_from_the_next_sample_on(
    made: CExport, y: Any, tmp_path: Path
) -> None:
    """Those of a filter and a controller that were made with them, to the last bit."""
    wanted = exported(made) | {"kp": 2200.0, "kd": 14.0}
    wanted["var_y"] *= 2
    told, counts, in_use = flown(made, tmp_path, y, wanted)
    assert counts == [1, 0, 1]
    assert in_use[6] == 2200.0
    before, _, _ = flown(made, tmp_path, y, exported(made))
    np.testing.assert_array_equal(told[:SWAP], before[:SWAP])
    assert (told[SWAP:] != before[SWAP:]).any(axis=0).all()
    # From the start: the same as Python's, which starts as the export does.
    from_start, _, _ = flown(made, tmp_path, y, wanted, swap=0)
    pid = SCENARIO.controller.completed(BEARING)
    old = Controller.of_axis(BEARING, KalmanFilter(BEARING, precision="float32"), pid, TIMES).fields
    noise = FilterNoise(measurement=2 * KalmanFilter(BEARING).variances.measurement)
    other = KalmanFilter(BEARING, noise=noise, precision="float32")
    new = Controller.of_axis(
        BEARING, other, pid.model_copy(update={"kp": 2200.0, "kd": 14.0}), TIMES
    )
    kept = {key: old[key] for key in ("std", "start", "start_by", "hold", "hold_by", "place")}
    here = new.run(y, np.zeros(len(y)), np.ones(len(y)), other=kept)
    np.testing.assert_array_equal(from_start[:, 0], here["iu"])


@pytest.mark.parametrize("name", ["mass", "strong"])
def test_mass_and_magnet_constant_are_worked_into_the_model(
    name: str, made: CExport, y: Any, tmp_path: Path
) -> None:
    """What acts between two samples goes with both: the load that is found changes."""
    wanted = exported(made)
    wanted[name] *= 1.15
    told, counts, _ = flown(made, tmp_path, y, wanted, swap=0)
    same, _, _ = flown(made, tmp_path, y, exported(made), swap=0)
    assert counts == [1, 0, 1]
    late = slice(600, None)
    if name == "mass":  # it is known, and the load then makes up for the weight that is not there
        expected = 0.15 * 5.08
        assert np.mean(told[late, 1] - same[late, 1]) == pytest.approx(expected, rel=0.1)
    else:
        assert np.abs(told[late, 1] - same[late, 1]).mean() > 0.1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("var_y", 0.0),
        ("mass", -0.5),
        ("kp", -1.0),
        ("gate", float("nan")),
        ("T_f", 1e39),
        ("mass", 1e-30),
        ("mass", 1e-6),
        ("mass", 1e30),
        ("kp", 1e30),
        ("strong", 2.0),
    ],
)
def test_what_cannot_be_is_refused_and_the_old_flies_on(
    name: str, value: float, made: CExport, y: Any, tmp_path: Path
) -> None:
    wanted = exported(made) | {name: value}
    if value != value or value > 1e38:
        wanted[name] = 1e39  # infinite in float
    flags = "(float)1e+39"
    told, counts, in_use = flown(made, tmp_path, y, wanted)
    place = [each.name for each in PARAMETERS].index(name)
    assert counts == [1, 1 << place, 0], flags
    same, _, _ = flown(made, tmp_path, y, exported(made))
    np.testing.assert_array_equal(told, same)
    np.testing.assert_allclose(in_use, list(exported(made).values()), rtol=1e-7)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_its_own_self_test_passes(precision: Any, tmp_path: Path) -> None:
    export_c(BEARING, None, tmp_path / "rig", prefix="rig", scenario=SCENARIO,
             calibrated=True, precision=precision)  # fmt: skip
    done = program("gcc", tmp_path / "rig", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    said = subprocess.run([tmp_path / "out"], capture_output=True, text=True).stdout
    assert said.startswith("pass")
    assert "equal to the last bit" in said


def test_what_is_made_of_more_is_not_calibrated(tmp_path: Path) -> None:
    with pytest.raises(AmbkitError, match="made of more than noise"):
        export_c(BEARING, None, tmp_path, kind="augmented", scenario=SCENARIO, calibrated=True)
    lqg = SCENARIO.replace(controller=Control(type="lqg"))
    with pytest.raises(AmbkitError, match="this controller has a regulator"):
        export_c(BEARING, None, tmp_path, scenario=lqg, calibrated=True)
    with pytest.raises(AmbkitError, match="calibration needs a controller"):
        export_c(BEARING, None, tmp_path, calibrated=True)


def draws(made: CExport, n: int, seed: int) -> Any:
    """Return n sets (n, 12): within the limits, at their ends, and one or all numbers beyond."""
    told = json.loads((made.folder / "calibration.json").read_text())["parameters"]
    low, high = (np.array([each[end] for each in told]) for end in ("low", "high"))
    random = np.random.default_rng(seed)
    sets = []
    for k in range(n):
        wanted = low + random.random(len(low)) * (high - low)
        if k % 4 == 1:
            wanted = np.where(random.random(len(low)) < 0.5, low, high)
        elif k % 4 == 2:
            wanted[random.integers(len(low))] *= 10.0 ** random.choice([-30, -6, -1, 1, 3, 30])
        elif k % 4 == 3:
            wanted = wanted * 10.0 ** random.uniform(-3, 3, len(low))
        sets.append(wanted)
    return np.array(sets, np.float32), (low, high)


@pytest.mark.parametrize(
    ("kind", "feedback", "n"),
    [
        ("linear", "estimate", 40), ("extended", "measurement", 40),
        *(pytest.param(kind, feedback, 1000, marks=pytest.mark.study)
          for kind in ("linear", "extended") for feedback in ("estimate", "measurement")),
    ],
)  # fmt: skip
def test_no_set_that_is_taken_lets_a_hovering_rotor_fall(
    kind: str, feedback: Any, n: int, tmp_path: Path
) -> None:
    """One set after the other in one flight; what is refused changes nothing."""
    scenario = Scenario(duration=0.1, sequence=LiftOff(), controller=Control(feedback=feedback))
    made = export_c(BEARING, None, tmp_path / "rig", prefix="rig", scenario=scenario,
                    calibrated=True, kind=kind)  # fmt: skip
    program = flips.source(
        flips.AXIS + flips.CALIBRATED, KF="rig_kalman", LOAD=0.5, NAME_STATE="memory",
        PLACE="rig.filter", header="rig_calibration.h", **flips.magnets_of(made),
    )  # fmt: skip
    sets, (low, high) = draws(made, n, seed=1)
    rows = "\n".join(" ".join(f"{value:.9g}" for value in each) for each in sets)
    out = flips.compiled(made, program, "-DDRAWS")
    done = subprocess.run([out, "1500"], input=rows, capture_output=True, text=True, check=True)
    told = np.array([line.split() for line in done.stdout.splitlines()], np.int64)
    beyond = ((sets < low.astype(np.float32)) | (sets > high.astype(np.float32))) @ 2 ** np.arange(
        len(low)
    )
    np.testing.assert_array_equal(told[:, 0], beyond)
    np.testing.assert_array_equal(told[:, 1], beyond == 0)
    assert told[:, 2].all()
    assert not told[:, 3].any()
    assert 0.4 * n < (beyond == 0).sum() < 0.6 * n


# ---- A2L ----

needs_readelf = pytest.mark.skipif(
    not any(map(shutil.which, a2l.READERS)), reason="readelf is not installed"
)


@needs_readelf
def test_addresses_come_from_the_program(made: CExport, y: Any, tmp_path: Path) -> None:
    """Each is where the program itself says that the member is."""
    _, _, _ = flown(made, tmp_path, y[:2], exported(made))
    program = tmp_path / "main"
    with pytest.raises(SystemExit) as left:
        main(["export", "a2l", str(made.folder), "--elf", str(program), "--out",
              str(tmp_path / "rig.a2l")])  # fmt: skip
    assert not left.value.code
    text = (tmp_path / "rig.a2l").read_text()
    found = dict(re.findall(r"/begin CHARACTERISTIC (\S+) .*\n\s+VALUE (0x[0-9A-F]+)", text))
    found |= dict(
        re.findall(r"/begin MEASUREMENT (\S+) .*\n.*\n\s+ECU_ADDRESS (0x[0-9A-F]+)", text)
    )
    base = a2l.symbol(program, "calibration").address
    places = tmp_path / "places.c"
    fields = [f"wanted[{k}]" for k in range(12)] + [f"in_use[{k}]" for k in range(12)]
    fields += ["request", "answered", "refused", "flying"]
    rows = "".join(f'printf("%zu\\n", offsetof(amb_calibration, {field}));' for field in fields)
    places.write_text(
        '#include "rig_calibration.h"\n#include <stddef.h>\n#include <stdio.h>\n'
        f"int main(void) {{ {rows} return 0; }}\n"
    )
    subprocess.run(["gcc", *INCLUDES, str(places), "-o", str(tmp_path / "places")],
                   cwd=made.folder, check=True)  # fmt: skip
    offsets = subprocess.run([tmp_path / "places"], capture_output=True, text=True).stdout.split()
    names = [each.name for each in PARAMETERS]
    expected = dict(zip(
        [f"calibration.wanted.{n}" for n in names] + [f"calibration.in_use.{n}" for n in names]
        + [f"calibration.{n}" for n in ("request", "answered", "refused", "flying")],
        [base + int(offset) for offset in offsets], strict=True,
    ))  # fmt: skip
    assert {name: int(place, 16) for name, place in found.items()} == expected


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # its own
@pytest.mark.parametrize("big_endian", [False, True])
def test_another_reads_the_a2l_file(made: CExport, tmp_path: Path, big_endian: bool) -> None:
    """pya2l, by its grammar of ASAP2 1.7: each parameter with its address, limits and unit."""
    from pya2l import import_a2l, model

    at = a2l.Symbol(0x20000100, 1000, big_endian=big_endian)
    path = tmp_path / "rig.a2l"
    told = json.loads((made.folder / "calibration.json").read_text())
    path.write_text(a2l.text(told, at, "calibration"))
    session = import_a2l(str(path), in_memory=True, loglevel="ERROR")
    wanted = {each.name: each for each in session.query(model.Characteristic)}
    shown = {each.name: each for each in session.query(model.Measurement)}
    methods = {each.name: each for each in session.query(model.CompuMethod)}
    real, n = 4, len(told["parameters"])
    for k, each in enumerate(told["parameters"]):
        one, flies = (f"calibration.{which}.{each['name']}" for which in ("wanted", "in_use"))
        assert wanted[one].address == at.address + k * real
        assert (wanted[one].type, wanted[one].deposit) == ("VALUE", "Real")
        limits = each["low"], each["high"]
        assert (wanted[one].lowerLimit, wanted[one].upperLimit) == limits
        assert (shown[flies].lowerLimit, shown[flies].upperLimit) == limits
        assert limits[0] <= each["exported"] <= limits[1] < 1e3 * each["exported"]
        assert shown[flies].ecu_address.address == at.address + (n + k) * real
        assert shown[flies].datatype == "FLOAT32_IEEE"
        assert methods[wanted[one].conversion].unit == each["unit"]
    assert wanted["calibration.request"].address == at.address + 2 * n * real
    assert (len(wanted), len(shown)) == (n + 1, n + 3)
    (common,) = session.query(model.ModCommon)
    assert common.byte_order.byteOrder == ("MSB_FIRST" if big_endian else "MSB_LAST")
    session.close()


@needs_readelf
@pytest.mark.parametrize(
    ("elf", "symbol", "said"),
    [("program", "nothing", "has no variable nothing"), ("text", "calibration", "is no ELF file")],
)
def test_what_is_not_there_is_said(
    elf: str, symbol: str, said: str, made: CExport, y: Any, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    flown(made, tmp_path, y[:2], exported(made))
    (tmp_path / "text").write_text("no program")
    path = tmp_path / ("main" if elf == "program" else "text")
    words = ["--elf", str(path), "--symbol", symbol, "--out", str(tmp_path / "rig.a2l")]
    with pytest.raises(SystemExit) as left:
        main(["export", "a2l", str(made.folder), *words])
    assert left.value.code == 2
    assert said in capsys.readouterr().err
