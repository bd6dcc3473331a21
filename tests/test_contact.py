"""A rotor on its touch-down bearings: the filter that knows them, by a textbook and the truth."""

import numpy as np
import pytest
from export_cases import Filters, printed_by
from filter_cases import full
from oracles import magnet_force
from scipy.stats import chi2

import ambkit
from ambkit import FilterNoise, Machine, Scenario, Status
from ambkit.estimate.registry import KINDS
from ambkit.export.c import export_c
from ambkit.machine.accessories import Stop
from ambkit.machine.magnets import magnet_of
from ambkit.simulation.run import simulate_run

SENSOR = {"sensor__noise_variance": "33.6 um^2"}  # 5.8 um
AXIS = Machine.preset("zittau_axial").replace(
    **SENSOR, stop={"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"}
)
INTENSITY = 1500.0  # presses the rotor on a stop a third of the time [N^2/s]
NOISE = FilterNoise(disturbance=INTENSITY)
SETTLED = 200  # samples


def pressed(machine, seed, duration=0.5):
    """A run under a random walk of the disturbance force, as the filters assume."""
    T = machine.sampling_time
    n = round(duration / T) + 1
    steps = np.random.default_rng(1000 + seed).normal(0, np.sqrt(INTENSITY * T), n)
    load = ambkit.Recorded.of(T * np.arange(n), np.cumsum(steps))
    return ambkit.simulate(machine, Scenario(duration=duration, seed=seed, disturbance=load)).record


def stop_force(machine, record):
    """Return how deep the rotor is in a stop [m], and the force of that [N], of the truth."""
    side = np.sign(record["x"])
    depth = np.maximum(side * record["x"] - machine.clearance, 0)
    give = np.maximum(1 + 1.5 * machine.stop.damping * side * record["v"], 0)
    return depth, machine.stop.stiffness * depth**1.5 * give


def in_contact(estimate):
    return (np.asarray(estimate.status) & int(Status.CONTACT)) != 0


# ---- The equations


def textbook(kf, record):
    """Run an extended Kalman filter with a spring beyond the clearance, by full matrices."""
    machine, model, s = kf.machine, kf.model, kf.core.parameters["set"]
    T, m, stop = machine.sampling_time, machine.rotor.mass, machine.stop
    growth = sum(N * var for N, var in zip(model.N, s["var_d"], strict=True))
    X, P, means, b = kf.core.mean.copy(), kf.core.covariance.copy(), [], model.b[:, 0]
    for k, (y, u) in enumerate(zip(record["y"], np.r_[0, record["u"]], strict=False)):
        if k:
            iu = np.clip(s["k_ui"][0] * u, s["iu_min"][0], s["iu_max"][0])
            displaced = X[0] + T / 2 * X[1]
            there = np.clip(displaced, -machine.clearance, machine.clearance)  # straight beyond
            k_i, k_s = (float(value) for value in magnet_of(machine).tangent(iu, there))
            force = magnet_force(machine, iu, there) + k_s * (displaced - there)
            force += s["f_0"][0] + X[2]
            side, depth = np.sign(displaced), abs(displaced) - machine.clearance
            w, N = np.array([k_s, k_s * T / 2, 1.0, 0.0]), 0.0
            if depth > 0:
                limit = (m / T**2 / (1.5 * stop.stiffness)) ** 2
                curved = min(depth, limit)
                elastic = stop.stiffness * curved**1.5 + m / T**2 * (depth - curved)
                c = min(1.5 * stop.damping * elastic, m / T)
                N = max(elastic + c * side * X[1], 0.0)
            if N > 0:
                stiffness = 1.5 * stop.stiffness * curved**0.5
                w -= [stiffness, stiffness * T / 2 + c, 0.0, 0.0]
            A = model.L + np.outer(b, w)
            Q = (k_i * s["k_ui"][0]) ** 2 * s["var_u"][0] + (0.3 * N) ** 2
            X = model.L @ X + b * (force - side * N)
            P = A @ P @ A.T + growth + Q * np.outer(b, b)
        c_y = model.c[0]
        S = c_y @ P @ c_y + s["var_y"][0]
        X = X + P @ c_y / S * (y - c_y @ X)
        P = P - np.outer(P @ c_y, c_y @ P) / S
        means.append(X)
    return np.array(means), P


@pytest.mark.parametrize(("stiffness", "damping"), [(1e8, 0.3), (3e12, 50.0)])
def test_it_is_the_textbook_s_filter_with_a_spring(stiffness, damping):
    """Also of a stop that is stiffer than a sample resolves."""
    machine = AXIS.replace(stop={"stiffness": stiffness, "damping": damping})
    record = pressed(machine, 2, 0.2)
    kf = ambkit.ContactKalmanFilter(machine, noise=NOISE, frozen_limit=0, gate=1e6)
    kf.reset(kf.equilibrium_state(record["y"][0], record["y"][0]))
    means, P = textbook(kf, record)
    history = kf.core.run(record["y"], record["u"], covariance=True)
    assert (history["status"] & int(Status.CONTACT)).any()
    unused = Status.MISSING | Status.OUTLIER | Status.FROZEN | Status.RESTARTED
    assert not (history["status"] & int(unused)).any()
    size = np.abs(means).max(axis=0)
    np.testing.assert_allclose(history["mean"] / size, means / size, atol=1e-8)
    std = np.sqrt(np.diag(P))
    ours = full(history["covariance"][-1:])[0] / np.outer(std, std)
    np.testing.assert_allclose(ours, P / np.outer(std, std), atol=1e-8)


def ring_of_two(machine):
    """A filter of a machine whose rotor is pressed into a ring, askew, at its mean."""
    kf = ambkit.ContactKalmanFilter(machine)
    place, _ = kf.view.along_axes(kf.states)
    askew = np.zeros(len(machine.axes))
    askew[:2] = 1.001 * machine.bearings[0].clearance * np.array([0.6, -0.8])
    mean = np.linalg.pinv(place) @ askew
    mean[[state.role == "velocity" for state in kf.states]] = 0.003
    return kf, mean


def stopped(name, stiffness=1e9, **changes):
    """A machine whose every bearing has a stop."""
    machine, stop = Machine.preset(name), Stop(stiffness=stiffness, damping=0.3)
    bearings = tuple(b.model_copy(update={"stop": stop}) for b in machine.bearings)
    return machine.model_copy(update={"bearings": bearings} | changes)


@pytest.mark.parametrize("name", ["ufu_rig", "tum_mlps"])
def test_in_a_ring_the_covariance_goes_by_the_derivatives_of_the_mean(name):
    kf, mean = ring_of_two(stopped(name, speed=200.0))
    free = ambkit.ExtendedKalmanFilter(Machine.preset(name).model_copy(update={"speed": 200.0}))
    u = np.zeros(len(kf.machine.axes))
    size = np.array([state.size for state in kf.states])

    def ahead(filter, at):
        filter.core.reset(at, 1e-3 * size)
        filter.core.predict(u)
        return filter.core.mean.copy()

    def moved(filter):
        """Return A P A' of P = diag(size^2), by derivatives, in units of the sizes."""
        steps = 1e-6 * np.diag(size)
        A = np.array([ahead(filter, mean + step) - ahead(filter, mean - step) for step in steps])
        A = A.T / 2e-6 / size[:, None]
        return A @ A.T

    def predicted(filter, std):
        filter.core.reset(mean, std)
        assert filter.core.predict(u) == (Status.CONTACT if filter is kf else Status.OK)
        return filter.core.covariance / np.outer(size, size)

    forces = kf.core.contact_forces(np.array([mean]))[0]
    assert forces[:2] @ [0.6, -0.8] < 0
    assert not forces[2:].any()
    # What does not follow from P, growth and scatter, is the same of any P.
    small = 1e-3
    ours = (predicted(kf, 2 * small * size) - predicted(kf, small * size)) / (3 * small**2)
    stiffened = np.abs(moved(kf) - moved(free)).max()
    assert stiffened > 0.03
    np.testing.assert_allclose(ours, moved(kf), rtol=0, atol=0.01 * stiffened)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_free_rotor_s_filter_is_the_extended_one_to_the_bit(precision):
    machine = AXIS.replace(stop=None)
    record = pressed(machine, 2, 0.1)
    histories = []
    for kind in ("contact", "extended"):
        kf = KINDS[kind].make(machine, noise=NOISE, precision=precision)
        y, u = (record[name].astype(precision) for name in ("y", "u"))
        histories.append(kf.core.run(y, u, covariance=True))
    assert all((histories[0][name] == histories[1][name]).all() for name in histories[1])


# ---- Truth


def episodes(mask):
    """Return where true stretches begin and end."""
    edges = np.flatnonzero(np.diff(np.r_[0, mask.astype(int), 0]))
    return zip(edges[::2], edges[1::2], strict=True)


def judged(machine, seeds):
    """Return errors [m], [N], shares of consistent samples, and delays [s], over touchdown runs."""
    T, noise = machine.sampling_time, NOISE
    kinds = {name: KINDS[name].make(machine, noise=noise) for name in ("contact", "extended")}
    kinds["constant-velocity"] = KINDS["constant-velocity"].make(machine)
    found = {name: [] for name in ("raw", *kinds, "forces", "of", "nees", "told", "released")}
    of_states = ["x", "v", "f_d"]
    for seed in seeds:
        record = pressed(machine, seed)
        depth, force = stop_force(machine, record)
        touching = (depth > 0) & (np.arange(depth.size) >= SETTLED)
        found["raw"].append(np.mean((record["y"] - record["x"])[SETTLED:] ** 2))
        for name, kf in kinds.items():
            estimate = kf.run(record)
            found[name].append(np.mean((estimate["x"] - record["x"])[SETTLED:] ** 2))
            if name == "contact":
                mean_force = (force + np.r_[force[1:], force[-1]]) / 2  # over the sample
                along = np.sign(record["x"]) * kf.contact_forces(estimate)[:, 0]
                found["forces"].append((along + mean_force)[touching])
                found["of"].append(mean_force[touching])
                flagged = in_contact(estimate)
                for start, end in episodes(touching):
                    if end - start >= 1e-3 / T:
                        found["told"].append(np.argmax(flagged[start:]) * T)
                    if end < depth.size - 50 and not (depth[end : end + 20] > 0).any():
                        found["released"].append(np.argmin(flagged[end:]) * T)
                kf.reset(kf.equilibrium_state(record["y"][0], record["y"][0]))
                history = kf.core.run(record["y"], record["u"], covariance=True)
                at = [kf.model.index(state) for state in of_states]
                P = full(history["covariance"])[:, at][:, :, at]
                error = history["mean"][:, at] - np.column_stack([record[k] for k in of_states])
                std = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
                scaled = np.linalg.solve(
                    P / std[:, :, None] / std[:, None], (error / std)[..., None]
                )
                nees = (error / std * scaled[..., 0]).sum(axis=1)[SETTLED:]
                found["nees"].append(np.mean(nees < chi2.ppf(0.95, 3)))
    return {name: np.concatenate(v) if name in ("forces", "of") else np.array(v)
            for name, v in found.items()}  # fmt: skip


STOPS = {
    "5.8 um, soft": (AXIS, 0.10),
    "1 um": (
        AXIS.replace(
            sensor__noise_variance="1 um^2", sensor__lag="20 us",
            stop={"stiffness": "1e9 N/m^1.5", "damping": "0.3 s/m"},
        ), 0.10,
    ),
    "3 um, 20 kHz": (
        AXIS.replace(
            sampling_time="50 us", sensor__noise_variance="9 um^2", sensor__lag="50 us",
            stop={"stiffness": "1e9 N/m^1.5", "damping": "0.3 s/m"},
        ), 0.10,
    ),
    "5.8 um, stiff": (AXIS.replace(stop={"stiffness": "3e9 N/m^1.5", "damping": "0.3 s/m"}), 0.35),
}  # fmt: skip
"""Machines, and how far off the contact force may be [1]: by a stiff stop a sensor tells less."""


@pytest.mark.parametrize(
    ("name", "runs"),
    [("1 um", 5), *(pytest.param(name, 100, marks=pytest.mark.long) for name in STOPS)],
)
def test_on_touchdowns_it_is_as_good_as_it_says_and_better_than_its_sensor(name, runs):
    machine, share = STOPS[name]
    found = judged(machine, range(runs))
    rms = {kind: 1e6 * np.sqrt(np.mean(found[kind]))
           for kind in ("raw", "contact", "extended", "constant-velocity")}  # fmt: skip
    off = np.sqrt(np.mean(found["forces"] ** 2) / np.mean(found["of"] ** 2))
    assert (found["contact"] < found["raw"]).all()
    assert rms["contact"] < 0.65 * min(rms["raw"], rms["constant-velocity"])
    assert rms["extended"] > rms["raw"]
    assert 0.93 <= np.mean(found["nees"]) <= 0.97
    assert off < share
    assert np.mean(found["told"] <= 1e-3) > 0.99
    assert np.mean(found["released"] <= 2e-3) > 0.99
    assert found["told"].size > 4 * runs / 2


@pytest.mark.parametrize("name", ["tum_mlps", "ufu_rig"])
def test_a_spinning_rotor_that_drops_is_levitated_again(name):
    """By the estimate: from its touch-down bearings up, in contact first."""
    machine = stopped(name, speed=200.0)
    kf = KINDS["contact"].make(machine)
    scenario = Scenario(duration=0.4, start="landed", feedback="estimate", seed=1)
    run = simulate_run(machine, scenario, estimator=kf)
    record, estimate = run.record, run.estimate
    place, _ = kf.view.along_axes(kf.states)
    means = np.column_stack([estimate[state.name] for state in kf.states])
    error = means @ place.T - np.column_stack([record[f"s_{axis.name}"] for axis in machine.axes])
    assert in_contact(estimate)[:20].any()
    assert not in_contact(estimate)[-200:].any()
    assert np.sqrt(np.mean(error[SETTLED:] ** 2)) < 1e-6
    dropped = simulate_run(machine, scenario.replace(start="levitated", off=0.1), estimator=kf)
    assert in_contact(dropped.estimate)[-400:].any()
    assert np.isfinite(dropped.estimate.innovation).all()


# ---- Where it could go wrong


def test_it_comes_back_from_an_outage_on_the_stop():
    record = pressed(AXIS, 2)
    depth, _ = stop_force(AXIS, record)
    start = next(a for a, b in episodes(depth > 0) if a > SETTLED)
    y = record["y"].copy()
    y[start + 20 : start + 320] = np.nan
    kf = ambkit.ContactKalmanFilter(AXIS, noise=NOISE)
    estimate = kf.run(ambkit.Record(record.t, {"y": y, "u": record["u"]}))
    error = estimate["x"] - record["x"]
    assert np.isfinite(estimate["x"]).all()
    assert np.abs(error[start + 420 :]).max() < 5e-5


@pytest.mark.parametrize("scatter", [-0.1, np.nan, np.inf])
def test_a_scatter_that_is_no_share_is_refused(scatter):
    with pytest.raises(ValueError, match="scatter must be 0 or more"):
        ambkit.ContactKalmanFilter(AXIS, scatter=scatter)


# ---- C


@pytest.mark.parametrize("precision", ["double", "float"])
def test_exported_c_has_its_bits_along_touchdowns(precision, tmp_path):
    dtype = {"double": "float64", "float": "float32"}[precision]
    kf = KINDS["contact"].make(AXIS, noise=NOISE, precision=dtype)
    made = export_c(AXIS, kf, tmp_path / "c", prefix="rig", force=True)
    assert "equal to the last bit" in printed_by(made.folder)
    record = pressed(AXIS, 2, 0.2)
    y, u = (record[name].astype(dtype) for name in ("y", "u"))
    estimate = kf.run(ambkit.Record(record.t, {"y": y, "u": u}))
    assert in_contact(estimate).sum() > 50
    filter = Filters(tmp_path, {"rig": made}, precision).start("rig")
    status = [filter.reset(y[0])]
    means = [list(filter.estimates)[:3]]
    for k in range(1, len(y)):
        status.append(filter.step(y[k], u[k - 1]))
        means.append(list(filter.estimates)[:3])
    ours = np.column_stack([estimate[name] for name in ("x", "v", "f_d")])
    assert (np.array(means)[1:] == ours[1:].astype(dtype)).all()
    assert (np.array(status)[1:] == np.asarray(estimate.status)[1:]).all()
