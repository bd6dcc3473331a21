"""The committed stub is what the extension module says of itself."""

from pathlib import Path

import pytest

import ambkit

STUB = Path(ambkit.__file__).parent / "_core.pyi"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_stub_is_current():
    from nanobind.stubgen import StubGen

    from ambkit import _core

    generator = StubGen(_core)
    generator.put(_core)
    assert STUB.read_text() == generator.get(), (
        "run: python -m nanobind.stubgen -m ambkit._core -o src/ambkit/_core.pyi"
    )


def test_both_builds_have_the_same_names():
    from ambkit import _core, _core_f32

    assert dir(_core) == dir(_core_f32)
