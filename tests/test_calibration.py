"""Calibration on the running rig: checked, taken over between two samples, read back; A2L."""

import json
import re
import shutil
import subprocess
from typing import Any, NamedTuple

import flips
import numpy as np
import pytest
from export_cases import CORE_PRECISION, INCLUDES, SAME_BITS, STRICT, printed_by
from exporting import export_c
from quick import quick

from ambkit import FilterNoise, KalmanFilter, Machine, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control, LiftOff
from ambkit.data.signals import signal
from ambkit.estimate.registry import learned_magnet
from ambkit.export import a2l
from ambkit.export.c import CExport
from ambkit.export.c.calibration import PARAMETERS
from ambkit.export.c.control import controller_of
from ambkit.machine.axes import weights_of
from ambkit.simulation.run import simulate
from ambkit.simulation.waveforms import Ramp

BEARING = Machine.preset("zittau_axial")
TIMES = LiftOff(wait=2e-3, lift=0.02, land=0.02)
SCENARIO = Scenario(duration=0.08, start="landed", sequence=TIMES, controller=Control())
SWAP = 400  # sample at which other numbers fly, in flight

PROGRAM = """#include "rig_calibration.h"
#include <stdio.h>
#define N (int)(sizeof y / sizeof y[0])
amb_calibration calibration;
static %(rig)s_state rig;
static const amb_real y[][AMB_SENSORS] = {%(y)s};
static const amb_real wanted[] = {%(wanted)s};
int main(void)
{
  %(output)s out;
  %(rig)s_init(&rig);
  rig_cal_init(&calibration);
  for (int k = 0; k < N; k++) {
    if (k == %(swap)d) {
      for (int i = 0; i < AMB_PARAMETERS; i++)
        calibration.wanted[i] = wanted[i];
      calibration.request++;
    }
    rig_calibrate(&calibration, &rig);
    %(step)s
    printf("\\n");
  }
  printf("%%u %%u %%u", calibration.answered, calibration.refused, calibration.flying);
  for (int i = 0; i < AMB_PARAMETERS; i++)
    printf(" %%.17g", (double)calibration.in_use[i]);
  return 0;
}
"""
ONE = """(void)rig_step(&rig, y[k][0], 0.0F, true, &out);
    printf("%.17g %.17g", (double)out.iu, (double)out.f_d);"""
SEVERAL = """static const amb_real middle[AMB_CONTROLS];
    (void)rig_control_step(&rig, y[k], middle, (amb_real)SPEED, true, &out);
    for (int f = 0; f < AMB_CONTROLS; f++)
      printf("%.17g ", (double)out.iu[f]);
    """
"""What a sample prints: all currents, then all loads."""


class Calibrated(NamedTuple):
    """A machine's controller, exported with calibration, and readings of a flight."""

    machine: Machine
    made: CExport
    y: Any

    @property
    def precision(self):
        return CORE_PRECISION[self.made.precision]

    @property
    def told(self):
        return json.loads((self.made.folder / "calibration.json").read_text())

    @property
    def exported(self):
        return {each["name"]: each["exported"] for each in self.told["parameters"]}

    def filter(self, **options):
        return KalmanFilter(self.machine, precision=self.precision, **options)

    def controller(self, estimator):
        return controller_of(estimator, SCENARIO)

    def run(self, controller, **other):
        """Currents and loads, as the core computes them here."""
        number = np.dtype(self.precision).type
        n, p = len(self.y), len(self.machine.axes)
        here = controller.in_core(**other).run(
            self.y.astype(number), np.zeros((n, p), number), np.ones(n, number),
            float(self.machine.speed or 0.0),
        )  # fmt: skip
        loads = [s.role == "disturbance force" for s in controller.estimator.states]
        return here["iu"], here["mean"][:, loads]


def export_of(name, precision, place):
    machine = Machine.preset(name)
    made = export_c(machine, None, place / "rig", prefix="rig", scenario=SCENARIO, calibrated=True,
                    precision=precision)  # fmt: skip
    estimator = KalmanFilter(machine, precision=CORE_PRECISION[precision])
    record = simulate(machine, SCENARIO, estimator=estimator)
    readings = [signal("y", at.name) for at in machine.readings]
    return Calibrated(machine, made, np.column_stack([record[name] for name in readings]))


START = ("std", "start", "start_by", "hold", "hold_by", "place", "settling", "bound")
"""Fields of the controller that stay those of the export."""

LOAD = 2  # of the states of an axis

NAMES = ("zittau_axial", "tum_mlps", "tum_mlps_flexible")
MACHINES = quick(
    [f"{name} {precision}" for name in NAMES for precision in ("float", "double")],
    ["zittau_axial float", "tum_mlps double"],
    [],
)


@pytest.fixture(scope="module", params=MACHINES)
def of(request, tmp_path_factory):
    return export_of(*request.param.split(), tmp_path_factory.mktemp("calibrated"))


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    return export_of("zittau_axial", "float", tmp_path_factory.mktemp("calibrated"))


def simulated(of, place, expected, swap=SWAP):
    """Fly through readings: currents and loads, the counts, and what is in use in the end."""
    several = not of.machine.single
    loads = "".join(
        f'printf("%.17g ", (double)out.estimates.f_d_{axis.name});' for axis in of.machine.axes
    )
    numbers = {
        "y": ",\n".join("{" + ", ".join(f"(amb_real){v:.17g}" for v in row) + "}" for row in of.y),
        "wanted": ", ".join(f"(amb_real){value:.17g}" for value in expected.values()),
        "swap": swap,
        "rig": "rig_control" if several else "rig",
        "output": "rig_command" if several else "rig_output",
        "step": SEVERAL.replace("SPEED", str(of.machine.speed)) + loads if several else ONE,
    }
    source, program = place / "main.c", place / "main"
    source.write_text(PROGRAM % numbers)
    files = [of.made.folder / file for file in of.made.sources]
    flags = [flag for flag in STRICT if flag != "-Wdouble-promotion"]
    command = ["gcc", "-std=c99", *flags, *SAME_BITS, *INCLUDES]
    words = [*command, source, *files, "-lm", "-o", program]
    done = subprocess.run(words, cwd=of.made.folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    rows = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split("\n")
    told = np.array([row.split() for row in rows[:-1]], float)
    last, p = rows[-1].split(), len(of.machine.axes)
    return told[:, :p], told[:, p:], [int(word) for word in last[:3]], [float(w) for w in last[3:]]


def test_what_is_as_exported_flies_the_same_bits(of, tmp_path):
    iu, loads, counts, in_use = simulated(of, tmp_path, of.exported, swap=0)
    assert counts == [1, 0, 1]
    here = of.run(of.controller(of.filter()))
    np.testing.assert_array_equal(iu, here[0])
    np.testing.assert_array_equal(loads, here[1])
    np.testing.assert_allclose(in_use, list(of.exported.values()), rtol=1e-7)


def test_other_noise_and_gains_fly_from_the_next_sample_on(of, tmp_path):
    """Those of a filter and a controller that were made with them, to the last bit."""
    gains = {name: 1.1 * v for name, v in of.exported.items() if name.startswith(("kp", "kd"))}
    noise = {name: 1.2 * v for name, v in of.exported.items() if name.startswith("var_y")}
    expected = of.exported | gains | noise
    iu, loads, counts, in_use = simulated(of, tmp_path, expected)
    assert counts == [1, 0, 1]
    np.testing.assert_allclose(in_use, list(expected.values()), rtol=1e-7)
    before = simulated(of, tmp_path, of.exported)
    np.testing.assert_array_equal(iu[:SWAP], before[0][:SWAP])
    assert (iu[SWAP:] != before[0][SWAP:]).any(axis=0).all()
    assert (loads[SWAP:] != before[1][SWAP:]).any(axis=0).all()
    # From the start: the same as Python's, which starts as the export does.
    from_start = simulated(of, tmp_path, expected, swap=0)
    old = of.controller(of.filter())
    other = of.filter(noise=FilterNoise(measurement=tuple(noise.values()) if len(noise) > 1
                                        else next(iter(noise.values()))))  # fmt: skip
    new = of.controller(other)
    values = list(gains.values())
    half = len(values) // 2
    pids = [
        [kp, pid[1], kd, *pid[3:]]
        for kp, kd, pid in zip(values[:half], values[half:], old.law.pids, strict=True)
    ]
    kept = {key: old.fields[key] for key in START}
    here = of.run(new, **kept, pid=pids)
    np.testing.assert_array_equal(from_start[0], here[0])


@pytest.mark.parametrize("name", ["mass", "strong"])
def test_mass_and_magnet_constant_are_worked_into_the_model(name, of, tmp_path):
    """What acts between two samples goes with both: the load that is found changes."""
    expected = {key: v * (1.1 if key.startswith(name) else 1.0) for key, v in of.exported.items()}
    _, loads, counts, _ = simulated(of, tmp_path, expected, swap=0)
    _, same, _, _ = simulated(of, tmp_path, of.exported, swap=0)
    assert counts == [1, 0, 1]
    late = slice(600, None)
    if name == "mass":  # it is known, and the load then makes up for the weight that is not there
        weight = 0.1 * -np.array(weights_of(of.machine))
        assert np.mean((loads - same)[late], axis=0) == pytest.approx(weight, rel=0.1)
    else:
        assert (np.abs((loads - same)[late]).mean(axis=0) > 0.02 * np.abs(same).std(axis=0)).all()


def test_a_rotor_of_another_mass_is_that_of_another_model(axis, tmp_path):
    """What the filter finds with the number is what one finds that was made for such a rotor."""
    expected = axis.exported | {"mass": 1.1 * axis.machine.rotor.mass}
    iu, loads, _, _ = simulated(axis, tmp_path, expected, swap=0)
    heavy = axis.machine.replace(rotor__mass=expected["mass"])
    old, noise = axis.controller(axis.filter()), FilterNoise(*axis.filter().variances)
    made = KalmanFilter(heavy, noise=noise, precision="float32")
    kept = {key: old.fields[key] for key in START}
    kept["std"] = [v * (1.1 if k == LOAD else 1.0) for k, v in enumerate(kept["std"])]
    here = axis.run(axis.controller(made), **kept, pid=old.fields["pid"])
    np.testing.assert_allclose(iu, here[0], atol=2e-5)
    np.testing.assert_allclose(loads, here[1], atol=1e-4)


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
def test_what_cannot_be_is_refused_and_the_old_flies_on(name, value, axis, tmp_path):
    expected = axis.exported | {name: value}
    if value != value or value > 1e38:
        expected[name] = 1e39  # infinite in float
    check_refused(axis, expected, [name], tmp_path)


def test_numbers_of_each_axis_are_refused_by_their_kinds(of, tmp_path):
    last = {"kp": 30.0, "strong": 2.0, "var_y": -1.0}
    expected = of.exported
    for kind, share in last.items():
        expected[[name for name in expected if name.startswith(kind)][-1]] *= share
    check_refused(of, expected, list(last), tmp_path)


def check_refused(of, expected, kinds, place):
    iu, loads, counts, in_use = simulated(of, place, expected)
    names = [each.name for each in PARAMETERS]
    assert counts == [1, sum(1 << names.index(kind) for kind in kinds), 0]
    same = simulated(of, place, of.exported)
    np.testing.assert_array_equal(iu, same[0])
    np.testing.assert_array_equal(loads, same[1])
    np.testing.assert_allclose(in_use, list(of.exported.values()), rtol=1e-7)


def test_its_own_self_test_passes(of):
    said = printed_by(of.made.folder)
    assert "FAIL" not in said
    assert said.count("equal to the last bit") == 1 + (not of.machine.single)


def test_what_is_made_of_more_is_not_calibrated(tmp_path):
    with pytest.raises(AmbkitError, match="made of more than noise"):
        export_c(BEARING, None, tmp_path, kind="augmented", scenario=SCENARIO, calibrated=True)
    lqg = SCENARIO.replace(controller=Control(type="lqg"))
    with pytest.raises(AmbkitError, match="this controller has a regulator"):
        export_c(BEARING, None, tmp_path, scenario=lqg, calibrated=True)
    with pytest.raises(AmbkitError, match="calibration needs a controller"):
        export_c(BEARING, None, tmp_path, calibrated=True)
    run_up = SCENARIO.replace(speed=Ramp(slope=600.0))
    with pytest.raises(AmbkitError, match="calibration is for one speed of rotation"):
        export_c(Machine.preset("tum_mlps"), None, tmp_path, scenario=run_up, calibrated=True)


def draws(made, n, seed):
    """Return n sets of numbers: within the limits, at their ends, and one or all numbers beyond."""
    told = json.loads((made.folder / "calibration.json").read_text())["parameters"]
    low, high = (np.array([each[end] for each in told]) for end in ("low", "high"))
    random = np.random.default_rng(seed)
    sets = []
    for k in range(n):
        expected = low + random.random(len(low)) * (high - low)
        if k % 4 == 1:
            expected = np.where(random.random(len(low)) < 0.5, low, high)
        elif k % 4 == 2:
            expected[random.integers(len(low))] *= 10.0 ** random.choice([-30, -6, -1, 1, 3, 30])
        elif k % 4 == 3:
            expected = expected * 10.0 ** random.uniform(-3, 3, len(low))
        sets.append(expected)
    number = np.float32 if made.precision == "float" else np.float64
    kinds = [each.name for each in PARAMETERS]
    of = [
        max(kinds.index(kind) for kind in kinds if each["name"].startswith(kind)) for each in told
    ]
    expected = np.array(sets, number)
    beyond = (expected < low.astype(number)) | (expected > high.astype(number))
    refused = [sum(1 << kind for kind in {of[i] for i in np.flatnonzero(row)}) for row in beyond]
    return expected, np.array(refused)


@pytest.mark.parametrize(
    ("name", "kind", "feedback", "precision", "n"),
    [
        ("zittau_axial", "linear", "estimate", "float", 40),
        ("zittau_axial", "extended", "measurement", "float", 40),
        pytest.param("tum_mlps", "linear", "estimate", "double", 200, marks=pytest.mark.long),
        *(pytest.param(*of, 200, marks=pytest.mark.study)
          for of in (("tum_mlps", "linear", "estimate", "float"),
                     ("tum_mlps", "extended", "measurement", "float"),
                     ("tum_mlps_flexible", "linear", "estimate", "float"),
                     ("tum_mlps_flexible", "linear", "measurement", "double"))),
        *(pytest.param("zittau_axial", kind, feedback, "float", 1000, marks=pytest.mark.study)
          for kind in ("linear", "extended") for feedback in ("estimate", "measurement")),
    ],
)  # fmt: skip
def test_no_set_that_is_taken_lets_a_hovering_rotor_fall(
    name, kind, feedback, precision, n, tmp_path
):
    """One set after the other in one flight; what is refused changes nothing."""
    machine = Machine.preset(name)
    scenario = Scenario(duration=0.1, sequence=LiftOff(), controller=Control(feedback=feedback))
    magnet = None if kind == "linear" else learned_magnet(kind, machine)
    made = export_c(machine, magnet, tmp_path / "rig", prefix="rig", scenario=scenario,
                    calibrated=True, kind=kind, precision=precision)  # fmt: skip
    sampled = flips.AXIS if machine.single else flips.SEVERAL
    program = flips.source(
        sampled + flips.CALIBRATED, KF="rig_kalman", LOAD=0.5, NAME_STATE="memory",
        PLACE="rig.filter" + ".filter" * (not machine.single), header="rig_calibration.h",
        rig="rig_state" if machine.single else "rig_control_state", SPEED=machine.speed or 0,
        **flips.magnets_of(made),
    )  # fmt: skip
    sets, refused = draws(made, n, seed=1)
    rows = "\n".join(" ".join(f"{value:.17g}" for value in each) for each in sets)
    out = flips.compiled(made, program, "-DDRAWS", optimise=n > 40)
    done = subprocess.run([out, "1500"], input=rows, capture_output=True, text=True, check=True)
    told = np.array([line.split() for line in done.stdout.splitlines()], np.int64)
    np.testing.assert_array_equal(told[:, 0], refused)
    np.testing.assert_array_equal(told[:, 1], refused == 0)
    assert told[:, 2].all()
    assert not told[:, 3].any()
    assert 0.4 * n < (refused == 0).sum() < 0.6 * n


# ---- A2L ----

needs_readelf = pytest.mark.skipif(
    not any(map(shutil.which, a2l.READERS)), reason="readelf is not installed"
)


@needs_readelf
def test_addresses_come_from_the_program(of, call, tmp_path):
    """Each is where the program itself says that the member is."""
    simulated(of, tmp_path, of.exported)
    program = tmp_path / "main"
    assert call("export", "a2l", of.made.folder, "--elf", program, "--out", "rig.a2l").code == 0
    text = (tmp_path / "rig.a2l").read_text()
    found = dict(re.findall(r"/begin CHARACTERISTIC (\S+) .*\n\s+VALUE (0x[0-9A-F]+)", text))
    found |= dict(
        re.findall(r"/begin MEASUREMENT (\S+) .*\n.*\n\s+ECU_ADDRESS (0x[0-9A-F]+)", text)
    )
    base = a2l.symbol(program, "calibration").address
    places = tmp_path / "places.c"
    names = list(of.exported)
    fields = [f"{which}[{k}]" for which in ("wanted", "in_use") for k in range(len(names))]
    fields += ["request", "answered", "refused", "flying"]
    rows = "".join(f'printf("%zu\\n", offsetof(amb_calibration, {field}));' for field in fields)
    places.write_text(
        '#include "rig_calibration.h"\n#include <stddef.h>\n#include <stdio.h>\n'
        f"int main(void) {{ {rows} return 0; }}\n"
    )
    subprocess.run(["gcc", *INCLUDES, str(places), "-o", str(tmp_path / "places")],
                   cwd=of.made.folder, check=True)  # fmt: skip
    offsets = subprocess.run([tmp_path / "places"], capture_output=True, text=True).stdout.split()
    expected = dict(zip(
        [f"calibration.wanted.{n}" for n in names] + [f"calibration.in_use.{n}" for n in names]
        + [f"calibration.{n}" for n in ("request", "answered", "refused", "flying")],
        [base + int(offset) for offset in offsets], strict=True,
    ))  # fmt: skip
    assert {name: int(place, 16) for name, place in found.items()} == expected


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # its own
@pytest.mark.parametrize("big_endian", quick([False, True], [True]))
def test_another_reads_the_a2l_file(of, tmp_path, big_endian):
    """pya2l, by its grammar of ASAP2 1.7: each parameter with its address, limits and unit."""
    from pya2l import import_a2l, model

    at = a2l.Symbol(0x20000100, 1000, big_endian=big_endian)
    path = tmp_path / "rig.a2l"
    told = of.told
    path.write_text(a2l.text(told, at, "calibration"))
    session = import_a2l(str(path), in_memory=True, loglevel="ERROR")
    expected = {each.name: each for each in session.query(model.Characteristic)}
    shown = {each.name: each for each in session.query(model.Measurement)}
    methods = {each.name: each for each in session.query(model.CompuMethod)}
    kind, real = {"float": ("FLOAT32_IEEE", 4), "double": ("FLOAT64_IEEE", 8)}[of.made.precision]
    n = len(told["parameters"])
    for k, each in enumerate(told["parameters"]):
        one, flies = (f"calibration.{which}.{each['name']}" for which in ("wanted", "in_use"))
        assert expected[one].address == at.address + k * real
        assert (expected[one].type, expected[one].deposit) == ("VALUE", "Real")
        limits = each["low"], each["high"]
        assert (expected[one].lowerLimit, expected[one].upperLimit) == limits
        assert (shown[flies].lowerLimit, shown[flies].upperLimit) == limits
        assert limits[0] <= each["exported"] <= limits[1] < 1e3 * each["exported"]
        assert shown[flies].ecu_address.address == at.address + (n + k) * real
        assert shown[flies].datatype == kind
        assert methods[expected[one].conversion].unit == each["unit"]
    assert expected["calibration.request"].address == at.address + 2 * n * real
    assert (len(expected), len(shown)) == (n + 1, n + 3)
    (common,) = session.query(model.ModCommon)
    assert common.byte_order.byteOrder == ("MSB_FIRST" if big_endian else "MSB_LAST")
    session.close()


@needs_readelf
@pytest.mark.parametrize(
    ("elf", "symbol", "message"),
    [("program", "nothing", "has no variable nothing"), ("text", "calibration", "is no ELF file")],
)
def test_what_is_not_there_is_reported(elf, symbol, message, axis, call, tmp_path):
    simulated(axis, tmp_path, axis.exported)
    (tmp_path / "text").write_text("no program")
    path = tmp_path / ("main" if elf == "program" else "text")
    words = ["--elf", str(path), "--symbol", symbol, "--out", str(tmp_path / "rig.a2l")]
    told = call("export", "a2l", axis.made.folder, *words)
    assert told.code == 2
    assert message in told.err
