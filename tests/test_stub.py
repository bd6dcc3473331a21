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


def test_all_builds_have_the_same_names():
    from ambkit import _any, _any_f32, _core, _core_f32

    assert dir(_core) == dir(_core_f32)
    assert dir(_any) == dir(_any_f32)
    assert set(dir(_any)) - set(dir(_core)) == {
        "MOST_FORCES", "MOST_SENSORS", "MOST_STATES", "run_turning", "stand",
    }  # fmt: skip
    assert set(dir(_core)) <= set(dir(_any))


def test_what_differs_in_the_build_for_any_model_is_in_its_stub():
    from nanobind.stubgen import StubGen

    from ambkit import _any

    of_all, of_core = StubGen(_any), STUB.read_text()
    of_all.put(_any)
    written = (STUB.parent / "_any.pyi").read_text()
    for line in of_all.get().splitlines():
        told = line.partition(" = ")[0].strip()
        assert told in of_core or told in written, line
    assert "def __init__(self, arrays: dict[str, Any]) -> None: ..." in written
