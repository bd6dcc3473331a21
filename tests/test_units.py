"""Units at the boundary: read exactly, printed as engineers write, refused with a clear word."""

import doctest
import math
import subprocess
import sys
from contextlib import suppress
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambkit.base import units
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import seeds_in
from ambkit.base.units import engineering, factor, parse
from ambkit.machine.machine import Machine

SURFACE_UNITS = [
    *("m", "A", "s", "kg", "V", "N", "Hz", "m^2", "V^2", "N m^2/A^2", "A/V"),
    *("A/m", "A/(m s)", "A s/m", "m/s", "N/s", "N s", "N/A", "N/m", "1"),
]
finite = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("2 mm", "m", 2e-3),
        ("2mm", "m", 2e-3),
        (" -0.5 mm ", "m", -0.5e-3),
        ("+.5e1 um", "m", 5e-6),
        ("20 µs", "s", 20e-6),  # micro sign
        ("20 μs", "s", 20e-6),  # Greek mu
        ("6.7 N mm^2/A^2", "N m^2/A^2", 6.7e-6),
        ("6.7 N*mm**2/A**2", "N m^2/A^2", 6.7e-6),
        ("8.3e-5 mm^2", "m^2", 8.3e-11),
        ("83 µm²", "m^2", 8.3e-11),
        ("60.54 g", "kg", 0.06054),
        ("12 mA/(mm/s)", "A s/m", 12.0),
        ("1 kHz", "Hz", 1000.0),
        ("180 deg", "rad", math.pi),
        ("5", "1", 5.0),
        ("50 %", "1", 0.5),
    ],
)
def test_parse_gives_exactly_the_si_value(text, unit, value):
    assert parse(text, unit) == value


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("2", "m", '"2" has no unit'),
        ("two mm", "m", "is not a number with a unit"),
        ("", "m", "is not a number with a unit"),
        ("nan mm", "m", "is not a number with a unit"),
        ("1,5 A", "A", "decimal comma, write 1.5"),
        ("2 mn", "m", '"mn" is not a known unit'),
        ("2 mm + 3", "m", "is not a known unit"),
        ("2 m(", "m", "is not a known unit"),
        ("2 3 mm", "m", "is not a known unit"),
        ("0.05,mm", "m", "is not a known unit"),
        ("2 m,m", "m", "is not a known unit"),
        ("2 A", "m", "A cannot be converted to m"),
        ("50 rad/s", "Hz", "rad/s cannot be converted to Hz"),
        ("3000 rpm", "m", "rpm cannot be converted to m"),
        ("5 degC", "K", "use K instead"),
        ("1 V", "1", "must be a plain number"),
        ("1e999 m", "m", "too large"),
    ],
)
def test_parse_says_what_is_wrong(text, unit, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")) as caught:
        parse(text, unit)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.002, "m", "2 mm"),
        (-0.0005, "m", "-0.5 mm"),
        (0.518, "kg", "0.518 kg"),
        (0.06054, "kg", "60.54 g"),
        (6.7e-6, "N m^2/A^2", "6.7 N mm^2/A^2"),
        (8.3e-11, "m^2", "83 µm^2"),
        (8e-5, "V^2", "80 mV^2"),
        (7537.5, "N/m", "7537.5 N/m"),
        (20_000.0, "A/(m s)", "20 kA/(m s)"),
        (0.0, "m", "0 m"),
        (5.0, "1", "5"),
        (0.5056298507, "A", "0.50563 A"),
        (math.inf, "m", "inf m"),
    ],
)
def test_engineering_prints_as_an_engineer_writes(value, unit, text):
    assert engineering(value, unit) == text


@pytest.mark.parametrize(
    ("value", "error", "unit", "texts"),
    [
        (2.413e-6, 5.61e-9, "N m^2/A^2", ("2.413 N mm^2/A^2", "0.00561 N mm^2/A^2")),
        (0.02781, 8.01e-3, "N^2/s", ("0.02781 N^2/s", "0.00801 N^2/s")),
        (1.162e-12, 8.4e-15, "m^2", ("1.162 µm^2", "0.0084 µm^2")),
        (0.5e-3, 2.0, "m", ("0.5 mm", "2000 mm")),
        (0.0, 3e-6, "m", ("0 m", "3 µm")),
    ],
)
def test_an_error_stands_in_the_unit_of_its_value(value, error, unit, texts):
    assert (engineering(value, unit, 4), engineering(error, unit, 3, like=value)) == texts


sizes = st.floats(1e-30, 1e30)


@given(sizes, sizes, st.sampled_from(["m", "m^2", "N", "N m^2/A^2", "kg"]))
def test_whatever_stands_beside_a_value_has_its_unit(other, value, unit):
    shown = engineering(other, unit, 3, like=value).partition(" ")
    assert shown[2] == engineering(value, unit, 4).partition(" ")[2]
    assert parse(f"{shown[0]} {shown[2]}", unit) == pytest.approx(other, rel=0.006)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (3.638, 12.34, "4 ± 12"),
        (123.4, 120.0, "123 ± 120"),
        (0.51234, 0.0123, "0.512 ± 0.012"),
        (0.1, math.nan, "0.1"),
        (92.0, 0.0, "92 ± 0"),
        (125.796989, 1.4e-14, "125.8 ± 0"),
        (12.3, 2e6, "12.3 ± 2e+06"),
        (3.2e12, 4.56e11, "3.2e+12 ± 4.6e+11"),
    ],
)
def test_a_value_ends_where_its_error_does(value, error, text):
    assert units.with_error(value, error) == text


@given(finite, st.sampled_from(SURFACE_UNITS))
def test_every_value_survives_printing_and_reading(value, unit):
    assert parse(engineering(value, unit, digits=None), unit) == value


@given(st.decimals(-1000, 1000, places=6), st.sampled_from([("mm", 3), ("um", 6), ("km", -3)]))
def test_the_same_length_in_another_unit_is_the_same_float(number, scaled):
    unit, shift = scaled
    assert parse(f"{number:f} m", "m") == parse(f"{number.scaleb(shift):f} {unit}", "m")


@given(st.text(max_size=20), st.sampled_from(SURFACE_UNITS))
def test_any_text_gives_a_finite_number_or_a_value_error(text, unit):
    with suppress(ValueError):
        assert math.isfinite(parse(text, unit))


def test_factor_and_its_inverse():
    assert factor("mm", "m") == 1e-3
    assert factor("N mm^2/A^2", "N m^2/A^2") == 1e-6
    assert factor("rpm", "rad/s") == pytest.approx(2 * math.pi / 60, rel=1e-15)
    assert parse("12000 rpm", "Hz") == parse("12 krpm", "Hz") == 200.0
    with pytest.raises(ValueError, match="cannot be converted"):
        factor("V", "A")


def test_docstring_examples():
    assert doctest.testmod(units).failed == 0


def test_typeset_as_in_a_book():
    assert units.typeset("ISO 14839-3, force-free, arm-none-eabi-gcc") == (
        "ISO 14839-3, force-free, arm-none-eabi-gcc"
    )
    assert units.typeset(engineering(-6.7e-6, "N m^2/A^2")) == "−6.7\u00a0N\u00a0mm²/A²"
    assert units.typeset("2.6 to 2.87 N mm^2/A^2") == "2.6 to 2.87\u00a0N\u00a0mm²/A²"
    assert (
        units.typeset("0.9 A s/m, 3 µs ± 2 µs")
        == "0.9\u00a0A\u00a0s/m, 3\u00a0µs\u00a0±\u00a02\u00a0µs"
    )


def test_seeds_are_a_number_a_range_or_first_and_number():
    assert seeds_in(3) == seeds_in("3") == seeds_in("0:3") == range(3)
    assert seeds_in("4:3") == seeds_in(range(4, 7)) == range(4, 7)
    for wrong in ("0", "4:0", "-1:3", "4:", ":4", "3.5", "1:2:3", "", range(0), range(0, 9, 2),
                  range(-1, 3), True):  # fmt: skip
        with pytest.raises(AmbkitError, match=r"FIRST:N with the first from 0 on, are the "):
            seeds_in(wrong)


COMMON = [f"{prefix}{name}" for prefix in units._SHIFTS for name in (*units._COMMON, *units._ROOTS)]
PRODUCTS = (
    *("A/(m s)", "N mm^2/A^2", "12 A", "m/s/s", "kg m/s^2", "1/(rad/s)", "rpm/s", "N s/m s", ""),
    *("m**2", "m^-1", "(mm/s)", "A/(m/s)^2", "m(", "m^0", "m ^2", "µm²", "N/m^1.5", "m//s", "/s"),
)


@pytest.mark.parametrize("pattern", ["{}", "{}^3", "{}^-2", "rad/{}", "mA {}", "{} / kg^2"])
def test_common_units_have_the_size_that_pint_gives(pattern):
    known = [u for u in map(pattern.format, COMMON + list(PRODUCTS)) if units._common_root(u)]
    assert len(known) > 180
    for unit in known:
        (size, exponents), (expected, roots) = units._common_root(unit), units._root_by_pint(unit)
        assert size == pytest.approx(expected, rel=Decimal("1e-26")), unit  # degrees hold pi
        assert exponents == roots, unit


def test_reading_and_checking_a_machine_does_not_import_pint(tmp_path):
    # Its import takes longer than the command.
    Machine.preset("zittau_axial").save(tmp_path / "b.toml")
    code = (
        "import atexit, sys, ambkit.cli.main as cli; atexit.register(lambda: print(*sys.modules)); "
        "cli.main(['check', 'b.toml'])"
    )
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
    assert "b.toml: ok" in run.stdout
    assert "pint" not in run.stdout.split()
