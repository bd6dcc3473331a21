"""What a file is, and what is wrong with it."""

import tomllib

import numpy as np
import pytest

import ambkit
from ambkit.data import recordings
from ambkit.machine import presets
from ambkit.machine.forces.force_points import load_force_points
from ambkit.workflow.check import inspect, schema_of

FORCE = """iu [mA],x [mm],f_mag [N]
{rows}
"""


def grid(bearing, n=5):
    iu, x = np.meshgrid(np.linspace(-1.5, 1.5, n), np.linspace(-0.5e-3, 0.5e-3, n))
    return iu, x, ambkit.ClosedLaw(bearing).force(iu, x)


def force_file(path, rows):
    path.write_text(FORCE.format(rows="\n".join(",".join(map(repr, row)) for row in rows)))
    return path


def rows_of(bearing):
    iu, x, force = grid(bearing)
    return np.column_stack([1e3 * iu.ravel(), 1e3 * x.ravel(), force.ravel()]).tolist()


def test_each_kind_is_recognised_by_what_it_holds(bearing, tmp_path):
    bearing.save(tmp_path / "a.toml")
    ambkit.Scenario(seed=4).save(tmp_path / "b.toml")
    ambkit.Expert.paper().save(tmp_path / "c.json")
    ambkit.simulate(bearing, ambkit.Scenario(duration=0.01)).record.save(tmp_path / "d.parquet")
    force_file(tmp_path / "e.csv", rows_of(bearing))
    kinds = {
        "a.toml": ("machine", "zittau_axial, two-sided, 0.518 kg"),
        "b.toml": ("scenario", "0.5 s, nothing demanded"),
        "c.json": ("expert", "25 rules for Tables 4, 5 and 6 of the paper"),
        "d.parquet": ("record", "101 samples of r, y, u"),
        "e.csv": ("measured force", "25 points, -1.5 A to 1.5 A, -0.5 mm to 0.5 mm, without"),
    }
    for name, (kind, about) in kinds.items():
        found = inspect(tmp_path / name)
        assert found.ok, found.problems
        assert found.kind == kind
        assert found.about.startswith(about)


def test_a_preset_is_checked_by_its_name():
    item = inspect("tum_mlps")
    assert item.kind == "machine"
    assert item.ok
    assert item.path.name == "tum_mlps.toml"
    assert "did you mean tum_mlps?" in inspect("tum_mlp").problems[0]


def test_a_log_needs_its_map():
    folder = recordings.folder()
    rest = inspect(folder / "rest.csv")
    assert rest.ok
    assert "without y and u" in rest.about
    logs = folder.parents[2] / "shared" / "data" / "inteco"
    if not logs.is_dir():
        pytest.skip("the rig's logs are not here (../shared/data/inteco)")
    log = logs / "closed_loop" / "step-LQI-KF.mat"
    assert "needs a channel map" in inspect(log).problems[0]
    assert inspect(log, folder / "closed_loop.toml").kind == "record"


def test_missing_samples_are_reported(bearing, tmp_path):
    t = 1e-4 * np.arange(10)
    y = np.where(t < 2.5e-4, np.nan, 0.0)
    ambkit.Record(t, {"y": y, "u": 0 * t}).save(tmp_path / "r.csv")
    assert "every 0.1 ms, missing 3 of y" in inspect(tmp_path / "r.csv").about
    ambkit.Record(t, {"y": y, "u": y}).save(tmp_path / "rows.csv")
    assert "3 missing in each signal" in inspect(tmp_path / "rows.csv").about
    (tmp_path / "header.csv").write_text("t [s],y [mm],u [V]\n")
    (problem,) = inspect(tmp_path / "header.csv").problems
    assert problem.endswith("header.csv: t must have at least 2 samples, has none")


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.toml", "a = [", "not valid TOML"),
        ("a.toml", "", "none of its keys is known in those (it is empty)"),
        ("a.toml", "name = 'x'\nmagnet = 3\nrotor = 4", "magnet: must be a table"),
        ("a.toml", "duration = '1 s'\nsed = 3", "sed: unknown key, did you mean seed?"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", "{}", "rules"),
        ("a.csv", "t [s],y [m]\n0,1\n1", "cut short"),
        ("a.csv", "t [s],y\n0,1\n1,2\n", "y has no unit"),
        ("a.xyz", "", "unknown kind of file"),
    ],
)
def test_problems_are_reported_not_raised(tmp_path, name, text, problem):
    path = tmp_path / name
    path.write_text(text)
    found = inspect(path)
    assert not found.ok
    assert any(problem in each for each in found.problems), found.problems
    assert all(str(path) in each for each in found.problems)


def test_schemas_allow_what_the_presets_say():
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(schema_of("machine"))
    for name in presets.names():
        validator.validate(tomllib.loads(presets.text(name)))
    wrong = tomllib.loads(presets.text("zittau_axial"))
    wrong["rotor"]["type"] = "mass"
    assert not validator.is_valid(wrong)
    assert "signals" in schema_of("map")["required"]
    with pytest.raises(KeyError):
        schema_of("record")


def test_measured_points_may_lie_anywhere(bearing, tmp_path):
    rows = rows_of(bearing)[::2] + rows_of(bearing)[:3]
    points = load_force_points(force_file(tmp_path / "f.csv", rows))
    iu, x, force = np.array(rows).T
    np.testing.assert_allclose(points.current, 1e-3 * iu, rtol=1e-14)
    np.testing.assert_allclose(points.displacement, 1e-3 * x, rtol=1e-14, atol=1e-18)
    np.testing.assert_array_equal(points.force, force)
    assert points.standard_error is None


def test_measured_points_that_are_none_are_refused(bearing, tmp_path):
    rows = [[1.0, 0.1, 2.0], [1.0, 0.2, float("nan")]]
    with pytest.raises(ambkit.AmbkitError, match=r"f\.csv: force must be finite, is nan at point"):
        load_force_points(force_file(tmp_path / "f.csv", rows))
    (tmp_path / "g.csv").write_text("iu [A],x [m]\n0,0\n")
    with pytest.raises(ambkit.RecordError, match="has no column f_mag; it has iu, x"):
        load_force_points(tmp_path / "g.csv")


FOREIGN = "Strom;Spalt;Kraft\n-1,5;0,1;2\n1;0,4;3\n0;0,2;1\n"
MEANING = """
[signals.iu]
column = "Strom"
unit = "A"
[signals.x]
column = "Spalt"
unit = "mm"
[signals.f_mag]
column = "Kraft"
unit = "N"
"""


def test_a_force_with_other_columns_is_checked_with_what_they_mean(tmp_path):
    (tmp_path / "fe.csv").write_text(FOREIGN)
    (tmp_path / "fe.toml").write_text(MEANING)
    found = inspect(tmp_path / "fe.csv", tmp_path / "fe.toml")
    assert (found.kind, found.ok) == ("measured force", True)
    assert found.about.startswith("3 points, -1.5 A to 1 A, 0.1 mm to 0.4 mm")
    meaning = inspect(tmp_path / "fe.toml")
    assert (meaning.kind, meaning.ok) == ("channels of a force map", True)
    assert set(schema_of("force")["properties"]) == {"signals"}


@pytest.mark.parametrize("head", ["Strom;Spalt;Kraft", "iu [A];gap [mm];force [N]"])
def test_a_force_with_other_columns_alone_is_reported_how(tmp_path, head):
    (tmp_path / "fe.csv").write_text(FOREIGN.replace("Strom;Spalt;Kraft", head))
    found = inspect(tmp_path / "fe.csv")
    assert not found.ok
    assert "a measured force has columns iu [A], x [mm] and f_mag [N]" in found.problems[-1]
    assert "ambkit schema force" in found.problems[-1]
    with pytest.raises(ambkit.RecordError) as error:
        load_force_points(tmp_path / "fe.csv")
    assert "a measured force has columns" in error.value.problems[-1]


def test_a_log_without_units_is_not_taken_for_a_force(tmp_path):
    (tmp_path / "log.csv").write_text("time;y;u\n0;1;2\n1;2;1\n2;1;2\n")
    assert not any("measured force" in text for text in inspect(tmp_path / "log.csv").problems)


@pytest.mark.parametrize(("steps", "reported"), [(40, False), (80, True)])
def test_a_converter_too_coarse_for_the_loop_is_reported(bearing, tmp_path, steps, reported):
    noise = bearing.sensor.noise_variance**0.5
    bearing.replace(sensor__quantisation=steps * noise).save(tmp_path / "coarse.toml")
    remarks = inspect(tmp_path / "coarse.toml").remarks
    coarse = [text for text in remarks if "80 standard deviations of the sensor's noise" in text]
    assert len(coarse) == reported
