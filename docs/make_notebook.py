"""Write examples/thread.ipynb, which is examples/thread.py as a notebook.

``python docs/make_notebook.py``. The script is the source: its docstring and its cells (``# %%``,
``# %% [markdown]``) become those of the notebook, without outputs.
"""

import ast
import json
import re
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parent.parent / "examples" / "thread.py"
CELL = re.compile(r"^# %%( \[markdown\])?\n", re.MULTILINE)


def cells(script: str) -> list[tuple[str, str]]:
    """Return the kind and the text of each cell."""
    head, *parts = CELL.split(script)
    title, _, about = (ast.get_docstring(ast.parse(head)) or "").partition("\n")
    results = [("markdown", f"# {title.rstrip('.')}\n{about}")]
    for markdown, text in zip(parts[::2], parts[1::2], strict=True):
        if markdown:
            results.append(("markdown", re.sub(r"^# ?", "", text.strip(), flags=re.MULTILINE)))
        else:
            results.append(("code", text.strip()))
    return results


def notebook(script: str) -> str:
    """Return a script as a notebook."""
    made: list[dict[str, Any]] = []
    for number, (kind, text) in enumerate(cells(script)):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}}
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        made.append(cell | {"source": text.splitlines(keepends=True)})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {
        "cells": made,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(whole, ensure_ascii=False, indent=1) + "\n"


if __name__ == "__main__":
    text = notebook(SCRIPT.read_text(encoding="utf-8"))
    SCRIPT.with_suffix(".ipynb").write_text(text, encoding="utf-8")
