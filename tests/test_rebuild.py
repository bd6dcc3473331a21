"""A model that C makes anew from physical parameters has the bits of one composed by Python."""

import math

import numpy as np
import pytest

import ambkit
from ambkit.estimate.core_model import numbers
from ambkit.estimate.rebuild import Formulas, Rebuild, with_parameters
from ambkit.machine.magnets import core_module
from ambkit.models.machine_parts import compose, machine_parts

PRESETS = [
    "zittau_axial", "inteco_ml", "tum_mlps", "heart_pump", "ufu_rig", "tum_mlps_flexible",
]  # fmt: skip


def anywhere(rng, new):
    """Change a parameter to anywhere within its limits; note it."""

    def change(name, value, low, high):
        away = rng.uniform(low, high) if low < 0 < high else value * 10 ** rng.uniform(-1, 1)
        new[name] = min(max(away, low), high)
        return new[name]

    return change


def composed(machine, **options):
    model = compose(machine_parts(machine, **options), machine.sampling_time)
    return numbers(model)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("delay", [None, 0.4, 2.0])
def test_other_parameters_give_the_bits_of_another_machine(preset, delay):
    machine = ambkit.preset(preset)
    if delay is not None:
        machine = machine.model_copy(update={"delay": delay * machine.sampling_time})
    turns = machine.rotor.type != "mass"
    options = {"synchronous": ("unbalance", "runout")} if turns and delay is None else {}
    of, rng = Rebuild.of(machine, **options), np.random.default_rng(3)
    np.testing.assert_array_equal(of.numbers(core_module(), {}), composed(machine, **options))
    for _ in range(2):
        new = {}
        other = with_parameters(machine, anywhere(rng, new))
        assert tuple(new) == of.names
        right = composed(other, **options)
        np.testing.assert_array_equal(of.numbers(core_module(), new), right)
        single = of.numbers(core_module("float32"), new)
        np.testing.assert_array_equal(single, right.astype("float32"))


@pytest.mark.parametrize("preset", PRESETS)
def test_each_parameter_moves_the_model(preset):
    machine = ambkit.preset(preset)
    of = Rebuild.of(machine)
    before = of.numbers(core_module(), {})
    for name, value in zip(of.names, of.values, strict=True):
        moved = of.numbers(core_module(), {name: value * 1.01 if value else 10.0})
        assert (moved != before).any(), name


def test_what_would_be_another_kind_is_refused():
    of = Rebuild.of(ambkit.preset("zittau_axial"))
    assert of.names == ("mass", "gain", "lag")
    for name, value in (("mass", -1.0), ("lag", 0.0), ("gain", math.nan), ("mass", math.inf)):
        with pytest.raises(ValueError, match="a parameter is beyond its limits"):
            of.numbers(core_module(), {name: value})


def test_a_recorded_number_is_the_number():
    formulas = Formulas()
    a, b = formulas.parameter("a", 3.0, 0, 9), formulas.parameter("b", 7.0, 0, 9)
    made = [a + b, 1 + a, a - b, 1 - a, a * b, 2 * a, a / b, 1 / a, -a, a**2, 2.0 * b, b + 0.5]
    assert made == [10, 4, -4, -2, 21, 6, 3 / 7, 1 / 3, -3, 9, 14, 7.5]
    assert formulas.slot(2 * b) == formulas.slot(2.0 * b) == made[10].slot
    with pytest.raises(TypeError):
        a**3
