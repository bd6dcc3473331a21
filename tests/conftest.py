"""Settings of all tests, and what several of them export."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from ambkit.export.c import CExport

# A busy machine must not fail a test: what must be fast is measured in benchmarks/.
settings.register_profile("ambkit", deadline=None)
settings.load_profile("ambkit")


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., CExport]:
    """Export a kind of `export_cases.KINDS` in a precision, each one once; to be read only."""
    import export_cases

    folder = tmp_path_factory.mktemp("export")
    made: dict[tuple[str, str], CExport] = {}

    def export(kind: str, precision: str = "float") -> CExport:
        key = kind, precision
        if key not in made:
            made[key] = export_cases.export(kind, folder / "-".join(key), precision=precision)
        return made[key]

    return export
