"""An exported filter made anew in C is the export of the changed machine, and flies like it."""

import shutil
import subprocess

import numpy as np
import pytest

import ambkit
from ambkit.estimate.core_model import numbers
from ambkit.estimate.rebuild import with_parameters
from ambkit.export.c import export_c

CLANG = shutil.which("clang-14") or shutil.which("clang")

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

PROGRAM = r"""
#include "NAME_data.h"
#include "NAME_rebuild.h"
#include <stdio.h>
#include <stdlib.h>

static NAME_state filter;
static NAME_rebuilt other;
static double room[UPPER_ROOM];

int main(int count, char **words)
{
  double parameters[UPPER_PARAMETERS];
  if (!NAME_rebuilds_itself(&other, room))
    return 2;
  for (int i = 0; i < UPPER_PARAMETERS; i++)
    parameters[i] = strtod(words[1 + i], NULL);
  if (count != 1 + UPPER_PARAMETERS || NAME_rebuild(parameters, &other, room) != AMB_OK)
    return 3;
  for (int i = 0; i < UPPER_NUMBERS; i++)
    printf("%a\n", (double)other.numbers[i]);
  NAME_init(&filter);
  NAME_work_by(&filter, &other);
  const amb_estimator *by = filter.by;
  const amb_real at_rest[AMB_STATES] = {0};
  (void)by->methods->reset(by, &filter.filter, at_rest, NAME_std);
  for (int k = 1; k <= 20; k++) {
    const amb_real u[AMB_CONTROLS] = {AMB_C(0.1)};
    amb_real y[AMB_SENSORS] = {0};
    amb_kalman_result result;
    y[0] = AMB_C(1e-6) * (amb_real)k;
    (void)amb_estimator_step(by, &filter.filter, y, u, &result);
  }
  for (int i = 0; i < AMB_STATES; i++)
    printf("%a\n", (double)filter.filter.mean[i]);
  parameters[UPPER_PARAMETERS - 1] *= 1e3;
  return filter.by == by && NAME_rebuild(parameters, &other, room) == AMB_BAD_PARAMETER ? 0 : 4;
}
"""


def built(machine, folder, filter):
    export_c(machine, filter, folder, editable=True, force=True)
    name = machine.name
    text = PROGRAM.replace("NAME", name).replace("UPPER", name.upper())
    (folder / "program.c").write_text(text)
    sources = sorted(folder.glob("*.c")) + sorted(folder.glob("core/src/*.c"))
    flags = ["-std=c99", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion",
             "-Wdouble-promotion", "-Werror", "-fsanitize=address,undefined"]  # fmt: skip
    includes = [f"-I{folder / part}" for part in ("", "core/include", "core")]
    done = subprocess.run(["gcc", *flags, *includes, *sources, "-o", folder / "program"],
                          capture_output=True, text=True)  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "program"


def changed(machine, seed):
    """The machine with each parameter up to a tenth away, and the parameters."""
    rng, values = np.random.default_rng(seed), []

    def change(_name, value, low, high):
        values.append(min(max(value * rng.uniform(0.9, 1.1), low), high))
        return values[-1]

    return with_parameters(machine, change), values


IN_WASM = r"""
#include "NAME_rebuild.h"

static NAME_rebuilt other;
static double room[UPPER_ROOM], parameters[UPPER_PARAMETERS];

__attribute__((export_name("set"))) void set(int i, double value) { parameters[i] = value; }
__attribute__((export_name("make"))) int make(void)
{
  return (int)NAME_rebuild(parameters, &other, room);
}
__attribute__((export_name("number"))) double number(int i) { return (double)other.numbers[i]; }
"""

IN_NODE = """
const [file, count, ...values] = process.argv.slice(2);
const compiled = new WebAssembly.Module(require("fs").readFileSync(file));
const { set, make, number } = new WebAssembly.Instance(compiled, {}).exports;
values.forEach((value, i) => set(i, Number(value)));
if (make() !== 0) process.exit(3);
const numbers = Float64Array.from({ length: Number(count) }, (_, i) => number(i));
process.stdout.write(Buffer.from(numbers.buffer));
"""

LATE = ambkit.preset("zittau_axial").replace(amplifier__bandwidth="900 Hz", delay="0.15 ms")
CASES = [
    pytest.param(LATE, "float64", id="one axis in double"),
    pytest.param(LATE, "float32", id="one axis in float", marks=pytest.mark.long),
    pytest.param(ambkit.preset("tum_mlps"), "float32", id="four axes", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("machine", "precision"), CASES)
def test_c_makes_anew_what_an_export_of_the_changed_machine_has(machine, precision, tmp_path):
    noise = ambkit.KalmanFilter(machine).variances
    options = {"noise": ambkit.FilterNoise(*noise), "precision": precision}
    filter = ambkit.KalmanFilter(machine, **options)
    program = built(machine, tmp_path / "c", filter)
    other, values = changed(machine, 4)
    done = subprocess.run([program, *map(repr, values)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    got = np.array([float.fromhex(line) for line in done.stdout.split()])
    right = ambkit.KalmanFilter(other, **options)
    expected = numbers(right.model).astype(precision)
    np.testing.assert_array_equal(got[: len(expected)], expected)
    flown = got[len(expected) :]
    n, axes, readings = len(filter.states), len(machine.axes), len(machine.readings)
    right.reset(np.zeros(n), std=filter.default_std())
    for k in range(1, 21):
        y, u = np.zeros(readings), np.zeros(axes)
        y[0], u[0] = 1e-6 * k, 0.1
        right.predict(u if axes > 1 else u[0])
        right.update(y if readings > 1 else y[0])
    # The known weight is that of the export and what the mass adds, so to a rounding.
    size = np.array([state.size for state in filter.states])
    room = 1e-12 if precision == "float64" else 1e-5
    np.testing.assert_allclose(flown / size, right.mean / size, rtol=room, atol=room * 1e-2)
    assert np.abs(flown / size).max() > 1e-4


@pytest.mark.long
@pytest.mark.skipif(
    None in (shutil.which("node"), CLANG), reason="there is no node or no clang for WebAssembly"
)
@pytest.mark.parametrize("preset", ["tum_mlps", "compressor"])
def test_in_node_it_has_the_bits_of_python(preset, tmp_path):
    machine, folder = ambkit.preset(preset), tmp_path / "c"
    filter = ambkit.KalmanFilter(machine)
    export_c(machine, filter, folder, editable=True, force=True)
    text = IN_WASM.replace("NAME", machine.name).replace("UPPER", machine.name.upper())
    (folder / "wasm.c").write_text(text)
    sources = sorted(folder.glob("*.c")) + sorted(folder.glob("core/src/*.c"))
    includes = [f"-I{folder / part}" for part in ("", "core/include", "core")]
    command = [CLANG, "--target=wasm32-wasi", "-std=c99", "-O2", "-ffp-contract=off",
               "-mexec-model=reactor", "-Wl,--gc-sections", *includes, *sources,
               "-o", folder / "out.wasm"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (folder / "run.cjs").write_text(IN_NODE)
    other, values = changed(machine, 5)
    expected = numbers(ambkit.KalmanFilter(other).model)
    numbers_in = [str(len(expected)), *map(repr, values)]
    words = ["node", folder / "run.cjs", folder / "out.wasm", *numbers_in]
    done = subprocess.run(words, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    np.testing.assert_array_equal(np.frombuffer(done.stdout), expected)
