"""The bearing: presets, what its values mean, and what it refuses."""

import doctest
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from machine_cases import BEARINGS

import ambkit
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.identification.forces.lift_off import fit_lift_off, load_points
from ambkit.machine import parts as parts_module
from ambkit.machine import presets
from ambkit.machine.loading import levitation_current_at
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.machine.parts import GRAVITY, MU_0, Amplifier, Magnet, Sensor, magnet_constant

SIX_MISTAKES = """\
name = "mine"
sampling_time = "0.1 s/V"

[magnet]
type = "two-sided"
magnet_constant = "6.7 N mm^2/A^2"
airgap = "2 mm"
bias_current = "1.5 A"

[rotor]
mass = "-0.5 kg"
gravity = -x
clearance = 0.001

[amplifier]
gain = "1 A/V"
current_limit = "2 A"
noise_variance = "8e-5 V^2"

[sensor]
gain = 1
lag = "0.2 ms"
noise_variance = "83 µm^2"
"""


@pytest.fixture
def zittau():
    return Machine.preset("zittau_axial")


def test_six_mistakes_are_reported_at_once_in_order():
    with pytest.raises(ConfigError) as caught:
        Machine.from_toml(SIX_MISTAKES, "mine.toml")
    assert str(caught.value).splitlines() == [
        "6 problems in mine.toml:",
        '  mine.toml:2: sampling_time: "0.1 s/V": s/V cannot be converted to s,'
        ' write it like "0.1 ms"',
        "  mine.toml:7: magnet.airgap: unknown key, did you mean air_gap?",
        "  mine.toml:11: rotor.mass: must be greater than 0 kg, is -0.5 kg",
        '  mine.toml:12: gravity: write it in quotes: gravity = "-x"',
        '  mine.toml:13: rotor.clearance: 0.001 has no unit, write it like "0.2 mm"',
        "  mine.toml:17: amplifier.current_limit: must be at most magnet.bias_current, 1.5 A,"
        " with a two-sided magnet; is 2 A",
    ]


def test_the_papers_bearing_has_the_papers_values(zittau):
    assert zittau.magnet == Magnet(
        type="two-sided", magnet_constant=6.7e-6, air_gap=2e-3, bias_current=1.5
    )
    assert (zittau.rotor.mass, zittau.rotor.gravity) == (0.518, "-x")
    assert zittau.amplifier.noise_variance == 8e-5
    assert zittau.sensor.noise_variance == 8.3e-11
    assert math.sqrt(zittau.sensor.noise_variance) == pytest.approx(9.1e-6, rel=2e-3)
    assert zittau.weight == pytest.approx(-5.08, abs=0.005)


def test_what_the_paper_does_not_give_is_marked_as_chosen():
    text = presets.text("zittau_axial")
    chosen = ("sampling_time", "gravity", "clearance", "gain", "current_limit", "lag")
    for line in text.splitlines():
        if line.partition("=")[0].strip() in chosen:
            assert "chosen" in line, line


def test_preset_files_are_named_after_their_bearing_and_listed():
    assert set(BEARINGS) >= {"zittau_axial", "inteco_ml"}
    for name in BEARINGS:
        assert Machine.preset(name).name == name


def test_an_unknown_preset_names_the_nearest():
    with pytest.raises(AmbkitError, match=r'no preset "zitau_axial"; did you mean zittau_axial\?'):
        Machine.preset("zitau_axial")
    with pytest.raises(AmbkitError, match=r"there are: compressor, .*zittau_axial"):
        presets.text("../bearing")


@pytest.mark.parametrize("name", BEARINGS)
def test_the_levitation_current_carries_the_rotor(name):
    bearing = Machine.preset(name)
    magnet, iu = bearing.magnet, bearing.levitation_current
    pull = magnet.magnet_constant * ((magnet.bias_current + iu) / magnet.air_gap) ** 2
    if magnet.type == "two-sided":
        pull -= magnet.magnet_constant * ((magnet.bias_current - iu) / magnet.air_gap) ** 2
    assert pull == pytest.approx(-bearing.weight, rel=1e-12)
    assert bearing.current_min < iu < bearing.current_max


@pytest.mark.parametrize("load", [-1e4, 1e4])
def test_a_load_beyond_all_currents_gets_the_one_that_comes_closest(load):
    bearing = Machine.preset("zittau_axial")
    ends = (bearing.current_min, bearing.current_max)
    left = [abs(magnet_of(bearing).force(iu, 0.0) + bearing.weight + load) for iu in ends]
    assert levitation_current_at(bearing, load=load) == ends[int(np.argmin(left))]


def test_the_one_sided_rig_rests_at_its_operating_point_without_control_current():
    rig = Machine.preset("inteco_ml")
    assert abs(rig.levitation_current) < 1e-4 * rig.magnet.bias_current
    assert rig.current_min == -rig.magnet.bias_current
    assert rig.current_max == rig.amplifier.current_limit


def test_the_one_sided_rig_has_the_law_of_its_lift_off_points():
    points = load_points(Path(__file__).parent.parent / "examples/recordings/lift_off_points.csv")
    rig = Machine.preset("inteco_ml")
    fit = fit_lift_off(points, rig.rotor.mass, gap_range=(4e-3, 16e-3))
    gap, bias = fit.operating_point(10e-3)
    assert rig.magnet.magnet_constant == pytest.approx(fit.magnet_constant, rel=1e-4)
    assert rig.magnet.air_gap == pytest.approx(gap, rel=1e-4)
    assert rig.magnet.bias_current == pytest.approx(bias, rel=1e-4)


@pytest.mark.parametrize(("angle", "share"), [("0 deg", -1), ("45 deg", -(0.5**0.5)),
                                              ("60 deg", -0.5), ("90 deg", 0), ("180 deg", 1),
                                              (np.pi / 3, -0.5)])  # fmt: skip
def test_gravity_at_an_angle_pulls_by_its_cosine(zittau, angle, share):
    slanted = zittau.replace(rotor__gravity=angle)
    assert slanted.weight == pytest.approx(share * zittau.rotor.mass * GRAVITY, abs=1e-12)
    assert Machine.from_toml(slanted.to_toml()) == slanted
    held = magnet_of(slanted).force(slanted.levitation_current, 0.0)
    assert float(held) == pytest.approx(-slanted.weight, abs=1e-9)


def test_a_slanted_bearing_s_load_is_reported_from_its_weight(zittau):
    slanted = zittau.replace(rotor__gravity="45 deg")
    run = ambkit.simulate(slanted, step="0.2 mm", filter="extended")
    assert run.estimate.f_d[1000:].mean() == pytest.approx(0, abs=0.05)  # of 3.6 N of weight


@pytest.mark.parametrize(("gravity", "message"), [
    ("down", 'must be "-x", "+x", "none" or like "45 deg", is "down"'),
    ("50 mm", '"50 mm": mm cannot be converted to rad, write it like "45 deg"'),
    (True, 'true is not a number, write it like "45 deg"'),
])  # fmt: skip
def test_what_is_no_direction_of_gravity_is_reported(zittau, gravity, message):
    with pytest.raises(ConfigError) as error:
        zittau.replace(rotor__gravity=gravity)
    assert f"rotor.gravity: {message}" in str(error.value)


def test_gravity_gives_the_weight_its_sign(zittau):
    assert zittau.replace(rotor__gravity="+x").weight == -zittau.weight
    level = zittau.replace(rotor__gravity="none")
    assert level.weight == 0
    assert level.levitation_current == 0


COIL = 'turns = 200\npole_area = "400 mm^2"'


def with_magnet(zittau, lines):
    text = zittau.to_toml().replace('magnet_constant = "6.7 N mm^2/A^2"', lines)
    return Machine.from_toml(text, "b.toml")


def test_the_magnet_constant_follows_from_the_coil(zittau):
    bearing = with_magnet(zittau, COIL)
    assert bearing.magnet.magnet_constant == magnet_constant(200, 400e-6)
    assert bearing.magnet.magnet_constant == MU_0 * 400e-6 * 200**2 / 4
    assert "magnet_constant" not in bearing.to_toml()
    assert "drawing" not in bearing.to_toml()
    assert Machine.from_toml(bearing.to_toml()) == bearing
    assert bearing.replace(magnet__turns=400).magnet.magnet_constant == magnet_constant(400, 400e-6)
    assert Magnet(
        type="two-sided", turns=200, pole_area="400 mm^2", air_gap=2e-3, bias_current=1.5
    ).magnet_constant == magnet_constant(200, 400e-6)


def test_mu_0_is_that_of_scipy():
    from scipy.constants import mu_0

    assert pytest.approx(mu_0, rel=1e-9) == MU_0


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("turns = 200", ["b.toml:6: magnet.pole_area: missing: turns alone do not"]),
        ('pole_area = "4 cm^2"', ["b.toml:6: magnet.turns: missing: pole_area alone does not"]),
        ('turns = 200\npole_area = "4 mm"', ["b.toml:9: magnet.pole_area: "]),
        ('turns = 0\npole_area = "4 mm^2"', ["b.toml:8: magnet.turns: must be greater than 0"]),
        (f'{COIL}\nmagnet_constant = "6 N mm^2/A^2"', ["turns and pole_area give 5.02655 N mm^2"]),
        ("", ["b.toml:6: magnet.magnet_constant: missing: magnet constant k"]),
    ],
)
def test_a_magnet_has_either_a_constant_or_a_coil(zittau, lines, message):
    with pytest.raises(ConfigError) as caught:
        with_magnet(zittau, lines)
    assert len(caught.value.problems) == len(message)
    for problem, part in zip(caught.value.problems, message, strict=True):
        assert part in problem


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rotor.clearance": 2e-3}, "rotor.clearance: must be less than magnet.air_gap, 2 mm"),
        ({"amplifier.current_limit": 1.6}, "must be at most magnet.bias_current, 1.5 A"),
        ({"amplifier.current_limit": 0.5}, "must be at least 0.50563 A, which carries the rotor"),
        ({"magnet.type": "one-sided", "rotor.gravity": "none"}, 'rotor.gravity: must be "-x"'),
        ({"magnet.air_gap": 0}, "magnet.air_gap: must be greater than 0 m, is 0 m"),
        ({"sampling_time": 0}, "sampling_time: must be greater than 0 s"),
        ({"sensor.noise_variance": 0}, "sensor.noise_variance: must be greater than 0 m^2"),
        ({"sensor.noise_variance": -1e-12}, "must be greater than 0 m^2, is -1 µm^2"),
        ({"amplifier.noise_variance": -1}, "amplifier.noise_variance: must be greater than 0 V^2"),
        ({"rotor.mass": math.nan}, "rotor.mass: must be finite"),
        ({"rotor.mass": math.inf}, "rotor.mass: must be finite"),
        ({"rotor.mass": None}, "rotor.mass: null is not a number"),
        ({"sensor.lag": -1e-3}, "sensor.lag: must be greater than 0 s, is -1 ms"),
    ],
)
def test_what_cannot_be_is_refused(zittau, change, message):
    with pytest.raises(ConfigError) as caught:
        zittau.replace(**change)
    assert message in str(caught.value)
    assert len(caught.value.problems) == 1


def test_contradictions_are_reported_beside_other_mistakes(zittau):
    """The gap is compared although the same table has an unknown key and a wrong one."""
    text = zittau.to_toml().replace('"1 mm"', '"3 mm"').replace("bias_current", "bias")
    with pytest.raises(ConfigError) as caught:
        Machine.from_toml(text, "b.toml")
    assert "must be less than magnet.air_gap, 2 mm; is 3 mm" in str(caught.value)
    assert "magnet.bias: unknown key, did you mean bias_current?" in str(caught.value)


def positive(greatest=1e3):
    return st.floats(1e-9, greatest)


@st.composite
def bearings(draw):
    """Any bearing that can be: the limits between its values held by construction."""
    kind = draw(st.sampled_from(["two-sided", "one-sided"]))
    gap, bias, mass = draw(positive()), draw(positive()), draw(positive())
    least = 4 * 9.81 * mass * gap**2 / bias**2
    magnet = Magnet(
        type=kind,
        magnet_constant=draw(st.floats(1.1 * least, 1e6 * least)),
        air_gap=gap,
        bias_current=bias,
    )
    rotor = dict(mass=mass, gravity="-x", clearance=gap * draw(st.floats(0.01, 0.99)))
    amplifier = Amplifier(
        gain=draw(positive()), current_limit=bias, noise_variance=draw(positive())
    )
    sensor = Sensor(gain=draw(positive()), lag=draw(positive()), noise_variance=draw(positive()))
    text = st.text(st.characters(exclude_categories=["Cs", "Cc"], include_characters="\t\n"))
    line = st.text(
        st.characters(categories=["L", "M", "N", "P", "S", "Zs"]), min_size=1, max_size=80
    )
    return Machine(
        name=draw(line),
        description=draw(text),
        source=draw(text),
        sampling_time=draw(positive()),
        magnet=magnet,
        rotor=rotor,
        amplifier=amplifier,
        sensor=sensor,
    )


@given(bearings())
def test_toml_round_trip_is_the_identity(bearing):
    assert Machine.from_toml(bearing.to_toml()) == bearing
    assert pickle.loads(pickle.dumps(bearing)) == bearing
    assert bearing.replace() == bearing


any_positive = st.floats(min_value=5e-324, allow_nan=False, allow_infinity=False)


@given(
    st.sampled_from(["two-sided", "one-sided"]),
    st.fixed_dictionaries(
        dict.fromkeys(["magnet_constant", "air_gap", "bias_current"], any_positive)
    ),
    any_positive,
    any_positive,
)
@example(
    "one-sided", {"magnet_constant": 3.25e-83, "air_gap": 197.0, "bias_current": 1.0}, 2.2e-311, 1.0
)
def test_absurd_values_are_refused_or_taken_but_never_a_traceback(kind, magnet, mass, limit):
    data = Machine.preset("zittau_axial").model_dump()
    data["magnet"] |= magnet | {"type": kind}
    data["rotor"]["mass"], data["amplifier"]["current_limit"] = mass, limit
    try:
        bearing = Machine(**data)
    except ConfigError as error:
        assert error.problems  # noqa: PT017
    else:
        assert abs(bearing.levitation_current) <= limit


def test_the_json_schema_knows_both_ways_to_give_the_magnet():
    magnet = Machine.json_schema()["$defs"]["Magnet"]
    assert magnet["required"] == ["type", "air_gap", "bias_current"]
    assert magnet["oneOf"] == [
        {"required": ["magnet_constant"]},
        {"required": ["turns", "pole_area"]},
    ]


def test_docstring_examples():
    assert doctest.testmod(parts_module).failed == 0


# ---- What a bearing can have beside ----

PARTS = """\

[stop]
stiffness = "1e8 N/m^1.5"
damping = "0.3 s/m"

[[sensor.runout]]
order = 1
amplitude = "3 µm"
phase = "30 deg"

[[sensor.runout]]
order = 2
amplitude = "1 µm"

[[sensor.hum]]
frequency = "50 Hz"
amplitude = "5 µm"
bandwidth = "0.5 Hz"

[sensor.coloured_noise]
variance = "1 µm^2"
bandwidth = "200 Hz"
"""


def with_parts(*changes, parts=PARTS):
    """The paper's bearing with parts, and with lines put behind others or instead of them."""
    text = presets.text("zittau_axial")
    text = text.replace("[magnet]", 'delay = "0.15 ms"\nspeed = "12000 rpm"\n\n[magnet]')
    amplifier = 'bandwidth = "2 kHz"\nvoltage_limit = "50 V"\nresistance = "2 ohm"'
    text = text.replace("[amplifier]", f"[amplifier]\n{amplifier}")
    sensor = 'quantisation = "0.5 µm"\nquadratic = "20 1/m"\ncubic = "1e4 1/m^2"'
    text = text.replace("[sensor]", f"[sensor]\n{sensor}") + parts
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def problems(text):
    with pytest.raises(ConfigError) as caught:
        Machine.from_toml(text, "mine.toml")
    return [line.strip() for line in str(caught.value).splitlines() if "mine.toml:" in line]


def line_of(text, key):
    return next(n for n, line in enumerate(text.splitlines(), 1) if line.startswith(key))


def test_parts_are_read_with_their_units_and_written_back():
    bearing = Machine.from_toml(with_parts())
    assert bearing.delay == 0.15e-3
    assert bearing.speed == pytest.approx(400 * math.pi, rel=1e-15)
    assert bearing.amplifier.bandwidth == 2e3
    assert (bearing.amplifier.voltage_limit, bearing.amplifier.resistance) == (50.0, 2.0)
    assert (bearing.sensor.quantisation, bearing.sensor.quadratic) == (0.5e-6, 20.0)
    assert [line.order for line in bearing.sensor.runout] == [1, 2]
    assert bearing.sensor.runout[0].phase == pytest.approx(math.pi / 6, rel=1e-15)
    assert bearing.sensor.hum[0].bandwidth == 0.5
    assert bearing.sensor.coloured_noise is not None
    assert (bearing.stop.stiffness, bearing.stop.damping) == (1e8, 0.3)
    assert Machine.from_toml(bearing.to_toml()) == bearing


def test_a_bearing_without_parts_is_written_without_them(zittau):
    assert list(zittau.model_dump(exclude_none=True)["sensor"]) == ["gain", "lag", "noise_variance"]
    new = ("delay", "speed", "bandwidth", "quant", "quadratic", "cubic", "hum", "runout", "stop")
    keys = {line.partition(" ")[0].strip("[]") for line in zittau.to_toml().splitlines()}
    assert not keys & set(new)


@pytest.mark.parametrize(
    ("changes", "key", "text"),
    [
        (
            [('voltage_limit = "50 V"', 'voltage_limit = "6 V"')],
            "voltage_limit",
            "amplifier.voltage_limit: must be greater than 6 V, which the greatest coil current"
            " needs at rest; is 6 V",
        ),
        (
            [('bandwidth = "2 kHz"\n', "")],
            "[amplifier]",
            "amplifier.bandwidth: missing: voltage_limit limits what the current follows with",
        ),
        (
            [('resistance = "2 ohm"\n', "")],
            "[amplifier]",
            "amplifier.resistance: missing: voltage_limit alone does not give the current's slew",
        ),
        (
            [('delay = "0.15 ms"', 'delay = "1.7 ms"')],
            "delay",
            "delay: must be at most 16 samples, 1.6 ms; is 1.7 ms",
        ),
        (
            [('speed = "12000 rpm"\n', "")],
            "#",
            "speed: missing: sensor.runout is at multiples of it",
        ),
        (
            [('speed = "12000 rpm"', 'speed = "200 Hz"')],
            "speed",
            'speed: "200 Hz": Hz cannot be converted to rad/s, write it like "12000 rpm"',
        ),
        (
            [("order = 2", "order = 6")],
            "order = 6",
            "sensor.runout[1].order: must be less than or equal to 5, is 6",
        ),
        (
            [('speed = "12000 rpm"', 'speed = "150000 rpm"')],
            "order = 2",
            "sensor.runout[1].order: 2 times the speed is 5000 Hz, must be less than half the"
            " sampling frequency, 5000 Hz",
        ),
        (
            [('frequency = "50 Hz"', 'frequency = "5 kHz"')],
            "frequency",
            "sensor.hum[0].frequency: must be less than half the sampling frequency, 5000 Hz; is"
            " 5000 Hz",
        ),
        (
            [('stiffness = "1e8 N/m^1.5"', 'stiffness = "1e8 N/m"')],
            "stiffness",
            'stop.stiffness: "1e8 N/m": N/m cannot be converted to N/m^1.5, write it like'
            ' "1e8 N/m^1.5"',
        ),
        (
            [('damping = "0.3 s/m"', 'bounce = "0.8"')],
            "bounce",
            "stop.bounce: unknown key, known here: stiffness, damping, friction, radius",
        ),
        (
            [('variance = "1 µm^2"\n', "")],
            "[sensor.coloured_noise]",
            'sensor.coloured_noise.variance: missing: variance [m^2], such as "1 µm^2"',
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_part_is_reported_with_its_line(changes, key, text):
    toml = with_parts(*changes)
    assert problems(toml) == [f"mine.toml:{line_of(toml, key)}: {text}"]
