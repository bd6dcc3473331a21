"""An unstable loop is drawn and told: Nyquist, loop gain and poles, and what grows."""

import math

import numpy as np
import pytest
from machine_cases import machine

from ambkit import Machine, assess
from ambkit.assessment.assess import MEASUREMENT
from ambkit.control.pid import PID

PLANTS = {
    "axis": lambda: assess(Machine.preset("zittau_axial"), "linear", SHAKY),
    "machine": lambda: assess(machine(), "linear", SHAKY),
}
SHAKY = PID(kp=25e3, ki=0.0, kd=0.5)


@pytest.fixture(scope="module", params=PLANTS)
def found(request):
    return PLANTS[request.param]()


def test_growth_and_frequency_are_those_of_the_loop(found):
    """Followed in time: after the time to double the slowest of all has doubled."""
    for each in found.loops.values():
        assert not each.stable
        pole = each.unstable_poles[0]
        assert pole.frequency > 1.0
        A, T = each.loop.closed.A, each.loop.T
        state = np.linalg.matrix_power(A, 2**14)
        state = state / np.linalg.norm(state)
        steps = round(20 * pole.doubling / T)
        grown = np.linalg.norm(np.linalg.matrix_power(A, steps) @ state)
        swings = 2.0 ** (steps * T / pole.doubling)
        assert grown == pytest.approx(swings, rel=0.7)  # where in its swing it is read
        many = 10 * steps
        more = np.linalg.norm(np.linalg.matrix_power(A, many) @ state)
        assert math.log(more) == pytest.approx(many * T * pole.growth, rel=0.02)


def test_it_is_drawn(found):
    figure = found.figure(MEASUREMENT)
    assert [panel.title for panel in figure.panels] == [
        "Open loop", "Poles of the closed loop", "Loop gain", "Phase",
    ]  # fmt: skip
    assert figure.image(".png")[:4] == b"\x89PNG"
    pole = found.loops[MEASUREMENT].unstable_poles[0]
    (named,) = (item.text for item in figure.panels[2].items if getattr(item, "text", ""))
    assert named == f"{pole.frequency:.4g} Hz, {pole.growth:+.3g}/s"
    assert f"{pole.frequency:.4g} Hz grows by {pole.growth:.3g}/s" in figure.caption


def test_it_is_reported_and_written(found, tmp_path):
    pole = found.to_dict()["loops"][MEASUREMENT]["unstable_poles"]["1"]
    assert pole["time_to_double"] == pytest.approx(math.log(2) / pole["growth"])
    assert found.rows[0].kept is False
    assert any(row.name == "doubling time" for row in found.rows)
    found.page(tmp_path / "v.html")
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    assert "Not kept: zone overall" in page


def test_the_command_prints_it(call, tmp_path):
    soft = tmp_path / "shaky.toml"
    soft.write_text('[controller]\nkp = "25000 A/m"\nki = "0 A/(m s)"\nkd = "0.5 A s/m"\n')
    asked = ["assess", "zittau_axial", "--filter", "none", "--controller", str(soft)]
    told = call(*asked, "--plot", str(tmp_path / "p.png"))
    assert told.code == 0, told.err
    assert "Unstable poles of the closed loop" in told.out
    assert "doubling time" in told.out
    assert (tmp_path / "p.png").exists()
