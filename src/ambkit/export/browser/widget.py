"""The workbench as a notebook widget, with settings in both directions."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from typing import Any

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


def widget_of(page: str) -> Any:
    """Return the widget of a page."""
    return _kind()(page=page)
