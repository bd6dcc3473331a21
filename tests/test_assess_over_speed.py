"""A machine's loop over its speed of rotation."""

import math

import numpy as np
import pytest
from machine_cases import made

import ambkit
from ambkit import Machine
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.judge.loop.loop_of import LoopOf

RPM = math.pi / 30
UFU = Machine.preset("ufu_rig")


# ---- over speed


@pytest.mark.long
def test_over_speed_goes_through_the_machines_own():
    own = UFU.model_copy(update={"speed": 600.0})
    over = ambkit.assess_speed(own, "linear", fastest=1200.0, count=3)
    found = ambkit.assess(own, "linear").loops["linear"]
    assert over.speed == pytest.approx([0.0, 600.0, 1200.0])
    assert over.peaks[1] == pytest.approx([at.peak for at in found.axes.values()], rel=1e-6)
    assert over.largest[1] == pytest.approx(found.largest[0], rel=1e-6)
    assert over.orbit[1] == pytest.approx(
        [at.demands.displacement for at in found.axes.values()], rel=1e-6
    )
    assert over.current[1] == pytest.approx(
        [at.demands.current for at in found.axes.values()], rel=1e-6
    )
    assert set(over.integrals) == {0.0, 600.0, 1200.0}
    assert all(each.holds for each in over.integrals.values())
    assert over.voltage is None
    assert len(over.figure().panels) == 3
    assert len(over.figures()[1].panels) == 2


def test_a_filter_over_speed_is_told_the_speed():
    fast = UFU.model_copy(update={"speed": 3000.0})
    still = UFU.model_copy(update={"speed": 0.0})
    point = OperatingPoint.of_machine(still)
    for name in ("linear", "linear-adaptive-noise"):
        _, told = LoopOf(still).at_speed(3000.0, made(name, still))
        expected = made(name, fast)
        a, b = (estimator_at(each, point) for each in (told, expected))
        np.testing.assert_allclose(a.A, b.A, rtol=1e-9, atol=1e-12)
        assert not np.allclose(a.A, estimator_at(made(name, still), point).A, rtol=1e-6)


@pytest.mark.parametrize(("options", "message"), [
    ({"fastest": -1.0}, "greater than 0 rad/s"),
    ({"fastest": 1e5}, "half a revolution within a sample"),
    ({"count": 1}, "count must be 2"),
    ({"filter": ["linear", "extended"]}, "give one filter, not 2"),
    ({"filter": "observer"}, "takes one axis"),
    ({"disturbance": {"Z": 3.0}}, "no axis Z"),
    ({"disturbance": {"A1": 1e6}}, "holds the rotor"),
])  # fmt: skip
def test_refusals(options, message):
    with pytest.raises(AmbkitError, match=message):
        ambkit.assess_speed(UFU, **options)
