"""Descriptions in TOML: each mistake is told with its place, and all of them at once."""

import json
import tomllib
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ambkit
from ambkit.base import escaping
from ambkit.base.config import Document, Part, toml_text
from ambkit.base.config.document import updated
from ambkit.base.config.quantities import Quantity
from ambkit.base.errors import AmbkitError, ConfigError


class Wheel(Part):
    """A wheel."""

    radius: Annotated[float, Quantity("m", "30 cm", above=0)]
    """Radius of the wheel [m]."""
    spokes: int = 8


class Cart(Document):
    """A cart."""

    name: str
    colour: Literal["red", "green"] = "red"
    drag: Annotated[float, Quantity("1", "0.3", at_least=0)] = 0.3
    wheel: Wheel


GOOD = """\
name = "mine"
[wheel]
radius = "30 cm"
"""


def problems(text):
    """Return what is told about a text that must be refused."""
    with pytest.raises(ConfigError) as caught:
        Cart.from_toml(text, "cart.toml")
    assert str(caught.value).count("cart.toml:") >= len(caught.value.problems)
    return list(caught.value.problems)


def test_a_good_file_is_read_in_si():
    assert Cart.from_toml(GOOD) == Cart(name="mine", wheel=Wheel(radius=0.3))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"30 cm"', "0.3", '3: wheel.radius: 0.3 has no unit, write it like "30 cm"'),
        ('"30 cm"', '"30 s"', '3: wheel.radius: "30 s": s cannot be converted to m, write it like'),
        ('"30 cm"', '"-3 cm"', "3: wheel.radius: must be greater than 0 m, is -3 cm"),
        ('"30 cm"', "true", "3: wheel.radius: true is not a number, write it like"),
        ('"30 cm"', "inf", "3: wheel.radius: inf has no unit"),
        ('"30 cm"', '"30 cm"\nspokes = "x"', "4: wheel.spokes: must be a valid integer"),
        ("radius", "raduis", "3: wheel.raduis: unknown key, did you mean radius?"),
        ("[wheel]", "[wheels]", "2: wheels: unknown key, did you mean wheel?"),
        ("[wheel]", "[[wheels]]", "2: wheels: unknown key, did you mean wheel?"),
        ("radius", "drag = 1\nradius", "3: wheel.drag: unknown key here, it belongs above the"),
        ('"mine"', '"mine"\nspokes = 3', "2: spokes: unknown key here, it belongs to [wheel]"),
        ('"mine"', '"mine"\nxyz = 3', "2: xyz: unknown key, known here: name, colour, drag, wheel"),
        ('"mine"', "3", "1: name: must be a valid string, is 3"),
        ('"mine"', '"mine"\ndrag = -1', "2: drag: must be at least 0, is -1"),
        ('"mine"', '"mine"\ndrag = nan', "2: drag: must be finite, is nan"),
        ('"mine"', '"mine"\ncolour="grene"', 'must be "red" or "green", is "grene"; did you mean'),
        ('radius = "30 cm"', "", "2: wheel.radius: missing: radius of the wheel [m], such as "),
        (
            '[wheel]\nradius = "30 cm"',
            "",
            "1: wheel: missing: a table with radius; optional spokes",
        ),
        ('[wheel]\nradius = "30 cm"', "wheel = 3", "2: wheel: must be a table, is 3"),
    ],
)
def test_one_mistake_gives_one_line_that_says_where_and_what(old, new, message):
    """One problem each, with the right line number: no follow-up message for the same mistake."""
    found = problems(GOOD.replace(old, new))
    assert len(found) == 1
    assert message in found[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = mine", '1: name: write it in quotes: name = "mine"'),
        ('name = "a"\nname = "b"', "2: name: is written twice in this table"),
        ('name = "a\n', "1: not valid TOML: illegal character"),
        ("name", "1: not valid TOML: expected '=' after a key"),
        ("[wheel]\n[wheel]\n", "2: [wheel] is written twice"),
        ("x = [1,\n2", "2: not valid TOML: unclosed array"),
        ("[wheel]\nradius = 30 cm # about", '2: radius: write it in quotes: radius = "30 cm"'),
        ("x = True", "1: x: write it: x = true"),
    ],
)
def test_wrong_syntax_is_reported_with_its_line(text, message):
    assert any(message in problem for problem in problems(text))


def test_after_a_mistake_of_clear_meaning_the_rest_is_still_checked():
    found = problems('name = mine\ncolour = "blue"\n[wheel]\nradius = 30 mm\nspokes = "x"\n')
    assert [f.split(":")[1] for f in found] == ["1", "2", "4", "5"]
    assert "radius: must" not in str(found)


def test_lines_of_dotted_quoted_and_repeated_keys():
    text = 'a.b = 1\n"c d" = [1,\n  2]\n[e.f]\ng = { h = 1 }\n[[i]]\nj = 1\n[[i]]\n[i.k]\nl = 2\n'
    lines = toml_text.parse(text).lines
    assert lines["a", "b"] == 1
    assert lines["c d", 1] == 3
    assert lines["e", "f", "g", "h"] == 5
    assert lines["i", 0, "j"] == 7
    assert lines["i", 1] == 8
    assert lines["i", 1, "k", "l"] == 10


def test_in_python_all_mistakes_are_reported_too():
    with pytest.raises(ConfigError, match=r"Wheel\.radius: must be greater than 0 m, is -1 m"):
        Wheel(radius=-1)
    with pytest.raises(ConfigError) as caught:
        Cart(name=3, wheel={"radius": "2 s", "spoke": 3})
    assert len(caught.value.problems) == 3
    assert isinstance(caught.value, AmbkitError)


def test_models_are_frozen_and_hashable():
    cart = Cart.from_toml(GOOD)
    with pytest.raises(ValueError, match="frozen"):
        cart.wheel.radius = 3.0
    assert hash(cart) == hash(Cart.from_toml(GOOD))


def test_replace_checks_and_names_what_is_unknown():
    cart = Cart.from_toml(GOOD)
    assert cart.replace(wheel__radius="1 m").wheel.radius == 1.0
    assert cart.replace(**{"wheel.radius": 1.0, "name": "b"}).name == "b"
    for changes, told in [
        ({"wheel__radius": 0}, "Cart.wheel.radius: must be greater than 0 m, is 0 m"),
        ({"wheel__raduis": 1}, "Cart.wheel.raduis: unknown key, did you mean radius?"),
        ({"name__x": 1}, "Cart.name__x: there is no such key"),
    ]:
        with pytest.raises(ConfigError) as caught:
            cart.replace(**changes)
        assert str(caught.value) == told


def test_files_that_cannot_be_read_or_written_are_named(tmp_path):
    with pytest.raises(AmbkitError, match=r"none\.toml: cannot be read: No such file"):
        Cart.load(tmp_path / "none.toml")
    with pytest.raises(AmbkitError, match="cannot be read: Is a directory"):
        Cart.load(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b'name = "Z\xfc"')
    with pytest.raises(AmbkitError, match="is not UTF-8 text"):
        Cart.load(tmp_path / "latin.toml")
    with pytest.raises(AmbkitError, match=r"cart\.toml: cannot be written: No such file"):
        Cart.from_toml(GOOD).save(tmp_path / "none" / "cart.toml")
    with pytest.raises(AmbkitError, match="cannot be written: Not a directory"):
        Cart.from_toml(GOOD).save(tmp_path / "latin.toml" / "cart.toml")


def test_a_file_that_cannot_be_replaced_stays_whole(tmp_path):
    target = tmp_path / "cart.toml"
    target.mkdir()
    with pytest.raises(AmbkitError, match="cannot be written"):
        Cart.from_toml(GOOD).save(target)
    assert [p.name for p in tmp_path.iterdir()] == ["cart.toml"]


def test_load_names_file_and_line_and_accepts_windows_text(tmp_path):
    path = tmp_path / "cart.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert Cart.load(path) == Cart.from_toml(GOOD)
    path.write_text(GOOD.replace("30 cm", "30 s"))
    with pytest.raises(ConfigError, match=rf"{path}:3: wheel\.radius: "):
        Cart.load(path)


names = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
values = st.recursive(
    st.text(st.characters(exclude_categories=["Cs"])) | st.integers() | st.booleans() | st.floats(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(names, values, max_size=4))
def test_any_nested_data_is_written_as_toml_that_reads_back(data):
    toml = toml_text.parse(escaping.toml_text(data))
    assert toml.problems == []
    assert repr(_plain_first(toml.data)) == repr(_plain_first(data))


def _plain_first(data):
    """Order mappings by what TOML leaves open: whether a table stands before a list of tables."""
    if isinstance(data, list):
        return [_plain_first(each) for each in data]
    if not isinstance(data, dict):
        return data
    plain = {k: v for k, v in data.items() if not isinstance(v, dict | list)}
    return plain | {k: _plain_first(data[k]) for k in sorted(data.keys() - plain.keys())}


def test_what_is_written_as_toml_keeps_its_order():
    table = {"d": [1.5, 2.5], "c": "x", "b": {"f": True, "e": 1e-9}, "a": {"h": [], "g": -0.0}}
    found = tomllib.loads(escaping.toml_text(table | {"list": [table, {"long": "x" * 200}]}))
    assert repr(found) == repr(table | {"list": [table, {"long": "x" * 200}]})


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_with_a_line(text):
    with pytest.raises(ConfigError) as caught:
        Cart.from_toml(text, "cart.toml")
    assert all(p.startswith("cart.toml:") for p in caught.value.problems)


def test_the_json_schema_says_units_examples_and_defaults():
    schema = Cart.json_schema()
    assert json.loads(json.dumps(schema)) == schema
    assert schema["required"] == ["name", "wheel"]
    assert schema["additionalProperties"] is False
    radius = schema["$defs"]["Wheel"]["properties"]["radius"]
    assert (radius["type"], radius["examples"]) == ("string", ["30 cm"])
    assert radius["description"] == "Radius of the wheel [m]."
    assert schema["properties"]["drag"]["default"] == 0.3


def test_checked_values_make_the_same_model_as_unchecked_ones_of_pydantic():
    bearing = ambkit.preset("zittau_axial")
    rotor = bearing.rotor.model_copy(update={"mass": 0.7})
    update = {"rotor": rotor, "speed": 3.0}
    bearing.axes  # noqa: B018 computed of it, and not to be kept
    copy = updated(bearing, update)
    assert copy == bearing.model_copy(update=update)
    assert vars(copy).keys() == type(bearing).model_fields.keys()
    assert copy.model_fields_set == bearing.model_fields_set | update.keys()
    assert copy.axes[0].bearing.clearance == bearing.clearance
    assert copy.model_dump() == bearing.model_copy(update=update).model_dump()
