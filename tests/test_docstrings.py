"""Every parameter of a public name is documented, as python-control's own tests demand."""

import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel

import ambkit

SECTIONS = ("Parameters", "Attributes")


def documented(thing: Any) -> set[str]:
    """Return the names in the sections on parameters and attributes of a docstring."""
    lines = inspect.cleandoc(thing.__doc__ or "").splitlines()
    found, inside = set[str](), False
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if below and set(below) == {"-"}:
            inside = line in SECTIONS
        elif inside and (entry := re.match(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :|$)", line)):
            found |= {name.lstrip("*") for name in entry[1].split(", ")}
    return found


def public() -> Iterator[tuple[str, Any]]:
    """Yield all public classes and functions, and the public methods of the classes."""
    for name in ambkit.__all__:
        thing = getattr(ambkit, name)
        if not callable(thing):
            continue
        yield name, thing
        for key in dir(thing) if inspect.isclass(thing) else ():
            method = inspect.getattr_static(thing, key)
            function = getattr(method, "__func__", method)
            ours = str(getattr(function, "__module__", "")).startswith("ambkit")
            if inspect.isfunction(function) and ours and not key.startswith("_"):
                yield f"{name}.{key}", function


def parameters(thing: Callable[..., Any]) -> set[str]:
    """Return the parameters that need words: not self, and no tag that can only be one thing."""
    if inspect.isclass(thing) and issubclass(thing, BaseModel):
        fields = thing.model_fields.items()
        return {
            name
            for name, field in fields
            if not field.description and len(get_args(field.annotation)) != 1
        }
    if inspect.isclass(thing) and "__init__" not in vars(thing):
        return set()  # an enumeration, or an error that is only a name
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


PUBLIC = dict(public())


@pytest.mark.parametrize("name", PUBLIC)
def test_every_parameter_is_documented(name):
    thing = PUBLIC[name]
    assert inspect.cleandoc(thing.__doc__ or ""), f"{name} has no docstring"
    assert parameters(thing) - documented(thing) == set()


def test_what_is_missing_is_noticed():
    def step(y: float, u: float) -> None:
        """Go on.

        Parameters
        ----------
        y : float
            Measured position [m].
        """

    assert parameters(step) - documented(step) == {"u"}
    assert documented(ambkit.AdaptiveKalmanFilter) == {"bearing", "magnet", "options"}
    assert {"innovation", "innovation_variance"} <= documented(ambkit.Estimate)
