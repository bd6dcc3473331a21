"""Campaigns: what a study says, machines that follow from seed and run alone, rows that stay."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.stats import binomtest, norm

import ambkit
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.campaigns import run, store
from ambkit.campaigns.campaign import Campaign
from ambkit.campaigns.distributions import Choice, Normal, Truncated, Uniform
from ambkit.campaigns.keys import changed
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.results import clopper_pearson, looks
from ambkit.campaigns.sobol_indices import problem_of, vary_from
from ambkit.campaigns.study import Study
from ambkit.campaigns.study_tables import UNITS
from ambkit.campaigns.worker import compute, peaks
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.simulation import plans

ROOT = Path(__file__).parent.parent

STUDY = """
name = "tolerances"
machine = "zittau_axial"
runs = 60
seed = 3
part = 16

[scenario]
duration = "20 ms"
disturbance = { type = "step", amplitude = "3 N", time = "5 ms" }

[record]
traces = ["x", "f_d_estimate"]
every = 20

[[vary]]
what = "magnet.air_gap"
type = "normal"
std = "2 %"

[[vary]]
what = "rotor.mass"
type = "uniform"
tolerance = "5 %"

[[vary]]
what = "estimator"
type = "choice"
values = ["linear", "low-pass"]

[passes]
zone = "A"
"""


def study(text=STUDY, **changes):
    return Study.from_toml(text).model_copy(update=changes)


def plan(**changes):
    return Plan(study(**changes))


def varied(way, *vary, **more):
    return Plan(Study(name="a", machine="zittau_axial", sampling=way, vary=vary, **more))


THREE = (
    Uniform(what="rotor.mass", low=0.5, high=0.6, levels=None),
    Uniform(what="magnet.air_gap", low=1.9e-3, high=2.1e-3),
    Uniform(what="sensor.lag", low=1e-4, high=3e-4),
)


@pytest.fixture
def call(call, tmp_path):
    """Call ambkit in this process, in a folder with the study."""
    (tmp_path / "s.toml").write_text(STUDY)
    return call


# --- points


@pytest.mark.parametrize("way", ["sobol", "latin-hypercube", "random", "saltelli"])
def test_points_follow_from_seed_and_run_alone(way):
    a = varied(way, *THREE, runs=100, seed=5)
    whole = a.points(0, 100)
    pieces = [a.points(first, first + 7 if first < 98 else 100) for first in range(98, -1, -7)]
    np.testing.assert_array_equal(np.concatenate(pieces[::-1]), whole)
    assert (varied(way, *THREE, runs=100, seed=6).points(0, 100) != whole).any()
    assert (whole.min(axis=0) >= [0.5, 1.9e-3, 1e-4]).all()
    assert (whole.max(axis=0) <= [0.6, 2.1e-3, 3e-4]).all()


def test_a_latin_hypercube_has_one_point_in_each_stratum():
    points = varied("latin-hypercube", *THREE, runs=40).points(0, 40)
    strata = np.sort(((points[:, 0] - 0.5) / 0.1 * 40).astype(int))
    np.testing.assert_array_equal(strata, np.arange(40))


def test_a_grid_has_all_combinations_with_its_ends_each_as_often_as_asked():
    mass = Uniform(what="rotor.mass", low=0.5, high=0.6, levels=3)
    who = Choice(what="estimator", values=("linear", "extended"))
    grid = varied("grid", mass, who, repeats=2)
    assert grid.runs == 12
    found = grid.points(0, 12).tolist()
    expected = [[m, k] for m in (0.5, 0.55, 0.6) for k in (0.0, 1.0) for _ in range(2)]
    np.testing.assert_allclose(found, expected)


def test_groups_for_indices_are_those_of_salib_and_share_their_noise():
    """A, then A with one column of B after the other, then B."""
    a = varied("saltelli", *THREE, runs=50)
    groups = a.points(0, 50).reshape(10, 5, 3)
    A, B = groups[:, 0], groups[:, -1]
    for k in range(3):
        mixed = A.copy()
        mixed[:, k] = B[:, k]
        np.testing.assert_array_equal(groups[:, 1 + k], mixed)
    np.testing.assert_array_equal(a.noise(0, 50), np.repeat(np.arange(10), 5))


def test_distributions_are_what_the_study_says():
    a = varied(
        "sobol",
        Normal(what="magnet.air_gap", std=2e-5),
        Truncated(what="rotor.mass", mean=0.5, std=0.1, low=0.45, high=0.6),
        Choice(what="estimator", values=("linear", "extended"), weights=(3, 1)),
        runs=4096,
    )
    gap, mass, who = a.points(0, 4096).T
    assert gap.mean() == pytest.approx(2e-3, abs=1e-7)
    assert gap.std() == pytest.approx(2e-5, rel=0.01)
    assert mass.min() >= 0.45
    assert mass.max() <= 0.6
    below = (norm.cdf(0) - norm.cdf(-0.5)) / (norm.cdf(1) - norm.cdf(-0.5))
    assert np.mean(mass < 0.5) == pytest.approx(below, abs=0.002)
    assert np.mean(who == 1) == pytest.approx(0.25, abs=0.002)


def test_what_is_correlated_is_so_and_keeps_its_distribution():
    gap = Normal(what="magnet.air_gap", std=2e-5)
    mass = Normal(what="rotor.mass", std=0.01)
    pair = {"between": ("magnet.air_gap", "rotor.mass"), "coefficient": -0.7}
    a = varied("sobol", gap, mass, THREE[2], runs=4096, correlation=[pair])
    found = a.points(0, 4096)
    assert np.corrcoef(found.T)[0, 1] == pytest.approx(-0.7, abs=0.01)
    assert abs(np.corrcoef(found.T)[0, 2]) < 0.01
    assert found[:, 1].std() == pytest.approx(0.01, rel=0.01)
    np.testing.assert_array_equal(found[1000:1300], a.points(1000, 1300))


# --- studies


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('std = "2 %"', 'std = "2 kg"', 's.toml:19: vary[0].std: "2 kg": kg cannot be'),
        ('std = "2 %"', "std = 2", "s.toml:19: vary[0].std: 2 has no unit"),
        ("magnet.air_gap", "magnet.airgap", "s.toml:17: vary[0].what: there is no key"),
        (
            '"linear", "low-pass"',
            '"linear", "lowpass"',
            "s.toml:29: vary[2].values[1]: there is no",
        ),
        ("runs = 60", "", "s.toml: runs: missing: how many machines"),
        ("runs = 60", 'runs = 61\nsampling = "saltelli"', "runs: must be a multiple of 5"),
        ("part = 16", "prat = 16", "did you mean part?"),
        ("rotor.mass", "sampling_time", "cannot vary: it belongs to the controller"),
        ("rotor.mass", "magnet.air_gap", "magnet.air_gap varies already, in vary[0]"),
        (
            'zone = "A"',
            'at_most = { recovery = "3 m" }',
            'passes.at_most.recovery: "3 m": m cannot',
        ),
        ('zone = "A"', "[stop]\nwidth = 0.0", "stop.width: must be greater than 0"),
        ('"zittau_axial"', '"nothing.toml"', "nothing.toml: cannot be read"),
    ],
)
def test_what_is_wrong_with_a_study_is_reported_with_its_line(old, new, message, call):
    Path("s.toml").write_text(STUDY.replace(old, new, 1))
    code, _, err = call("check", "s.toml")
    assert code == 2
    assert message.replace("s.toml: ", "") in err
    assert call("campaign", "run", "s.toml", "--folder", "o")[0] == 2
    assert not Path("o").exists()


def test_check_knows_studies_and_their_schema(call):
    code, out, _ = call("check", "s.toml")
    assert code == 0
    assert "study: 60 machines of zittau_axial, sobol; what varies: magnet.air_gap" in out
    assert "vary" in json.loads(call("schema", "study")[1])["properties"]


def test_a_study_survives_its_file(tmp_path):
    """Numbers of Python are SI, and have units in the file."""
    made = Study(
        name="a", machine="zittau_axial", runs=3, vary=(Normal(what="magnet.air_gap", std=2e-5),),
        passes={"at_most": {"recovery": 0.05}},
    )  # fmt: skip
    first = Plan(made)
    first.described.save(tmp_path / "a.toml")
    again = Plan(Study.load(tmp_path / "a.toml"))
    assert again.fingerprint == first.fingerprint
    np.testing.assert_array_equal(again.points(0, 3), first.points(0, 3))
    assert 'std = "20 µm"' in (tmp_path / "a.toml").read_text(encoding="utf-8")


def test_the_fingerprint_tells_what_the_rows_follow_from():
    same = plan(name="other", description="words", stop=None).fingerprint
    assert plan().fingerprint == same
    assert plan(seed=4).fingerprint != same
    assert Plan(Study.from_toml(STUDY.replace("2 %", "3 %"))).fingerprint != same
    assert plan(machine="inteco_ml").fingerprint != same


def test_salibs_problems_go_in_and_out():
    problem = {
        "num_vars": 3,
        "names": ["magnet.air_gap", "rotor.mass", "sensor.lag"],
        "bounds": [[1.9e-3, 2.1e-3], [0.5, 0.01], [1e-4, 3e-4, 2e-4, 5e-5]],
        "dists": ["unif", "norm", "truncnorm"],
    }
    assert problem_of(varied("sobol", *vary_from(problem), runs=8)) == problem
    with pytest.raises(AmbkitError, match="no distribution 'triang'"):
        vary_from(problem | {"dists": ["unif", "norm", "triang"]})


# --- machines


def test_machines_are_as_the_bearing_would_be_made():
    b = ambkit.preset("zittau_axial")
    values = {"magnet.magnet_constant": 7e-6, "rotor.mass": 0.55, "magnet.air_gap": 2.1e-3}
    assert changed(b, values) == b.replace(
        **{key.replace(".", "__"): value for key, value in values.items()}
    )
    coil = ambkit.Machine.load(ROOT / "examples/spindle.toml")
    wide = changed(coil, {"magnet.pole_area": 6e-4})
    assert wide == coil.replace(magnet__pole_area=6e-4)
    assert wide.magnet.magnet_constant == pytest.approx(1.2 * coil.magnet.magnet_constant)


@pytest.mark.parametrize(("machine", "key", "low"), [
    ("zittau_axial", "rotor.clearance", "1 mm"), ("tum_mlps", "bearing.A.clearance", "0.1 mm"),
])  # fmt: skip
def test_a_machine_that_cannot_be_is_reported_and_counts_as_bad(machine, key, low):
    nominal = ambkit.Machine.preset(machine).bearings[0].magnet.air_gap
    wide = Uniform(what=key, low=low, high=f"{1.5 * nominal} m")
    a = Plan(Study(name="a", machine=machine, vary=(wide,), runs=8, scenario={"duration": 0.005}))
    rows = compute(a, 0, 8).runs.to_pydict()
    impossible = np.array(rows[key]) >= nominal
    assert 0 < impossible.sum() < 8
    assert [("impossible" in f) for f in rows["fails"]] == impossible.tolist()
    np.testing.assert_array_equal(np.isnan(rows["f_d_rms"]), impossible)


def test_a_mass_below_zero_is_reported():
    negative = varied("sobol", Uniform(what="rotor.mass", low=-0.1, high=0.5), runs=4)
    wrong = [d.wrong for d in negative.machines(np.array([[-0.1]]), np.zeros(1, np.uint64), 0)]
    assert wrong == ["rotor.mass is -0.1 kg"]


@pytest.mark.parametrize(("key", "values", "feedback"), [
    ("amplifier.gain", ("1 A/V", "1.2 A/V"), "estimate"),
    ("sensor.gain", (1.0, 1.2), "measurement"),
])  # fmt: skip
def test_the_controller_goes_by_the_nominal_gains(key, values, feedback):
    """Twice the gain is twice the loop's gain: as if all gains of the controller were doubled."""
    gain = Choice(what=key, values=values)
    simulated = ambkit.Scenario(duration=0.02, noise=False).fed(feedback)
    a = varied("grid", gain, scenario=simulated)
    one, more = a.machines(a.points(0, 2), a.noise(0, 2), 0)
    pid = one.planned.scenario.controller
    assert more.planned.scenario.controller.kp == pytest.approx(1.2 * pid.kp)
    of_one, of_more = peaks([one.planned, more.planned])
    assert of_one != pytest.approx(of_more, rel=1e-3)


@pytest.mark.parametrize("feedback", ["estimate", "measurement"])
@pytest.mark.parametrize(
    "kind",
    ["linear", "closed-law", "extended", "low-pass", "unscented", "augmented", "steady-state"],
)
@pytest.mark.parametrize("preset", ["zittau_axial", "inteco_ml"])
def test_peaks_of_many_loops_are_those_of_each(preset, kind, feedback):
    b = ambkit.preset(preset)
    pid = ambkit.PID.for_bearing(b).model_copy(update={"feedback": feedback})
    made = Plan(Study(name="a", machine=preset, estimator=kind, runs=1)).estimators[kind]
    fed = made if feedback == "estimate" else None
    rng = np.random.default_rng(0)
    plants = [
        changed(b, {"rotor.mass": b.rotor.mass * m, "magnet.air_gap": b.magnet.air_gap * g,
                    "sensor.lag": m * b.sensor.lag, "amplifier.gain": g * b.amplifier.gain})
        for m, g in rng.uniform(0.9, 1.1, (3, 2))
    ]  # fmt: skip
    scenario = ambkit.Scenario(controller=pid)
    found = peaks([plans.Planned(p, scenario, fed) for p in plants])
    expected = [LoopBuilder(p, pid).peak(fed) for p in plants]
    np.testing.assert_allclose(found, expected, rtol=2e-6)


def test_margins_of_a_campaign_solve_no_equation_for_each_machine(monkeypatch):
    ambkit.PID.for_bearing(ambkit.preset("zittau_axial"))  # which is tuned once
    solved = []
    old = np.linalg.eigvals
    monkeypatch.setattr(np.linalg, "eigvals", lambda A: (solved.append(1), old(A))[1])
    monkeypatch.setattr(scipy.linalg, "solve_discrete_are", None)
    mass = Uniform(what="rotor.mass", tolerance="3 %")
    a = varied("sobol", mass, runs=64, estimator="closed-law", scenario={"duration": 0.002})
    rows = compute(a, 0, 64).runs.to_pydict()
    assert np.isfinite(rows["peak_S"]).all()
    assert len(solved) < 20


def test_an_unstable_loop_has_an_infinite_peak():
    b = ambkit.preset("zittau_axial")
    weak = ambkit.PID.for_bearing(b).model_copy(update={"kp": 10.0, "feedback": "measurement"})
    assert peaks([plans.Planned(b, ambkit.Scenario(controller=weak))]) == np.inf


# --- shares


@pytest.mark.parametrize(("count", "of"), [(0, 20), (20, 20), (7, 20), (990, 1000)])
def test_intervals_of_shares_are_those_of_clopper_and_pearson(count, of):
    found = clopper_pearson(count, of, 0.9)
    exact = binomtest(count, of).proportion_ci(0.9, method="exact")
    assert (found.low, found.high) == pytest.approx((exact.low, exact.high))


def test_looks_grow_and_end_with_the_study():
    assert looks(1, 1000, 10) == [1]
    assert looks(40, 100, 1000) == [10, 13, 17, 22, 28, 35, 40], "each a quarter more"
    assert looks(3, 100, 0) == [1, 2, 3]


# --- rows that stay


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.parquet"))}


def test_rows_are_the_same_to_the_last_bit_however_they_came(tmp_path, monkeypatch):
    """All at once; interrupted while a part is written, and gone on with in another order."""
    whole = run.campaign(study(), tmp_path / "a")
    assert len(whole) == 60
    real, calls = os.replace, []

    def interrupted(source, target):
        calls.append(target)
        if len(calls) == 6:
            raise KeyboardInterrupt
        real(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run.campaign(study(), tmp_path / "b", threads=1)
    monkeypatch.undo()
    half = run.status(tmp_path / "b")
    assert not half.data["complete"]
    assert 0 < half.data["parts"] < 4
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "b/runs").glob("part-*")}
    again = run.campaign(study(), tmp_path / "b")
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert {p: p.stat().st_mtime_ns for p in kept} == kept  # finished parts are left alone
    assert run.status(tmp_path / "b").data["complete"]
    of = {"folder", "worst", "worst_by"}  # which say where it lies
    one, other = again.to_dict(), whole.to_dict()
    assert {k: v for k, v in one.items() if k not in of} == {
        k: v for k, v in other.items() if k not in of
    }
    (tmp_path / "b/runs/part-000002.parquet").unlink()
    run.campaign(study(), tmp_path / "b")
    assert files(tmp_path / "a") == files(tmp_path / "b")


def test_runs_do_not_depend_on_the_parts(tmp_path):
    a = run.campaign(study(), tmp_path / "a")
    b = run.campaign(study(part=7), tmp_path / "b")
    for name in a.columns:
        np.testing.assert_array_equal(a.column(name), b.column(name))


def test_a_replay_is_the_run_of_the_rows(tmp_path):
    a = run.campaign(study(), tmp_path / "a")
    found = a.replay(17)
    for name, value in found.row.items():
        there = a.column(name)[17]
        assert value == there or (np.isnan(value) and np.isnan(there))
    x = found.run.record["x"]
    assert np.abs(x).max() == a.column("displacement_peak")[17]
    error = (found.run.estimate.f_d - found.run.record["f_d"])[1:]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(a.column("f_d_rms")[17], rel=1e-12)
    traced = a.replay(20).run.record["x"]
    import pyarrow.parquet as pq

    rows = pq.ParquetFile(tmp_path / "a/traces/part-000001.parquet").read().to_pydict()
    there = np.array(rows["x"])[np.array(rows["run"]) == 20]
    np.testing.assert_array_equal(there, traced)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: Path(f, "campaign.json").write_text("{"), "is no JSON"),
        (lambda f: Path(f, "runs/part-000001.parquet").write_bytes(b"PAR1"), "is damaged, delete"),
        (
            lambda f: Path(f, "campaign.json").write_text(
                Path(f, "campaign.json").read_text().replace('"ambkit": "', '"ambkit": "9')
            ),
            "was started by ambkit 9",
        ),
    ],
)
def test_what_is_wrong_with_a_folder_is_reported_at_once(spoil, message, call):
    assert call("campaign", "run", "s.toml", "--folder", "o")[0] == 0
    before = files(Path("o"))
    spoil("o")
    code, _, err = call("campaign", "run", "s.toml", "--folder", "o")
    assert code == 2
    assert message in err
    changed = {name for name, content in files(Path("o")).items() if before[name] != content}
    assert changed <= {"runs/part-000001.parquet"}


def test_a_changed_study_is_not_mixed_in(call):
    assert call("campaign", "run", "s.toml", "--folder", "o")[0] == 0
    Path("s.toml").write_text(STUDY.replace("2 %", "3 %"))
    code, _, err = call("campaign", "run", "s.toml", "--folder", "o")
    assert code == 2
    assert "o: belongs to another study" in err
    Path("other").mkdir()
    Path("other/thing").write_text("")
    code, _, err = call("campaign", "run", "s.toml", "--folder", "other")
    assert "other: holds thing and no campaign" in err
    code, _, err = call("campaign", "run", "s.toml", "--folder", "other/thing")
    assert code == 2
    assert "other/thing: cannot be made" in err
    assert "there is no campaign in it" in call("campaign", "status", "other")[2]


def test_a_full_disk_is_reported_and_leaves_what_there_was(call, monkeypatch):
    def full(_file):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        code, _, err = call("campaign", "run", "s.toml", "--folder", "o")
    assert code == 2
    assert "part-000000.parquet: cannot be written: No space left on device" in err
    assert not list(Path("o").rglob("*.tmp"))
    assert call("campaign", "run", "s.toml", "--folder", "o")[0] == 0


def test_two_campaigns_do_not_work_in_one_folder(tmp_path):
    place = store.Folder(tmp_path / "o", plan())
    with place.held(), pytest.raises(AmbkitError, match="another campaign is running in it"):
        run.campaign(study(), tmp_path / "o")
    run.campaign(study(), tmp_path / "o")


def test_a_study_stops_where_its_interval_is_narrow_enough(tmp_path):
    stop = {"width": 0.08, "least": 40}
    text = STUDY.replace("runs = 60", "runs = 400")
    made = Study.from_toml(text + f"\n[stop]\nwidth = {stop['width']}\nleast = {stop['least']}\n")
    found = run.campaign(made, tmp_path / "o")
    assert 40 <= len(found) < 400
    assert found.good.width <= 0.08
    assert run.status(tmp_path / "o").data["complete"]
    assert len(Campaign.load(tmp_path / "o")) == len(found)


def test_ctrl_c_says_that_it_can_be_gone_on_with(call, monkeypatch):
    def interrupted(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr(store.Folder, "write", interrupted)
    code, _, err = call("campaign", "run", "s.toml", "--folder", "o")
    assert code == 130
    assert "interrupted; finished parts are kept in o, the same command goes on" in err


# --- results


def test_the_folder_is_read_as_it_lies_by_others(tmp_path):
    duckdb, pandas, polars = (pytest.importorskip(n) for n in ("duckdb", "pandas", "polars"))
    found = run.campaign(study(), tmp_path / "o")
    runs = tmp_path / "o" / "runs"
    mean = found.column("f_d_rms").mean()
    assert pandas.read_parquet(runs)["f_d_rms"].mean() == pytest.approx(mean, rel=1e-12)
    assert polars.read_parquet(runs)["f_d_rms"].mean() == pytest.approx(mean, rel=1e-12)
    query = f"select avg(f_d_rms), count(*) from '{runs}/*.parquet'"
    assert duckdb.sql(query).fetchall()[0] == (pytest.approx(mean, rel=1e-12), 60)
    assert found.frame(["run", "estimator"])["estimator"].nunique() == 2


def test_results_have_their_words_tables_and_pictures(call):
    code, out, _ = call(
        "campaign", "run", "s.toml", "--folder", "o", "--out", "o.html", "--plot", "o.png"
    )
    assert code == 0
    assert "tolerances: 60 machines; " in out
    assert "Yield by estimator" in out
    assert "low-pass" in out
    assert "ambkit campaign replay o " in out
    page = Path("o.html").read_text(encoding="utf-8")
    for words in ("Sensitivities", "The worst machines", "Clopper and Pearson", "replay"):
        assert words in page
    found = Campaign.load("o")
    assert repr(found).startswith("<Campaign: tolerances: ")
    assert "yield" in found._repr_html_()
    told = json.loads(call("campaign", "report", "o", "--json")[1])
    assert told["yield"]["of"] == 60
    assert sum(told["zones"].values()) == 60
    assert set(told["quantiles"]) <= set(UNITS)
    command = told["worst"][0]["command"].split()
    assert call(*command[1:])[0] == 0
    assert Path(command[-1]).exists()
    assert "finished, 60 runs in 4 parts" in call("campaign", "status", "o")[1]
    assert json.loads(call("campaign", "problem", "s.toml")[1])["num_vars"] == 3
    assert "there is no run 60" in call("campaign", "replay", "o", "60")[2]


def test_extras_that_are_not_there_are_named(tmp_path, monkeypatch):
    import sys

    away = ("distributed", "SALib", "optuna")
    for name in {*away, *(name for name in sys.modules if name.startswith(away))}:
        monkeypatch.setitem(sys.modules, name, None)
    found = run.campaign(study(), tmp_path / "o")
    with pytest.raises(AmbkitError, match=r"ambkit\[campaign\]"):
        found.indices()
    with pytest.raises(AmbkitError, match=r"needs distributed: pip install 'ambkit\[campaign\]'"):
        run.campaign(study(), tmp_path / "p", cluster="local")
    with pytest.raises(AmbkitError, match=r"needs optuna"):
        ambkit.tune_robust(study())


def test_a_study_that_is_wrong_in_python_is_reported_alike():
    with pytest.raises(ConfigError, match=r"Study.vary\[0\].what: there is no key rotor.weight"):
        Study(name="a", machine="zittau_axial", runs=3, vary=(Uniform(what="rotor.weight"),))
