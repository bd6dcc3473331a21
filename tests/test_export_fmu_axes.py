"""FMUs of machines with several axes: equal to the library to the last bit, in FMPy."""

from __future__ import annotations

import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambkit import KalmanFilter, Machine, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.control.lift_off_sequence import LiftOff
from ambkit.export.fmu import export_fmu
from ambkit.simulation.run import Run, simulate_run

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import Instance, unpacked  # noqa: E402

MACHINE = Machine.preset("tum_mlps")
T = MACHINE.sampling_time
QUICK = LiftOff(wait=2e-3, lift=0.02, land=0.02, stop=0.08)
READINGS = [f"y_{reading.name}" for reading in MACHINE.readings]
AXES = [axis.name for axis in MACHINE.axes]
GOES_ON = """
import pickle, sys
from fmu_instance import Instance
folder, given, out = sys.argv[1:]
state, inputs, names = pickle.load(open(given, "rb"))
other = Instance(folder).start()
other.fmu.setFMUState(other.fmu.deserializeFMUState(state))
other.at = len(inputs["y_La1"])
pickle.dump(other.run(inputs, names), open(out, "wb"))
"""


def flown(**options: Any) -> tuple[Scenario, Run]:
    scenario = Scenario(seed=3, **options)
    return scenario, simulate_run(MACHINE, scenario, estimator=KalmanFilter(MACHINE))


def simulated(path: Path, run: Run, names: list[str], **more: Any) -> Any:
    inputs = {name: run.record[name] for name in names} | more
    n = len(run.record.t)
    signals = np.zeros(n, dtype=[("time", float), *((name, float) for name in inputs)])
    signals["time"] = T * np.arange(n)
    for name, values in inputs.items():
        signals[name] = values
    return fmpy.simulate_fmu(str(path), stop_time=n * T, output_interval=T, input=signals)


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_estimator_of_several_axes_has_python_s_bits(fmi: Any, tmp_path: Path) -> None:
    _, run = flown(duration=300 * T, feedback="measurement")
    path = export_fmu(MACHINE, None, tmp_path / "filter.fmu", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    found = simulated(path, run, READINGS + [f"u_{name}" for name in AXES])
    estimate = KalmanFilter(MACHINE).run(run.record, covariance=True)
    for name in estimate.names:
        np.testing.assert_array_equal(found[name][1:], estimate[name], name)
        std = found[f"std_{name}"][1:]  # by the core's own root
        np.testing.assert_allclose(std, estimate.std(name), rtol=1e-15, err_msg=name)
    for k, reading in enumerate(MACHINE.readings):
        of_reading = found[f"innovation_{reading.name}"][1:]
        np.testing.assert_array_equal(of_reading, estimate.innovation[:, k])
    np.testing.assert_array_equal(found["status"][1:], estimate.status)


@pytest.mark.parametrize(
    "options",
    [
        {"duration": 300 * T, "feedback": "estimate"},
        {"duration": 1200 * T, "feedback": "measurement", "start": "landed", "sequence": QUICK},
    ],
    ids=["in flight", "from rest to rest"],
)
def test_a_whole_controller_of_several_axes_has_python_s_bits(
    options: dict[str, Any], tmp_path: Path
) -> None:
    scenario, run = flown(**options)
    path = export_fmu(
        MACHINE, None, tmp_path / "flown.fmu", kind="whole-controller", scenario=scenario
    ).path
    assert validate_fmu(str(path)) == []
    more = {"speed": np.full(len(run.record.t), MACHINE.speed)}
    if scenario.sequence is not None:
        more["fly"] = scenario.sequence.fly(run.record.t)
    found = simulated(path, run, READINGS + [f"r_{name}" for name in AXES], **more)
    for name in AXES:
        np.testing.assert_array_equal(found[f"u_{name}"][1:], run.record[f"u_{name}"], name)
    assert run.estimate is not None
    for name in run.estimate.names:
        np.testing.assert_array_equal(found[f"estimate.{name}"][1:], run.estimate[name], name)
    np.testing.assert_array_equal(found["status"][1:], run.status)
    if scenario.sequence is not None:
        np.testing.assert_array_equal(found["mode"][1:], run.record["mode"])
        assert set(run.record["mode"]) == {0, 1, 2, 3, 4}


def test_the_bytes_of_a_state_go_on_in_another_process(tmp_path: Path) -> None:
    _, run = flown(duration=40 * T)
    path = export_fmu(MACHINE, None, tmp_path / "filter.fmu", fmi=2).path
    folder, names = unpacked(path, tmp_path / "unpacked"), tuple(f"f_d_{name}" for name in AXES)
    inputs = {name: run.record[name] for name in [*READINGS, *(f"u_{name}" for name in AXES)]}
    first, rest = ({name: at[part] for name, at in inputs.items()}
                   for part in (slice(20), slice(20, 40)))  # fmt: skip
    one = Instance(folder).start()
    one.run(first, names)
    state = one.fmu.serializeFMUState(one.fmu.getFMUState())
    given, out = tmp_path / "given", tmp_path / "out"
    given.write_bytes(pickle.dumps((state, rest, names)))
    command = [sys.executable, "-c", GOES_ON, str(folder), str(given), str(out)]
    subprocess.run(command, check=True, cwd=Path(__file__).parent)
    assert pickle.loads(out.read_bytes()) == one.run(rest, names)


@pytest.mark.parametrize("kind", ["plant", "closed-loop", "controller"])
def test_what_there_is_not_of_several_axes_is_said(kind: Any, tmp_path: Path) -> None:
    with pytest.raises(AmbkitError, match=f"tum_mlps has several axes: .* no {kind}"):
        export_fmu(MACHINE, None, tmp_path / "no.fmu", kind=kind)
