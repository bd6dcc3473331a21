"""Small faults that a verification from outside found, each with what is said now."""

import os

import pytest

import ambkit
from ambkit import AmbkitError, Machine
from ambkit.base import units
from ambkit.estimate.filter_file import FORMAT
from ambkit.estimate.registry import KINDS
from ambkit.export.c import export_c
from ambkit.workflow.check import inspect

ZITTAU = Machine.preset("zittau_axial")


@pytest.mark.parametrize("kind", [ambkit.Machine])
@pytest.mark.parametrize("name", [3, None, 2.5])
def test_a_number_is_no_preset(kind, name):
    with pytest.raises(AmbkitError, match="a preset has a name, such as"):
        kind.preset(name)


@pytest.mark.parametrize("key", ["sensor.gain", "amplifier.gain"])
@pytest.mark.parametrize("gain", [1e-320, 1e-30, 1e300])
def test_a_gain_that_no_number_format_bears_is_refused(key, gain):
    with pytest.raises(AmbkitError, match=rf"{key}: must be at (least|most)"):
        ZITTAU.replace(**{key: gain})


@pytest.mark.parametrize("unit", ["mm^99999999999", "mm^-99999999999", "mm^9999"])
def test_a_unit_without_a_size_is_no_unit(unit):
    for ask in (lambda: units.factor(unit, "m"), lambda: units.factor(unit, unit)):
        with pytest.raises(ValueError, match=r"too (large|small)|not a known unit|converted"):
            ask()


def test_a_log_with_such_a_unit_is_refused_and_guessed_at_alike(tmp_path, call):
    log = tmp_path / "a.csv"
    log.write_text("t [s],y [mm^99999999999],u [V]\n" + "".join(f"{k},1,2\n" for k in range(9)))
    for words in (["check", str(log)], ["read", str(log)], ["read", "guess", str(log)]):
        told = call(*words)
        assert told.code in (0, 2)
        assert "report it" not in told.err


def test_what_may_never_end_is_not_checked(tmp_path):
    zero, pipe = tmp_path / "zero.toml", tmp_path / "pipe.csv"
    zero.symlink_to("/dev/zero")
    os.mkfifo(pipe)
    for each in (zero, pipe):
        assert inspect(each).problems == (
            f"{each}: is no file but a device or a pipe, which may never end",
        )


def filter_text(tmp_path):
    path = tmp_path / "made.toml"
    ambkit.ExtendedKalmanFilter(ZITTAU).save(path)
    return path.read_text()


def test_a_filters_file_has_a_version(tmp_path):
    text = filter_text(tmp_path)
    assert text.startswith(f"format = {FORMAT}\n")
    path = tmp_path / "f.toml"
    path.write_text(text.replace(f"format = {FORMAT}\n", ""))  # as those before it
    assert inspect(path).problems == ()
    path.write_text(text.replace(f"format = {FORMAT}", f"format = {FORMAT + 1}"))
    (problem,) = inspect(path).problems
    assert problem == f"{path}:1: format: is 2, and this ambkit reads up to 1: use a newer one"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gate =", "gaet =", "gaet: unknown key, did you mean gate?"),
        ("kind =", 'colour = "blue"\nkind =', "colour: unknown key"),
        ('preset = "zittau_axial"', "preset = 3", "machine.preset: must be a valid string, is 3"),
    ],
)
def test_one_mistake_in_a_filters_file_is_one_error(tmp_path, old, new, message):
    path = tmp_path / "f.toml"
    path.write_text(filter_text(tmp_path).replace(old, new))
    (problem,) = inspect(path).problems
    assert message in problem


class Mine:
    """A class of one's own, which is no estimator of this house."""

    def update(self, y, u):
        return y


@pytest.mark.parametrize(("given", "error", "message"), [
    *((given, TypeError, r"must be of type .*, is the ")
      for given in (Mine(), ambkit.KalmanFilter, 3, [Mine()])),
    *((given, AmbkitError, r"there is no filter .*linear") for given in ("nosuch", ["nosuch"])),
])  # fmt: skip
def test_what_is_no_filter_is_named_in_a_line(given, error, message):
    calls = [
        lambda: ambkit.assess(ZITTAU, given),
        lambda: ambkit.compare(ZITTAU, given),
        lambda: ambkit.inject_faults(ZITTAU, given),
    ]
    if error is TypeError:
        calls += [
            lambda: ambkit.simulate(ZITTAU, filter=given, duration=0.01).record,
            lambda: ambkit.run_many(given, [0.0], [0.0]),
            lambda: ambkit.harmonics(given, None),
        ]
    else:
        calls.append(lambda: ambkit.tune(ZITTAU, filter=given))
    for call in calls:
        with pytest.raises(error, match=message):
            call()


@pytest.mark.parametrize("given", ["zittau_axial", 3, Mine()])
def test_what_is_no_machine_is_named_in_a_line(given):
    kinds = [kind for kind in KINDS.values() if not kind.magnet]
    calls = [lambda kind=kind: kind.make(given) for kind in kinds]
    pid = ambkit.PID
    for call in (*calls, *(lambda of=of: of(given) for of in (pid.for_bearing, pid.textbook))):
        with pytest.raises(TypeError, match=r"machine must be of type Machine.*, is "):
            call()


def test_a_pid_for_several_axes_is_refused_in_a_line():
    with pytest.raises(AmbkitError, match="tum_mlps has the axes A1, A2, B1, B2: name one of them"):
        ambkit.PID.for_bearing(ambkit.Machine.preset("tum_mlps"))


@pytest.mark.parametrize(("call", "message"), [
    (lambda _: ambkit.AdaptiveKalmanFilter(ZITTAU, 3), "magnet must be of type MagnetModel, is"),
    (lambda _: ambkit.inject_faults(ZITTAU, {"a": 3}), "a must be of type Estimator, is the int 3"),
    (lambda to: export_c("zittau_axial", ambkit.KalmanFilter(ZITTAU), to),
     "machine must be of type Machine, is the str"),
    (lambda to: export_c(ZITTAU, "linear", to), "filter must be of type Estimator, is the str"),
])  # fmt: skip
def test_what_does_not_fit_is_named_in_a_line(call, message, tmp_path):
    with pytest.raises(TypeError, match=message):
        call(tmp_path / "c")


def test_tune_names_a_sampling_time_that_is_not_the_records(tmp_path, call):
    """It ended with "this is an error of ambkit"."""
    log = tmp_path / "slow.csv"
    log.write_text("t [s],y [mm],u [V]\n" + "".join(f"{k / 1000},0.1,0\n" for k in range(900)))
    told = call("tune", "zittau_axial", log, "--budget", "2")
    assert told.code == 2
    assert "is sampled every 0.001 s, but 'zittau_axial'" in told.err


def test_a_document_that_never_ends_is_refused(monkeypatch):
    """``ambkit simulate <(yes)`` read on until it was killed."""
    monkeypatch.setenv("AMBKIT_READ_MEMORY", "1 GB")
    with pytest.raises(AmbkitError, match="a device that does not end within 10 MB"):
        ambkit.Machine.load("/dev/zero")


def test_compare_by_a_list_in_the_place_of_a_case():
    with pytest.raises(TypeError, match="case must be of type str or Case"):
        ambkit.compare(ZITTAU, case=["linear"])


def test_a_class_is_told_to_be_made():
    with pytest.raises(TypeError, match=r"KalmanFilter\(\.\.\.\) makes one"):
        ambkit.simulate(ZITTAU, filter=ambkit.KalmanFilter)


@pytest.mark.parametrize(
    ("speed", "message"), [(10471.9755, "100000 rpm"), (0.0, "0 rpm"), (1.1e5, "1050400 rpm")]
)
def test_speeds_have_no_exponent(speed, message):
    assert units.rpm(speed) == message


def test_parts_of_a_campaign_say_what_they_were_made_from(tmp_path):
    from pyarrow import parquet

    study = ambkit.Study(
        name="a", machine="zittau_axial", runs=2, part=2, seed=7, scenario={"duration": 0.002},
        record={"margins": False},
    )  # fmt: skip
    found = ambkit.campaign(study, tmp_path / "out")
    (part,) = (tmp_path / "out" / "runs").glob("*.parquet")
    told = {k.decode(): v.decode() for k, v in parquet.read_schema(part).metadata.items()}
    assert told["seed"] == "7"
    assert told["study_hash"] == found.plan.fingerprint
    assert told["ambkit"] == ambkit.__version__
    assert {"numpy", "scipy", "python", "study", "part"} <= told.keys()


@pytest.mark.parametrize("name", ["ambkit", "numpy", "python"])
def test_a_worker_of_other_versions_is_refused(name):
    from ambkit.campaigns.worker import part_of, versions

    with pytest.raises(AmbkitError, match=rf"worker .* has {name} .*, and this is {name} 0\.0\.1"):
        part_of(b"", 0, versions() | {name: "0.0.1"})


@pytest.mark.parametrize("adds", ["", ".exe"])
def test_what_a_compiler_calls_its_output_does_not_matter(tmp_path, monkeypatch, adds):
    """Gcc for Windows adds ``.exe`` to an output without an ending."""
    from ambkit.export.fmu import sources

    fake = tmp_path / "x86_64-w64-mingw32-gcc"
    fake.write_text(
        "#!/bin/sh\nfor last; do :; done\n"
        f'case "$last" in *.*) ;; *) last="$last{adds}";; esac\necho made > "$last"\n'
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert sources.compiled({"a.c": ""}, ["a.c"], cross=fake.name) == b"made\n"


def test_a_mistake_in_an_expert_is_told_with_its_line(tmp_path):
    from ambkit.fuzzy.training import train

    path = tmp_path / "expert.json"
    train(ZITTAU).save(path)
    lines = path.read_text().splitlines()
    rule = next(k for k, line in enumerate(lines) if "weight_k_i" in line) + 2
    lines[rule] = lines[rule].replace('"weight_k_i": ', '"weight_k_i": "x", "colour": ', 1)
    path.write_text("\n".join(lines))
    problems = inspect(path).problems
    assert len(problems) == 2
    assert all(each.startswith(f"{path}:{rule + 1}: rules") for each in problems), problems
    path.write_text("[3]\n")
    assert inspect(path).problems[0].startswith(f"{path}:1: ")
