"""Telemetry: frames that an export writes, as Python reads them."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from export_cases import BEARING, INCLUDES, SAME_BITS, STRICT
from exporting import export_c
from machine_cases import machine

import ambkit
from ambkit import KalmanFilter, Scenario, Step
from ambkit.base.errors import RecordError

compiled = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

# Takes frames out every 8 samples but for some, between which frames find no room.
USER = """#include "rig_telemetry.h"
#include <stdio.h>
static rig_telemetry frames;
static void out(uint32_t word)
{
  for (int k = 0; k < 4; k++)
    (void)putchar((int)((word >> (8 * k)) & 0xFFU));
}
int main(void)
{
  rig_state state;
  rig_estimates now;
  uint32_t words[RIG_TELEMETRY_WORDS];
  double y, u;
  rig_init(&state);
  rig_telemetry_init(&frames);
  for (int k = 0; scanf("%lf %lf", &y, &u) == 2; k++) {
    const amb_status status = rig_step(&state, (amb_real)y, (amb_real)u, &now);
    (void)rig_telemetry_put(&frames, &now, status);
    if ((k % 8 == 7) && ((k < 200) || (k > 300)))
      while (rig_telemetry_take(&frames, words))
        for (unsigned int i = 0; i < RIG_TELEMETRY_WORDS; i++)
          out(words[i]);
  }
  return 0;
}
"""

USES = '#include "rig_telemetry.h"\nint main(void) { return 0; }\n'

OF_COMMAND = """#include "rig_telemetry.h"
#include <stdio.h>
static rig_telemetry frames;
int main(void)
{
  static rig_command out;
  uint32_t words[RIG_TELEMETRY_WORDS];
  for (int f = 0; f < AMB_CONTROLS; f++) {
    out.coil[f][1] = (amb_real)f + AMB_C(0.5);
    out.u[f] = (amb_real)f + AMB_C(0.25);
  }
  out.estimates.FIRST = AMB_C(0.75);
  out.mode = AMB_FLYING;
  rig_telemetry_init(&frames);
  for (int k = 0; k < 2; k++)
    (void)rig_telemetry_put(&frames, &out, AMB_OK);
  while (rig_telemetry_take(&frames, words))
    for (unsigned int i = 0; i < RIG_TELEMETRY_WORDS; i++)
      for (int k = 0; k < 4; k++)
        (void)putchar((int)((words[i] >> (8 * k)) & 0xFFU));
  return 0;
}
""".replace("FIRST", KalmanFilter(machine()).states[0].name)


def built(made, folder, source):
    (folder / "main.c").write_text(source)
    files = [
        str(path)
        for path in made.folder.rglob("*.c")
        if path.parent.name not in ("selftest", "proof")
    ]
    includes = [f"-I{made.folder / flag[2:]}" for flag in INCLUDES]
    out = folder / "user.out"
    words = ["gcc", "-std=c99", *STRICT, *SAME_BITS, *includes, *files, str(folder / "main.c")]
    subprocess.run([*words, "-o", str(out)], check=True, timeout=120)
    return out


@pytest.fixture(scope="module")
def simulated():
    scenario = Scenario(duration=0.0599, reference=Step(amplitude=2e-4, time=0.01))
    return ambkit.simulate(BEARING, scenario).record


@pytest.fixture(scope="module", params=["float", "double"])
def made(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames") / request.param
    return export_c(BEARING, None, folder, prefix="rig", precision=request.param, telemetry=True)


@pytest.fixture(scope="module")
def sent(made, simulated):
    y, u = simulated["y"].copy(), simulated["u"]
    y[70] = np.nan
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    program = built(made, made.folder.parent, USER)
    before = np.concatenate([[0.0], u[:-1]])
    text = "".join(f"{a!r} {b!r}\n" for a, b in zip(y.tolist(), before.tolist(), strict=True))
    done = subprocess.run([program], input=text.encode(), capture_output=True, timeout=60)
    return done.stdout


@compiled
def test_what_is_read_is_what_the_filter_said(made, sent, simulated):
    record = ambkit.read_telemetry(sent, made.folder / "telemetry.json")
    precision = {"float": "float32", "double": "float64"}[made.precision]
    y = simulated["y"].copy()
    y[70] = np.nan
    there = ambkit.Record(simulated.t, {"y": y, "u": simulated["u"]})
    estimate = KalmanFilter(BEARING, precision=precision).run(there)
    n = len(record.t)
    there_is = ~np.isnan(record["x"])
    assert n == 600
    assert record.meta["missing"] == n - there_is.sum() == 88
    for k, name in enumerate(("x", "v", "f_d", "x_m")):
        expected = estimate.mean[:n, k].astype("f4").astype(float)
        np.testing.assert_array_equal(record[name][there_is], expected[there_is])
    innovation = estimate.innovation[:n].astype("f4").astype(float)
    np.testing.assert_array_equal(record["innovation"][there_is], innovation[there_is])
    assert int(record["status"][70]) & ambkit.Status.MISSING
    assert record["usable"][0] == 0
    assert record["usable"][-1] == 1


@compiled
def test_what_is_damaged_is_left_out(made, sent):
    layout = made.folder / "telemetry.json"
    whole = ambkit.read_telemetry(sent, layout)
    length = 4 * (6 + 5)
    spoilt = bytearray(b"\x00AMBnoise" + sent)
    spoilt[9 + 5 * length + 20] ^= 4  # a bit of a number
    del spoilt[9 + 9 * length + 3 : 9 + 9 * length + 8]  # bytes that did not arrive
    record = ambkit.read_telemetry(bytes(spoilt), layout)
    assert record.meta["missing"] == whole.meta["missing"] + 2
    assert np.isnan(record["x"][[5, 9]]).all()
    left = ~np.isnan(record["x"])
    np.testing.assert_array_equal(record["x"][left], whole["x"][left])


@compiled
def test_what_are_no_frames_of_it_is_reported(made, sent, tmp_path):
    layout = made.folder / "telemetry.json"
    with pytest.raises(RecordError, match="two frames at least"):
        ambkit.read_telemetry(b"AMBF" + bytes(200), layout)
    other = tmp_path / "telemetry.json"
    other.write_text(json.dumps(json.loads(layout.read_text()) | {"layout": 1}))
    with pytest.raises(RecordError, match="of another export"):
        ambkit.read_telemetry(sent, other)
    with pytest.raises(RecordError, match=r"is not the telemetry\.json"):
        ambkit.read_telemetry(sent, made.folder / "README.md")
    with pytest.raises(RecordError, match="No such file"):
        ambkit.read_telemetry(tmp_path / "nothing.bin", layout)
    with pytest.raises(RecordError, match="the controller restarted"):
        ambkit.read_telemetry(sent[44:] + sent[:44], layout)


@compiled
@pytest.mark.parametrize("simulated", [False, True], ids=["filter", "controller"])
def test_frames_of_a_machine(simulated, tmp_path):
    scenario = Scenario() if simulated else None
    made = export_c(
        machine(), None, tmp_path / "c", prefix="rig", telemetry=True, scenario=scenario
    )
    told = json.loads((made.folder / "telemetry.json").read_text())
    names = [each["name"] for each in told["numbers"]]
    one = KalmanFilter(machine(), precision="float32")
    readings = [each.name for each in machine().readings]
    axes = [axis.name for axis in machine().axes] if simulated else []
    assert names == [
        *(state.name for state in one.states),
        *(f"{what}_{name}" for what in ("innovation", "variance") for name in readings),
        *(f"{what}_{name}" for name in axes for what in ("coil_0", "coil_1", "iu", "u")),
    ]
    folder = tmp_path / "user"
    folder.mkdir()
    program = built(made, folder, OF_COMMAND if simulated else USES)
    if simulated:
        record = ambkit.read_telemetry(
            subprocess.run([program], capture_output=True, timeout=60).stdout,
            made.folder / "telemetry.json",
        )
        for k, name in enumerate(axes):
            np.testing.assert_array_equal(record[f"coil_1_{name}"], np.float32([k + 0.5] * 2))
            np.testing.assert_array_equal(record[f"u_{name}"], np.float32([k + 0.25] * 2))
        np.testing.assert_array_equal(record[names[0]], [0.75, 0.75])
        np.testing.assert_array_equal(record["mode"], [3, 3])


def test_an_export_without_has_none(tmp_path):
    made = export_c(BEARING, None, tmp_path / "c", prefix="rig")
    assert not [file for file in made.files if "telemetry" in file]
