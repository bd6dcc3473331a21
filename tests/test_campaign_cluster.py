"""Campaigns with real processes: on clusters, killed at any instant, and gone on with.

The rows must be those of one process that nobody disturbed, to the last bit.
"""

import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kills processes by SIGKILL"),
]

STUDY = """
name = "killed"
machine = "zittau_axial"
runs = 2400
part = 160
seed = 1
estimator = "linear"

[scenario]
duration = "50 ms"
disturbance = { type = "step", amplitude = "3 N", time = "10 ms" }

[[vary]]
what = "magnet.air_gap"
type = "normal"
std = "2 %"

[[vary]]
what = "rotor.mass"
type = "uniform"
tolerance = "5 %"
"""

ENVIRONMENT = os.environ | {
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


def command(*arguments):
    return [sys.executable, "-m", "ambkit", "campaign", "run", *arguments]


def started(folder, *arguments, **more):
    """Begin a campaign in a process of its own, with what it starts in a group."""
    return subprocess.Popen(
        command("s.toml", *arguments), cwd=folder, text=True, env=ENVIRONMENT,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, **more,
    )  # fmt: skip


def finished(process, seconds=240):
    try:
        _, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    return process.returncode, err


def parts(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.glob("runs/part-*.parquet"))}


def until(true, seconds=90):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def began(process, folder, seen):
    """Wait until a campaign has more parts than were seen, or has ended."""
    until(lambda: len(parts(folder)) > seen or process.poll() is not None)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return a folder with the study, and its rows by one process."""
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "s.toml").write_text(STUDY)
    code, err = finished(started(folder, "--folder", "alone"))
    assert code == 0, err
    found = parts(folder / "alone")
    assert len(found) == 15
    return folder, found


def test_killed_at_random_moments_it_ends_with_the_same_rows(undisturbed):
    folder, expected = undisturbed
    draw, kills, seen = random.Random(7), 0, 0
    while True:
        process = started(folder, "--folder", "killed", "--threads", "1")
        try:
            # As long as it takes to begin, and then at any instant of the work.
            began(process, folder / "killed", seen)
            time.sleep(draw.uniform(0.0, 0.3))
        finally:
            running = process.poll() is None
            if running:
                os.killpg(process.pid, signal.SIGKILL)
        code, err = finished(process)
        assert code in (0, -signal.SIGKILL), err
        there = parts(folder / "killed")
        assert all(expected[name] == content for name, content in there.items())
        assert len(there) >= seen  # a finished part stays
        seen, kills = len(there), kills + running
        if code == 0 or kills == 2:
            break
    code, err = finished(started(folder, "--folder", "killed"))
    assert code == 0, err
    assert kills > 0
    assert parts(folder / "killed") == expected
    assert not list((folder / "killed").rglob("*.tmp"))


def test_ctrl_c_leaves_what_is_gone_on_with(undisturbed):
    folder, expected = undisturbed
    process = started(
        folder, "--folder", "stopped", "--threads", "1",
        # A test that runs in the background inherits that SIGINT is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    until(lambda: parts(folder / "stopped"))
    os.killpg(process.pid, signal.SIGINT)
    code, err = finished(process)
    assert code == 130
    assert "finished parts are kept in stopped" in err
    assert "Traceback" not in err
    assert finished(started(folder, "--folder", "stopped"))[0] == 0
    assert parts(folder / "stopped") == expected


def test_a_file_that_may_not_grow_is_reported(undisturbed):
    """As a full disk or a quota: the system refuses the write itself."""
    folder, _ = undisturbed

    def small():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000))

    code, err = finished(started(folder, "--folder", "full", preexec_fn=small))
    assert code == 2
    assert "cannot be written: File too large" in err
    assert parts(folder / "full") == {}


def test_workers_of_this_machine_give_the_same_rows(undisturbed):
    folder, expected = undisturbed
    process = started(folder, "--folder", "local", "--cluster", "local", "--workers", "2")
    code, err = finished(process)
    assert code == 0, err
    assert parts(folder / "local") == expected


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def dask(*arguments):
    """Start a scheduler or a worker of Dask, as its users do."""
    process = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def scheduler(port):
    return dask("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")


def worker(port):
    return dask(
        "dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-nanny",
        "--no-dashboard", "--death-timeout", "60",
    )  # fmt: skip


def test_a_worker_killed_midway_changes_nothing(undisturbed):
    folder, expected = undisturbed
    port = free_port()
    with scheduler(port), worker(port) as first, worker(port):
        process = started(folder, "--folder", "worker", "--cluster", f"tcp://127.0.0.1:{port}")
        until(lambda: len(parts(folder / "worker")) >= 3)
        os.killpg(first.pid, signal.SIGKILL)
        code, err = finished(process)
    assert code == 0, err
    assert parts(folder / "worker") == expected


def test_a_scheduler_that_is_started_again_is_given_the_rest(undisturbed):
    folder, expected = undisturbed
    port = free_port()
    with scheduler(port) as old, worker(port):
        process = started(folder, "--folder", "scheduler", "--cluster", f"tcp://127.0.0.1:{port}")
        until(lambda: len(parts(folder / "scheduler")) >= 3)
        os.killpg(old.pid, signal.SIGKILL)
        old.wait()
        with scheduler(port), worker(port):
            code, err = finished(process)
    assert code == 0, err
    assert parts(folder / "scheduler") == expected


def test_a_scheduler_that_is_not_there_is_reported(undisturbed):
    folder, _ = undisturbed
    from ambkit.base.errors import AmbkitError
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.run import of
    from ambkit.campaigns.study import Study

    plan = Plan(Study.load(folder / "s.toml"))
    where = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(AmbkitError, match=r"no answer from .* the same command resumes"):
        list(of(where, plan, [0], patience=1.0))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # half made
def test_jobs_of_slurm_are_asked_for_as_the_configuration_says():
    pytest.importorskip("dask_jobqueue")
    import dask

    from ambkit.base.errors import AmbkitError
    from ambkit.campaigns.run import _slurm

    with pytest.raises(AmbkitError, match=r"describe a job in .*jobqueue.yaml"):
        _slurm()
    with dask.config.set({"jobqueue.slurm.cores": 4, "jobqueue.slurm.memory": "8GB",
                          "jobqueue.slurm.queue": "night"}):  # fmt: skip
        cluster = _slurm()
        script = cluster.job_script()
        cluster.close()
    assert "#SBATCH -p night" in script
    assert json.dumps(sys.executable).strip('"') in script
