"""Docstrings are written for an editor; two things that reStructuredText needs besides."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment


def _escape(
    _app: Sphinx, _what: str, _name: str, _thing: Any, _options: Any, lines: list[str]
) -> None:
    """Keep an absolute value, ``|x|``, from being taken for a substitution."""
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in lines]


def _find_elsewhere(
    app: Sphinx, env: BuildEnvironment, node: Any, content: nodes.TextElement
) -> nodes.Element | None:
    """Let a docstring name what its module imports without saying from where."""
    if node.get("refdomain") != "py" or "refspecific" in node:
        return None
    node["refspecific"] = True
    domain = env.get_domain("py")
    return domain.resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], node["reftarget"], node, content
    )


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen."""
    app.connect("autodoc-process-docstring", _escape)
    app.connect("missing-reference", _find_elsewhere)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
