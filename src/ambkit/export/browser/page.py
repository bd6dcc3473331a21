"""The page with its machines."""

import html
import json
import os
import re
import tempfile
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.export.browser.parameters import (
    axis_models,
    axis_parameters,
    expert_numbers,
    left_out,
    rotor_parameters,
)
from ambkit.machine.machine import Machine

PRESETS = ("zittau_axial", "inteco_ml", "hindawi_2011", "heart_pump")
"""Machines in every page besides the requested one."""

PAGE = Path(__file__).with_name("page.html")  #: Result of `web/build.sh`.

_DATA = re.compile(r'(<script type="application/json" id="data">).*?(</script>)', re.DOTALL)


def _as_data(machine: Machine) -> dict[str, Any]:
    """Return a machine's data for the page."""
    data: dict[str, Any] = {"name": machine.name, "description": machine.description}
    if left := list(dict.fromkeys(left_out(machine))):
        data["description"] += f" (without {', '.join(left)})"
    if not machine.single:
        return data | {"axis": {}, "rotor": rotor_parameters(machine)}
    return data | {"axis": axis_parameters(machine), "expert": expert_numbers(machine)}


@dataclass(frozen=True)
class Workbench:
    """An interactive page of machines."""

    machines: Sequence[Machine]  #: Machines, the displayed one first.

    @property
    def finding(self) -> str:
        """Description, in a sentence."""
        size = len(self.text.encode()) / 1e6
        return f"The workbench of {self.machines[0].name}: one HTML page of {size:.1f} MB."

    @cached_property
    def text(self) -> str:
        """HTML of the page."""
        data = json.dumps(self.to_dict())
        # Only these end a script; JSON can escape them.
        for sign in "<>&\u2028\u2029":
            data = data.replace(sign, f"\\u{ord(sign):04x}")
        page = PAGE.read_text(encoding="utf-8")
        return _DATA.sub(lambda match: match[1] + data + match[2], page, count=1)

    def to_dict(self) -> dict[str, Any]:
        """Return the machines' data for the page, and the models of an axis's filters."""
        machines = [_as_data(machine) for machine in self.machines]
        return {"machines": machines, "models": axis_models()}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page."""
        files.write_text(path, self.text)

    def open(self) -> None:
        """Open the page in the browser, from a file among the temporary ones."""
        path = Path(tempfile.mkdtemp(prefix="ambkit-")) / "workbench.html"
        self.save(path)
        webbrowser.open(path.as_uri())

    @cached_property
    def widget(self) -> Any:
        """The page as a notebook widget with settings in both directions; needs anywidget."""
        if not has_widgets():
            raise AmbkitError("the widget needs anywidget: pip install 'ambkit[notebook]'")
        return _kind()(page=self.text)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Return the widget if available, else the page in a frame."""
        if has_widgets():
            return self.widget._repr_mimebundle_(**options)
        return {"text/plain": self.finding, "text/html": self._repr_html_()}

    def _repr_html_(self) -> str:
        """Return the page in a frame of a notebook."""
        frame = (
            'style="width: 100%; height: 900px; border: 0" sandbox="allow-scripts allow-downloads"'
        )
        return f'<iframe {frame} srcdoc="{html.escape(self.text)}"></iframe>'


def workbench_of(machine: Machine | None) -> Workbench:
    """Return the page of a machine and the presets."""
    presets = [Machine.preset(name) for name in PRESETS]
    if machine is None:
        return Workbench(presets)
    return Workbench([machine, *(other for other in presets if other.name != machine.name)])


SCRIPT = """
export default {
  render({ model, el }) {
    const frame = document.createElement("iframe");
    frame.title = "ambkit workbench";
    frame.sandbox = "allow-scripts allow-downloads";
    frame.style.cssText = "width: 100%; height: 900px; border: 0";
    frame.srcdoc = model.get("page");
    const heard = ({ source, data }) => {
      if (source !== frame.contentWindow || typeof data?.workbench !== "string") return;
      model.set("settings", data.workbench);
      model.save_changes();
    };
    const ask = () => frame.contentWindow?.postMessage({ workbench: model.get("settings") }, "*");
    window.addEventListener("message", heard);
    model.on("change:settings", ask);
    frame.addEventListener("load", () => model.get("settings") && ask());
    el.append(frame);
    return () => {
      window.removeEventListener("message", heard);
      model.off("change:settings", ask);
    };
  },
};
"""


def has_widgets() -> bool:
    """Whether anywidget is installed."""
    return find_spec("anywidget") is not None


@cache
def _kind() -> Any:
    """Return the class of the widget."""
    import anywidget
    import traitlets

    class WorkbenchWidget(anywidget.AnyWidget):
        """The page, with its settings as the fragment of a link."""

        _esm = SCRIPT
        page = traitlets.Unicode().tag(sync=True)
        settings = traitlets.Unicode().tag(sync=True)

    return WorkbenchWidget
