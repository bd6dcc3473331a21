"""The guess at channels by physics: disguised logs, other rigs, and what must not be guessed."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import lfilter

import ambkit
from ambkit.base.errors import RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.files.tables import read_log
from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.comparison import feeds
from ambkit.data.reading.derived_channels import (
    filters_of_others,
    is_filtered,
    is_formula,
    raw_counterparts,
    same_numbers,
    standardised,
    velocities,
)
from ambkit.data.reading.levitation_test import bands
from ambkit.data.reading.position_search import rotor
from ambkit.data.reading.propose import guess
from ambkit.data.reading.reader import read
from tests import disguises, voltages
from tests.headers import HEADERS

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "closed_loop"
needs_rig = pytest.mark.skipif(
    not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)"
)


def judged(path, hidden, true):
    """Write a log in disguise as a matrix without names, and say what the guess made of it."""
    savemat(path, {"a": hidden.rows})
    try:
        signals = ChannelMap.from_toml(guess(path)).signals
    except RecordError as error:
        return "refused" if "refused: nothing in it is levitated" in str(error) else str(error)
    y, u = signals["y"], signals["u"]
    right = hidden.is_right(y.row, u.row, y.sign * u.sign < 0, true)
    return "right" if right and hidden.order[signals["t"].row] == 0 else f"wrong: {hidden.name}"


@needs_rig
def test_disguised_logs_of_the_rig_are_told_apart(tmp_path):
    found = [judged(tmp_path / "log.mat", *each) for each in disguises.of_the_rig(RIG, 12, seed=1)]
    assert found.count("right") >= 11
    assert {*found} <= {"right", "refused"}


@pytest.mark.study
@needs_rig
def test_of_200_disguises_none_is_silently_wrong(tmp_path):
    found = [judged(tmp_path / "log.mat", *each) for each in disguises.of_the_rig(RIG, 200, seed=2)]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 197


@pytest.mark.study
@needs_rig
def test_where_no_converter_shows_nothing_is_silently_wrong(tmp_path):
    cases = disguises.of_the_rig(RIG, 192, seed=5, steps=False)
    found = [judged(tmp_path / "log.mat", *each) for each in cases]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 170


@needs_rig
@pytest.mark.parametrize("seed", [4, 6])
def test_without_converters_steps_the_noise_tells(tmp_path, seed):
    cases = disguises.of_the_rig(RIG, 12, seed=seed, steps=False)
    found = [judged(tmp_path / "log.mat", *each) for each in cases]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 9


def told_of_another_rig(path, seed):
    """Say what the guess makes of a simulated log in disguise, as `judged` does."""
    hidden, names = disguises.other_rig(seed)
    savemat(path, {"a": hidden.rows})
    try:
        signals = ChannelMap.from_toml(guess(path)).signals
    except RecordError as error:
        return "refused" if "refused: nothing in it is levitated" in str(error) else str(error)
    t, y, u = (signals[name] for name in "tyu")
    right = [names[each.row] for each in (t, y, u)] == ["t", "y", "u"]
    flips = hidden.signs[y.row] * hidden.signs[u.row] < 0
    return "right" if right and (y.sign * u.sign < 0) == flips else f"wrong: {hidden.name}"


def test_of_other_rigs_none_is_silently_wrong(tmp_path):
    seeds = (3, 16, 1194, 1198, *range(20, 30))
    found = [told_of_another_rig(tmp_path / "log.mat", seed) for seed in seeds]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 4


@pytest.mark.study
def test_of_200_other_rigs_none_is_silently_wrong(tmp_path):
    found = [told_of_another_rig(tmp_path / "log.mat", seed) for seed in range(1000, 1200)]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 60


def told_of_voltages(path, count, seed):
    """Say what the guess makes of disguised logs without a current."""
    for rows, rng in voltages.logs(count, seed):
        hidden = disguises.disguise(rows, rng, cut=rows.shape[1])
        savemat(path, {"a": hidden.rows})
        try:
            signals = ChannelMap.from_toml(guess(path)).signals
        except RecordError as error:
            yield "refused" if "refused: nothing in it is levitated" in str(error) else str(error)
            continue
        y, u = signals["y"], signals["u"]
        flips = hidden.signs[y.row] * hidden.signs[u.row] < 0
        places = [hidden.order[signals[name].row] for name in "tyu"]
        right = places == [0, 1, 2] and (y.sign * u.sign < 0) == flips
        yield "right" if right else f"wrong: {places}"


@pytest.mark.parametrize(("count", "seed", "least"), [
    (6, 0, 4), pytest.param(48, 1, 36, marks=pytest.mark.study),
])  # fmt: skip
def test_rotors_that_a_voltage_drives_are_understood(tmp_path, count, seed, least):
    found = list(told_of_voltages(tmp_path / "log.mat", count, seed))
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= least


@needs_rig
def test_a_machine_is_proposed_from_the_gap_and_the_pole(tmp_path):
    ball = ambkit.preset("inteco_ml")
    text = guess(RIG / "multisteps_stairs-PID_gain_scheduling-KF.mat")
    lines = text[text.index("# A first machine file") :].splitlines()[1:]
    (tmp_path / "rig.toml").write_text("\n".join(line.lstrip("# ") for line in lines))
    proposed = ambkit.load(tmp_path / "rig.toml")
    assert proposed.magnet.air_gap == pytest.approx(ball.magnet.air_gap, rel=0.3)
    assert proposed.magnet.bias_current == pytest.approx(ball.magnet.bias_current, rel=0.1)
    assert proposed.levitation_current == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(("seed", "is_lively"), [(2, True), (1, False)])
def test_a_machine_is_proposed_where_a_voltage_drives_the_coil(tmp_path, seed, is_lively):
    gap, rate = 12e-3, 50.0
    driven = voltages.Driven((2 * 9.81 / gap) ** 0.5, rate, 0.3, 5e-4, 1e-3)
    t, x, u, *_ = voltages.flown(driven, np.random.default_rng(seed))
    rows = np.column_stack([t, 1e3 * 0.02 * gap * x, 8 * (1 + 0.02 * u)])
    np.savetxt(tmp_path / "log.csv", rows, "%.7g", ",", comments="", header="t_s,pos_mm,coil_V")
    _, found, lines = guess(tmp_path / "log.csv").partition("# A first machine file")
    assert bool(found) == is_lively
    if not is_lively:
        return  # its pole would be off by 30 %
    machine = "\n".join(line.lstrip("# ") for line in lines.splitlines()[1:])
    (tmp_path / "rig.toml").write_text(machine)
    proposed = ambkit.load(tmp_path / "rig.toml")
    assert proposed.magnet.air_gap == pytest.approx(gap, rel=0.2)
    assert 2 * np.pi * proposed.amplifier.bandwidth == pytest.approx(rate, rel=0.2)


def test_a_position_that_was_filtered_is_named_and_none_that_was_not():
    for name in ("of the paper", "one magnet"):
        channels = disguises.simulated(name)
        assert is_filtered(channels["x_estimated"])
        assert not is_filtered(channels["y"])


def test_what_drives_a_measured_current_is_the_control(tmp_path):
    t = 1e-3 * np.arange(4000)
    duty = 0.4 + 0.1 * np.sign(np.sin(20 * t)) + 0.01 * np.random.default_rng(0).normal(size=t.size)
    current = lfilter([0.04], [1, -0.96], 2.7 * duty)
    for scale, channel in ((1.0, "control"), (2.7, "u")):
        table = np.column_stack([t, np.sin(3 * t), scale * duty, current])
        np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,z,U1,I1", comments="")
        assert ChannelMap.from_toml(guess(tmp_path / "log.csv")).signals[channel].column == "U1"


def simple(n=6000):
    """A sensor, its estimate, and what is computed of them: noise of 1, a motion of 0.6."""
    rng = np.random.default_rng(4)
    x = 30 * lfilter([1e-3], [1, -1.96, 0.963], rng.normal(size=n))
    y = x + rng.normal(size=n)
    return np.array([y, x, lfilter([0.3], [1, -0.7], y), np.diff(y, prepend=0.0), np.cumsum(y)])


def test_what_is_made_of_others_is_known():
    unit = standardised(simple())
    raw = [False] * len(unit)
    assert filters_of_others(unit, raw) == {2}  # no sum: what it is of is its difference
    assert filters_of_others(unit, [True] * len(unit)) == set()
    assert 3 in velocities(unit)
    assert raw_counterparts(unit, list(bands(unit)), 1, [0, 3, 4]) == [0]
    t = np.arange(6000)
    sine = standardised(np.array([np.sin(t / 50), np.cos(t / 50) + 1e-3 * simple()[0]]))
    assert is_formula(sine[0])
    assert not is_formula(sine[1])
    assert velocities(sine) == set()  # a sine has no noise that its difference could have


def test_a_filter_that_is_noisier_than_its_sensor_is_not_taken_for_it():
    """It takes out the lag of a slow sensor; which of the two is raw nothing tells."""
    log = disguises.simulated("quiet sensor")
    rng = np.random.default_rng(1)
    ahead = np.gradient(log["y"]) * 3 + 1e-9 * rng.normal(size=log["y"].size)
    found = rotor(np.array([log["y"], log["u"], log["y"] + ahead]))
    assert found is None or found.position == 0


@pytest.mark.parametrize("name", disguises.OTHERS)
def test_rigs_of_other_kinds_are_told_apart(name):
    log = disguises.simulated(name)
    names = [n for n in log if n != "t"]
    order = np.random.default_rng(len(name)).permutation(len(names))
    names = [names[k] for k in order]
    found = rotor(np.array([log[n] for n in names]))
    assert (names[found.position], names[found.control]) == ("y", "u")
    assert not found.turned  # greater u pulls towards greater y


def test_a_volt_is_as_good_as_a_metre():
    log = disguises.simulated("of the paper")
    rows = np.array([-4.2 - 3100.0 * log["y"], log["u"]])
    found = rotor(rows)
    assert (found.position, found.control, found.turned) == (0, 1, True)


def still(n=6000):
    """Signals of all kinds in which nothing floats."""
    rng = np.random.default_rng(3)
    t = 1e-3 * np.arange(n)
    noise = rng.normal(size=(3, n))
    waves = np.sin(2 * np.pi * np.array([[3.0], [7.0], [0.5]]) * t)
    spring = lfilter([1e-4], [1, -1.98, 0.985], noise[0])
    return {
        "noise": noise,
        "walks": np.cumsum(noise, axis=1),
        "waves": waves + 0.01 * noise,
        "a spring and its force": np.array([spring + 1e-4 * noise[1], noise[0]]),
        "in steps": np.round(waves * 20) / 20,
    }


@pytest.mark.parametrize("name", still())
def test_nothing_is_guessed_where_nothing_floats(name):
    assert rotor(still()[name]) is None


def test_a_record_too_short_for_a_band_is_no_rotor():
    log = disguises.simulated("one magnet")
    assert rotor(np.array([log["y"], log["u"]])[:, :150]) is None


def test_copies_are_one_channel():
    a = np.random.default_rng(1).normal(size=(2, 500))
    rows = np.array([a[0], a[1], 3 - 2 * a[0], a[1], a[0] + 1e-3 * a[1]])
    assert same_numbers(rows) == {2: 0, 3: 1}


def names_of(text):
    return {k: c.array or c.column for k, c in ChannelMap.from_toml(text).signals.items()}


@pytest.mark.parametrize("digits", ["%.17g", "%.9g", "%.6g"])
def test_a_reference_that_is_named_a_command_is_no_control(tmp_path, digits):
    """Written with few digits it repeats its values, as what a converter measured does."""
    log = disguises.simulated("of the paper")
    time = np.arange(log["y"].size) * np.diff(log["t"]).mean()
    columns = (time, log["y"], log["u"], log["r"])
    np.savetxt(tmp_path / "log.csv", np.stack(columns, axis=1), digits, ",", comments="",
               header="time,AI0,AO0,CMD")  # fmt: skip
    found = names_of(guess(tmp_path / "log.csv"))
    assert found == {"t": "time", "y": "AI0", "u": "AO0", "r": "CMD"}


def test_of_arrays_of_several_lengths_all_are_considered(tmp_path):
    log = disguises.simulated("one magnet")
    rng = np.random.default_rng(4)
    old = rng.normal(size=(6, log["t"].size + 777))
    savemat(tmp_path / "log.mat", {
        "old": old, "sim_time": log["t"], "sim_cur": log["u"], "sim_gap": log["y"],
        "spare": np.zeros(9),
    })  # fmt: skip
    text = guess(tmp_path / "log.mat")
    assert names_of(text) == {"t": "sim_time", "y": "sim_gap", "u": "sim_cur"}
    assert len(read(tmp_path / "log.mat", ChannelMap.from_toml(text)).record) == log["t"].size


@pytest.mark.parametrize("shape", ["columns", "apart"])
def test_structures_of_simulink_are_read(tmp_path, shape):
    log = disguises.simulated("one magnet")
    y, u, t = log["y"], log["u"], log["t"][:, None]

    def signals(values, label):
        return {"values": values, "dimensions": float(np.ndim(values) > 1), "label": label}

    if shape == "columns":
        content = {"out": {"time": t, "signals": signals(np.column_stack([y, u]), ""),
                           "blockName": "rig/To Workspace"}}  # fmt: skip
    else:
        both = np.array([(y[:, None], 1.0, "gap [m]"), (u[None, None], 1.0, "coil current")],
                        dtype=[("values", "O"), ("dimensions", "O"), ("label", "O")])  # fmt: skip
        content = {"out": {"time": t, "signals": both, "blockName": "rig/To Workspace"}}
    savemat(tmp_path / "log.mat", content)
    text = guess(tmp_path / "log.mat")
    record = read(tmp_path / "log.mat", ChannelMap.from_toml(text)).record
    np.testing.assert_array_equal(record["y"], y)
    np.testing.assert_array_equal(record["u"], u)
    np.testing.assert_allclose(record.t, t.ravel())


def test_a_header_of_comments_is_read_over(tmp_path):
    log = disguises.simulated("one magnet")
    rows = zip(log["t"].tolist(), log["u"].tolist(), log["y"].tolist(), strict=True)
    lines = ["# rig of the second floor", "% 2024-05-03, run 7", "time,coil,gap",
             *(f"{t!r},{u!r},{y!r}" for t, u, y in rows)]  # fmt: skip
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    assert names_of(guess(tmp_path / "log.csv")) == {"t": "time", "y": "gap", "u": "coil"}


def of_a_rig(n=3000):
    """What a rig logs of the paper's bearing, by the marks of `HEADERS`."""
    log = {name: values[:n] for name, values in disguises.simulated("of the paper").items()}
    rng = np.random.default_rng(1)
    u, hiss = log["u"], rng.normal(size=n)
    current = np.round(lfilter([0.6], [1, -0.4], u) + 2e-3 * hiss, 4)
    return {
        "t": log["t"], "y": np.round(log["y"], 7), "u": np.round(u, 5), "r": log["r"],
        "xe": log["x_estimated"], "ve": log["v_estimated"], "i": current,
        "d": np.round(0.5 + 0.3 * u + 0.02 * rng.normal(size=n), 3), "e": log["r"] - log["y"],
        "T": 25 + np.round(1e-3 * np.cumsum(hiss), 2), "n": np.round(314 + hiss, 1),
    }  # fmt: skip


def headed(path, header, rig):
    """Write a log with a header, and say whether its channels are taken for what they are."""
    line, _, marks = header.rpartition(" = ")
    marks, separator = marks.split(), ";" if ";" in line else ","
    rows = np.column_stack([rig[mark] for mark in marks]).tolist()
    text = "\n".join([line, *(separator.join(f"{v:.9g}" for v in row) for row in rows)])
    path.write_text(text + "\n")
    heads = [re.sub(r"\s*[\[(].*", "", name) for name in line.split(separator)]
    names = dict(zip(marks, heads, strict=True))
    wanted = {"t": names["t"], "y": names["y"]}
    if "u" in names:
        wanted |= {"u": names["u"]} | ({"current": names["i"]} if "i" in names else {})
    else:
        wanted |= {"u": names["i"]} | ({"control": names["d"]} if "d" in names else {})
    wanted |= {signal: names[mark] for mark, signal in
               (("r", "r"), ("xe", "x_logged"), ("ve", "v_logged")) if mark in names}  # fmt: skip
    try:
        return "right" if names_of(guess(path)) == wanted else f"wrong: {header}"
    except RecordError:
        return "refused"


@pytest.mark.parametrize(
    "headers", [HEADERS[::10], pytest.param(HEADERS, marks=pytest.mark.long)], ids=["some", "all"]
)
def test_the_fields_names_are_known(tmp_path, headers):
    rig = of_a_rig()
    found = [headed(tmp_path / "log.csv", header, rig) for header in headers]
    assert {*found} <= {"right", "refused"}
    assert found.count("right") >= 0.95 * len(found)


@pytest.mark.parametrize("head", [
    "LabVIEW Measurement\nSeparator,Comma\nMulti_Headings,No\n\nX_Value,Weg,Strom,Comment",
    "LabVIEW Measurement\nSamples 2048 2048\nX_Dimension Time Time\n\nX_Value,Weg,Strom,Comment",
    "Model,MSO24\nLabel,,\nx-axis,1,2\nsecond,Volt,Volt",
    "Time,GVL.stWeg.fX,GVL.stStrom.fX\ns,um,1",
    "Time,Pos,Cur\nhh:mm:ss,um,A",
])  # fmt: skip
def test_instruments_heads_are_read(tmp_path, head):
    rig = of_a_rig()
    rows = np.column_stack([rig["t"], 2 + 1e4 * rig["y"], rig["i"]])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=head)
    with (tmp_path / "log.csv").open("a") as file:
        file.write("# stopped by the user\n\n# 3000 samples, 0 lost\n")
    is_above_units = head.endswith(("Volt", "um,A", "um,1"))
    first, y, u = head.split("\n")[-1 - is_above_units].split(",")[:3]
    assert names_of(guess(tmp_path / "log.csv")) == {"t": first, "y": y, "u": u}


def test_names_above_channels_with_times_of_their_own_are_read(tmp_path):
    head = "Name\tScope\n\n" + "".join(
        f"{key}\t{x}\t{key}\t{u}\n"
        for key, x, u in (("Name", "fWeg", "fStrom"), ("Port", 851, 851), ("Offset", 0, 0))
    )
    rows = "".join(f"{0.1 * k:g}\t{k % 7}\t{0.1 * k:g}\t{-(k % 5)}\n" for k in range(50))
    (tmp_path / "log.csv").write_text(head + rows)
    log = read_log(tmp_path / "log.csv")
    assert (log.order, log.units["Time#0"]) == (("Time#0", "fWeg", "Time#2", "fStrom"), "ms")


@pytest.mark.parametrize(("head", "marks", "size", "line"), [
    ("Zeit,Sollstrom,Weg", "t y u", 400, "y and u: Weg or Sollstrom"),
    ("t,x_est,x_meas,u", "t y xe u", 3000, "y and x_logged: x_meas or x_est"),
    ("t,i_ref,i_meas,pos", "t i u y", 3000, "u and current: i_ref or i_meas"),
    ("t,pos,i_ref,i_meas", "t y u i", 3000, ""),
    ("t,y,i_cmd,F", "t y u force", 3000, "u: i_cmd or F"),
    ("t,temperature,position", "t y u", 3000, "y: position: named so"),
    ("t,a,b,c", "t y i3 u2", 3000, "u: c or b: it goes with it"),
    ("t,z_filt,i", "t xe i", 3000, "y: z_filt: an estimate"),
])  # fmt: skip
def test_ambiguity_is_said(tmp_path, head, marks, size, line):
    rig = of_a_rig(size)
    rig |= {"force": np.round(40 * rig["i"], 2), "i3": np.round(rig["i"], 3)}
    rig["u2"] = np.round(2 * rig["u"], 3)
    rows = np.column_stack([rig[mark] for mark in marks.split()])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=head)
    said = [text for text in guess(tmp_path / "log.csv").splitlines() if text.startswith("# ?")]
    assert any(line in text for text in said) if line else not said


def test_of_two_nameless_channels_the_one_that_carries_noise_is_the_control(tmp_path):
    y = np.random.default_rng(5).normal(size=4000)
    rows = np.column_stack([1e-4 * np.arange(y.size), -lfilter([3.0, -2.0], [1], y), y])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header="Time,CH1,CH2")
    text = guess(tmp_path / "log.csv")
    assert names_of(text) == {"t": "Time", "y": "CH2", "u": "CH1"}
    assert "# ? y: CH2 or CH1: no name says so" in text


def test_a_step_in_the_first_tenth_is_the_reference(tmp_path):
    machine = ambkit.preset("zittau_axial")
    scenario = ambkit.scenario_for(machine, step="50 µm", duration="0.3 s")
    ambkit.simulate(machine, scenario).record.save(tmp_path / "log.csv")
    assert names_of(guess(tmp_path / "log.csv"))["r"] == "r"


@pytest.mark.parametrize(("head", "flip", "turns"), [
    ("Keyphasor", False, True), ("KPH", True, True), ("AI7", True, True), ("Tacho", False, False),
])  # fmt: skip
def test_a_channel_of_two_levels_is_the_keyphasor(tmp_path, head, flip, turns):
    rig = of_a_rig()
    angle = (250 + 20 * np.sin(9 * rig["t"])) * rig["t"]  # a status bit goes up once
    mark = (angle % (2 * np.pi) < 0.4) if turns else rig["t"] > rig["t"].mean()
    level = np.where(mark != flip, 4.8, 0.1) + 0.02 * np.random.default_rng(5).normal(size=3000)
    rows = np.column_stack([rig["t"], rig["y"], rig["u"], level])
    header = f"t,position,control,{head}"
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=header)
    signals = ChannelMap.from_toml(guess(tmp_path / "log.csv")).signals
    assert ("keyphasor" in signals) == turns
    if turns:
        assert (signals["keyphasor"].column, signals["keyphasor"].sign) == (head, -1 if flip else 1)


def test_a_command_leads_the_current_that_follows_it(tmp_path):
    rig = of_a_rig()
    rows = np.column_stack([rig["t"], rig["y"], rig["i"], rig["u"]])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header="t,gap,amps A,amps B")
    text = guess(tmp_path / "log.csv")
    found = names_of(text)
    assert (found["u"], found["current"]) == ("amps B", "amps A")
    assert ChannelMap.from_toml(text).signals["u"].unit == "A"


def test_a_control_is_that_of_the_positions_own_axis(tmp_path):
    run = ambkit.simulate(ambkit.preset("ufu_rig"), duration=0.4).record
    names = ("u_B1", "y_A1", "y_B1", "u_A1")
    rows = np.column_stack([run.t, *(run[name] for name in names)])
    header = "t,coil 1 [A],sensor 1 [m],sensor 2 [m],coil 2 [A]"
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=header)
    found = names_of(guess(tmp_path / "log.csv"))
    assert (found["y"], found["u"]) == ("sensor 1", "coil 2")


@pytest.mark.parametrize(("codec", "header"), [
    ("gb2312", "时间,转子位移,线圈电流"), ("cp932", "時間,変位,コイル電流"),
    ("cp1251", "время,смещение,ток"), ("latin-1", "tempo,posição,corrente"),
])  # fmt: skip
def test_names_in_national_encodings_are_read(tmp_path, codec, header):
    rig = of_a_rig(400)
    rows = np.column_stack([rig["t"], rig["y"], rig["i"]])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=header, encoding=codec)
    assert names_of(guess(tmp_path / "log.csv")) == dict(zip("tyu", header.split(","), strict=True))


@pytest.mark.parametrize(("head", "marks", "wanted"), [
    ("t,y,u,velocity", "t y u n", {}),  # a speed of rotation
    ("t,y,u [A],bias [A]", "t y u bias", {}),
    ("t,y,bias [A],u [A]", "t y bias u", {}),
    ("t,y,i [A],dc_link [V]", "t y i T", {"u": "i"}),
    ("t,y,u,x_ref", "t y u xe", {"x_logged": "x_ref"}),
    ("t,y,u,x_obs", "t y u T", {}),
    ("t,Sensor A,Sensor B,u", "t twin y u", {"y": "Sensor A"}),
    ("t,a [m],b [m],u", "t steps y u", {"y": "b"}),
    ("t,e [m],y [m],u", "t e y u", {}),
    ("t_log,t_ctrl,y,u", "jumps t y u", {"t": "t_ctrl"}),
    ("t,y_cmd,y_meas,u", "t y r u", {"y": "y_cmd", "r": "y_meas"}),
    ("t,y,u1,u2", "t y u i", {"u": "u1", "current": "u2"}),
    ("t,x_1,x_2,Row,cmd_1,cmd_2", "t y T count u n", {"y": "x_1", "u": "cmd_1"}),
])  # fmt: skip
def test_a_name_that_the_motion_contradicts_is_none(tmp_path, head, marks, wanted):
    rig = of_a_rig()
    t, rng = rig["t"], np.random.default_rng(2)
    rig |= {
        "bias": np.round(2 + 1e-3 * rng.normal(size=t.size), 4),
        "twin": np.round(rig["xe"] + 0.7 * np.std(np.diff(rig["y"])) * rng.normal(size=t.size), 8),
        "steps": 1e-5 * (t > t.mean()),
        "jumps": np.where(t > t.mean(), t + 0.05, t),
        "count": np.arange(t.size),
    }  # fmt: skip
    rows = np.column_stack([rig[mark] for mark in marks.split()])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=head)
    usual = {"t": "t", "y": "y", "u": "u"}
    assert names_of(guess(tmp_path / "log.csv")) == usual | wanted


@pytest.mark.parametrize(("line", "step"), [
    ("# fs = 2 kHz", 5e-4), ("% Ts: 0.01", 0.01), ("Sample rate [kHz]: 10", 1e-4),
    ("# sampling period 50 us", 5e-5), ("# rate 1/Ts", None),
])  # fmt: skip
def test_a_rate_above_the_numbers_is_read(tmp_path, line, step):
    rig = of_a_rig(400)
    rows = np.column_stack([rig["y"], rig["u"]])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header=f"{line}\ny,u")
    text = guess(tmp_path / "log.csv")
    assert ("\nsampling_time" in text) == (step is not None)
    if step is not None:
        assert ChannelMap.from_toml(text).sampling_time == pytest.approx(step)


@pytest.mark.parametrize(("label", "unit", "scale"), [
    ("pos (0.1um)", "um", 0.1), ("pos_0p1um", "um", 0.1), ("pos [?m]", "µm", 1), ("pos", "µm", 1),
    ("pos (A0)", "µm", 1), ("fActPosUm", "um", 1), ("nm", "nm", 1),
])  # fmt: skip
def test_units_of_fieldbuses_and_damaged_ones_are_read(tmp_path, label, unit, scale):
    rig = of_a_rig(400)  # without a unit the size of the noise says it
    rows = np.column_stack([rig["t"], 1e6 * rig["y"], rig["u"]])
    np.savetxt(tmp_path / "log.dat", rows, "%.9g", ",", comments="", header=f"t,{label},u")
    y = ChannelMap.from_toml(guess(tmp_path / "log.dat")).signals["y"]
    assert (y.unit, y.scale) == (unit, scale)


def test_a_refusal_says_what_hides_the_motion(tmp_path):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.choice([0.02, 0.02, 0.05], 600))
    y = np.round(1.3 + 0.05 * np.sin(t), 2)
    np.savetxt(tmp_path / "log.csv", np.column_stack([t, y, y / 60]), "%.9g", ",")
    with pytest.raises(RecordError, match=r"steps of column 0 range from 0\.02 to 0\.05") as raised:
        guess(tmp_path / "log.csv")
    assert "column 2 holds the same numbers as column 1; column 1 takes 11 values" in str(
        raised.value
    )


def test_there_is_no_reference_without_a_position(tmp_path):
    rig = of_a_rig(400)
    rows = np.column_stack([rig["t"], rig["r"], rig["u"]])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header="t,w,u")
    assert "r" not in names_of(guess(tmp_path / "log.csv"))
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header="t,soll,u")
    with pytest.raises(RecordError, match="refused"):
        guess(tmp_path / "log.csv")


def test_physics_go_before_names(tmp_path):
    rig = of_a_rig() | {"false": np.round(np.random.default_rng(3).normal(size=3000), 3)}
    log = "\n".join(["time,position,probe,current", *(
        f"{t!r},{a!r},{y!r},{i!r}" for t, a, y, i in
        zip(*(rig[of].tolist() for of in ("t", "false", "y", "i")), strict=True)
    )])  # fmt: skip
    (tmp_path / "log.csv").write_text(log + "\n")
    text = guess(tmp_path / "log.csv")
    assert names_of(text)["y"] == "probe"
    assert "named like a position, but probe moves with current as a levitated rotor does" in text


def test_a_control_is_no_copy_of_the_position(tmp_path):
    rig = of_a_rig(400)
    rows = zip(rig["t"].tolist(), rig["y"].tolist(), strict=True)
    text = "\n".join(["t,y,u", *(f"{t!r},{y!r},{2 - 3e3 * y!r}" for t, y in rows)])
    (tmp_path / "log.csv").write_text(text + "\n")
    assert "u" not in names_of(guess(tmp_path / "log.csv"))


@pytest.mark.parametrize(("above", "row", "wanted"), [
    (["# Ts: 0.01s", "# Columnas: t y i", "#"], "{}\t{}\t{}", "t y i"),
    (["% 1: time (s)  2: rotor displacement (um)  3: coil command (A)"], "{} {} {}",
     "time,rotor displacement,coil command"),
    (["% t x i", "% s um A"], "{} {} {}", "t x i"),
    (["Levitator v2"], "ms:{},pos:{},cur:{}", "ms pos cur"),
    ([], "millis: {}\tgap_mm: {}\tI_mA: {}", "millis gap_mm I_mA"),
    ([], "T={} Hall={} PWM={}", "T Hall PWM"),
])  # fmt: skip
def test_names_of_comments_and_in_each_line_are_read(tmp_path, above, row, wanted):
    rig = of_a_rig(400)
    rows = zip(np.arange(400), 1e6 * rig["y"], rig["u"], strict=True)
    lines = [*above, *(row.format(*(f"{v:.6g}" for v in values)) for values in rows)]
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    names = wanted.split("," if "," in wanted else None)
    assert names_of(guess(tmp_path / "log.txt")) == dict(zip("tyu", names, strict=True))


def test_the_colour_of_the_noise_tells_a_reading_from_its_control():
    """A controller that is fed with an estimate passes on little of what is fast."""
    load = ambkit.Scenario(
        duration=0.6, seed=13, disturbance=ambkit.Sine(amplitude=1, frequency=11)
    )
    run = ambkit.simulate(ambkit.preset("zittau_axial"), load).record
    y, u = (Candidate(name, {}, run[name]) for name in "yu")
    assert feeds(y, u)
    assert not feeds(u, y)


@pytest.mark.parametrize("seed", range(4))
def test_two_white_noises_do_not_tell_a_reading_from_its_control_by_colour(seed):
    load = ambkit.Scenario(controller={"feedback": "measurement"}, duration=0.1, seed=seed)
    run = ambkit.simulate(Path(__file__).parents[1] / "examples/spindle.toml", load, None).record
    y, u = (Candidate(name, {}, run[name]) for name in "yu")
    assert (feeds(y, u), feeds(u, y)) == (True, False)


def test_a_clock_without_jumps_goes_first(tmp_path):
    t = 1e-3 * np.arange(500)
    logged = np.where(t > 0.2, t + 0.05, t)
    rows = np.column_stack([logged, t, np.sin(20 * t), np.cos(20 * t)])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", comments="", header="time,clock,y,u")
    assert names_of(guess(tmp_path / "log.csv"))["t"] == "clock"


def test_a_position_without_noise_is_said_to_be_no_reading(tmp_path):
    t = 1e-3 * np.arange(600)
    noise = 0.01 * np.random.default_rng(2).normal(size=t.size)
    for y, said in ((np.sin(20 * t), True), (np.sin(20 * t) + noise, False)):
        rows = np.column_stack([t, y, np.cos(20 * t) + noise])
        np.savetxt(tmp_path / "log.csv", rows, "%.15g", ",", comments="", header="t,y,u")
        assert ("It has no noise" in guess(tmp_path / "log.csv")) == said
