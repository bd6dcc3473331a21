"""How Sphinx builds these pages.

uv run --group docs sphinx-build -W --keep-going -b html docs docs/_build/html
"""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "extensions"), str(HERE)]  # and the chapters of paper/
# The commands of this Python, for the pages that run `ambkit`.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
# Matrices are small here: threads of linear algebra would wait for each other, in each kernel too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# models/ is no part of the package; one page shows it.
os.environ["PYTHONPATH"] = str(HERE.parent)

# Kernels with settings of their own, whoever builds: no history, no advice about transports.
KERNELS = HERE / "_build" / "ipython"
(KERNELS / "profile_default").mkdir(parents=True, exist_ok=True)
(KERNELS / "profile_default" / "ipython_kernel_config.py").write_text(
    "c.IPKernelApp.log_level = 40\nc.HistoryManager.enabled = False\n"
    # Figures have their layout; cutting their margins would draw each once more.
    "c.InlineBackend.print_figure_kwargs = {'bbox_inches': None}\n"
)
os.environ["IPYTHONDIR"] = str(KERNELS)

project = "ambkit"
author = "the ambkit developers"
copyright = author  # no year: a built page does not depend on when it was built
version = release = version_of("ambkit")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "docstrings",
    "headers",
    "mathml",
    "reproduced",
    "terminal",
]
exclude_patterns = ["_build", "README.md"]
nitpicky = True  # a name that leads nowhere is an error

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

nb_execution_mode = "force"  # a stored output would hide that a snippet no longer runs
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # a snippet that hangs; other processes may have the processors
nb_execution_in_temp = True  # what a snippet writes does not land between the sources
nb_merge_streams = True
nb_ipywidgets_js = {}  # no page fetches anything from elsewhere

autodoc_typehints = "none"  # the docstrings say shape, unit and type
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
numpydoc_show_class_members = False
numpydoc_show_inherited_class_members = False
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = "ambkit"
html_static_path = ["_static"]
html_css_files = ["ambkit.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
html_sidebars = {"index": []}  # the first page leads everywhere itself
html_theme_options = {
    "logo": {"text": "ambkit"},
    "navbar_align": "left",
    "header_links_before_dropdown": 9,
    "navbar_end": ["theme-switcher"],
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "secondary_sidebar_items": {"index": [], "paper/*": [], "[!ip]**": ["page-toc"]},
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
}


def setup(app: object) -> None:
    """Write the workbench beside the first page, which shows it."""
    from ambkit import workbench

    def write(built: object) -> None:
        workbench().save(Path(built.outdir) / "workbench.html")

    app.connect("builder-inited", write)
