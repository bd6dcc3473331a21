"""Flexible rotors: beams against theory and against ROSS, matrices in files, measured modes."""

import dataclasses
import math
import runpy
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from ambkit import AmbkitError, ConfigError, Machine, mode_shapes
from ambkit.base.errors import RecordError
from ambkit.machine import presets
from ambkit.machine.rotors import beam
from ambkit.machine.rotors.matrix_file import read_matrices
from ambkit.machine.rotors.modes import body_of, reduced
from ambkit.rotordynamics import machine_report
from ambkit.workflow.check import inspect

ROSS = Path(__file__).parents[1] / "examples" / "flexible" / "ross_amb.npz"
STEEL = {"density": 7850.0, "youngs": 2.1e11, "poisson": 0.3}
HERTZ = 2 * math.pi


def uniform(length, outer, inner=0.0, count=40):
    return beam.assemble([beam.Element(length / count, outer, inner, **STEEL)] * count, [])


def frequencies(matrices, count):
    """Free bending frequencies [rad/s]."""
    return np.sqrt(matrices.free_modes[0][:count])


# ---- beams ----


def test_a_thin_beam_is_euler_s():
    """cos(b) cosh(b) = 1 of a free beam."""
    roots = [brentq(lambda b: math.cos(b) - 1 / math.cosh(b), k * math.pi + 0.5, k * math.pi + 2.5)
             for k in (1, 2, 3, 4)]  # fmt: skip
    length, outer = 1.0, 1e-3
    own = math.sqrt(STEEL["youngs"] / STEEL["density"]) * outer / 4
    expected = np.array(roots) ** 2 * own / length**2
    np.testing.assert_allclose(frequencies(uniform(length, outer), 4), expected, rtol=2e-5)


def timoshenko(length, outer, inner, w):
    """Determinant of a free beam by Timoshenko's equations: zero at its frequencies.

    By the exact solution of the four first-order equations over the length (transfer matrix).
    """
    from scipy.linalg import expm

    one = beam.Element(length, outer, inner, **STEEL)
    A, moment = one.area, one.second_moment
    E, rho = one.youngs, one.density
    kGA = 12 * E * moment / (one.shear * length**2)
    # w' = th + Q/kGA, th' = M/EI, M' = Q - rho I w^2 th ... by the balance of a slice
    slice_ = np.array([
        [0, 1, 0, 1 / kGA], [0, 0, 1 / (E * moment), 0],
        [0, -rho * moment * w**2, 0, -1], [-rho * A * w**2, 0, 0, 0],
    ])  # fmt: skip
    across = expm(slice_ * length)
    return float(np.linalg.det(across[2:, :2]))


@pytest.mark.parametrize("inner", [0.0, 0.06])
def test_a_thick_beam_is_timoshenko_s(inner):
    found = frequencies(uniform(0.5, 0.1, inner, count=200), 4)
    for w in found:
        low, high = (timoshenko(0.5, 0.1, inner, w * (1 + share)) for share in (-2e-4, 2e-4))
        assert low * high < 0
    thin = math.sqrt(STEEL["youngs"] / STEEL["density"]) * math.hypot(0.1, inner) / 4
    assert found[0] < 0.95 * 4.73004**2 * thin / 0.5**2  # shear and rotary inertia count here


def test_a_section_is_divided_where_discs_are():
    one = beam.Element(1.0, 0.02, 0.0, **STEEL)
    elements = beam.divided([one, one], [0.37, 1.2])
    ends = np.cumsum([each.length for each in elements])
    for cut in (0.37, 1.0, 1.2, 2.0):
        assert np.abs(ends - cut).min() < 1e-12
    assert len(elements) >= beam.FINEST
    assert max(each.length for each in elements) <= 2.0 / beam.FINEST * (1 + 1e-9)


# ---- ROSS ----


def ufu(laminations):
    """The elements of ROSS's example, one for one, as its source has them."""
    ends = np.array([
        0, 12, 32, 52, 72, 92, 112, 120.8, 127.2, 134.8, 140.5, 146.9, 153, 159.2, 165.3, 180.4,
        190.5, 206.3, 222.1, 237.9, 253.7, 269.5, 285.3, 301.1, 316.9, 324.3, 336.3, 358, 364,
        370.5, 382.5, 398.6, 414.7, 430.8, 446.9, 463, 479.1, 495.2, 511.3, 527.4, 535.6, 545.7,
        560.7, 566.9, 573.1, 579.2, 585.6, 591.3, 598.9, 605.3, 614.1, 634.1, 646.1,
    ]) / 1e3  # fmt: skip
    outer = [6.35, *[32] * 4, *[34.8] * 9, *[49.9] * 2, *[19.05] * 11, *[54] * 2, *[19.05] * 11,
             *[49.9] * 2, *[34.8] * 9, 6.35]  # fmt: skip
    elements = [
        beam.Element(float(length), d / 1e3, 0.0, 7850.0, 1.9e11, 0.3)
        for length, d in zip(np.diff(ends), outer, strict=True)
    ]

    def disc(node, width, inner, out, density):
        mass = density * math.pi * width * (out**2 - inner**2) / 4
        across = mass * (out**2 + inner**2) / 16 + mass * width**2 / 12
        return beam.Disc(float(ends[node]), mass, across, mass * (out**2 + inner**2) / 8)

    at = [*range(6, 14), *range(43, 51)]
    widths = [8.8, 6.4, 7.5, 5.7, 6.4, 6.1, 6.2, 6.2]
    discs = [disc(n, w, 0.054, 0.12, 7850.0) for n, w in ((27, 4e-3), (28, 7e-3), (29, 14e-3))]
    discs += [
        disc(n, w / 1e3, 0.0348, 0.0498, laminations)
        for n, w in zip(at, widths + widths[::-1], strict=True)
    ]
    return beam.assemble(elements, discs)


def test_matrices_are_those_of_ross():
    """The file was written by ROSS 2.3 itself, with examples/flexible/from_ross.py."""
    theirs, ours = read_matrices(ROSS), ufu(7600.0)
    for name in "MKG":
        a, b = getattr(ours, name), getattr(theirs, name)
        size = np.sqrt(np.outer(np.diag(b), np.diag(b)))
        assert np.abs((a - b) / size).max() < 1e-11
    np.testing.assert_allclose(frequencies(ours, 5), frequencies(theirs, 5), rtol=1e-9)
    assert theirs.D is not None


def test_the_preset_s_free_modes():
    one = Machine.preset("ufu_flexible")
    np.testing.assert_allclose(one.bending.frequency[:2] / HERTZ, [104.19, 400.28], atol=6e-3)
    rigid = Machine.preset("ufu_rig")
    assert one.rotor.mass == pytest.approx(rigid.rotor.mass, rel=1e-6)
    for inertia in ("transverse_inertia", "polar_inertia"):
        own, other = (getattr(each.rotor, inertia) for each in (one, rigid))
        assert own == pytest.approx(other, rel=1e-5)
    for axis, other in zip(one.axes, rigid.axes, strict=True):
        assert axis.line.place == pytest.approx(other.line.place, abs=2e-6)


# ---- reduction ----


def test_a_reduced_rotor_has_the_compliance_of_the_whole():
    """At a frequency far below what is left out: against the whole matrices."""
    whole = ufu(7700.0)
    places = [0.153, 0.5669]
    nodes = [2 * int(np.argmin(np.abs(whole.place - z))) for z in places]
    w = HERTZ * 250.0
    full = np.linalg.inv(whole.K - w**2 * whole.M)[np.ix_(nodes, nodes)]
    body = body_of(whole)

    def told(**keys):
        found = reduced(whole, HERTZ * 500.0, 0.01, **keys)
        rows = np.array([[1, z - body.centre, *found.shape(z)] for z in places])
        stiff = np.concatenate([[0.0, 0.0], found.stiffness])
        mass = np.concatenate([[body.mass, body.transverse_inertia], found.mass])
        return np.asarray((rows / (stiff - w**2 * mass)) @ rows.T)

    cut, kept = told(), told(attachments=places)
    size = np.abs(full).max()
    assert np.abs(cut - full).max() > 1e-3 * size
    assert np.abs(kept - full).max() < 1e-3 * np.abs(cut - full).max() + 1e-12 * size


def test_the_static_compliance_left_out_is_reported():
    whole = ufu(7700.0)
    places = [0.153, 0.5669]
    part = reduced(whole, HERTZ * 500.0, 0.01)
    more = reduced(whole, HERTZ * 1e6, 0.01)
    rows = np.array([more.shape(z) for z in places])[:, 2:]
    expected = (rows / more.stiffness[2:]) @ rows.T
    assert part.residual is not None
    np.testing.assert_allclose(part.residual(places), expected, rtol=1e-9)


def test_modes_are_orthogonal_to_the_rigid_body_and_of_its_scale():
    whole = ufu(7700.0)
    found = reduced(whole, HERTZ * 3000.0, 0.004)
    assert len(found.frequency) == 5
    shape = np.array([found.shape(z) for z in np.linspace(*found.ends, 2001)])
    np.testing.assert_allclose(np.abs(shape).max(axis=0), 1, rtol=0.01)
    np.testing.assert_allclose(found.damping_ratio, 0.004, rtol=1e-12)
    np.testing.assert_allclose(found.polar, found.polar.T)
    assert found.polar[0, 0] == pytest.approx(body_of(whole).polar_inertia)


def test_damping_of_matrices_is_taken_where_no_ratio_is_given():
    whole = ufu(7700.0)
    proportional = beam.Matrices(
        whole.M, whole.K, whole.G, 3.0 * whole.M + 1e-5 * whole.K, whole.place, whole.shear
    )
    found = reduced(proportional, HERTZ * 500.0, None)
    expected = 3.0 / (2 * found.frequency) + 1e-5 * found.frequency / 2
    np.testing.assert_allclose(found.damping_ratio, expected, rtol=1e-6)
    with pytest.raises(ValueError, match="no damping of the modes is given"):
        reduced(whole, HERTZ * 500.0, None)


# ---- files of matrices ----


def content(**changes):
    with np.load(ROSS) as found:
        given = {name: found[name] for name in found.files}
    return {name: each for name, each in (given | changes).items() if each is not None}


def saved(path, **changes):
    np.savez(path, **content(**changes))
    return path


def test_units_and_order_of_a_file_do_not_matter(tmp_path):
    """Millimetres and tonnes, rows and nodes in any order: the same rotor, to what rounding does.

    The eigenvalues of a beam of 53 nodes reach over 10 decades.
    """
    given, rng = content(), np.random.default_rng(5)
    turns = np.array([each.startswith("th") for each in given["direction"]])
    scale = np.where(turns, 1e3, 1.0)
    mixed = rng.permutation(len(turns))
    nodes = rng.permutation(len(given["place"]))
    changes = {
        name: (given[name] * np.outer(scale, scale) * 1e-3)[np.ix_(mixed, mixed)] for name in "MKGD"
    }
    changes |= {
        "direction": given["direction"][mixed], "unit_of_length": "mm", "unit_of_mass": "t",
        "node": np.argsort(nodes)[given["node"]][mixed], "place": given["place"][nodes] * 1e3,
    }  # fmt: skip
    first, second = read_matrices(ROSS), read_matrices(saved(tmp_path / "mm.npz", **changes))
    one, other = (reduced(each, HERTZ * 1000.0, 0.004) for each in (first, second))
    np.testing.assert_allclose(other.frequency, one.frequency, rtol=1e-9)
    np.testing.assert_allclose(other.mass, one.mass, rtol=1e-9)
    np.testing.assert_allclose(np.abs(other.shape(0.2)), np.abs(one.shape(0.2)), rtol=1e-9)
    np.testing.assert_allclose(other.polar[0, 0], one.polar[0, 0], rtol=1e-12)


def test_a_mat_file_is_read_as_well(tmp_path):
    from scipy.io import savemat

    given = content()
    cells = np.array(given["direction"].tolist(), dtype=object)
    savemat(tmp_path / "a.mat", given | {"direction": cells})
    savemat(tmp_path / "b.mat", given)  # rows of characters
    for name in ("a.mat", "b.mat"):
        np.testing.assert_array_equal(read_matrices(tmp_path / name).K, read_matrices(ROSS).K)


class Bad:
    """What a pickle would run."""

    def __reduce__(self):
        return (exec, ("raise SystemExit('run by a pickle')",))


@pytest.mark.parametrize(("changes", "text"), [
    ({"M": None}, "has no M; it holds"),
    ({"unit_of_length": None}, 'has no unit_of_length, such as "m"'),
    ({"unit_of_mass": "m"}, "m cannot be converted to kg"),
    ({"source": np.array([Bad()], dtype=object)}, "holds Python objects (a pickle)"),
    ({"M": np.full((318, 318), np.nan)}, "M must be finite"),
    ({"K": np.eye(3)}, "K must be 318 by 318, as direction has it; is 3 by 3"),
    ({"direction": np.array(["up"] * 318)}, "direction must be some of x, y, z, th_x"),
    ({"node": np.arange(318)}, "node must be 318 whole numbers from 0 to 52"),
    ({"place": np.zeros(53)}, "place must be of nodes apart"),
    ({"M": np.array([["a"]])}, "M must be of real numbers"),
    ({"G": -content()["G"]}, "G has the sign of a rotation from y to x"),
    ({"K": content()["K"] + np.eye(318) * 1e6}, "must leave the rotor free, without bearings"),
    ({"K": content()["K"] + np.diag(np.arange(318) % 6 == 0) * 1e6}, "the same in the x and the y"),
])  # fmt: skip
def test_hostile_files_are_refused(changes, text, tmp_path):
    path = saved(tmp_path / "rotor.npz", **changes)
    toml = machine_of("matrices", f'file = "{path.name}"\nmodes_up_to = "500 Hz"')
    with pytest.raises(ConfigError) as found:
        Machine.from_toml(toml, "m.toml", tmp_path)
    told = str(found.value)
    assert text in told
    assert "m.toml:" in told
    assert "rotor.file" in told


def test_a_damaged_file_is_refused_or_its_numbers_are_the_same(tmp_path):
    """An archive has bytes that mean nothing to its numbers, such as dates; all others count."""
    content, expected = ROSS.read_bytes(), dataclasses.asdict(read_matrices(ROSS))
    rng = np.random.default_rng(7)
    refused = 0
    for k in range(40):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), 30):
            damaged[at] ^= int(rng.integers(1, 256))
        path = tmp_path / f"{k}.npz"
        cut = content[: int(rng.integers(1, len(content)))]
        path.write_bytes(bytes(damaged) if k % 2 else cut)
        try:
            matrices = dataclasses.asdict(read_matrices(path))
        except RecordError as error:
            refused += str(error).startswith(f"{path}: ")
        else:
            np.testing.assert_equal(matrices, expected)
    assert refused >= 39


def test_a_file_that_lies_about_its_size_is_refused(tmp_path):
    import io
    import zipfile

    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as file:
        file.writestr("M.npy", head.getvalue() + b"12345678")
    with pytest.raises(RecordError, match=r"would take|damaged"):
        read_matrices(tmp_path / "lie.npz")


# ---- descriptions ----

REST = presets.text("ufu_flexible")
REST = REST[REST.index("[[bearing]]") :]


def machine_of(kind, keys):
    """A machine on the bearings of UFU's rig."""
    return (
        'name = "made"\nsampling_time = "0.1 ms"\nspeed = "1200 rpm"\n\n'
        f'[rotor]\ntype = "{kind}"\n{keys}\n\n{REST}'
    )


def test_a_rotor_from_a_file_is_that_of_its_table(tmp_path):
    """ROSS's file has lighter laminations; besides that it is the preset's rotor."""
    path = tmp_path / "ross.npz"
    path.write_bytes(ROSS.read_bytes())
    keys = 'file = "ross.npz"\nmodes_up_to = "1 kHz"\ndamping_ratio = 0.005'
    one = Machine.from_toml(machine_of("matrices", keys), "m.toml", tmp_path)
    text = presets.text("ufu_flexible").replace('"7700 kg/m^3"', '"7600 kg/m^3"')
    other = Machine.from_toml(text)
    # Finer elements, in which the discs are the same points.
    np.testing.assert_allclose(one.bending.frequency, other.bending.frequency, rtol=3e-4)
    np.testing.assert_allclose(one.bending.mass, other.bending.mass, rtol=2e-3)
    assert one.rotor.mass == pytest.approx(other.rotor.mass, rel=1e-9)
    assert Machine.from_toml(one.to_toml(tmp_path), folder=tmp_path) == one


def measured(**changes):
    keys = {
        "mass": '"5.9 kg"', "transverse_inertia": '"0.186 kg m^2"',
        "polar_inertia": '"0.0048 kg m^2"',
    }  # fmt: skip
    mode = {
        "frequency": '"104 Hz"', "damping_ratio": "0.004", "mass": '"1.45 kg"',
        "places": '["-0.3 m", "-0.2 m", "0 m", "0.2 m", "0.6 m"]',
        "shape": "[0.9, 0.15, -0.55, 0.3, 0.95]",
    } | changes  # fmt: skip
    table = "\n".join(f"{key} = {value}" for key, value in keys.items())
    of_mode = "\n".join(f"{key} = {value}" for key, value in mode.items())
    text = machine_of("modes", f"{table}\n\n[[rotor.mode]]\n{of_mode}")
    for of_shaft, of_centre in (("153", "-184.64"), ("566.9", "229.26"), ("364", "26")):
        text = text.replace(f'"{of_shaft} mm"', f'"{of_centre} mm"')
    return text


def test_measured_modes():
    one = Machine.from_toml(measured())
    assert one.positions[-2:] == ("m1_x", "m1_y")
    # As if each deflection were told by where it is largest: the same mode.
    doubled = measured(shape="[1.8, 0.3, -1.1, 0.6, 1.9]", mass='"5.8 kg"')
    other = Machine.from_toml(doubled)
    for a, b in zip(one.axes, other.axes, strict=True):
        assert a.line.shape == pytest.approx(b.line.shape)
    np.testing.assert_allclose(one.masses, other.masses)
    assert one.bending.shape(-0.2) * 0.95 == pytest.approx(0.15)


@pytest.mark.parametrize(("changes", "text"), [
    ({"places": '["-0.1 m", "0 m", "0.1 m", "0.2 m", "0.6 m"]'}, "sensor[0].place: -0.18464 m is"),
    ({"places": '["0.1 m", "0 m", "0.3 m", "0.4 m", "0.6 m"]'}, "places: must increase"),
    ({"shape": "[1, 2]"}, "mode[0].shape: must be 5 numbers, one for each place; is 2"),
    ({"shape": "[0, 0, 0, 0, 0]"}, "must not be 0 everywhere"),
    ({"damping_ratio": "1.5"}, "damping_ratio: must be less than 1"),
    ({"frequency": '"8 kHz"'}, "keeps a mode at 8000 Hz"),
])  # fmt: skip
def test_modes_that_cannot_be_are_reported(changes, text):
    with pytest.raises(ConfigError) as found:
        Machine.from_toml(measured(**changes), "m.toml")
    assert text in str(found.value)


@pytest.mark.parametrize(("old", "new", "text"), [
    ('modes_up_to = "1 kHz"', 'modes_up_to = "50 Hz"',
     "16: rotor.modes_up_to: must be at least 104.188 Hz, the first bending mode"),
    ('modes_up_to = "1 kHz"', 'modes_up_to = "9 kHz"', "the sampling tells frequencies only up to"),
    ("damping_ratio = 0.01", "", "rotor.damping_ratio: missing"),
    ('place = "364 mm", width', 'place = "764 mm", width',
     "33: rotor.disc[1].place: 0.764 m is beyond the shaft, which ends at 0.6461 m"),
    ('place = "566.9 mm"\nangle', 'place = "666.9 mm"\nangle',
     "bearing[1].place: 0.6669 m is beyond the rotor, whose second_end is at 0.6461 m"),
    ('material = "laminations"', 'material = "laminatons"', "rotor.disc[3].material: must be one"),
    ('length = "80 mm"', 'length = "-80 mm"', "21: rotor.section[1].length: must be greater"),
    ('inner_diameter = "54 mm"', 'inner_diameter = "154 mm"', "rotor.disc[0].inner_diameter"),
    ('width = "4 mm", outer', 'mass = "1 kg", width = "4 mm", outer', "rotor.disc[0].width: give"),
    ("poisson_ratio = 0.31", "poisson_ratio = 0.7", "poisson_ratio: must be at most 0.5"),
    ('type = "shaft"', 'type = "shatf"', 'rotor.type: must be one of "rigid", "shaft"'),
    ('type = "shaft"\n', "", "rotor.type: missing"),
])  # fmt: skip
def test_what_cannot_be_is_reported_with_its_line(old, new, text):
    whole = presets.text("ufu_flexible")
    assert old in whole
    with pytest.raises(ConfigError) as found:
        Machine.from_toml(whole.replace(old, new, 1), "m.toml")
    assert text in str(found.value)


def nodes_of(one, mode):
    """Places at which a mode does not move [m]."""
    places = np.linspace(*one.bending.ends, 2001)
    out = np.array([one.bending.shape(float(z))[mode] for z in places])
    at = np.flatnonzero(out[:-1] * out[1:] < 0)
    return np.asarray(
        places[at] - out[at] * (places[at + 1] - places[at]) / (out[at + 1] - out[at])
    )


def test_check_says_what_is_kept_who_holds_it_and_what_is_at_a_node(tmp_path):
    """In one file: sensor A at a node, and one between bearing B and its sensor."""
    text = presets.text("ufu_flexible")
    first, second = nodes_of(Machine.from_toml(text), 0)
    sensors = text.index("[[sensor]]")
    moved = text[sensors:].replace('"153 mm"', f'"{first:.9g} m"')
    path = tmp_path / "one.toml"
    path.write_text(text[:sensors] + moved.replace('"566.9 mm"', '"480 mm"'))
    line = path.read_text().splitlines().index(f'place = "{first:.9g} m"') + 1
    remarks = " ".join(inspect(path).remarks)
    for told in (
        f"line {line}: sensor A at",
        "is at a node of mode 1, 104.19 Hz, and does not see it",
        "a node of mode 1, 104.19 Hz, is between bearing B and its sensor B",
        "3 bending modes are kept",
        "400.28 Hz",
        "768.23 Hz",
        "centre of mass is at 0.337638 m",
        "from 1117.6 Hz on",
    ):
        assert told in remarks  # fmt: skip
    with pytest.raises(ConfigError, match=r"at a node of mode 1.*no sensor sees it"):
        Machine.from_toml(text[:sensors] + moved.replace('"566.9 mm"', f'"{second:.9g} m"'))


def test_check_says_what_shapes_of_modes_left_out_are_kept():
    one = Machine.preset("ufu_flexible").replace(rotor__residual=True)
    assert one.bending is not None
    (remark,) = machine_report._left_out(one, one.bending)
    assert "by 2 attached shapes" in remark.text


def test_mode_shapes_are_drawn():
    found = mode_shapes(Machine.preset("ufu_flexible"))
    assert found.figure().image(".png")[:4] == b"\x89PNG"
    assert found.to_dict()["modes"]["1"]["frequency"] == pytest.approx(104.19, abs=0.01)
    assert found.magnets["A"][0] == found.sensors["A"][0] == 0.153
    with pytest.raises(AmbkitError, match="its rotor is rigid"):
        mode_shapes(Machine.preset("ufu_rig"))


# ---- the script that writes such files ----


class Rotor:
    """What from_ross.py asks of a rotor of ROSS, with the matrices of the file that it wrote."""

    def __init__(self, shaft_elements=None, disk_elements=None, held=0.0):
        given = content()
        self.shaft_elements, self.disk_elements = shaft_elements, disk_elements
        self.nodes_pos, self.m = given["place"].tolist(), 5.9
        self._of, self.held = given, held

    def M(self, speed):
        return np.asarray(self._of["M"])

    def K(self, speed):
        return np.asarray(self._of["K"] + self.held * np.eye(318))

    def C(self, speed):
        return np.asarray(self._of["D"])

    def G(self):
        return np.asarray(self._of["G"])

    @classmethod
    def load(cls, path):
        return cls(held=1e6)


def test_the_script_for_ross_writes_a_free_rotor(tmp_path, monkeypatch):
    """ROSS itself needs an environment of its own; this stands for it."""
    ross = types.ModuleType("ross")
    ross.Rotor, ross.rotor_amb_example = Rotor, lambda: Rotor(held=1e6)
    ross.__version__ = "0"
    monkeypatch.setitem(sys.modules, "ross", ross)
    for arguments in ([], ["rotor.toml"]):
        out = str(tmp_path / "out.npz")
        monkeypatch.setattr(sys, "argv", ["from_ross.py", out, *arguments])
        runpy.run_path(str(ROSS.with_name("from_ross.py")), run_name="__main__")
        np.testing.assert_array_equal(read_matrices(out).K, read_matrices(ROSS).K)
