"""The thread: from a rig's log, German, turned, late and off, to C that takes its raw signal."""

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ambkit
from ambkit import Estimator, Machine
from ambkit.data.channel_map import ChannelMap, inputs_of
from ambkit.workflow import design_candidates
from ambkit.workflow.design import design, objections_to_loop
from ambkit.workflow.identified import identified_filter
from ambkit.workflow.identified_toml import annotated_toml

KNOWN = Machine.preset("zittau_axial").replace(name="my rig")
TRUE = KNOWN.replace(delay="0.15 ms", magnet__magnet_constant="6.2 N mm^2/A^2")
FREE = ["magnet_constant", "delay", "disturbance_noise"]
MAP = """
[signals.t]
column = "Zeit"
unit = "s"
[signals.y]
column = "Abstand"
unit = "mm"
sign = -1
offset = "10 mm"
[signals.u]
column = "Strom"
unit = "A"
scale = "1 V/A"
offset = "-0.94 V"
"""


def simulated(seed):
    places = (3e-4, -3e-4, 2e-4, -2e-4, 3e-4, -2e-4, 2e-4, -3e-4, 1e-4, 0.0)
    times = tuple(0.05 + 0.12 * k for k in range(len(places)))
    reference = ambkit.Sequence(times=times, values=places)
    load = ambkit.Sequence(times=(0.0, 0.6), values=(0.0, 1.0))
    scenario = ambkit.Scenario(duration=1.3, reference=reference, disturbance=load, seed=seed)
    return ambkit.simulate(TRUE, scenario).record


def logged(record, path):
    """Write a log as the rig has it; return its numbers."""
    y = np.array([f"{v:.7g}" for v in 10.0 - 1e3 * record["y"]])
    u = np.array([f"{v:.7g}" for v in record["u"] + 0.94])
    rows = (f"{t:.7g};{a};{b}".replace(".", ",") for t, a, b in zip(record.t, y, u, strict=True))
    path.write_text("\n".join(["Zeit;Abstand;Strom", *rows]) + "\n")
    return y.astype(float), u.astype(float)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    for seed in (1, 2):
        logged(simulated(seed), folder / f"log{seed}.csv")
    (folder / "map.toml").write_text(MAP)
    return folder, made(folder)


def made(folder, **options):
    return design(
        KNOWN, [folder / "log1.csv"], folder / "out", channels=folder / "map.toml", free=FREE,
        validate=[folder / "log2.csv"], kinds=["linear", "extended"], prefix="rig",
        precision="double", **options,
    )  # fmt: skip


def test_the_filter_is_nearly_as_good_as_one_that_was_told_everything(rig):
    folder, found = rig
    made = Estimator.load(folder / "out" / "filter.toml")
    told = ambkit.ExtendedKalmanFilter(TRUE, noise=ambkit.FilterNoise(*made.variances))
    ours, best, raw = [], [], []
    for seed in range(20, 30):
        record = simulated(seed)
        late = slice(500, None)
        a = made.run_raw(10 - 1e3 * record["y"], record["u"] + 0.94)
        b = told.run(record)
        ours.append([np.mean((a[s] - record[s])[late] ** 2) for s in ("x", "f_d")])
        best.append([np.mean((b[s] - record[s])[late] ** 2) for s in ("x", "f_d")])
        raw.append(np.mean((record["y"] - record["x"])[late] ** 2))
    ratio = np.sqrt(np.mean(ours, axis=0) / np.mean(best, axis=0))
    assert (ratio < 1.1).all(), ratio
    assert np.sqrt(np.mean(ours, axis=0)[0]) < 0.7 * np.sqrt(np.mean(raw))
    assert found.chosen.kind == "extended"


def test_it_says_which_filter_to_fly_and_why(rig):
    folder, found = rig
    assert found.finding.startswith(
        "Use the extended Kalman filter with decentralised PID control: "
    )
    rows = {row.key: row for row in found.rows if row.of == found.chosen.kind}
    assert rows["x"].value < rows["raw_sensors"].value
    assert rows["load"].value > 0
    assert rows["ahead_10"].value > rows["ahead_1"].value
    assert found.objections == ()
    page = (folder / "out" / "design.html").read_text()
    assert "Use the extended Kalman filter" in page
    assert set(found.made) >= {"machine.toml", "scenario.toml", "filter.toml", "verdict.html", "c",
                               "controller", "design.html", "candidates"}  # fmt: skip


def test_the_c_gives_python_s_bits_on_the_rig_s_own_numbers(rig, tmp_path):
    compiler = shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler (gcc or clang) here")
    folder, _ = rig
    y, u = logged(simulated(7), tmp_path / "log.csv")
    numbers = "\n".join(f"{a!r} {b!r}" for a, b in zip(y.tolist(), u.tolist(), strict=True))
    (tmp_path / "run.c").write_text("""
#include <stdio.h>
#include "rig.h"
int main(void)
{
  static rig_state state;
  rig_estimates now;
  double y, u, before = 0.0;
  rig_init(&state);
  while (scanf("%lf %lf", &y, &u) == 2) {
    (void)rig_step(&state, y, before, &now);
    before = u;
    printf("%.17g %.17g %.17g\\n", now.x, now.v, now.f_d);
  }
  return 0;
}
""")
    c = folder / "out" / "c"
    sources = [p for p in c.rglob("*.c") if "selftest" not in p.parts]
    flags = ["-std=c99", "-O1", "-ffp-contract=off", "-DAMB_NO_CONTRACTION"]
    includes = [f"-I{c}", f"-I{c / 'core/include'}", f"-I{c / 'core'}"]
    subprocess.run([compiler, *flags, *includes, tmp_path / "run.c", *sources, "-o",
                    tmp_path / "run"], check=True)  # fmt: skip
    out = subprocess.run([tmp_path / "run"], input=numbers, capture_output=True, text=True).stdout
    got = np.array([line.split() for line in out.splitlines()], dtype=float)
    estimate = Estimator.load(folder / "out" / "filter.toml").run_raw(y, u)
    np.testing.assert_array_equal(got, estimate.mean[:, :3])


def test_a_bad_filter_is_not_exported_unasked(rig, monkeypatch, capsys):
    folder, _ = rig
    monkeypatch.setattr(design_candidates, "FAR_FROM_BOUND", -0.01)
    shutil.rmtree(folder / "out" / "c")
    refused = made(folder)
    assert refused.exported is None
    assert not (folder / "out" / "c").exists()
    assert "above the Cramér-Rao bound, more than -1 %" in refused.objections[0]
    assert made(folder, anyway=True).exported is not None


def test_a_filter_out_of_zone_a_is_not_exported_unasked(rig):
    _, found = rig
    assert all(1 < each.peak < 3 for each in found.candidates)
    assert found.to_dict()["candidates"]["linear"]["peak"] == found.candidates[0].peak
    risky = SimpleNamespace(stable=True, peak=3.52)
    (objection,) = objections_to_loop(risky, None)
    assert "the peak of |S| is 3.52, zone B of ISO 14839-3" in objection
    (objection,) = objections_to_loop(found.loop, 1.5)
    assert "not below 1.5" in objection


def test_the_command_makes_what_was_lost_again_and_alike_and_nothing_else(rig, call, monkeypatch):
    folder, found = rig
    KNOWN.save(folder / "known.toml")
    monkeypatch.chdir(folder)
    files = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*.toml")}
    lost = Path("out/candidates/linear.toml")
    before = lost.read_text()
    lost.unlink()
    free = [word for name in FREE for word in ("--free", name)]
    arguments = ["design", "known.toml", "log1.csv", "--channels", "map.toml", "--validate",
                 "log2.csv", *free, "--filter", "linear", "--filter", "extended", "--prefix", "rig",
                 "--precision", "double", "--out", "out"]  # fmt: skip
    told = call(*arguments)
    assert told.code == 0
    assert " ".join(found.finding.split()) in " ".join(told.out.split())
    assert lost.read_text() == before
    kept = files.keys() - {lost, Path("out/filter.toml")}
    assert all(path.stat().st_mtime_ns == files[path] for path in kept)


@pytest.mark.long
def test_zeros_that_a_log_does_not_tell_stay_as_the_map_has_them(rig):
    """Under an unknown load the offsets are as likely none; a filter with them would be far off."""
    folder, _ = rig
    channels = ChannelMap.load(folder / "map.toml")
    record = ambkit.load(folder / "log1.csv", channels)
    of_log = inputs_of(channels)
    found = ambkit.identify(KNOWN, record, free=[*FREE, "position_offset", "current_offset"])
    assert not found.likelihood.offsets_count
    assert found.likelihood.standard_error("position_offset") > 1e-6
    made = identified_filter(found, of_log)
    assert made.inputs == of_log
    assert "inputs.y.offset" not in made.origin
    (said,) = found.of_the_zeros
    assert "consistent with zero; the offsets are unchanged" in said
    assert "[signals." not in annotated_toml(found.likelihood, folder)
