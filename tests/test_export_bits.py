"""Exports of machines that are not the paper's axis: the self-test in C gives Python's bits.

Their own model is code, straight-line, or arrays that loops go through.
"""

import re
import shutil
import subprocess
from itertools import product

import fe_map
import iron
import pytest
from export_cases import BEARING, PRECISIONS, compiled, printed_by, program
from exporting import export_c
from machine_cases import PRESETS, RIGS, machine
from quick import quick

import ambkit
from ambkit import AmbkitError, Machine, Scenario
from ambkit.control.control import LiftOff
from ambkit.estimate.registry import KINDS
from ambkit.export.c.model import MOST_UNROLLED, states
from ambkit.models.model import Descriptor

NOISE = {"variance": 1e-12, "bandwidth": 200.0}
LATE = 1.5 * BEARING.sampling_time


def hum(*frequencies):
    return [{"frequency": f, "amplitude": 5e-6, "bandwidth": 0.5} for f in frequencies]


AXES = {
    "amplifier": BEARING.replace(amplifier__bandwidth=2000.0),
    "delay": BEARING.replace(delay=LATE),
    "noise": BEARING.replace(sensor__coloured_noise=NOISE),
    "hum": BEARING.replace(sensor__hum=hum(50.0)),
    "all": BEARING.replace(
        delay=LATE, amplifier__bandwidth=2000.0, sensor__coloured_noise=NOISE, sensor__hum=hum(50.0)
    ),
}
# One of each C file; those that have a constant gain or no model are further below.
OF_MACHINES = (
    "linear", "closed-law", "extended", "ud", "augmented", "multiple-model", "unscented",
)  # fmt: skip
OF_AXES = (
    *OF_MACHINES, "observer", "steady-state", "extended-adaptive-noise", "linear-adaptive-noise",
)  # fmt: skip
BUILDS = (("double", False), ("double", True), ("float", None))
# Machine, kind, precision, and whether by loops; None: as the export chooses.
CASES = [
    *(("all", kind, *build) for kind, build in product(OF_AXES, BUILDS)),
    *product(AXES.keys() - {"all"}, ("linear", "extended"), ("double",), (False, True)),
    *product(("rigid rotor",), OF_MACHINES, ("float",), (None, False)),
    *product(PRESETS, ("linear",), ("float", "double"), (None,)),
]
# Each part, kind, form, rig and precision.
QUICK = {
    *((part, ("linear", "extended")[k // 2 % 2], "double", k % 2 == 1)
      for k, part in enumerate(sorted(AXES.keys() - {"all"}))),
    *(("all", kind, *BUILDS[k % 3]) for k, kind in enumerate(OF_AXES)),
    *(("all", "linear", *build) for build in BUILDS),
    *(("rigid rotor", kind, "float", (None, False)[k % 2])
      for k, kind in enumerate(OF_MACHINES[::2])),
    *((rig, "linear", ("float", "double")[k % 2], None) for k, rig in enumerate(sorted(RIGS))),
}  # fmt: skip


def made(machine, kind, out, **options):
    magnet = None if kind == "linear" else KINDS[kind].magnet(machine)
    return export_c(machine, magnet, out, kind=kind, prefix="f", **options)


@compiled
@pytest.mark.parametrize(
    ("name", "kind", "precision", "loops"), quick(sorted(CASES, key=str), QUICK)
)
def test_c_has_python_s_bits(name, kind, precision, loops, tmp_path):
    if name in AXES:
        exported = AXES[name]
    else:
        exported = machine() if name == "rigid rotor" else Machine.preset(name)
    made(exported, kind, tmp_path, precision=precision, loops=loops)
    assert "equal to the last bit" in printed_by(tmp_path)
    if name not in AXES:
        header = (tmp_path / "f.h").read_text()
        assert "amb_real th_x;" in header
        assert "A1, A2, B1, B2" in header


@compiled
def test_a_large_model_is_computed_by_loops(tmp_path):
    large = BEARING.replace(sensor__hum=hum(50.0, 100.0, 150.0, 300.0, 600.0))
    export = made(large, "extended", tmp_path)
    assert "core/src/loops.c" in export.files
    assert "core/generated/model.h" not in export.files
    (states,) = re.findall(
        r"#define AMB_STATES (\d+)", (tmp_path / "core/include/ambkit/precision.h").read_text()
    )
    assert int(states) == 4 + 2 * 5 > MOST_UNROLLED
    assert "equal to the last bit" in printed_by(tmp_path)


def test_its_header_names_its_states(tmp_path):
    export = made(AXES["all"], "linear", tmp_path)
    header = (tmp_path / "f.h").read_text()
    (fields,) = re.findall(r"typedef struct f_estimates \{\n(.*?)\n\}", header, re.DOTALL)
    names = re.findall(r"amb_real (\w+);", fields)
    assert names[:4] == ["x", "v", "f_d", "x_m"]
    assert {"i", "u_1", "u_2", "hum_c", "hum_s"} < set(names)
    assert names[-4:] == ["k_i", "k_s", "innovation", "variance"]
    model = (tmp_path / "core" / "generated" / "model.h").read_text()
    assert f"#define AMB_STATES {len(names) - 4}\n" in model
    assert "core/include/ambkit/loops.h" not in export.files
    assert max(map(len, model.splitlines())) <= 100
    assert export.cost is None


def test_a_state_of_a_name_that_c_has_gets_another():
    described = [Descriptor(n, "m", 1.0, "noise") for n in ("x", "double", "k_i", "feed_back")]
    assert [s.field for s in states(described)] == ["x", "double_", "k_i_", "feed_back_"]


FLOWN = {
    "estimate": Scenario(controller={"feedback": "estimate"}),
    "measurement": Scenario(controller={"feedback": "measurement"}),
    "sequence": Scenario(sequence=LiftOff()),
    "levitated": Scenario(start="levitated"),
}
CONTRACTED = ("-ffp-contract=fast", "-march=native")
# The least that fuses.
FUSED = {
    "gcc": ("-O1", "-fexpensive-optimizations", *CONTRACTED), "clang": ("-O1", *CONTRACTED),
}  # fmt: skip
"""What gcc and clang take by default for aarch64, or for this processor."""


def fuses(compiler):
    words = [compiler, *FUSED[compiler], "-dM", "-E", "-x", "c", "/dev/null"]
    defined = subprocess.run(words, capture_output=True, text=True).stdout
    return "__FMA__" in defined or "__aarch64__" in defined


OTHERS = ("tum_mlps", "heart_pump", "ufu_flexible", "compressor", "tum_mlps_flexible")
BY = [*product(("float", "double"), ("gcc", "clang"))]


@pytest.mark.parametrize(
    ("name", "flight", "precision", "compiler"),
    quick(
        [(name, flight, *by) for name, flight, by in product(OTHERS, FLOWN, BY)],
        [("tum_mlps", "measurement", "float", "clang"),
         ("heart_pump", "sequence", "float", "gcc"),
         ("tum_mlps", "levitated", "double", "gcc")],
        # Each machine in both precisions and by both compilers, each flight in all four.
        [(name, flight, *BY[3 - k % 4 if flight == "measurement" else k % 4])
         for k, name in enumerate(OTHERS) for flight in FLOWN],
    ),
)  # fmt: skip
def test_contraction_is_let_pass(name, flight, precision, compiler, tmp_path):
    """Where rounding is amplified, the self-test asks only those for bits that promise them."""
    if shutil.which(compiler) is None or not fuses(compiler):
        pytest.skip(f"{compiler} is not there, or this processor fuses nothing")
    made(Machine.preset(name), "linear", tmp_path, precision=precision, scenario=FLOWN[flight])
    done = program(compiler, tmp_path, tmp_path / "out", flags=FUSED[compiler])
    assert done.returncode == 0, done.stderr
    said = subprocess.run([tmp_path / "out"], capture_output=True, text=True)
    assert said.returncode == 0, said.stdout
    assert "accepted" in said.stdout  # bits differ, or it says nothing
    compared = re.search(r"Rounding decides in (\d+) of the (\d+) samples", said.stdout)
    if precision == "double":
        assert compared is None  # all samples
    else:
        left_out = 0.11 if name == "compressor" else 0.04
        assert compared is None or int(compared[1]) < left_out * int(compared[2])


@pytest.mark.parametrize(
    ("name", "precision"),
    [("heart_pump", "float"), ("heart_pump", "double"),
     pytest.param("tum_mlps_flexible", "float", marks=pytest.mark.long)],
)  # fmt: skip
def test_a_hundredth_of_a_gain_is_seen_by_who_contracts(name, precision, tmp_path):
    if not fuses("gcc"):
        pytest.skip("this processor fuses nothing")
    one = Machine.preset(name)
    scenario = Scenario(sequence=LiftOff())
    made(one, "linear", tmp_path, precision=precision, scenario=scenario)
    path, term = tmp_path / "core" / "src" / "controller.c", "pid->kp * weighted"
    assert path.read_text().count(term) == 1
    path.write_text(path.read_text().replace(term, f"AMB_C(1.01) * {term}"))
    assert program("gcc", tmp_path, tmp_path / "out", flags=FUSED["gcc"]).returncode == 0
    said = subprocess.run([tmp_path / "out"], capture_output=True, text=True).stdout
    assert "FAIL: f with its controllers" in said


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda to: export_c(BEARING, None, to, loops=True), "loops are for other models"),
        (lambda to: ambkit.export_c(machine(), "observer", out=to), "one axis"),
    ],
)
def test_what_cannot_be_exported_says_so(call, text, tmp_path):
    with pytest.raises(AmbkitError, match=text):
        call(tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_the_configuration_changes_with_the_machine(tmp_path):
    first = export_c(machine(), None, tmp_path / "a")
    again = export_c(machine(), None, tmp_path / "b")
    other = export_c(machine(speed=501.0), None, tmp_path / "c")
    assert first.configuration == again.configuration != other.configuration


# ---- filters of bearings with other parts ----

STD = BEARING.sensor.noise_variance**0.5
FORMS = {
    "plain": {}, "editable": {"editable": True}, "control": {"scenario": Scenario(duration=0.1)},
}  # fmt: skip


@compiled
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    ("form", "ratio", "kind"),
    [
        ("plain", 5, "extended"), ("editable", 1, "extended"), ("control", 20, "extended"),
        *(pytest.param("control", ratio, kind, marks=pytest.mark.study)
          for kind in ("linear", "ud", "observer", "augmented") for ratio in (5, 20, 50, 100)),
    ],
)  # fmt: skip
def test_a_sensor_with_steps(form, ratio, kind, precision, tmp_path):
    bearing = BEARING.replace(sensor__quantisation=ratio * STD)
    export_c(bearing, None, tmp_path / "c", prefix="rig", kind=kind, precision=precision,
             force=True, **FORMS[form])  # fmt: skip
    assert "equal to the last bit" in printed_by(tmp_path / "c")


@compiled
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("part", ["iron", "force map", "eddy current", "solid iron"])
def test_a_magnet_that_is_not_the_papers(part, precision, tmp_path):
    bearing = {
        "iron": lambda: iron.TWO_SIDED,
        "force map": lambda: Machine.load(fe_map.written(tmp_path)),
        "eddy current": lambda: BEARING.replace(magnet__eddy_current_lag=0.3e-3),
        "solid iron": lambda: BEARING.replace(magnet__eddy_current_corner=100.0),
    }[part]()
    made = export_c(bearing, None, tmp_path / "c", kind="extended", precision=precision, force=True)
    assert ("core/src/saturating.c" in made.sources) == (part == "iron")
    assert "equal to the last bit" in printed_by(made.folder)
