"""A rotor on its touch-down bearings: the filter that knows them, by a textbook and the truth."""

import numpy as np
import pytest
from export_cases import Filters, printed_by
from filter_cases import full
from oracles import magnet_force
from scipy.linalg import expm

import ambkit
from ambkit import FilterNoise, Machine, Scenario, Status
from ambkit.estimate.contact import samples_of_contact
from ambkit.estimate.registry import KINDS
from ambkit.export.c import cost, export_c, proof
from ambkit.judge.comparison.comparison import raw_error
from ambkit.judge.comparison.criteria import errors_along
from ambkit.judge.contact import contact_notes, on_stop, stop_notes
from ambkit.machine.magnets import magnet_of
from ambkit.simulation.run import simulate_run
from benchmarks.contact import (
    MACHINES,
    bound,
    episodes,
    judge,
    preset,
    true_forces,
    walks,
    with_stop,
)
from firmware import harness

SENSOR = {"sensor__noise_variance": "33.6 um^2"}  # 5.8 um
AXIS = Machine.preset("zittau_axial").replace(
    **SENSOR, stop={"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"}
)
NOISE = FilterNoise(disturbance=1500.0)
SETTLED = 200  # samples


def pressed(machine, seed, duration=0.5):
    """A run under a random walk of the disturbance force, as the filters assume."""
    T = machine.sampling_time
    n = round(duration / T) + 1
    steps = np.random.default_rng(1000 + seed).normal(0, np.sqrt(NOISE.disturbance * T), n)
    load = ambkit.Recorded.of(T * np.arange(n), np.cumsum(steps))
    return ambkit.simulate(machine, Scenario(duration=duration, seed=seed, disturbance=load)).record


def in_contact(estimate):
    return (np.asarray(estimate.status) & int(Status.CONTACT)) != 0


# ---- The equations


def elastic(machine, depth, T):
    """Return a stop's elastic force and its slope, straight where a time resolves no more."""
    steepest = 3 * machine.rotor.mass / T**2
    limit = (steepest / (1.5 * machine.stop.stiffness)) ** 2
    curved = np.clip(depth, 0, limit)
    force = machine.stop.stiffness * curved**1.5 + steepest * max(depth - curved, 0.0)
    return force, 1.5 * machine.stop.stiffness * curved**0.5


def held(machine, depth, rate, T):
    """Return N that is held over a time, and k and c of its tangent, from means without it."""
    m, stop = machine.rotor.mass, machine.stop
    E, k = elastic(machine, depth, T)
    c = min(1.5 * stop.damping * E, m / T)
    give = 1 / (1 + k * T**2 / (6 * m) + c * T / (2 * m))
    N = give * max(E + c * rate, 0.0) if depth > 0 else 0.0
    return (N, give * k, give * c) if N > 0 else (0.0, 0.0, 0.0)


def bounces(machine, X, P, a, side, parts=8):
    """Return mean and lateness of N, and its slopes by X, by the three points of a regression."""
    T, m = machine.sampling_time, machine.rotor.mass
    factor = np.linalg.cholesky(P[:2, :2])
    points = side * np.sqrt([[2, 0], [0.5, 1.5], [0.5, 1.5]]) * [[-1, 0], [1, -1], [1, 1]]
    points, t, h = X[:2] + points @ factor.T, (np.arange(parts) + 0.5) / parts, T / parts
    results = []
    for x, v in points:
        forces = []
        for _ in t:
            depth = side * (x + h / 2 * v + h**2 / 6 * a) - machine.clearance
            forces.append(held(machine, depth, side * (v + h / 2 * a), h)[0])
            more = a - side * forces[-1] / m
            x, v = x + h * v + h**2 / 2 * more, v + h * more
        results.append([np.mean(forces), np.mean(forces * (4 * t - 2))])
    plane = np.linalg.solve(np.column_stack([np.ones(3), points - X[:2]]), results)
    slopes = np.zeros((2, len(X)))
    slopes[:, :2] = plane[1:].T
    return plane[0], slopes


def textbook(kf, record):
    """Run an extended Kalman filter with a spring beyond the clearance, by full matrices."""
    machine, model, s = kf.machine, kf.model, kf.core.parameters["set"]
    T, m, lag = machine.sampling_time, machine.rotor.mass, machine.sensor.lag
    growth = sum(N * var for N, var in zip(model.N, s["var_d"], strict=True))
    X, P, means, b = kf.core.mean.copy(), kf.core.covariance.copy(), [], model.b[:, 0]
    # Responses to -1 N in the first half of a sample and 1 N in the second.
    A = np.zeros((5, 5))
    A[0, 1], A[1, 4], A[3, [0, 3]] = 1, 1 / m, [1 / lag, -1 / lag]
    half = expm(A * T / 2)[:4]
    late = half[:, 4] - half[:, :4] @ half[:, 4]
    brief = samples_of_contact(machine)[0] < 4.5
    for k, (y, u) in enumerate(zip(record["y"], np.r_[0, record["u"]], strict=False)):
        if k:
            iu = np.clip(s["k_ui"][0] * u, s["iu_min"][0], s["iu_max"][0])
            displaced = X[0] + T / 2 * X[1]
            there = np.clip(displaced, -machine.clearance, machine.clearance)  # straight beyond
            k_i, k_s = (float(value) for value in magnet_of(machine).tangent(iu, there))
            force = magnet_force(machine, iu, there) + k_s * (displaced - there)
            force += s["f_0"][0] + X[2]
            at = displaced + T**2 / (6 * m) * force  # by forces that are held over the sample
            w, side = np.array([k_s, k_s * T / 2, 1.0, 0.0]), np.sign(at)
            A, Q = model.L + np.outer(b, w), (k_i * s["k_ui"][0]) ** 2 * s["var_u"][0]
            extra = growth + Q * np.outer(b, b)
            by = np.column_stack([side * b, side * late])  # the states by N and its lateness
            if brief:
                N, slopes = bounces(machine, X, P, force / m, side)
                extra = extra + 0.1**2 * np.outer(by @ N, by @ N)
            else:
                depth = abs(at) - machine.clearance
                N, k, c = held(machine, depth, side * (X[1] + T / (2 * m) * force), T)
                slope = k * np.array([1, T / 2, T**2 / (6 * m), 0])
                slope += c * np.array([0, 1, T / (2 * m), 0])
                slopes = side * np.array([slope, 0 * slope])
                bent = 0.0
                if N > 0:  # N'' var(d) / 2 of N = K d^1.5 is bent N
                    bent = min(slope @ P @ slope / (6 * elastic(machine, depth, T)[0] ** 2), 6)
                extra = extra + (0.1**2 + 2 * bent**2) * N**2 * np.outer(b, b)
                N = np.array([(1 + bent) * N, 0.0])
            X = model.L @ X + b * force - by @ N
            A = A - by @ slopes
            P = A @ P @ A.T + extra
        c_y = model.c[0]
        S = c_y @ P @ c_y + s["var_y"][0]
        X = X + P @ c_y / S * (y - c_y @ X)
        P = P - np.outer(P @ c_y, c_y @ P) / S
        means.append(X)
    return np.array(means), P


@pytest.mark.parametrize(("stiffness", "damping"), [(1e8, 0.3), (3e10, 50.0)])
def test_it_is_the_textbook_s_filter_with_a_spring(stiffness, damping):
    """Also of a stop whose contacts are shorter than a few samples, in parts of a sample."""
    machine = AXIS.replace(stop={"stiffness": stiffness, "damping": damping})
    record = pressed(machine, 2, 0.2)
    kf = ambkit.ContactKalmanFilter(machine, scatter=0.1, noise=NOISE, frozen_limit=0, gate=1e6)
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


FRICTION = {"friction": 0.1, "radius": 0.02}


@pytest.mark.parametrize("friction", [{}, FRICTION])
@pytest.mark.parametrize("name", ["ufu_rig", "tum_mlps"])
def test_in_a_ring_the_covariance_goes_by_the_derivatives_of_the_mean(name, friction):
    kf, mean = ring_of_two(with_stop(Machine.preset(name).replace(speed=200.0), 1e9, **friction))
    free = ambkit.ExtendedKalmanFilter(Machine.preset(name).model_copy(update={"speed": 200.0}))
    u = np.zeros(len(kf.machine.axes))
    size = np.array([state.size for state in kf.states])

    def ahead(filter, at):
        filter.core.reset(at, 1e-6 * size)
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

    forces = kf.core.contact_forces(np.array([mean]), u[None])[0]
    normal, across = forces[:2] @ [0.6, -0.8], forces[:2] @ [0.8, 0.6]
    assert normal < 0
    assert across == pytest.approx(friction.get("friction", 0) * normal, abs=1e-3 * -normal)
    assert not forces[2:].any()
    # What does not follow from P, growth and scatter, is the same of any P.
    small = 1e-5
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


@pytest.mark.parametrize(
    ("name", "runs", "share"),
    [
        ("1 um, 1e9", 4, 0.10),
        pytest.param("5.8 um, 1e8", 40, 0.10, marks=pytest.mark.long),
        pytest.param("ufu_rig, friction", 12, 0.10, marks=pytest.mark.long),
        *(
            pytest.param(name, runs, share, marks=pytest.mark.study)
            for name, runs, share in [
                ("1 um, 3e9", 40, 0.12), ("3 um, 1e9, 20 kHz", 40, 0.10), ("5.8 um, 3e9", 40, 0.30),
                ("tum_mlps, friction", 12, 0.10),
            ]
        ),
    ],
)  # fmt: skip
def test_on_touchdowns_it_is_as_good_as_it_says_and_better_than_its_sensor(name, runs, share):
    result = judge(MACHINES[name](), range(runs))
    brief = name in ("1 um, 3e9", "3 um, 1e9, 20 kHz")  # a quarter of the time in contact
    assert np.mean(result.contact) > (0.25 if brief else 0.3)
    assert (np.array(result.errors["contact"]) < result.errors["raw"]).all()
    assert result.rms("contact") < 0.65 * min(result.rms("raw"), result.rms("constant-velocity"))
    assert name.startswith("tum") or result.rms("extended") > result.rms("raw")
    assert 0.92 <= np.mean(result.nees) <= 0.97
    assert result.off < share
    assert np.mean(np.array(result.flagged) <= 1e-3) > 0.98
    assert np.mean(np.array(result.released) <= 2e-3) > 0.98


@pytest.mark.parametrize(("name", "runs"), [
    ("zittau_axial", 2),
    pytest.param("ufu_rig", 6, marks=pytest.mark.long),
    pytest.param("tum_mlps", 6, marks=pytest.mark.study),
])  # fmt: skip
def test_a_drop_without_magnet_current_is_estimated_consistently(name, runs):
    result = judge(MACHINES[f"{name}, drop"](), range(40, 40 + runs), drops=True)
    assert 0.93 <= np.mean(result.nees) <= 0.97
    best = min(result.rms("raw"), result.rms("constant-velocity"), result.rms("extended"))
    assert result.rms("contact") < 0.3 * best
    assert result.off < 0.1
    assert np.mean(np.array(result.flagged) <= 1e-3) > 0.98
    assert np.mean(np.array(result.released) <= 2e-3) > 0.98


@pytest.mark.parametrize(("name", "seed"), [
    ("ufu_rig", 20016),
    *(pytest.param(name, seed, marks=pytest.mark.study)
      for name, seed in (("ufu_rig", 20005), ("tum_mlps", 20006), ("hindawi_2011", 20011))),
])  # fmt: skip
def test_backward_whirl_after_a_drop_is_followed(name, seed):
    """Dry friction drives the rotor some clearances into its rings, until it rolls along them."""
    machine = MACHINES[f"{name}, drop"]()
    result = judge(machine, [seed], drops=True)
    assert result.rms("contact") < 0.02 * result.rms("raw")
    assert result.nees[0] > 0.9
    assert result.off < 0.06
    duration = 5000 * machine.sampling_time
    record, noise = walks(machine, seed, duration, duration / 4)
    late = record.between(start=0.8 * duration)
    kf = KINDS["contact"].make(machine, noise=noise)
    error = errors_along(kf.run(late), late, kf.view)["x"]  # from a rotor at rest
    assert np.abs(error[:, 50:]).max() < 0.1 * machine.bearings[0].clearance


@pytest.mark.parametrize("sequence", [None, {"wait": 0.02, "lift": 0.1, "land": 0.1}])
@pytest.mark.parametrize("name", ["zittau_axial", "ufu_rig"])
def test_a_rotor_drops_and_levitates_again_in_one_run(name, sequence):
    """As the power fails and returns; along the record the filter is that in the loop."""
    machine = with_stop(Machine.preset(name), 1e9)
    kf = KINDS["contact"].make(machine)
    scenario = Scenario(
        duration=0.8, off=0.1, on=0.3, sequence=sequence, controller={"feedback": "estimate"}
    )
    run = simulate_run(machine, scenario, estimator=kf)
    along = kf.run(run.record)
    T, truth = machine.sampling_time, (true_forces(kf, run.record) != 0).any(axis=1)
    start, end = round(0.1 / T), round(0.3 / T)
    off = run.record["on"] == 0
    assert off[start:end].all()
    assert not off[:start].any()
    assert truth[start:end].any()
    assert not off[-end:].any()
    assert not truth[-end:].any()
    differ = [(along[s.name] - run.estimate[s.name])[start:] / s.size for s in kf.states]
    assert np.abs(differ).max() < 1e-3  # of another start
    error = errors_along(run.estimate, run.record, kf.view)["x"][:, SETTLED:]
    assert np.sqrt(np.mean(error**2)) < 0.8 * raw_error(machine, [run.record], SETTLED)
    displacement = np.array([run.record[run.displacement(axis)][-end:] for axis in run.axes])
    assert np.abs(displacement).max() < 0.6 * machine.bearings[0].clearance
    assert sequence is None or [mode["mode"] for mode in run.modes] == [
        "flying", "tripped", "off", "waiting", "lifting", "flying",
    ]  # fmt: skip


@pytest.mark.long
def test_no_estimator_knows_the_force_of_a_stiff_stop_much_better():
    """Nor to a tenth: a sensor of 5.8 um sees as much as the stop gives way."""
    best, ours = bound(MACHINES["5.8 um, 3e9"](), 501)
    assert 0.1 < best < ours < 1.3 * best


@pytest.mark.parametrize("name", ["tum_mlps", "ufu_rig"])
def test_a_spinning_rotor_that_drops_is_levitated_again(name):
    """By the estimate: from its touch-down bearings up, in contact first."""
    machine = with_stop(Machine.preset(name).replace(speed=200.0), 1e9, **FRICTION)
    kf = KINDS["contact"].make(machine)
    scenario = Scenario(duration=0.4, start="landed", controller={"feedback": "estimate"}, seed=1)
    run = simulate_run(machine, scenario, estimator=kf)
    assert in_contact(run.estimate)[:20].any()
    assert not in_contact(run.estimate)[-200:].any()
    dropped = simulate_run(machine, scenario.replace(start="levitated", off=0.1), estimator=kf)
    lost = np.asarray(dropped.estimate.status) & int(Status.OUTLIER | Status.RESTARTED)
    assert not lost.any()
    truth = (true_forces(kf, dropped.record) != 0).any(axis=1)
    flags, T = in_contact(dropped.estimate), machine.sampling_time
    assert not flags[: round(0.1 / T)].any()
    contacts = [(a, b) for a, b in episodes(truth) if b - a >= 1e-3 / T and b < len(flags) - 50]
    assert len(contacts) > 3
    assert max(np.argmax(flags[a:]) for a, _ in contacts) <= 1e-3 / T
    assert max(np.argmin(flags[b:]) for _, b in contacts if not truth[b : b + 20].any()) <= 2e-3 / T
    without = KINDS["contact"].make(with_stop(machine, 1e9)).run(dropped.record)
    flown = (run.estimate, run), (dropped.estimate, dropped), (without, dropped)
    errors = [
        np.sqrt(np.mean(errors_along(estimate, of.record, kf.view)["x"][:, SETTLED:] ** 2))
        for estimate, of in flown
    ]
    raw = [raw_error(machine, [of.record], SETTLED) for of in (run, dropped)]
    assert max(np.divide(errors[:2], raw)) < 0.8
    assert errors[1] < 0.97 * errors[2]


# ---- Where it could go wrong


def test_it_comes_back_from_an_outage_on_the_stop():
    record = pressed(AXIS, 2)
    start = next(a for a, b in episodes(np.abs(record["x"]) > AXIS.clearance) if a > SETTLED)
    y = record["y"].copy()
    y[start + 20 : start + 320] = np.nan
    kf = ambkit.ContactKalmanFilter(AXIS, noise=NOISE)
    estimate = kf.run(ambkit.Record(record.t, {"y": y, "u": record["u"]}))
    error = estimate["x"] - record["x"]
    assert np.isfinite(estimate["x"]).all()
    assert np.abs(error[start + 420 :]).max() < 5e-5


def test_filters_that_do_not_know_the_stop_are_named():
    record = pressed(AXIS, 2, 0.2)
    lies = np.mean(np.abs(record["x"]) > AXIS.clearance)
    assert np.mean(on_stop(AXIS, record)) == pytest.approx(lies, abs=0.05)
    assert lies > 0.1
    runs = {kind: KINDS[kind].make(AXIS).run(record) for kind in ("extended", "contact")}
    (note,) = contact_notes(AXIS, record, runs)
    assert note.startswith("extended: the rotor lies on a stop in ")
    unknown = list(contact_notes(AXIS.replace(stop=None), record, runs))
    assert unknown[0].startswith("contact: no bearing of zittau_axial has a stop")
    assert unknown[1].endswith("once [stop] states its stiffness")
    assert not list(contact_notes(AXIS, ambkit.simulate(AXIS, duration=0.1).record, runs))


def test_a_stop_too_stiff_for_its_sampling_time_is_named():
    contact = KINDS["contact"].label
    assert not list(stop_notes(AXIS, contact))
    stiff = AXIS.replace(stop={"stiffness": 1e12})
    assert not list(stop_notes(stiff, KINDS["extended"].label))
    (note,) = stop_notes(stiff, contact)
    assert note.startswith("zittau_axial: a contact lasts 1.")
    assert note.endswith("4.5 are needed for a consistent estimate")


@pytest.mark.parametrize(("kind", "stiffness", "texts"), [
    ("contact", None, ["no bearing of zittau_axial has a stop"]),
    ("contact", 1e12, ["zittau_axial: a contact lasts 1."]),
    ("contact", 1e8, []),
    ("extended", 1e12, []),
])  # fmt: skip
def test_check_and_export_name_what_keeps_stops_unknown(kind, stiffness, texts, tmp_path, caplog):
    stop = None if stiffness is None else {"stiffness": stiffness, "damping": 0.3}
    kf = KINDS[kind].make(AXIS.replace(stop=stop))
    kf.save(tmp_path / "f.toml")
    checked = ambkit.check([tmp_path / "f.toml"])
    export_c(kf.machine, kf, tmp_path / "c")
    for notes in (checked.notes, caplog.messages):
        found = [text for text in notes if "a stop" in text or "a contact" in text]
        assert all(text in note for text, note in zip(texts, found, strict=True))


@pytest.mark.parametrize("scatter", [-0.1, np.nan, np.inf])
def test_a_scatter_that_is_no_share_is_refused(scatter):
    with pytest.raises(ValueError, match="scatter must be 0 or more"):
        ambkit.ContactKalmanFilter(AXIS, scatter=scatter)


# ---- C


@pytest.mark.long
@pytest.mark.skipif(bool(harness.missing_tools()), reason="needs the cross compiler and qemu")
def test_in_contact_a_step_takes_at_most_half_as_much_again_as_the_extended_filter_s(tmp_path):
    record, median = pressed(AXIS, 2, 0.2), {}
    for kind in ("extended", "contact"):
        kf = KINDS[kind].make(AXIS, noise=NOISE, precision="float32")
        made = export_c(AXIS, kf, tmp_path / kind, prefix="filter", force=True)
        run = harness.run(
            harness.build(made.folder, tmp_path / f"{kind}_"), record["y"], record["u"]
        )
        touched = (run.status[1:] & int(Status.CONTACT)) != 0
        assert kind == "extended" or touched.sum() > 50
        median[kind] = np.median(run.instructions[touched if touched.any() else slice(None)])
    assert median["contact"] <= 1.5 * median["extended"]


@pytest.mark.long
@pytest.mark.skipif(bool(harness.missing_tools()), reason="needs the cross compiler and qemu")
@pytest.mark.parametrize("loops", [True, pytest.param(False, marks=pytest.mark.study)])
def test_in_both_rings_it_takes_no_more_and_compiles_without_a_warning(loops, tmp_path):
    machine, median, N = preset("hindawi_2011", **FRICTION), {}, 300
    record, noise = walks(machine, 7, 3000 * machine.sampling_time, 1000 * machine.sampling_time)
    y, u = (np.column_stack([record[f"{of}_{axis.name}"] for axis in machine.axes]) for of in "yu")
    np.hstack([y[2000:][:N], u[1999:][:N]]).astype("<f4").tofile(tmp_path / "input.bin")
    for kind in ("extended", "contact"):
        kf = KINDS[kind].make(machine, noise=noise, precision="float32")
        out = tmp_path / kind
        made = export_c(machine, kf, out, prefix="filter", loops=loops, force=True)
        main = harness.HERE / "axes.c"
        harness.emulated(harness.build(made.folder, out / "build", main=main).elf, tmp_path)
        counted = np.fromfile(tmp_path / "instructions.bin", "<u4")[1:]
        median[kind] = np.quantile(counted, 0.5 if kind == "extended" else 0.99)
    assert median["contact"] <= 1.5 * median["extended"]


@pytest.mark.parametrize(
    ("precision", "stiffness"), [("double", 1e8), ("float", 1e8), ("float", 1e12)]
)
def test_exported_c_has_its_bits_along_touchdowns(precision, stiffness, tmp_path):
    """Also where the magnets have no current."""
    machine = AXIS.replace(stop={"stiffness": stiffness, "damping": 0.3})
    dtype = {"double": "float64", "float": "float32"}[precision]
    kf = KINDS["contact"].make(machine, noise=NOISE, precision=dtype)
    made = export_c(machine, kf, tmp_path / "c", prefix="rig", force=True)
    assert "equal to the last bit" in printed_by(made.folder)
    record = pressed(machine, 2, 0.2)
    y, u = (record[name].astype(dtype) for name in ("y", "u"))
    on = np.ones(len(y), dtype)
    on[500:520] = 0
    signals = {"y": y, "u": u, "on": on}
    estimate = kf.run(ambkit.Record(record.t, signals, {"on": "1"}))
    assert in_contact(estimate).sum() > 50
    assert (estimate.k_i[501:521] == 0).all()
    filter = Filters(tmp_path, {"rig": made}, precision).start("rig")
    status = [filter.reset(y[0])]
    means = [list(filter.estimates)[:3]]
    for k in range(1, len(y)):
        if on[k - 1] == 0:
            filter.deenergise()
        status.append(filter.step(y[k], u[k - 1]))
        means.append(list(filter.estimates)[:3])
    ours = np.column_stack([estimate[name] for name in ("x", "v", "f_d")])
    assert (np.array(means)[1:] == ours[1:].astype(dtype)).all()
    assert (np.array(status)[1:] == np.asarray(estimate.status)[1:]).all()


def test_costs_and_proofs_of_resolved_contacts_are_not_those_of_short_ones():
    resolved, short = (
        KINDS["contact"].make(AXIS.replace(stop={"stiffness": k, "damping": 0.3}),
                              precision="float32")
        for k in (1e8, 1e12)
    )  # fmt: skip
    assert cost.of(resolved) is not None
    assert cost.of(short) is None
    assert proof.stored_as(short, "float") != proof.stored_as(resolved, "float")


def test_contact_after_a_power_failure_does_not_accuse_the_controller():
    notes = ambkit.simulate("zittau_axial", Scenario(duration=0.2, off=0.05)).notes
    (note,) = (text for text in notes if "touched the stop" in text)
    assert note.endswith(" after the power failure.")
