"""What the name of a channel says of its role: English, German, some Spanish and French.

A name has a quantity (position, current) and perhaps a modifier: demanded, measured, estimated.
``Sollstrom`` is a demanded current, a control signal; ``Istwert`` a measured position. Planes and
axes are numbered and lettered: ``W13`` and ``x_A`` are positions, ``v`` is a velocity.
"""

from __future__ import annotations

import re
from typing import NamedTuple


class NamedRole(NamedTuple):
    """What a name says."""

    role: str = ""  #: ``t``, ``y``, ``u``, ``i``, ``v``, ``r``; ``-`` for none of these.
    estimated: bool = False  #: Whether it is an estimate.
    weak: bool = False  #: Whether a single letter says it.
    drives: bool = False  #: Whether it drives a current: duty or voltage of a power stage.


_QUANTITIES = {
    "t": r"time|zeit|temps|tiempo|tempo|timestamps?|seconds?|secs?|clock|uhr|uhrzeit",
    "-": r"err|error|regelabweichung|regelfehler|temp\w*|status|state|mode|flags?|rpm|drehzahl|"
         r"omega|index|idx|count\w*|sample\w*|power|leistung|\w*kraft|force|druck|pressure|"
         r"key_?phasor\w*|kphi|tacho\w*|trigger|trig|\w*impuls\w*|pulses?|"
         r"phase|angle|winkel|beschl\w*|acc|accel\w*|fehler",
    "v": r"vel|velocity|geschw\w*|[xyz]dot|d[xyz]|vitesse|velocidad|velocit\w*",
    "i": r"cur|curr|current|(?:\w*spulen|\w*magnet|wicklungs|coil)?strom|ström\w*|amps?|iu|imag|"
         r"i?coil|spule\w*|corriente|courant|corrente|iout",
    "stage": r"duty\w*|pwm\w*|tastgrad|tastverh\w*|aussteuer\w*|volt\w*|\w*spannung|"
             r"tension|tensi\w*n|[uv]coil",
    "u": r"stell\w*|output|control|ctrl|actuat\w*",
    "y": r"pos|\w*position|posici\w*n|posizione|weg|\w*wegsensor|dist|distance|displ\w*|disp|gap|"
         r"(?:luft)?spalt|airgap|entrefer|abstand\w*|\w*lage|regelgr\w*|sensor\w*|auslenkung|"
         r"probe|prox\w*|ybobina|dsb|eddy|sonde|height|hoehe|höhe",
}  # fmt: skip
_SPEED = r"speed"
_DEMAND = (
    r"soll|sollwert|ref|reference|referenz|referencia|consign[ea]|riferimento|set|set_?point|setpt|"
    r"sp|desired|des|target|demand\w*|command\w*|cmd|vorgabe|f(?:ü|ue)hrungsgr\w*|rif"
)
_ORDER = r"command\w*|cmd"  #: Demands that mean a control signal where no quantity is named.
_ACTUAL = r"ist|istwert|act|actual|meas|measured|mess|messwert|fbk|feedback|raw|roh"
_ESTIMATED = (
    r"est\w*|hat|obs\w*|[eu]?kf|kalman|filt\w*|gefiltert|(?:ge)?sch(?:ä|ae)tz\w*|model\w*|"
    r"logged|pred\w*|smooth\w*"
)
_LETTERS = {"t": "t", "s": "", "r": "r", "w": "r", "v": "v", "i": "i", "u": "u", "y": "y", "x": "y",
            "z": "y"}  # fmt: skip
_PLACED = re.compile(r"(?:[xyz]\d+|w\d+|v\d{2,})[a-d]?")  #: Positions in numbered planes.
_OF_A_PLANE = re.compile(r"([iu])[v-z]\d+")  #: Current or control of such a plane.
_COMPOUND = re.compile(
    r"\b(soll|ist)(?=wert|strom|lage|pos|weg|spann|geschw|abstand)|"
    r"(?:(?<=strom)|(?<=lage)|(?<=tion)|(?<=weg)|(?<=pos)|(?<=nung))(soll|ist)(?=\b|wert|_)"
)
_SHORT = re.compile(r"([xyziuv])_?(ref|soll|set|cmd|des|d|ist|act|meas|mess|m|hat|est|kf|obs)")


def role_of(label: str) -> NamedRole:
    """Return what a name says."""
    spaced = re.sub(r"(?<=[a-zäöüß])(?=[A-ZÄÖÜ])", " ", label).lower()
    spaced = _COMPOUND.sub(r" \g<0> ", spaced.replace("_", " "))
    tokens = [w for w in re.split(r"[^a-z0-9äöüßéíó]+", spaced) if w]
    words: list[str] = []
    for token in tokens:
        short = _SHORT.fullmatch(re.sub(r"\d+", "", token))
        words += (
            [token] if _PLACED.fullmatch(token)
            else [of_plane[1]] if (of_plane := _OF_A_PLANE.fullmatch(token))
            else [short[1], {"d": "soll", "m": "ist"}.get(short[2], short[2])] if short
            else [w for w in re.split(r"\d+", token) if w]
        )  # fmt: skip
    return _role_of(words)


def _role_of(words: list[str]) -> NamedRole:
    def has(form: str) -> bool:
        return any(re.fullmatch(form, word) for word in words)

    quantities = [q for q, form in _QUANTITIES.items() if has(form)]
    demanded, estimated = has(_DEMAND), has(_ESTIMATED)
    quantity = next((q for q in quantities if q != "u" or not {"i", "y"} & {*quantities}), "")
    placed = any(_PLACED.fullmatch(word) for word in words) or (
        len(words) == 2 and words[0] in ("v", "w") and words[1] in ("a", "b", "c", "d")
    )
    of_plane = next((word for word in words if word in ("i", "u")), "y")  # i W13 is a current
    quantity, weak = quantity or (of_plane if placed else ""), False
    if quantity == "i" and {"u", "v"} & {*words} and has(r"coil|spule"):  # V_coil is a voltage
        quantity = "stage"
    if not quantity and has(_SPEED):
        quantity = "-" if has("rotor|shaft|spindle|motor|rot|rotation\\w*") else "v"
    if not quantity:
        letters = [_LETTERS[word] for word in words if _LETTERS.get(word)]
        quantity, weak = (letters[0], True) if letters else ("", False)
    drives = quantity == "stage"
    quantity = "u" if drives else quantity
    if demanded and quantity in ("y", "i", "u", "v", "", "r"):
        role = {"y": "r", "r": "r", "i": "u", "u": "u", "v": "-"}.get(quantity, "")
        return NamedRole(role or ("u" if has(_ORDER) else "r"), estimated, False, drives)
    if not quantity and has(_ACTUAL):
        quantity = "y"
    return NamedRole(quantity, estimated, weak, drives)
