"""The plant as an FMU for model exchange: integrated by FMPy with CVode, and by the library."""

import shutil

import numpy as np
import pytest
from exporting import export_fmu
from quick import quick

import ambkit
from ambkit import Machine, Scenario
from ambkit.simulation.run import simulate_run

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy import read_model_description  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import check_sources  # noqa: E402
from iron import TWO_SIDED as IRON  # noqa: E402
from test_export_fmu import fmutool  # noqa: E402

BEARING = Machine.preset("zittau_axial")
PARTS = {
    "amplifier__bandwidth": "1 kHz",
    "speed": "6000 rpm",
    "sensor__runout": [{"order": n, "amplitude": "3 um", "phase": "90 deg"} for n in (1, 3)],
    "sensor__quadratic": "20 1/m",
}
VOLTS = {"amplifier__voltage_limit": "20 V", "amplifier__resistance": "2 ohm"}
SOFT_STOP = {"stop": {"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"}}
CASES = {
    "plain": (BEARING, 3),
    "iron": (IRON, 3),
    "one-sided": (Machine.preset("inteco_ml"), 3),
    "amplifier": (BEARING.replace(**PARTS), 4),
    "eddy currents": (BEARING.replace(magnet__eddy_current_lag="0.2 ms"), 4),
    "voltage and eddy currents": (
        BEARING.replace(**PARTS, **VOLTS, magnet__eddy_current_lag="0.2 ms"),
        6,
    ),
    "voltage": (BEARING.replace(**PARTS, **VOLTS), 5),
}


def held(t, **series):
    """Series that stay between the samples: two rows for each."""
    T = t[1] - t[0]
    rows = np.zeros(2 * len(t), dtype=[("time", float), *((name, float) for name in series)])
    rows["time"] = np.column_stack([t, np.append(t[1:], t[-1] + T)]).ravel()
    for name, values in series.items():
        rows[name] = np.repeat(values, 2)
    return rows


def integrated(path, t, **series):
    """What CVode makes of it, the last row at each time; events have rows of their own."""
    T = t[1] - t[0]
    others = dict.fromkeys(("noise_u", "noise_y", "fault_y_offset", "fault_frozen"), 0.0)
    others |= dict.fromkeys(("on", "fault_y_gain", "fault_u_gain", "fault_current"), 1.0)
    given = {name: np.full(len(t), value) for name, value in others.items()} | series
    found = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", solver="CVode", stop_time=len(t) * T,
        output_interval=T, input=held(t, **given), relative_tolerance=1e-10,
    )  # fmt: skip
    return found[np.append(np.diff(found["time"]) > 1e-9 * T, True)]


@pytest.mark.parametrize("name", quick(
    CASES, ["plain", "one-sided", "voltage and eddy currents"]
))  # fmt: skip
def test_an_importer_that_integrates_it_finds_what_the_library_does(name, tmp_path):
    bearing, states = CASES[name]
    T = bearing.sampling_time
    samples = 120 if bearing.magnet.type == "one-sided" else 250  # alone it is unstable
    scenario = Scenario(
        duration=samples * T, noise=False, substeps=20,
        reference=ambkit.Step(amplitude=0.05 * bearing.clearance, time=20 * T),
        disturbance=ambkit.Step(amplitude=0.3 * bearing.weight, time=60 * T),
    )  # fmt: skip
    record = simulate_run(bearing, scenario).record
    fmi = 2 if states == 3 else 3
    path = export_fmu(bearing, None, tmp_path / "plant.fmu", kind="plant", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    assert len(read_model_description(str(path)).derivatives) == states
    found = integrated(path, record.t, u=record["u"], f_d=record["f_d"])
    np.testing.assert_allclose(found["time"][: len(record.t)], record.t, atol=1e-9 * T)
    for signal in ("x", "v", "x_m"):
        reached = np.abs(record[signal]).max()
        off = np.abs(found[signal][: len(record.t)] - record[signal]).max()
        assert off < 2e-5 * reached, (signal, off / reached)
    assert np.ptp(record["x"]) > 1e-6


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("changes", [{}, SOFT_STOP], ids=["hard", "soft"])
def test_it_falls_onto_its_stop_and_is_lifted(changes, fmi, tmp_path):
    """Without currents it falls; then they come back and pull it up to the other side."""
    bearing = BEARING.replace(rotor__clearance="0.3 mm", **changes)
    T, n = bearing.sampling_time, 400
    t = T * np.arange(n)
    path = export_fmu(bearing, None, tmp_path / "plant.fmu", kind="plant", fmi=fmi).path
    on = np.where((t < 0.02), 0.0, 1.0)
    u = np.full(n, 0.9 * bearing.current_max / bearing.amplifier.gain)
    zero = np.zeros(n)
    found = integrated(path, t, u=u, f_d=zero, on=on)
    signals = np.zeros(n, dtype=[("time", float), ("u", float), ("on", float)])
    signals["time"], signals["u"], signals["on"] = t, u, on
    stepped = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", stop_time=n * T, output_interval=T, input=signals
    )
    down, travel = np.sign(bearing.weight), bearing.clearance
    assert stepped["x"].min() <= -travel
    assert stepped["x"].max() >= travel
    off = np.abs(np.interp(stepped["time"], found["time"], found["x"]) - stepped["x"])
    # The library finds a stop at the end of one of its steps, the importer between.
    assert off.max() < np.abs(stepped["v"]).max() * T / 2
    if not changes:
        lying = (found["time"] > 0.015) & (found["time"] < 0.019)
        np.testing.assert_allclose(found["x"][lying], down * travel, rtol=1e-6)
        np.testing.assert_array_equal(found["v"][lying], 0)


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_tools_find_nothing(fmi, tmp_path):
    path = export_fmu(CASES["voltage"][0], None, tmp_path / "p.fmu", kind="plant", fmi=fmi).path
    said = fmutool(path)
    assert f"No semantic error against the FMI-{fmi} standard" in said
    assert "ERROR" not in said
    assert "WARNING" not in said
    for compiler in filter(shutil.which, ("gcc", "clang")):
        check_sources(path, tmp_path / compiler, compiler, "-Wdouble-promotion")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_dead_time_is_for_co_simulation_alone(fmi, tmp_path):
    late = BEARING.replace(delay="0.12 ms")
    path = export_fmu(late, None, tmp_path / "p.fmu", kind="plant", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    described = read_model_description(str(path))
    assert described.modelExchange is None
    assert described.coSimulation is not None
    assert not any(variable.name.startswith("der(") for variable in described.modelVariables)
