"""Write core/generated/ from the models: ``python -m derivation`` (``--check`` only compares)."""

import shutil
import subprocess
import sys
from pathlib import Path

from derivation.axial import axial
from derivation.emit import fields, header
from derivation.exponential import exponential_header
from derivation.laws import LAWS
from derivation.laws import law as force_law

ROOT = Path(__file__).resolve().parent.parent
GENERATED = ROOT / "core" / "generated"


def formatted(text: str) -> str:
    """Return C as clang-format writes it with the project's style."""
    tool = shutil.which("clang-format", path=str(Path(sys.executable).parent)) or "clang-format"
    command = [tool, f"--style=file:{ROOT / '.clang-format'}"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def main() -> int:
    """Write, or compare, all headers; return 1 where a committed file is stale."""
    stale = 0
    written = {"exponential.h": exponential_header()}
    for model in (axial,):
        written |= {f"{model.name}.h": header(model), f"{model.name}_fields.h": fields(model)}
    written |= {f"{law.name}.h": force_law.header(law) for law in LAWS}
    for name, unformatted in written.items():
        path, text = GENERATED / name, formatted(unformatted)
        if "--check" in sys.argv:
            if not path.exists() or path.read_text() != text:
                print(
                    f"{path.relative_to(ROOT)} is not what the derivation writes", file=sys.stderr
                )
                stale = 1
        else:
            path.write_text(text)
    return stale


if __name__ == "__main__":
    sys.exit(main())
