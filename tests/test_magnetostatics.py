"""The magnet from its drawing: the field against theory, the map, and the machine that takes it."""

from types import SimpleNamespace

import numpy as np
import pytest

import ambkit
from ambkit import AmbkitError
from ambkit.machine.force_law import MU_0
from ambkit.machine.forces.drawing import map_near
from ambkit.machine.forces.fitted_law import law_errors, preferred
from ambkit.machine.magnet_solution.solution import solve
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import (
    FREQUENCIES,
    dynamic_stiffness,
    dynamics_of,
    lag,
)
from ambkit.machine.magnetostatics.field import FieldSolver
from ambkit.machine.magnetostatics.iron import GRADES, Iron
from ambkit.machine.magnetostatics.layout import Layout, Region, rectangle
from ambkit.machine.magnetostatics.magnet_map import (
    Box,
    MagnetMap,
    TwoAxisMap,
    map_of,
    terms,
    two_axis_map,
)
from ambkit.models.plant import Plant, coupling_of

WINDING = '[winding]\nturns = 100\nbias_current = "3 A"\n'
IRON = '[iron]\nsaturation = "1.8 T"\nrelative_permeability = 2000\n'
CORE = """air_gap = "0.5 mm"
leg_width = "10 mm"
leg_height = "25 mm"
window_width = "18 mm"
back_iron = "10 mm"
coil_width = "7 mm"
rotor_thickness = "12 mm"
stack_length = "30 mm"
"""
E_CORE = 'type = "E-core"\nmiddle_width = "20 mm"\n' + CORE
U_CORE = 'type = "U-core"\n' + CORE
POT = """air_gap = "0.5 mm"
slot_width = "12 mm"
slot_depth = "20 mm"
outer_pole = "6 mm"
back_iron = "10 mm"
"""
THRUST = """type = "thrust"
shaft_diameter = "30 mm"
disc_diameter = "90 mm"
disc_thickness = "10 mm"
core_bore = "36 mm"
inner_pole = "7 mm"
"""
RADIAL = """type = "radial"
poles = 8
air_gap = "0.5 mm"
rotor_diameter = "60 mm"
shaft_diameter = "30 mm"
pole_width = "9 mm"
pole_height = "22 mm"
back_iron = "10 mm"
coil_width = "4 mm"
stack_length = "30 mm"
"""
MAGNET = """
[geometry.magnet]
thickness = "1 mm"
remanence = "1.2 T"
coercivity = "900 kA/m"
"""
HYBRID_RADIAL = (
    RADIAL.replace("poles = 8\n", 'magnet_pole_width = "9 mm"\n').replace("radial", "hybrid-radial")
    + MAGNET
)
HOMOPOLAR = RADIAL.replace("poles = 8\n", 'plane_distance = "25 mm"\n').replace(
    "radial", "homopolar"
)
HYBRID_THRUST = (
    """type = "hybrid-thrust"
air_gap = "0.5 mm"
shaft_diameter = "30 mm"
disc_diameter = "66 mm"
disc_thickness = "12 mm"
core_bore = "40 mm"
pole_width = "10 mm"
slot_depth = "15 mm"
radial_gap = "1 mm"
shoe_thickness = "4 mm"
magnet_height = "10 mm"
back_iron = "8 mm"
"""
    + MAGNET
)
BIASED = {
    "hybrid radial": HYBRID_RADIAL,
    "hybrid thrust": HYBRID_THRUST,
    "homopolar": HOMOPOLAR + 'magnet_area = "700 mm^2"\n' + MAGNET,
    "homopolar coil": HOMOPOLAR + "bias_turns = 60\n",
}
"""Those whose bias is made by permanent magnets, or by a coil of its own."""
GEOMETRIES = {
    "e-core": E_CORE,
    "u-core": U_CORE,
    "thrust": THRUST + POT,
    "ball": 'type = "pot-and-ball"\ninner_diameter = "20 mm"\nball_diameter = "50 mm"\n' + POT,
    "eight poles": RADIAL,
    "four poles": RADIAL.replace("= 8", "= 4").replace('h = "9', 'h = "18'),
    "twelve poles": RADIAL.replace("= 8", "= 12")
    .replace('h = "9', 'h = "5')
    .replace("4 mm", "3 mm"),
}
MACHINE = """name = "guide"
sampling_time = "0.1 ms"
rotor = {mass = "3 kg", gravity = "none", clearance = "0.25 mm"}
amplifier = {gain = "1 A/V", current_limit = "3 A", noise_variance = "1e-4 V^2"}
sensor = {gain = 1, lag = "0.05 ms", noise_variance = "1 µm^2"}
"""


def text(geometry, iron=IRON):
    winding = WINDING.replace('bias_current = "3 A"\n', "") if MAGNET in geometry else WINDING
    return f'name = "magnet"\n\n[geometry]\n{geometry}\n{winding}\n{iron}'


def drawing(geometry, iron=IRON):
    return Drawing.from_toml(text(geometry, iron))


def machine_of(folder, geometry, iron=IRON, more=""):
    """The machine whose magnet is this drawing."""
    (folder / "core.toml").write_text(text(geometry, iron))
    (folder / "m.toml").write_text(f'{MACHINE}[magnet]\nforce_map = "core.toml"\n{more}')
    return ambkit.Machine.load(folder / "m.toml")


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    base = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(base))


def check_one_energy(solver, place, current, step, rel):
    """Force and flux linkage are slopes of the coenergy, over steps of `step` [m] and 0.1 mA."""
    way, coil = solver.layout.directions[0], solver.layout.control[0]
    result = solver.at(place).solve(current)

    def slope(step, moved, more):
        ends = [solver.at(place + h * moved).solve(current + h * more, result.a).coenergy
                for h in (-step, step)]  # fmt: skip
        return (ends[1] - ends[0]) / (2 * step)

    assert result.force[0] == pytest.approx(slope(step, way, 0 * coil), rel=rel)
    assert coil @ result.flux == pytest.approx(slope(1e-4, 0, coil), rel=rel)


@pytest.mark.parametrize("geometry", ["e-core", "thrust", "ball"])
def test_force_and_flux_are_derivatives_of_one_energy(geometry):
    layout = drawing(GEOMETRIES[geometry]).layout
    current = 3 * layout.bias + layout.control[0]
    check_one_energy(FieldSolver(layout, 0.7), 1e-4 * layout.directions[0], current, 1e-8, rel=1e-6)


@pytest.mark.parametrize("geometry", ["e-core", "u-core", "thrust"])
def test_narrow_gap_between_ideal_iron_is_its_reluctance(geometry):
    """Without fringes and iron, force and flux are those of `ClosedLaw`."""
    iron = Iron(saturation=50.0, relative_permeability=1e6)
    narrow = GEOMETRIES[geometry].replace('air_gap = "0.5 mm"', 'air_gap = "0.1 mm"')
    made = drawing(narrow).replace(iron=iron)
    layout = made.layout
    result = FieldSolver(layout).at(0).solve(layout.control[0] * (layout.control[0] > 0))
    ideal = made.magnet_constant / made.geometry.air_gap**2
    assert result.force[0] == pytest.approx(ideal, rel=0.02)
    leakage = result.flux[0] / (2 * ideal * made.geometry.air_gap)
    assert 1 < leakage < 1.12  # across the window


@pytest.mark.parametrize("name", [
    "hybrid thrust", *(pytest.param(n, marks=pytest.mark.long)
                       for n in ("hybrid radial", "homopolar", "homopolar coil")),
])  # fmt: skip
def test_bias_of_magnets_or_a_coil_of_its_own(name):
    """In a narrow gap between ideal iron that of the reluctances; force and flux of one energy."""
    ideal = Iron(saturation=50.0, relative_permeability=1e5)
    made = drawing(BIASED[name].replace('air_gap = "0.5 mm"', 'air_gap = "0.1 mm"'))
    layout = made.replace(iron=ideal).layout
    solver, gap, way = FieldSolver(layout, 0.5), made.geometry.air_gap, layout.directions[0]
    bias, (at, on) = made.bias_current * layout.bias, (0.02 * gap, 0.05 * made.bias_current)
    k_i = solver.at().solve(bias + on * layout.control[0]).force[0] / on
    k_s = solver.at(at * way).solve(bias).force[0] / at
    stiffness = 4 * made.magnet_constant * made.bias_current / gap**2
    leakage = 0.13 if name.startswith("hybrid") else 0.08  # of the magnet, across the slots
    assert k_i == pytest.approx(stiffness, rel=leakage)
    assert k_s == pytest.approx(stiffness * made.bias_current / gap, rel=2 * leakage)
    layout = made.layout
    current = bias + 0.3 * on * layout.control[0]
    check_one_energy(FieldSolver(layout, 0.5), 10 * at * way, current, 1e-9, rel=1e-5)


def test_homopolar_bias_flux_is_that_of_its_magnetic_circuit():
    """The drop of the axial circuit and that of both gaps are the magnet's."""
    narrow = BIASED["homopolar"].replace('air_gap = "0.5 mm"', 'air_gap = "0.1 mm"')
    made = drawing(narrow, IRON.replace("2000", "100000").replace("1.8", "50"))
    axial = made.layout.axial
    per_length = FieldSolver(made.layout, 0.5).at().solve(np.zeros(4)).a[-1]
    drop = axial.mmf - axial.reluctance * per_length * axial.length
    flux = MU_0 * 4 * made.geometry.pole_width * drop / (2 * made.geometry.air_gap)
    assert 1 < per_length / flux < 1.12  # poles have sides


def test_brooks_coil_in_air_has_its_inductance():
    """L = 1.6994 µH/m r N^2 (Grover 1946, chapter 13), r = 1.5 c of a square section c x c."""
    c, turns = 0.02, 50
    coil = Region(rectangle(c - 0.5j * c, 2 * c + 0.5j * c), "coil", coil=0, turns=turns)
    places = [Region(rectangle(0.2 * c + 1j * z * c, 0.5 * c + 1j * (z + 0.2) * c), "air", moves=m)
              for z, m in ((1.0, True), (1.5, False))]  # fmt: skip
    far = 20 * c
    one = np.ones(1)
    layout = Layout(Region(rectangle(-1j * far, far + 1j * far), "air"), [coil, *places], (1j,),
                    one, one[None])  # fmt: skip
    result = FieldSolver(layout, 5).at(0).solve(one)
    assert result.flux[0] == pytest.approx(1.6994e-6 * 1.5 * c * turns**2, rel=2e-3)


@pytest.mark.long
def test_each_geometry_pulls_as_its_formula_says_roughly():
    for name, geometry in GEOMETRIES.items():
        made = drawing(geometry)
        layout = made.layout
        result = FieldSolver(layout, 0.6).at(0).solve(layout.control[0] * (layout.control[0] > 0))
        ideal = made.magnet_constant / made.geometry.air_gap**2
        share = result.force[0] / ideal
        # A ball is far from a flat face; of four poles each carries the flux of both neighbours.
        low, high = {"ball": (0.02, 0.3), "four poles": (0.4, 1.3)}.get(name, (0.75, 1.15))
        assert low < share < high, name


def test_map_is_consistent_and_right_between_its_points():
    made = drawing(U_CORE)
    result = map_of(made)
    size = np.abs(result.force).max()
    assert result.off(result.force_at)[0] < 5e-4 * size
    assert result.inconsistency < 3e-4
    layout, (iu, x, force) = made.layout, result.left_out[:, 1]  # of both cores, solved again
    at = FieldSolver(layout).at
    near, far = (
        at(sign * x * layout.directions[0]).solve((3 + sign * iu) * layout.bias).force[0]
        for sign in (1, -1)
    )
    assert near - far == pytest.approx(force, abs=1e-7 * size)
    iu, x = (np.linspace(axis[0], axis[-1], 401) for axis in (result.current, result.displacement))
    legs = [
        np.trapezoid(result.force_at(iu[-1], x), x), -np.trapezoid(result.force_at(iu[0], x), x),
        np.trapezoid(result.flux_at(iu, x[0]), iu), -np.trapezoid(result.flux_at(iu, x[-1]), iu),
    ]  # fmt: skip
    assert abs(sum(legs)) < 2e-5 * np.abs(legs).max()
    assert np.allclose(result.force, -result.force[::-1, ::-1], atol=1e-9 * result.force.max())


def _map_of_law(force, flux):
    """Return a map whose points are those of a law."""
    current, x = np.linspace(-3, 3, 11), 0.25e-3 * np.linspace(-1, 1, 7)
    between = np.array([[-2.1, 0.3, 1.4], [-0.21e-3, 0.1e-3, 0.07e-3]])
    left_out = np.vstack([between, force(*between)])
    grid = np.meshgrid(current, x)
    return MagnetMap(0.5e-3, True, current, x, force(*grid), flux(*grid), left_out)


def test_points_left_out_prefer_the_law_that_they_follow():
    """Ideal iron prefers the closed law, the magnet of a drawing its map."""
    k, s0, i0 = 5e-6, 0.5e-3, 3.0
    about = SimpleNamespace(
        type="two-sided", bias_current=i0, magnet_constant=2 * k, air_gap=1.3 * s0
    )
    ideal = _map_of_law(
        lambda i, x: k * (((i0 + i) / (s0 - x)) ** 2 - ((i0 - i) / (s0 + x)) ** 2),
        lambda i, x: 2 * k * ((i0 + i) / (s0 - x) - (i0 - i) / (s0 + x)),
    )
    assert ideal.inconsistency < 1e-9
    best = preferred(law_errors(about, ideal))
    assert best.key == "closed"
    assert best.law.machine.magnet.air_gap == pytest.approx(s0)
    assert preferred(law_errors(about, map_of(drawing(U_CORE)))).key == "map"


@pytest.mark.long
def test_map_within_tolerances_is_that_of_the_other_drawing():
    """Of numbers a little off the drawing's, one by one and together; far off it is solved."""
    made, box = drawing(U_CORE), Box(3.0, -3.0, 3.0, 0.25e-3)
    off = {"geometry.air_gap": 0.52e-3, "geometry.leg_width": 9.7e-3, "iron.saturation": 1.74}
    for changes, most in [({key: of}, 2e-3) for key, of in off.items()] + [(off, 4e-3)]:
        true, near = map_of(made.replace(**changes), box), map_near(made, changes, box)
        size = np.abs(true.force).max()
        assert 8 * most < np.abs(map_of(made, box).force - true.force).max() / size
        assert np.abs(near.force - true.force).max() < most * size
    far = {"iron.saturation": 1.4, "winding.turns": 120}
    assert np.array_equal(map_near(made, far, box).force, map_of(made.replace(**far), box).force)


@pytest.mark.long
def test_half_of_a_radial_map_is_the_other_half():
    """What symmetry fills in is what the field solution gives."""
    layout = drawing(RADIAL).layout
    solver = FieldSolver(layout, 0.6)
    near, far = (
        solver.at(sign * 1e-4).solve(3 * layout.bias + sign * 2 * layout.control[0]).force[0]
        for sign in (1, -1)
    )
    assert near == pytest.approx(-far, rel=1e-3)


def test_map_of_both_axes_has_one_energy_and_the_symmetry_of_a_ring():
    random = np.random.default_rng(2)
    ranges = np.array([3.0, 3.0, 2e-4, 2e-4])
    m = TwoAxisMap(ranges, random.normal(size=len(terms(10))), np.zeros(70), 0.0)
    place = 0.6 * ranges[:, None] * random.uniform(-1, 1, (4, 5))
    for axis, value in enumerate([*m.flux_at(place), *m.force_at(place)]):
        step = 1e-6 * ranges[axis] * np.eye(4)[:, axis : axis + 1]
        slope = (m.derivative(place + step) - m.derivative(place - step)) / (2 * step[axis])
        assert value == pytest.approx(slope, rel=1e-5)
    turned = np.array([-place[1], place[0], -place[3], place[2]])
    along, across = m.force_at(place)
    assert m.force_at(turned) == pytest.approx(np.array([-across, along]))
    k_i, k_s = m.stiffness_at(place)
    assert k_s[0, 1] == pytest.approx(k_s[1, 0])  # of one energy
    assert np.abs(k_i[0, 1]).min() > 0


@pytest.mark.long
def test_map_of_both_axes_is_the_field():
    """Anywhere in the box, in the centre, and for the flux linkage of every coil."""
    made = drawing(GEOMETRIES["four poles"])
    m, layout, solver = two_axis_map(made), made.layout, FieldSolver(made.layout, 0.6)
    random = np.random.default_rng(3)
    off = []
    for place in (m.ranges * random.uniform(-1, 1, (8, 4))).tolist():
        currents = 3 * layout.bias + np.array(place[:2]) @ layout.control
        s = solver.at(complex(*place[2:])).solve(currents)
        off.append(np.abs(m.force_at(place) - s.force).max())
        assert m.linkages_at(place) == pytest.approx(s.flux, abs=2e-3 * np.abs(s.flux).max())
    assert max(off) < 1.0  # of 500 N
    k_s = m.stiffness_at(np.zeros(4))[1]
    ends = [solver.at(5e-6j * sign).solve(3 * layout.bias).force[1] for sign in (1, -1)]
    assert k_s[1, 1] == pytest.approx((ends[0] - ends[1]) / 1e-5, rel=1e-3)
    with pytest.raises(AmbkitError, match="has one axis"):
        solve(drawing(U_CORE), both_axes=True)


def test_curves_rise_and_their_energy_is_the_integral():
    made = [Iron(material=name) for name in GRADES]
    table = Iron(flux_density=(0.5, 1.0, 1.5, 1.8), field_strength=(60, 130, 1200, 9000))
    b = np.linspace(0.01, 3.0, 3001)
    for iron in (*made, table, Iron(saturation=1.8, relative_permeability=2000)):
        h, slope, energy = iron.curve.at(b)
        assert (slope > 0).all()
        assert np.allclose(np.gradient(energy, b)[1:-1], h[1:-1], rtol=0.02, atol=20)
        assert slope[-1] == pytest.approx(1 / MU_0, rel=0.03)
    assert table.curve.at(np.array([1.5]))[0] == pytest.approx(1200)


@pytest.mark.parametrize(
    ("geometry", "line", "what"),
    [
        (RADIAL.replace('"9 mm"', '"25 mm"'), 9, "geometry.pole_width: 8 poles overlap"),
        (RADIAL.replace('"4 mm"', '"9 mm"'), 12, "geometry.coil_width: windings of neighbouring"),
        (RADIAL.replace('"30 mm"', '"80 mm"', 1), 8, "geometry.shaft_diameter: must be less"),
        (E_CORE.replace('"7 mm"', '"18 mm"'), 11, "geometry.coil_width: windings overlap"),
        (THRUST.replace('"90 mm"', '"40 mm"') + POT, 6, "geometry.disc_diameter: ends before"),
        (HYBRID_THRUST.replace('"66 mm"', '"55 mm"'), 7, "geometry.disc_diameter: ends before"),
        (
            HYBRID_THRUST.replace('"10 mm"\nback', '"14 mm"\nback'),
            14,
            "geometry.magnet_height: must",
        ),
        (HYBRID_RADIAL.replace('"1 mm"', '"30 mm"'), 16, "geometry.magnet.thickness: must be less"),
        (
            HYBRID_RADIAL.replace('"900 k', '"9 M'),
            18,
            "geometry.magnet.coercivity: must be at most",
        ),
        (HOMOPOLAR, 3, "geometry.magnet: the bias is made by one of"),
        (BIASED["homopolar"].replace('"700 mm^2"', '"0 mm^2"'), 14, "geometry.magnet_area: "),
        (RADIAL.replace("= 8", "= 2"), 5, "geometry.poles: "),
        (RADIAL.replace('"22 mm"', '"0.1 mm"'), 10, "geometry.pole_height: leaves no room"),
        (THRUST.replace('"36 mm"', '"20 mm"') + POT, 8, "geometry.core_bore: must be greater"),
    ],
)
def test_what_overlaps_is_refused_with_file_and_line(tmp_path, geometry, line, what):
    (tmp_path / "d.toml").write_text(text(geometry))
    with pytest.raises(AmbkitError, match=rf"d\.toml:{line}: {what}"):
        Drawing.load(tmp_path / "d.toml")


@pytest.mark.parametrize(
    ("geometry", "change", "what"),
    [(RADIAL, ('bias_current = "3 A"\n', ""), "bias_current: is missing"),
     (HYBRID_RADIAL, ("[iron]", 'bias_current = "3 A"\n[iron]'), "the magnets make the bias")],
)  # fmt: skip
def test_bias_current_is_stated_where_coils_make_it(geometry, change, what):
    with pytest.raises(AmbkitError, match=what):
        Drawing.from_toml(text(geometry).replace(*change))


@pytest.mark.parametrize(
    "iron",
    ["[iron]\n", '[iron]\nmaterial = "M350-50A"\nsaturation = "1.8 T"\nrelative_permeability = 9\n',
     '[iron]\nflux_density = ["1 T", "0.5 T"]\nfield_strength = ["100 A/m", "200 A/m"]\n'],
)  # fmt: skip
def test_a_curve_is_stated_once_and_rises(iron):
    with pytest.raises(AmbkitError, match=r"iron\.(material|flux_density): "):
        drawing(E_CORE, iron)


def test_machine_takes_a_drawing(tmp_path):
    machine = machine_of(tmp_path, U_CORE)
    magnet, result = ambkit.magnet_of(machine), map_of(drawing(U_CORE))
    assert machine.magnet.air_gap == 0.5e-3
    assert machine.magnet.type == "two-sided"
    iu, x = np.meshgrid(np.linspace(-3, 3, 9), np.linspace(-2e-4, 2e-4, 7))
    size = np.abs(result.force).max()
    assert np.abs(magnet.force(iu, x) - result.force_at(iu, x)).max() < 3e-4 * size
    run = ambkit.simulate(machine, ambkit.scenario_for(machine, load="20 N", duration="0.1 s"))
    assert np.abs(run.record["x"]).max() < 0.1e-3


@pytest.mark.long
def test_machine_may_differ_from_its_drawing(tmp_path):
    machine = machine_of(tmp_path, U_CORE, more='drawing.iron.saturation = "1.74 T"')
    nominal = machine.replace(magnet__drawing={})
    less, more = (float(ambkit.magnet_of(m).force(3.0, 0.2e-3)) for m in (machine, nominal))
    assert 0.93 < less / more < 0.98
    machine.save(tmp_path / "again.toml")
    assert ambkit.Machine.load(tmp_path / "again.toml") == machine
    told = r"m\.toml:8: magnet\.drawing\.iron\.saturation: .*A cannot be converted"
    with pytest.raises(AmbkitError, match=told):
        machine_of(tmp_path, U_CORE, more='drawing.iron.saturation = "1.74 A"')


def test_plant_couples_axes_that_share_their_iron(monkeypatch):
    """The C of a coupling is the map's force, at the currents and displacements of the run."""
    machine = ambkit.preset("tum_mlps")
    k = ambkit.ConstantStiffness.of(machine.isolated_axis("A1"))
    i, s = ranges = np.array([2.5, 0.35e-3])
    energy = {
        (1, 0, 1, 0): k.k_i * i * s, (0, 0, 2, 0): k.k_s * s**2 / 4,
        (1, 0, 1, 2): 0.2 * k.k_i * i * s, (1, 1, 1, 1): -0.1 * k.k_i * i * s,
    }  # fmt: skip
    coefficients = np.array([energy.get(tuple(of[[1, 0, 3, 2]]), energy.get(tuple(of), 0.0))
                             for of in terms(10)])  # fmt: skip
    both = TwoAxisMap(np.repeat(ranges, 2), coefficients, np.zeros(1), 0.0)
    monkeypatch.setattr("ambkit.models.plant.computed_force_of_both", lambda _machine: both)
    coupling, rings = coupling_of(machine), Plant._rings
    monkeypatch.setattr(Plant, "_rings", lambda self: [of | coupling for of in rings(self)])
    run = ambkit.simulate(
        machine, ambkit.scenario_for(machine, step="50 µm", load="20 N", duration="0.1 s")
    ).record
    place = np.stack([run[f"{of}_A{n}"] for of in ("iu", "s") for n in (1, 2)])
    forces = np.stack([run[f"f_mag_A{n}"] for n in (1, 2)])
    size = np.abs(forces).max()
    assert np.abs(forces - both.force_at(place)).max() < 1e-9 * size
    assert np.abs(forces[0] - k.k_i * place[0] - k.k_s * place[2]).max() > 0.02 * size


def test_machine_with_a_faulty_drawing_names_its_line(tmp_path):
    with pytest.raises(AmbkitError, match=r"core\.toml:11: geometry\.coil_width"):
        machine_of(tmp_path, E_CORE.replace('"7 mm"', '"30 mm"'))


def test_solution_states_stiffness_limits_and_laws(tmp_path):
    (tmp_path / "core.toml").write_text(text(U_CORE))
    result = ambkit.magnet(tmp_path / "core.toml")
    data = result.to_dict()
    k_i = result.stiffness[0]
    assert data["stiffness"]["finite elements"]["k_i"] == k_i
    assert 0.6 < k_i / data["stiffness"]["ideal iron"]["k_i"] < 1
    layout, solver = result.drawing.layout, result.solver
    near, far = (solver.at().solve((3 + i) * layout.bias).force[0] for i in (0.01, -0.01))
    assert k_i == pytest.approx((near - far) / 0.01, rel=5e-3)  # of both cores, by the field itself
    rise = (
        solver.at().solve(3.01 * layout.bias).flux[0]
        - solver.at().solve(2.99 * layout.bias).flux[0]
    )
    assert result.inductance == pytest.approx(rise / 0.02, rel=5e-3)
    errors = {law.key: law.rms for law in result.laws}
    assert errors["map"] < errors["saturating"] < errors["closed"] < errors["ideal"]
    assert data["solution"]["error"] < 1.5e-3
    assert len(result.figures()[0].panels[0].items) > 20  # lines of flux
    result.save(tmp_path / "map.csv")
    table = np.genfromtxt(tmp_path / "map.csv", delimiter=",", skip_header=1)
    assert np.allclose(table[:, 2], result.map.force.ravel())


def test_drawing_is_a_file_like_others(tmp_path):
    (tmp_path / "core.toml").write_text(text(U_CORE))
    assert isinstance(ambkit.load(tmp_path / "core.toml"), Drawing)


@pytest.mark.long
def test_sheets_lose_what_theory_says_and_lag(tmp_path):
    """At low frequency sigma d^2 (dB/dt)^2 / 12 in each volume; hysteresis as stated."""
    sheets = 'conductivity = "2e6 S/m"\nlamination = "0.5 mm"\nhysteresis_loss = "2 W/kg"\n'
    made = drawing(U_CORE, IRON + sheets)
    dynamics, layout = dynamics_of(made), made.layout
    position = FieldSolver(layout).at()
    iron = np.concatenate([at for _, at in position.solver.iron])
    step, bias = 1e-3, 3 * layout.bias
    more, less = (position.solve(bias + sign * step * layout.control[0]).B for sign in (1, -1))
    square = (np.abs((more - less) / (2 * step)) ** 2 * position.volume)[iron].sum()
    for at in (2, 4):
        omega = 2 * np.pi * FREQUENCIES[at]
        eddy = 2 * 2e6 * 0.5e-3**2 * omega**2 * square / 24  # of two cores
        hysteresis = 2 * 7650 * 2 * FREQUENCIES[at] / 50 * square / 1.5**2
        assert dynamics.eddy_loss[at] == pytest.approx(eddy, rel=5e-3)
        assert dynamics.hysteresis[at] == pytest.approx(hysteresis, rel=5e-3)
    first = lag(FREQUENCIES, dynamics.corner, 1.0)
    assert dynamics.stiffness == pytest.approx(first, abs=3e-3)
    assert np.degrees(np.angle(dynamics.stiffness[-1])) < -1.5
    machine = machine_of(tmp_path, U_CORE, IRON + sheets)
    assert machine.magnet.eddy_current_lag == pytest.approx(1 / (2 * np.pi * dynamics.corner))


@pytest.mark.long
def test_solid_iron_lags_by_half_an_order(tmp_path):
    """At five frequencies; and a machine takes the corner from its drawing."""
    solid = IRON + 'conductivity = "4.5e6 S/m"\n'
    dynamics = dynamics_of(drawing(THRUST + POT, solid))
    stiffness, corner = dynamics.stiffness, dynamics.corner
    high = FREQUENCIES > 9
    off = np.log(stiffness / lag(FREQUENCIES, corner))[high]
    assert high.sum() == 5
    assert np.abs(off.real).max() < 0.07
    assert np.abs(off.imag).max() < np.radians(4)
    finer = dynamic_stiffness(drawing(THRUST + POT, solid), FREQUENCIES[[2, 5]])[0]
    assert finer == pytest.approx(stiffness[[2, 5]], rel=0.02)
    poor = dynamic_stiffness(drawing(THRUST + POT, IRON + 'conductivity = "45 S/m"\n'))[0]
    assert np.abs(poor[:3] - 1).max() < 1e-3
    machine = machine_of(tmp_path, THRUST + POT, solid)
    assert machine.magnet.eddy_current_corner == pytest.approx(corner)


@pytest.mark.long
def test_gap_of_a_machine_overrides_the_drawing(tmp_path):
    machine = machine_of(tmp_path, U_CORE)
    wide = ambkit.magnet_of(machine.replace(magnet__air_gap="0.55 mm"))
    other = map_of(drawing(U_CORE.replace('"0.5 mm"', '"0.55 mm"')))
    k_i = (other.force_at(0.01, 0.0) - other.force_at(-0.01, 0.0)) / 0.02
    box = drawing(U_CORE.replace('"0.5 mm"', '"0.55 mm"')).displacement_range
    assert box == pytest.approx(0.275e-3)  # another box, so another map of the same magnet
    assert wide.tangent(0, 0)[0] == pytest.approx(float(k_i), rel=2e-3)
