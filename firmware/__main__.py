"""Measure anew what ``ambkit export cost`` prints: ``python -m firmware``."""

import json
import sys
import tempfile
from pathlib import Path

from ambkit.base import files
from ambkit.export.c import cost
from firmware import harness, measure

missing = harness.missing_tools()
if missing:
    sys.exit(f"not there: {', '.join(missing)}; see firmware/README.md")
with tempfile.TemporaryDirectory() as folder:
    figures = measure.measure(Path(folder))
files.write_text(cost.STORED, json.dumps(figures, indent=2) + "\n")
print(json.dumps(figures, indent=2))
