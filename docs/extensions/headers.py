"""``{headers} FOLDER...``: the C headers in these folders, each a section of the page.

The section of ``core/include/ambkit/kalman.h`` is ``ambkit-kalman-h``.
"""

from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]


class Headers(SphinxDirective):
    """The headers as they are, so that none is forgotten."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Make a section of each header."""
        folders = [ROOT / folder for folder in self.arguments[0].split()]
        return [self._section(path) for folder in folders for path in sorted(folder.glob("*.h"))]

    def _section(self, path: Path) -> nodes.section:
        self.env.note_dependency(str(path))
        text = path.read_text(encoding="utf-8")
        name = f"{path.parent.name}-{path.stem}-h"
        section = nodes.section("", nodes.title("", path.name), names=[name])
        self.state.document.note_explicit_target(section)
        where = nodes.literal("", str(path.relative_to(ROOT)))
        section += [nodes.paragraph("", "", where), nodes.literal_block(text, text, language="c")]
        return section


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("headers", Headers)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
