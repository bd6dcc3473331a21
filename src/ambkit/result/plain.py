"""Results as what JSON knows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any


def plain(data: Any) -> Any:
    """Turn results into what JSON knows; what is not a finite number becomes null."""
    if isinstance(data, dict):
        return {str(key): plain(item) for key, item in data.items()}
    if isinstance(data, list | tuple):
        return [plain(item) for item in data]
    if hasattr(data, "tolist"):  # of NumPy, array or scalar
        return plain(data.tolist())
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    return str(data) if isinstance(data, Path) else data
