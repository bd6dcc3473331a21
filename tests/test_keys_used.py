"""No number of a machine's file is read and then forgotten: each moves the plant that flies."""

import copy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from iron import TWO_SIDED as IRON

import ambkit
from ambkit import AmbkitError, Scenario
from ambkit.base.escaping import toml_text
from ambkit.workflow.check import documents, kind_of_toml

RICH = IRON.replace(
    name="rich", speed="6000 rpm", delay="0.03 ms", magnet__eddy_current_lag="0.2 ms",
    magnet__pole_angle="10 deg", amplifier__bandwidth="1 kHz", amplifier__voltage_limit="8 V",
    amplifier__resistance="2 ohm", amplifier__current_limit="0.9 A", rotor__gravity="45 deg",
    sensor__position_noise="-90 1/m", sensor__quadratic="20 1/m", sensor__cubic="1e4 1/m^2",
    sensor__quantisation="0.5 um",
    sensor__coloured_noise={"variance": "1 um^2", "bandwidth": "200 Hz"},
    sensor__hum=[{"frequency": "50 Hz", "amplitude": "5 um", "bandwidth": "0.5 Hz"}],
    sensor__runout=[{"order": 1, "amplitude": "3 um", "phase": "30 deg"}],
    stop={"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"}, rotor__clearance="0.15 mm",
)  # fmt: skip
FLIES = Scenario(duration=0.03, start="released", disturbance=ambkit.Step(amplitude=8.0, time=0.01))
DERIVED = ("sampling_time", "magnet__magnet_constant")


def numbers(thing, at=""):
    """Return the numbers of a part of a file with the key that `replace` takes."""
    found = []
    for name, value in (thing if isinstance(thing, dict) else thing.tables()).items():
        key = f"{at}{name}"
        if hasattr(value, "tables") or isinstance(value, dict):
            found += numbers(value, f"{key}__")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((key, value))
    return found


@pytest.fixture(scope="module")
def run():
    return ambkit.simulate(RICH, FLIES).record


@pytest.mark.parametrize(
    ("key", "value"), [(k, v) for k, v in numbers(RICH) if k not in DERIVED], ids=lambda v: str(v)
)
def test_each_number_moves_the_plant(run, key, value):
    changed = int(value * 1.25) if key.endswith("turns") else 1.1 * value
    other = ambkit.simulate(RICH.replace(**{key: changed}), FLIES).record
    same = all(np.array_equal(run[name], other[name]) for name in ("x", "y", "iu", "f_mag"))
    assert not same


def test_no_number_is_left_out():
    """What `RICH` does not state is a file, a word, or of the copper alone."""
    absent = {
        name
        for part in (RICH, RICH.magnet, RICH.amplifier, RICH.sensor)
        for name, value in part.tables().items()
        if value in (None, ())
    }
    assert absent == {"coil", "force_map", "force_channels", "force_scale", "eddy_current_corner"}


def test_a_corner_of_eddy_currents_moves_the_plant_in_place_of_a_lag():
    solid = RICH.replace(magnet__eddy_current_lag=None, magnet__eddy_current_corner="100 Hz")
    moved = [
        ambkit.simulate(solid.replace(magnet__eddy_current_corner=corner), FLIES).record["x"]
        for corner in (100.0, 110.0)
    ]
    assert not np.array_equal(*moved)


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("pulses", "per_turn", 3), ("pulses", "angle_noise", 0.02), ("pulses", "latency", 1.1e-3),
        ("pulses", "latency_error", 2e-4), ("pulses", "acceleration", 110.0),
        ("pulses", "max_speed", 900.0), ("pulses", "reverses", True), ("encoder", "per_turn", 3),
        ("encoder", "angle_noise", 0.02), ("speed", "speed_noise", 0.2),
        ("speed", "gain_error", 0.02),
    ],
)  # fmt: skip
def test_each_key_of_the_angle_moves_the_plant_or_its_estimate(kind, key, value):
    usual = {"type": kind, "per_turn": 2, "latency": 1e-3, "latency_error": 1e-4}
    usual |= {"gain_error": 0.01} if kind == "speed" else {}
    rotor = ambkit.Machine.preset("tum_mlps").replace(speed=600.0, unbalance=[])
    results = []
    for sensor in (usual, usual | {key: value}):
        machine = rotor.replace(angle=sensor)
        record = ambkit.simulate(machine, Scenario(duration=0.05)).record
        estimate = ambkit.estimate_angle(machine, record)
        results.append(np.column_stack([estimate.angle, estimate.angle_variance, estimate.status]))
    assert not np.array_equal(*results)


# ---- keys that nothing reads ----

FILES = [
    *(Path(ambkit.__file__).parent / "machine" / "presets").rglob("*.toml"),
    *(Path(__file__).parents[1] / "examples").rglob("*.toml"),
    *(Path(__file__).parent / "data").rglob("*.toml"),
]


def tables(data, at=()):
    """Yield the path of each table, in lists too."""
    if isinstance(data, dict):
        yield at
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if isinstance(value, dict | list):
            yield from tables(value, (*at, key))


@pytest.fixture(scope="module")
def a_filter(tmp_path_factory):
    path = tmp_path_factory.mktemp("filter") / "filter.toml"
    kf = ambkit.AugmentedKalmanFilter(ambkit.preset("zittau_axial"), wander=0.02)
    kf.origin = {"options.wander": "by hand"}
    kf.save(path)
    return path


@pytest.mark.parametrize("path", [*FILES, None], ids=lambda p: p.stem if p else "filter")
def test_a_key_that_nothing_reads_is_an_error(path, a_filter):
    path = path or a_filter
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    document = documents()[kind_of_toml(path)]
    for at in tables(data):
        wrong = copy.deepcopy(data)
        table = wrong
        for key in at:
            table = table[key]
        of_own_names = {"signals": {"zzz": 1}, "origin": "by hand"}  # tables that may have any key
        table["zzz"] = of_own_names.get(at[-1], 1) if at else 1
        with pytest.raises(AmbkitError, match=r"\.toml:\d+: .*zzz: unknown key, "):
            document.from_toml(toml_text(wrong), path.name, path.parent)
