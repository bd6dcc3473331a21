"""Write core/generated/ from the models: ``python -m models`` (``--check`` only compares)."""

import shutil
import subprocess
import sys
from pathlib import Path

from ambkit.models import compose, emit
from ambkit.models.axis_parts import PAPER_CONSTANTS
from ambkit.models.declaration import Part
from ambkit.models.parts import Amplifier, Disturbance, MagnetPlace, Rotor, Sensor
from models.axial import axial
from models.closed import initialisation
from models.exponential import exponential_header
from models.laws import LAWS
from models.laws import law as force_law

ROOT = Path(__file__).resolve().parent.parent
GENERATED = ROOT / "core" / "generated"
BY = "`python -m models`"


def formatted(text: str) -> str:
    """Return C as clang-format writes it with the project's style."""
    tool = shutil.which("clang-format", path=str(Path(sys.executable).parent)) or "clang-format"
    command = [tool, f"--style=file:{ROOT / '.clang-format'}"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def axial_headers() -> dict[str, str]:
    """Return the headers of the paper's axis: its steps by the pattern, its constants by SymPy."""
    plainest: list[Part] = [
        Rotor(1.0, 1.0, 1.0), MagnetPlace(1.0), Disturbance(1.0, 1.0), Sensor(1.0, 1.0, 1.0),
        Amplifier(1.0, None),
    ]  # fmt: skip
    names = emit.Names(compose(plainest, 1.0, name=axial.name), PAPER_CONSTANTS)
    steps = emit.header(
        names, axial.about, stem=axial.name, by=BY, includes=["phi"], more=initialisation(axial)
    )
    return {
        f"{axial.name}.h": steps,
        f"{axial.name}_fields.h": emit.fields(names, stem=axial.name, by=BY),
    }


def main() -> int:
    """Write, or compare, all headers; return 1 where a committed file is stale."""
    stale = 0
    written = {"exponential.h": exponential_header()} | axial_headers()
    written |= {f"{law.name}.h": force_law.header(law) for law in LAWS}
    for name, unformatted in written.items():
        path, text = GENERATED / name, formatted(unformatted)
        if "--check" in sys.argv:
            if not path.exists() or path.read_text() != text:
                print(f"{path.relative_to(ROOT)} is not what the models say", file=sys.stderr)
                stale = 1
        else:
            path.write_text(text)
    return stale


if __name__ == "__main__":
    sys.exit(main())
