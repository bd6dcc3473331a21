"""Unbalance control takes no rotor into its touch-down bearings where plain control does not."""

import functools
import math
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit import KalmanFilter, Machine
from ambkit.assessment.loop import assessed
from ambkit.assessment.rows import of_loop
from ambkit.control.control import Control
from ambkit.control.controllers import controllers_of
from ambkit.control.stabilising_controller import holding
from ambkit.control.synchronous_compensation import _Rotor
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.models.plant import Plant
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Constant, Ramp, Sum

OVERHUNG = Path(__file__).parent / "data" / "overhung.toml"
"""An overhung compressor of 50,000 rpm with a forward critical speed of the free rotor near it."""
PRESETS = ("ufu_flexible", "tum_mlps_flexible", "compressor")
RPM = math.pi / 30


def random_rotor(seed):
    """Return a rotor like the overhung one, of other sizes, places and damping; it can be held."""
    rng = np.random.default_rng(seed)
    base = Machine.load(OVERHUNG)
    while True:
        long, thick = rng.uniform(0.8, 1.4), rng.uniform(0.7, 1.2)
        rotor = base.rotor.model_dump(mode="json")
        for each in rotor["section"]:
            each["length"] *= long
            each["outer_diameter"] *= thick * rng.uniform(0.9, 1.1)
        for each in rotor["disc"]:
            each["place"] *= long
            heavy = rng.uniform(0.5, 2.0)
            for key in ("mass", "transverse_inertia", "polar_inertia"):
                each[key] *= heavy
        rotor["damping_ratio"] = float(np.exp(rng.uniform(np.log(0.001), np.log(0.02))))
        placed = {
            key: [each.model_copy(update={"place": each.place * long}) for each in parts]
            for key, parts in (
                ("bearing", base.bearings), ("sensor", base.sensors), ("unbalance", base.unbalance),
            )
        }  # fmt: skip
        try:
            machine = base.replace(name=f"rotor_{seed}", rotor=rotor, speed=20000 * RPM, **placed)
            first = float(machine.bending.frequency[0])
            machine = machine.replace(speed=min(first, 65000 * RPM))
        except (ambkit.AmbkitError, AttributeError, IndexError):
            continue
        if holding(machine, "estimate").held and first < 65000 * RPM:
            return machine


@functools.lru_cache
def machine_of(name):
    if name == "overhung":
        return Machine.load(OVERHUNG)
    return random_rotor(name) if isinstance(name, int) else Machine.preset(name)


@functools.lru_cache
def criticals(name):
    """Return the speeds at which the free rotor and the one held still move most [rad/s]."""
    machine = machine_of(name)
    filter = KalmanFilter(machine, synchronous=["unbalance"])
    rotor = _Rotor(Plant(machine), filter)
    sizes = np.ones(rotor.push.shape[1])
    speeds = float(machine.bending.frequency[0]) * np.linspace(0.4, 1.4, 400)
    found = {}
    for kind in ("force-free", "compensation"):
        far = [rotor.orbits(rotor.left(w, kind)[0], sizes)[1] for w in speeds]
        found[kind] = float(speeds[np.argmax(far)])
    return found


def drawn(run, machines):
    """Return a machine as described, as it is, and a ramp or a stay near a critical speed."""
    rng = np.random.default_rng([run, 7])
    name = machines[run % len(machines)]
    machine, kind = machine_of(name), rng.choice(["force-free", "force-free", "compensation"])
    peak, T = criticals(name)[kind], 0.2
    if rng.random() < 0.3:
        top = peak * rng.uniform(0.85, 1.15)
        speed = Constant(value=top)
    else:
        slope = RPM * float(np.exp(rng.uniform(np.log(5e3), np.log(1e5))))
        low = max(peak - slope * T * rng.uniform(0.2, 0.9), 300 * RPM)
        speed = Sum(parts=(Constant(value=low), Ramp(slope=slope, end=0.8 * T)))
        top = low + 0.8 * T * slope
    top = min(top, 0.9 * math.pi / machine.sampling_time)
    factor = float(np.exp(rng.uniform(np.log(0.2), np.log(5.0))))
    described = machine.replace(speed=top)
    planes = [
        {"place": z, "amount": factor * amount, "angle": rng.uniform(0, 2 * math.pi)}
        for z, amount, _ in machine.unbalances()
    ]
    control = Control(
        type=str(rng.choice(["decentralised", "translation and tilt", "lqg"], p=[0.6, 0.2, 0.2])),
        unbalance=str(kind),
    )
    flight = Scenario(duration=T, controller=control, speed=speed, seed=run).fed("estimate")
    return described, described.replace(unbalance=planes), flight


def touched(described, real, flight):
    """Return in how many samples a touch-down bearing is touched."""
    filter = KalmanFilter(described, synchronous=["unbalance"])
    T = described.sampling_time
    fastest = float(np.abs(flight.speed.sample(T * np.arange(round(flight.duration / T)))).max())
    control = controllers_of(Plant(described), flight.controller, filter, fastest=fastest)
    run = simulate_run(real, flight, estimator=filter, controllers=control)
    return run.samples_at_the_stop


def stable(described, flight):
    """Return whether the loop is stable at the fastest speed of a flight."""
    filter = KalmanFilter(described, synchronous=["unbalance"])
    loop = LoopBuilder(described, flight.controller).loop(filter)
    return bool(np.abs(loop.closed.poles()).max() < 1)


def worse(run, machines):
    """Return whether a touch-down bearing is touched, and not under plain control, which is stable.

    An unstable loop loses the rotor with any control, sooner or later: when is chance.
    """
    described, real, flight = drawn(run, machines)
    if not touched(described, real, flight):
        return False
    plain = flight.replace(controller=flight.controller.model_copy(update={"unbalance": "off"}))
    return stable(described, plain) and not touched(described, real, plain)


MACHINES = (*PRESETS, "overhung", *range(20))


@pytest.mark.parametrize("runs", [
    pytest.param(range(len(MACHINES)), marks=pytest.mark.long, id="one of each machine"),
    *(pytest.param(range(first, first + 100), marks=pytest.mark.study, id=f"from {first}")
      for first in range(0, 1000, 100)),
])  # fmt: skip
def test_no_contact_where_plain_control_has_none(runs):
    """Ramps and stays near critical speeds, with 0.2 to 5 times the unbalance that is described."""
    assert not [run for run in runs if worse(run, MACHINES)]


@pytest.mark.parametrize("larger", [1.0, 3.0])
def test_near_a_free_critical_speed_the_rotor_is_held(larger):
    """From 4 times the unbalance on plain control touches too, with a start at this speed."""
    machine = machine_of("overhung").replace(speed="49000 rpm")
    planes = [{"place": z, "amount": larger * u, "angle": a} for z, u, a in machine.unbalances()]
    flight = Scenario(
        duration=0.15, speed=Constant(value=machine.speed),
        controller=Control(cross_feedback=0.3, unbalance="force-free"),
    ).fed("estimate")  # fmt: skip
    assert touched(machine, machine.replace(unbalance=planes), flight) == 0


def test_a_rigid_rotor_that_is_held_still_touches_nothing():
    """Run up to 20,700 rpm with 3.5 times the preset's unbalance; plain control does as well."""
    described = Machine.preset("ufu_rig").replace(
        speed="20700 rpm", unbalance=[{"place": 0.026, "amount": 6.7e-5}]
    )
    real = described.replace(unbalance=[{"place": 0.026, "amount": 7e-5, "angle": 3.9}])
    slope = 45900 * RPM
    low = described.speed - 0.24 * slope
    flight = Scenario(
        duration=0.3, seed=26,
        controller=Control(type="decentralised", unbalance="compensation"),
        speed=Sum(parts=(Constant(value=low), Ramp(slope=slope, end=0.24))),
    ).fed("estimate")  # fmt: skip
    plain = flight.replace(controller=Control(type="decentralised"))
    assert [touched(described, real, each) for each in (plain, flight)] == [0, 0]


@pytest.mark.long
def test_assess_judges_the_orbit_together_with_the_peak():
    """Of an unbalance 18 times as large, near a critical speed: it needs five times the current."""
    machine = machine_of("overhung").replace(speed="49000 rpm")
    planes = [{"place": z, "amount": 18 * u, "angle": a} for z, u, a in machine.unbalances()]
    machine = machine.replace(unbalance=planes)
    filter = KalmanFilter(machine, synchronous=["unbalance"])
    of = LoopBuilder(machine, Control(cross_feedback=0.3, unbalance="force-free"))
    loop = assessed(filter.name, of.loop(filter), of)
    assert loop.zone == "A"
    assert loop.demands.zone in "BC"
    assert loop.verdict == "D"
    verdict = of_loop(loop)[0]
    assert (verdict.value, verdict.kept) == (loop.verdict, False)
    assert "plain control at 49000 rpm" in of.plain(filter)


def test_assess_knows_the_limit_of_a_large_unbalance():
    machine = machine_of("overhung").replace(speed="30000 rpm")
    orbits = []
    for factor in (1.0, 500.0):
        planes = [{"place": z, "amount": factor * u} for z, u, _ in machine.unbalances()]
        one = machine.replace(unbalance=planes)
        filter = KalmanFilter(one, synchronous=["unbalance"])
        for unbalance in ("off", "force-free"):
            of = LoopBuilder(one, Control(unbalance=unbalance))
            (response,) = of.harmonic_responses(of.loop(filter))
            orbits.append(np.abs(response.i).max() / factor)
    plain, free, same, limited = orbits
    assert free < 0.2 * plain
    assert same == pytest.approx(plain, rel=1e-6)
    assert limited == pytest.approx(plain, rel=1e-6)
