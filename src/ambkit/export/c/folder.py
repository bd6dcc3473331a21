"""A folder of generated files: written whole, recognised again, and nobody else's files touched."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ambkit.base import files
from ambkit.base.errors import AmbkitError

MANIFEST = "ambkit.sha256"  #: Hashes of an export's files, by which an older export is known.


def write(folder: Path, texts: dict[str, str]) -> Path:
    """Write all files, and take away those of an older export that are no longer there."""
    # Where an older export is, whoever owns the folder may have put files of his own beside it; any
    # other folder must be empty but for what is hidden, such as ``.git``.
    if not (folder / MANIFEST).exists() and any(folder.glob("[!.]*")):
        raise AmbkitError(
            f"{folder}: holds other files, and the {len(texts) + 1} of an export would lie among "
            "them; take a new folder or an empty one"
        )
    older = _older(folder / MANIFEST)
    for name, text in texts.items():
        path = folder / name
        same = path.is_file() and path.read_bytes() == text.encode()
        if name not in older and path.exists() and not same:
            raise AmbkitError(f"{path} is there already, and not from an export")
    lines = [f"{hashlib.sha256(text.encode()).hexdigest()}  {name}" for name, text in texts.items()]
    with files.replacing_in(folder, first=MANIFEST) as temporary:
        files.write_text(temporary / MANIFEST, "\n".join(lines) + "\n")
        for name, text in texts.items():
            files.make_folder((temporary / name).parent)
            files.write_text(temporary / name, text)
    for name in older - set(texts):
        (folder / name).unlink(missing_ok=True)
    return folder


def _older(manifest: Path) -> set[str]:
    """Return the files of an older export; none that lies outside its folder."""
    if not manifest.exists():
        return set()
    names = {line.partition("  ")[2] for line in files.read_text(manifest).splitlines()}
    folder = manifest.parent.resolve()  # a link in it may lead anywhere
    return {name for name in names if name and (folder / name).resolve().is_relative_to(folder)}
