"""What stands around the package: workflow, hooks, and, if asked for, wheel and sdist.

The last takes minutes: AMBKIT_TEST_WHEEL=1 python -m pytest tests/test_distribution.py
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
WORKFLOW = ROOT / ".github" / "workflows" / "ci.yml"
HOOKS = ROOT / ".pre-commit-config.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def read(path):
    """YAML, whose word ``on`` is a key and no boolean."""
    loaded = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {"on" if key is True else key: value for key, value in loaded.items()}


def test_the_workflow_runs_what_ci_runs_and_builds_for_all():
    workflow = read(WORKFLOW)
    assert {"push", "pull_request"} <= set(workflow["on"])
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    assert all(("run" in step) != ("uses" in step) for step in steps)
    assert any(step.get("run") == ".ci/run" for step in steps)
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
    for used in (step["uses"] for step in steps if "uses" in step):
        assert re.fullmatch(r"[\w-]+/[\w-]+@v\d+(\.\d+)*", used), used
    built = workflow["jobs"]["wheels"]["strategy"]["matrix"]["include"]
    archs = {
        (each["runner"].split("-")[0], arch) for each in built for arch in each["archs"].split()
    }
    assert archs == {
        ("ubuntu", "x86_64"), ("ubuntu", "aarch64"),
        ("macos", "arm64"), ("macos", "x86_64"), ("windows", "AMD64"),
    }  # fmt: skip
    files = re.findall(
        r"tests/\w+\.py", WORKFLOW.read_text() + str(PROJECT["tool"]["cibuildwheel"])
    )
    assert files
    assert all((ROOT / file).is_file() for file in files)


@pytest.mark.skipif(shutil.which("actionlint") is None, reason="actionlint is not installed")
def test_actionlint_finds_nothing():
    done = subprocess.run(["actionlint", WORKFLOW], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


def test_wheels_are_for_all_pythons_that_we_say():
    """The oldest one has a wheel of its own up to the one that the stable ABI begins with."""
    oldest = int(PROJECT["project"]["requires-python"].removeprefix(">=3."))
    stable = int(PROJECT["tool"]["scikit-build"]["wheel"]["py-api"].removeprefix("cp3"))
    expected = [f"cp3{minor}-*" for minor in range(oldest, stable + 1)]
    assert PROJECT["tool"]["cibuildwheel"]["build"] == expected


@pytest.mark.parametrize(
    "hook", [hook for repo in read(HOOKS)["repos"] for hook in repo["hooks"]], ids=lambda h: h["id"]
)
def test_a_hook_runs_a_tool_that_is_there(hook):
    assert hook["language"] == "system"
    command, *_ = hook["entry"].split()
    assert (Path(sys.executable).parent / Path(command).name).is_file()
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    if "files" in hook:
        assert any(re.search(hook["files"], name) for name in tracked)


asked = pytest.mark.skipif(
    "AMBKIT_TEST_WHEEL" not in os.environ, reason="takes minutes: set AMBKIT_TEST_WHEEL=1"
)


def uv(*arguments):
    """Run uv, from the machine or as ./test fetched it."""
    local = ROOT / ".tools" / "bin" / "uv"
    subprocess.run([shutil.which("uv") or str(local), *map(str, arguments)], check=True)


@asked
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_it_works_where_nothing_else_is(kind, tmp_path):
    uv("build", f"--{kind}", "--python", sys.executable, "--out-dir", tmp_path, ROOT)
    pattern = "*.whl" if kind == "wheel" else "*.tar.gz"
    (built,) = tmp_path.glob(pattern)
    if kind == "wheel":
        tracked = subprocess.run(
            ["git", "ls-files", "src/ambkit", "core", "sim"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout.split()  # fmt: skip
        expected = {re.sub(r"^(src/ambkit|(?=core|sim))", "ambkit/", name) for name in tracked}
        inside = set(zipfile.ZipFile(built).namelist())
        assert {name.replace("//", "/") for name in expected} <= inside
    uv("venv", "--python", sys.executable, tmp_path / "clean")
    python = tmp_path / "clean" / "bin" / "python"
    # As for a stranger: the settings of the checkout would build without what the sdist asks for.
    uv("pip", "install", "--no-config", "--python", python, built)
    subprocess.run([python, ROOT / "tests" / "installed.py"], check=True, cwd=tmp_path)
