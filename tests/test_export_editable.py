"""Exports whose data file has each number once, and starts wherever the rotor lies."""

import re
import shutil
from itertools import product

import numpy as np
import pytest
from export_cases import BEARING, Filters, export, printed_by
from quick import quick

import ambkit
from ambkit import FilterNoise, KalmanFilter

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

NOISE = FilterNoise(measurement=8.3e-11, control=8e-5, disturbance=100.0)
KINDS = ("linear", "closed-law", "extended", "ud", "multiple-model", "linear-adaptive-noise",
         "observer", "low-pass")  # fmt: skip


@pytest.mark.parametrize(("kind", "precision"), quick(
    product(KINDS, ("float", "double")),
    {*product(KINDS[::2], ("float",)), ("extended", "double"), ("multiple-model", "double")},
))  # fmt: skip
def test_what_follows_is_computed_at_init_to_the_same_bits(tmp_path, kind, precision):
    made = export(kind, tmp_path / "c", prefix="f", precision=precision, editable=True)
    assert "equal to the last bit" in printed_by(made.folder)


def test_as_printed_too(tmp_path):
    made = export("linear", tmp_path / "c", prefix="f", as_printed=True, editable=True)
    assert "equal to the last bit" in printed_by(made.folder)


def compiled(made, folder):
    """An export of prefix f, started."""
    return Filters(folder, {"f": made}, "float").start("f")


def edited(made, **numbers):
    """Edit numbers in the data file, each where it stands, which is once."""
    path = made.folder / f"{made.name}_data.c"
    text = path.read_text()
    for name, number in numbers.items():
        pattern = rf"(\b{name} = (?:\{{\s*)?)[-+.\de]+F"
        assert len(re.findall(pattern, text)) == 1, name
        text = re.sub(pattern, rf"\g<1>{number}", text)
    path.write_text(text)


def along(flies, record):
    u, means = np.concatenate([[0.0], record["u"][:-1]]), []
    for sample in zip(record["y"], u, strict=True):
        flies.step(*sample)
        means.append(flies.estimates[:4])
    return np.array(means)


@pytest.mark.parametrize(
    ("numbers", "like"),
    [
        ({"gate": "3.0F"}, {"gate": 3.0}),
        ({"lag": "0.0003F"}, {"sensor__lag": 3e-4}),
        ({"f_mass": "0.6F"}, {"rotor__mass": 0.6}),
    ],
    ids=["gate", "T_sen", "m"],
)
def test_what_is_edited_takes_effect(tmp_path, numbers, like):
    """As a filter that was told so from the start; but for what else stands in the file."""
    told = {"gravity": "disturbance", "noise": NOISE}
    made = export("linear", tmp_path / "c", prefix="f", editable=True, **told)
    own = dict(like)
    gate = own.pop("gate", 8.0)
    other = BEARING.replace(**own)
    kf = KalmanFilter(other, precision="float32", gate=gate, **told)
    first = KalmanFilter(BEARING, precision="float32", **told)
    edited(made, **numbers)
    flies = compiled(made, tmp_path)
    assert flies.started == 0
    T = BEARING.sampling_time
    run = ambkit.Scenario(
        duration=0.05, seed=1, controller=ambkit.PID.for_bearing(BEARING),
        reference=ambkit.Step(amplitude=3e-4, time=20 * T),
    )  # fmt: skip
    record = ambkit.simulate(BEARING, run).record
    found = along(flies, record)
    plain = first.run(record).mean
    assert np.abs(found - plain).max(axis=0)[0] > 0 or "gate" in numbers
    kf.reset(kf.initial_state(record["y"]), std=list(first.default_std()))
    expected = kf.core.run(record["y"], record["u"])["mean"]
    np.testing.assert_array_equal(found, np.asarray(expected, np.float32))


def test_settings_that_cannot_be_are_told(tmp_path):
    made = export("linear", tmp_path / "c", prefix="f", editable=True)
    edited(made, gate="-1.0F")
    assert compiled(made, tmp_path).started == 64  # AMB_BAD_PARAMETER


@pytest.mark.parametrize("beyond", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_first_sample_is_right_wherever_the_rotor_lies(tmp_path, beyond, side):
    """On a stop the noise shows it beyond in every other sample."""
    made = export("linear", tmp_path / "c", prefix="f")
    flies, noise, travel = compiled(made, tmp_path), 9.1e-6, BEARING.clearance
    flies.step(side * (travel + beyond * noise), 0.0)
    x = flies.estimates[0]
    assert x == pytest.approx(side * travel, abs=3.1 * noise)
    assert abs(x) <= travel + 3 * noise


def test_deviations_are_those_of_python(tmp_path):
    flies = compiled(export("extended", tmp_path / "c", prefix="f"), tmp_path)
    record = ambkit.simulate(BEARING, ambkit.Scenario(duration=0.02, seed=1)).record
    along(flies, record)
    kf = ambkit.ExtendedKalmanFilter(BEARING, precision="float32")
    kf.run(record)
    expected = np.sqrt(np.diag(kf.covariance))
    np.testing.assert_allclose(flies.deviations(), expected, rtol=1e-6)
