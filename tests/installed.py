"""Walk from a bearing to compiled C with the package as it was installed, away from the checkout.

    python tests/installed.py

Run by the Python that it is installed for, after each wheel that is built. Needs nothing but the
package; the C is compiled where there is a compiler that knows cc's options.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
SCRIPT = """
import ambkit
bearing = ambkit.Machine.load("my.toml")
record = ambkit.Record.load("run.csv")
estimate = ambkit.KalmanFilter(bearing).run(record)
assert estimate.x.shape == record.t.shape
"""


def ambkit(*arguments: str, out: Path | None = None) -> None:
    """Run a command, which must succeed."""
    print("ambkit", *arguments, flush=True)
    python("-m", "ambkit", *arguments, out=out)


def python(*arguments: str, out: Path | None = None) -> None:
    """Run Python without the folder it stands in on its path."""
    command = [sys.executable, "-P", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8")
    if done.returncode:
        sys.exit(f"{' '.join(arguments)} ended with {done.returncode}\n{done.stderr}{done.stdout}")
    if out:
        out.write_text(done.stdout, encoding="utf-8")


def compiled(folder: Path) -> None:
    """Build the exported C as README.md says, and let its self-test say that it is the filter."""
    print(f"compiling {folder.name}", flush=True)
    if shutil.which("cmake") and shutil.which("make"):
        build = folder.parent / "build"
        for command in (["cmake", "-S", folder, "-B", build], ["cmake", "--build", build]):
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        program = build / "selftest"
    elif compiler := next(filter(shutil.which, ("cc", "gcc", "clang")), None):
        program = folder.parent / "selftest"
        sources = sorted(folder.rglob("*.c"))
        includes = [f"-I{folder / name}" for name in (".", "core", "core/include")]
        flags = ["-std=c99", "-O2", "-ffp-contract=off", *includes]
        subprocess.run([compiler, *flags, *sources, "-o", program], check=True)
    else:
        print("there is no C compiler: the export is not compiled")
        return
    said = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    assert said.startswith("pass:"), said


def main() -> None:
    """Walk all of it in a folder of its own."""
    os.environ |= {"PYTHONUTF8": "1", "PYTHONIOENCODING": "utf-8"}
    for name in ("PYTHONPATH", "PYTHONHOME"):
        os.environ.pop(name, None)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        where = "import ambkit, pathlib; print(pathlib.Path(ambkit.__file__).resolve())"
        python("-c", where, out=Path("where.txt"))
        place = Path(Path("where.txt").read_text(encoding="utf-8").strip())
        assert not place.is_relative_to(HERE / "src"), f"{place} is the checkout, not an install"
        ambkit("presets", "zittau_axial", out=Path("my.toml"))
        ambkit("simulate", "my.toml", "--step", "0.3 mm", "--duration", "0.3 s", "--out", "run.csv")
        ambkit("check", "my.toml", "run.csv")
        ambkit("filter", "run.csv", "--machine", "my.toml", "--plot", "run.png", "--out", "est.csv")
        ambkit("filter", "run.csv", "--machine", "my.toml", "--plot", "run.html")
        ambkit("identify", "my.toml", "run.csv", "--out", "found.toml")
        ambkit("train", "my.toml", "--out", "expert.json")
        ambkit("filter", "run.csv", "--machine", "found.toml", "--filter",
               "adaptive@expert.json")  # fmt: skip
        ambkit("export", "c", "my.toml", "--filter", "expert.json", "--out", "c")
        ambkit("export", "fmu", "my.toml", "--out", "filter.fmu")
        compiled(Path("c").resolve())
        ambkit("tune", "found.toml", "run.csv", "--budget", "10",
               "--out", "filter.toml")  # fmt: skip
        ambkit("export", "c", "filter.toml", "--out", "tuned")
        print("examples/thread.py", flush=True)
        shutil.copy(HERE / "examples" / "thread.py", "thread.py")
        python("thread.py", out=Path("said.txt"))
        said = Path("said.txt").read_text(encoding="utf-8")
        assert "0 states differ" in said or "no C compiler" in said, said
        assert "than of the filter that was told everything" in said, said
        Path("script.py").write_text(SCRIPT, encoding="utf-8")
        python("script.py")
        python("-c", "from ambkit.data.recordings import *")
        python(
            "-c",
            "from ambkit.base.files import module_beside as f; f('docs', 'paper.reproduction'); "
            "from paper import study, recording, verdicts; verdicts.summary([], {})",
        )
        for made in ("run.png", "run.html", "est.csv", "found.toml", "filter.fmu"):
            assert Path(made).stat().st_size > 0, made
        os.chdir(HERE)
    print(f"{place.parent}: from the bearing to C, all of it")


if __name__ == "__main__":
    main()
