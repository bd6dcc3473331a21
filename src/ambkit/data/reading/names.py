"""What the name and the unit of a channel speak for."""

from __future__ import annotations

import re

from ambkit.data.reading.candidates import Candidate
from ambkit.data.signals import si_unit

_WORDS = {
    "t": r"t|time|zeit|temps|timestamps?|seconds?|sec|clock|uhr",
    "r": r"r|w|ref|reference|soll\w*|set_?point|sp|desired|target|command_pos\w*",
    "v": r"v|vel|velocity|speed|geschw\w*|xdot|dx",
    "i": r"i|cur|current|strom|amps?|iu|coil|spulenstrom",
    "u": r"u|control|ctrl|cmd|command|duty|pwm|stell\w*|output|volt\w*|spannung",
    "y": r"y|x|z|pos|position|weg|dist|distance|displ\w*|gap|abstand|lage|sensor|auslenkung",
}
_ESTIMATED = re.compile(r"est\w*|hat|obs\w*|kf|ekf|filt\w*|model\w*|logged")
_UNIT_IN_NAME = re.compile(r"(.*?)[ _]*(?:/ ?|_in_|_)(µm|um|mm|m|ms|us|s|A|mA|V|mV|mps)$")
_ROLES = {"s": "t", "m": "y", "m/s": "v", "A": "i", "V": "u"}
_USUAL = {"t": "s", "r": "m", "y": "m", "v": "m/s", "i": "A", "u": "V"}
_HOLDERS = re.compile(r"values?|data|signals?|\d*|out|yout|logsout|simout")
"""Parts of a name that say nothing, as of a structure that Simulink saves."""


def role_from_name(candidate: Candidate) -> None:
    """Read role and unit from the name."""
    if candidate.role or any(isinstance(place, int) for place in candidate.where.values()):
        return
    label = candidate.label
    in_name = _UNIT_IN_NAME.fullmatch(label)
    if in_name and in_name[1] and not candidate.unit:
        label, candidate.unit = in_name[1], in_name[2].replace("mps", "m/s")
        candidate.why.append("unit from its name")
    label = _own_part(label)
    words = [w for w in re.split(r"[^a-zäöüß]+", re.sub(r"\d+", " ", label.lower())) if w]
    candidate.estimated = any(_ESTIMATED.fullmatch(word) for word in words)
    named = [role for role, pattern in _WORDS.items() if _any(pattern, words)]
    role = named[0] if named else ""
    try:
        measured = si_unit(candidate.unit) if candidate.unit else ""
    except ValueError:
        candidate.why.append(f'its unit "{candidate.unit}" is not known')
        candidate.unit = measured = ""
    of_unit = _ROLES.get(measured, "")
    if role and measured and si_unit(_USUAL[role]) != measured:
        role = of_unit if of_unit not in ("", "u") or role not in ("u", "r") else role
        role = of_unit if not role or (role != "u" and si_unit(_USUAL[role]) != measured) else role
    if role:
        candidate.role = role
        candidate.why.append("by its name")
    elif of_unit:
        candidate.role = of_unit
        candidate.why.append("by its unit")


def _any(pattern: str, words: list[str]) -> bool:
    return any(re.fullmatch(pattern, word) for word in words)


def _own_part(label: str) -> str:
    """Return the last part of a full name that says something: ``pos`` of ``pos.values``."""
    parts = [re.sub(r"\[\d+\]$", "", part) for part in re.split(r"[/.]", label)]
    own_parts = [part for part in parts if not _HOLDERS.fullmatch(part.lower())]
    return (own_parts or parts)[-1]
