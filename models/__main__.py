"""Write what follows from the models: ``python -m models`` (``--check`` only compares)."""

import shutil
import subprocess
import sys
from pathlib import Path

from ambkit.models import compose, emit
from ambkit.models.declaration import Part
from ambkit.models.machine_parts import PAPER_CONSTANTS
from ambkit.models.parts.amplifier import Amplifier
from ambkit.models.parts.disturbance import Disturbance
from ambkit.models.parts.magnet import MagnetForce
from ambkit.models.parts.rotor import Rotor
from ambkit.models.parts.sensor import Sensor
from models.axial import axial
from models.closed import initialisation
from models.exponential import exponential_header
from models.laws import LAWS, written

ROOT = Path(__file__).resolve().parent.parent
GENERATED = "core/generated"
BY = "`python -m models`"


def formatted(text: str, name: str) -> str:
    """Return C as clang-format writes it with the project's style, and Python as ruff does."""
    tool = "ruff" if name.endswith(".py") else "clang-format"
    options = ["format", "--line-length=100", "-"] if tool == "ruff" else [
        f"--style=file:{ROOT / '.clang-format'}", f"--assume-filename={name}",
    ]  # fmt: skip
    program = shutil.which(tool, path=str(Path(sys.executable).parent)) or tool
    command = [program, *options]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def axial_headers() -> dict[str, str]:
    """Return the headers of the paper's axis: its steps by the pattern, its constants by SymPy."""
    plainest: list[Part] = [
        Rotor(1.0, 1.0, 1.0), MagnetForce(1.0), Disturbance(1.0, 1.0), Sensor(1.0, 1.0, 1.0),
        Amplifier(1.0, None),
    ]  # fmt: skip
    names = emit.Names(compose(plainest, 1.0, name=axial.name), PAPER_CONSTANTS)
    steps = emit.header(
        names, axial.about, stem=axial.name, by=BY, includes=["phi"], more=initialisation(axial)
    )
    return {
        f"{GENERATED}/{axial.name}.h": steps,
        f"bindings/{axial.name}_fields.h": emit.fields(names, stem=axial.name, by=BY),
    }


def texts() -> dict[str, str]:
    """Return all that is written, by its place in the checkout."""
    results = {f"{GENERATED}/exponential.h": exponential_header()}
    results |= axial_headers()
    for law in LAWS:
        if law.shared:
            results[f"{GENERATED}/{law.name}_law.h"] = written.header(law)
        results[f"core/include/ambkit/{law.name}.h"] = written.declaration(law)
        results[f"core/src/{law.name}.c"] = written.methods(law)
    results["bindings/laws.h"] = written.binding(LAWS)
    results["src/ambkit/machine/laws.py"] = written.python(LAWS)
    return results


def main() -> int:
    """Write, or compare, all files; return 1 where a committed file is stale."""
    stale = 0
    for name, unformatted in texts().items():
        path, text = ROOT / name, formatted(unformatted, name)
        if "--check" in sys.argv:
            if not path.exists() or path.read_text() != text:
                print(f"{name} is not what the models say", file=sys.stderr)
                stale = 1
        else:
            path.write_text(text)
    return stale


if __name__ == "__main__":
    sys.exit(main())
