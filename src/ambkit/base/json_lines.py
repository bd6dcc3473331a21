"""Where in a JSON text a value stands."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

_SPACE = re.compile(r"[ \t\n\r,:]*")


def line_of(text: str, path: Sequence[str | int]) -> int:
    """Return the line, from 1, of a value; of one that is missing that of what lacks it."""
    decode = json.JSONDecoder().raw_decode
    at = _next(text, 0)
    for step in path:
        is_object = text[at] == "{"
        if not is_object and text[at] != "[":
            break
        place, here = _next(text, at + 1), 0
        while text[place] not in "}]":
            key: str | int = here
            if is_object:
                key, place = decode(text, place)
                place = _next(text, place)
            if key == step:
                at = place
                break
            _, place = decode(text, place)
            place, here = _next(text, place), here + 1
        else:
            break
    return text.count("\n", 0, at) + 1


def _next(text: str, place: int) -> int:
    """Return where the next value begins, or what holds it ends."""
    match = _SPACE.match(text, place)
    return match.end() if match else place
