"""Commands on a page, run while the pages are built.

``{terminal}`` runs each of its lines in a folder of the page's own and shows what it printed; the
option ``:fails: 2`` is for a line that is meant to fail with that exit code. ``{file} NAME`` shows
a file and writes it into that folder. ``{manual} COMMAND`` shows the help of an ambkit command.
"""

import shlex
import subprocess
import tempfile
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from ambkit.cli.catalogue import GROUPS, within
from ambkit.cli.main import main

LANGUAGES = {".toml": "toml", ".csv": "text", ".json": "json"}
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

_folders: dict[str, tempfile.TemporaryDirectory[str]] = {}


def _run(line: str, folder: Path) -> tuple[int, str]:
    """Run a command line; return its exit code, and what it printed in the order of writing."""
    words = shlex.split(line)
    if words[0] == "ambkit" and not {">", "|"} & set(words):
        return _run_here(words[1:], folder)  # an interpreter less to start
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=120,
    )
    return done.returncode, done.stdout


def _run_here(arguments: list[str], folder: Path) -> tuple[int, str]:
    printed, code = StringIO(), 0
    with chdir(folder), redirect_stdout(printed), redirect_stderr(printed):
        try:
            main(arguments)
        except SystemExit as end:
            code = int(end.code or 0)
    return code, printed.getvalue()


class _InFolder(SphinxDirective):
    """What works in the page's folder; it goes when the page is read."""

    has_content = True

    @property
    def folder(self) -> Path:
        page = self.env.docname
        if page not in _folders:
            _folders[page] = tempfile.TemporaryDirectory(prefix="ambkit-docs-")
            # As far as the examples go, it looks like the repository's.
            Path(_folders[page].name, "examples").symlink_to(EXAMPLES)
        return Path(_folders[page].name)


class Terminal(_InFolder):
    """``{terminal}``."""

    option_spec = {"fails": directives.nonnegative_int}

    def run(self) -> list[nodes.Node]:
        """Run line by line."""
        expected, shown = self.options.get("fails", 0), []
        for line in self.content:
            code, output = _run(line, self.folder)
            if code != expected:
                raise self.error(f"$ {line}\n{output}\nexit code {code}")
            printed = "\n".join(text.rstrip() for text in output.splitlines()).strip("\n")
            shown.append(f"$ {line}\n{printed}".strip())
        text = "\n\n".join(shown)
        block = nodes.literal_block(text, text, language="console", classes=["terminal"])
        block["force"] = True  # an output with a per cent sign looks like a prompt
        return [block]


class File(_InFolder):
    """``{file} NAME``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Write the file, then show it."""
        name, text = self.arguments[0], "\n".join(self.content) + "\n"
        (self.folder / name).write_text(text, encoding="utf-8")
        language = LANGUAGES.get(Path(name).suffix, "text")
        block = nodes.container(classes=["literal-block-wrapper"], literal_block=True)
        block += nodes.caption("", name)
        block += nodes.literal_block(text, text, language=language)
        return [block]


class Manual(SphinxDirective):
    """``{manual} COMMAND``: its help, and that of its own commands if it has some."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Ask the command itself."""
        name = self.arguments[0]
        shown = []
        for command in (*([] if name in GROUPS else [name]), *within(name)):
            _, text = _run_here([*command.split(), "--help"], Path())
            shown.append(nodes.literal_block(text, text, language="text"))
        return shown


def _clean(app: Sphinx, _tree: nodes.document) -> None:
    folder = _folders.pop(app.env.docname, None)
    if folder:
        folder.cleanup()


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directives."""
    app.add_directive("terminal", Terminal)
    app.add_directive("file", File)
    app.add_directive("manual", Manual)
    app.connect("doctree-read", _clean)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
