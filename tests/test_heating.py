"""How warm coils become: against the equation integrated in time, and what is said of it."""

import math

import numpy as np
import pytest
from machine_cases import UFU
from scipy.integrate import solve_ivp

import ambkit
from ambkit.base.errors import AmbkitError
from ambkit.judge.loop.capacity import heating

COIL = {"thermal_resistance": "2 K/W", "time_constant": "20 min", "ambient": "313.15 K",
        "temperature_limit": "403.15 K"}  # fmt: skip
WARM = ambkit.preset("zittau_axial").replace(amplifier__resistance="4 ohm", coil=COIL)
MACHINE = UFU.model_copy(update={"bearing": tuple(
    at.model_copy(update={
        "amplifier": at.amplifier.model_copy(update={"resistance": 2.0}), "coil": WARM.coil,
    })
    for at in UFU.bearings
)})  # fmt: skip


def integrated(bearing, square, start, t):
    """The temperature of a coil over time [K], by its own equation."""
    coil, R = bearing.coil, bearing.amplifier.resistance

    def rate(_t, at):
        loss = R * square * (1 + coil.temperature_coefficient * (at - 293.15))
        return (coil.ambient - at + coil.thermal_resistance * loss) / coil.time_constant

    return solve_ivp(rate, (0, t[-1]), [start], t_eval=t, rtol=1e-10, atol=1e-9).y[0]


def test_a_coil_comes_to_rest_where_its_equation_does():
    found = heating(WARM, [2.0, 5.0])
    ends = [integrated(WARM, square, 313.15, np.array([0, 1e5]))[-1] for square in (2.0, 5.0)]
    assert found.temperature == pytest.approx(ends[1], rel=1e-8)
    losses = [4 * I2 * (1 + 3.93e-3 * (at - 293.15)) for I2, at in zip((2, 5), ends, strict=True)]
    assert found.loss == pytest.approx(sum(losses), rel=1e-8)
    # By iteration, as it is done by hand.
    at = 313.15
    for _ in range(200):
        at = 313.15 + 2 * 4 * 5 * (1 + 3.93e-3 * (at - 293.15))
    assert found.temperature == pytest.approx(at, rel=1e-9)


def test_the_time_until_the_limit_is_the_equations():
    found = heating(WARM, [2.0, 3.0])
    magnet = WARM.magnet
    most = (magnet.bias_current + WARM.current_max) ** 2
    t = np.linspace(0, found.until_limit, 50)
    assert integrated(WARM, most, found.temperature, t)[-1] == pytest.approx(403.15, abs=1e-3)
    cool = WARM.replace(coil__thermal_resistance="0.01 K/W")
    assert heating(cool, [2.0]).until_limit == math.inf
    assert heating(WARM, [20.0]).until_limit == 0
    assert heating(WARM.replace(coil__time_constant=None), [2.0]).until_limit is None
    # Where the resistance does not grow, and where it runs away.
    for coefficient, R_th in (("0 1/K", "3 K/W"), ("4e-3 1/K", "15 K/W")):
        other = WARM.replace(coil__temperature_coefficient=coefficient,
                             coil__thermal_resistance=R_th)  # fmt: skip
        told = heating(other, [0.5])
        t = np.linspace(0, told.until_limit, 50)
        assert integrated(other, most, told.temperature, t)[-1] == pytest.approx(403.15, abs=1e-3)


def test_a_coil_runs_away_where_its_loss_grows_faster_than_it_is_cooled():
    square = 1 / (2 * 4 * 3.93e-3)
    assert math.isfinite(heating(WARM, [0.999 * square]).temperature)
    found = heating(WARM, [1.001 * square])
    assert found.temperature == math.inf
    assert found.loss == math.inf
    hot = integrated(WARM, 1.001 * square, 313.15, np.array([0, 4e5, 8e5]))
    assert hot[2] - hot[1] > 1.2 * (hot[1] - hot[0])


def test_the_verdict_says_how_warm_coils_are():
    found = ambkit.assess(WARM, "linear")
    d = found.loops["linear"].demands
    squares = [(WARM.magnet.bias_current + side * found.point.iu) ** 2 for side in (1, -1)]
    assert d.heating.temperature == pytest.approx(heating(WARM, squares).temperature, rel=1e-3)
    rows = {row.key: row for row in found.rows if row.of == "linear"}
    assert rows["coil_temperature"].text() == f"{d.heating.temperature - 273.15:.1f} °C"
    assert rows["coil_temperature"].limit() == "below 130.0 °C"
    assert rows["coil_temperature"].kept
    assert rows["time_to_coil_temperature_limit"].value == d.heating.until_limit
    away = ambkit.assess(WARM.replace(coil__thermal_resistance="60 K/W"), "none")
    hot = next(row for row in away.rows if row.key == "coil_temperature")
    assert hot.text() == "runs away"
    assert hot.kept is False
    unknown = ambkit.assess(ambkit.preset("zittau_axial"), "none")
    (lacking,) = (note for note in unknown.notes if "not known" in note)
    assert lacking.endswith("the amplifier's resistance, and [coil] with thermal_resistance and "
                            "temperature_limit.")  # fmt: skip
    uncooled = ambkit.assess(WARM.replace(coil=None), "none")
    assert any(note.endswith("they need [coil] with thermal_resistance and temperature_limit.")
               for note in uncooled.notes)  # fmt: skip


def test_a_run_up_warms_the_coils_of_a_machine():
    over = ambkit.assess_speed(MACHINE, "none", fastest="9000 rpm", count=3)
    assert over.temperature.shape == (3, 4)
    own = ambkit.assess(MACHINE.model_copy(update={"speed": 0.0, "unbalance": ()}), "none")
    at_rest = [at.demands.heating.temperature for at in own.loops["measurement"].axes.values()]
    assert over.temperature[0] == pytest.approx(at_rest, rel=1e-6)
    assert (over.temperature[2] > over.temperature[0]).all()
    assert over.temperature_limit == 403.15
    assert len(over.figures()[1].panels) == 3
    assert ambkit.assess_speed(UFU, "none", fastest="9000 rpm", count=2).temperature is None
    same = ambkit.Machine.from_toml(MACHINE.to_toml())
    assert same.bearings[0].coil == WARM.coil
    assert same.isolated_axis("A1").coil == WARM.coil


@pytest.mark.parametrize(("changes", "message"), [
    ({"coil__temperature_limit": "300 K"}, "must be greater than 313.15 K, what cools it"),
    ({"amplifier__resistance": None}, "with it a coil warms by its current"),
])  # fmt: skip
def test_what_contradicts_itself_is_refused(changes, message):
    with pytest.raises(AmbkitError, match=message):
        WARM.replace(**changes)
