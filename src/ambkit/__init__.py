"""Adaptive Kalman filters for active magnetic bearings.

From a bearing's description, or a recording of the rig, to a tuned adaptive Kalman filter. All
quantities are SI. Names are imported when they are first used.
"""

from __future__ import annotations

import os
import re
from importlib import import_module

from ambkit.base import late_binding

# The stub states what is exported, once, for type checkers and for here: name by module.
with open(os.path.splitext(__file__)[0] + ".pyi", encoding="utf-8") as _stub:
    _IMPORTS = re.findall(r"^from (\S+) import \(?\s*(\w+)", _stub.read(), re.MULTILINE)
_MODULE_OF = {name: module for module, name in _IMPORTS}

# Files of estimators, behind methods of the estimators.
late_binding.PLACES["load_filter"] = "estimate.filter_saving:load"
late_binding.PLACES["save_filter"] = "estimate.filter_saving:save"

__all__ = ["__version__", *sorted(_MODULE_OF)]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("ambkit")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'ambkit' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
