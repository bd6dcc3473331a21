"""What the name of a channel says of its role: English, German, Romance languages and Chinese.

A name has a quantity (position, current) and perhaps a modifier: demanded, measured, estimated.
``Sollstrom`` is a demanded current, a control signal; ``Istwert`` a measured position. Planes and
axes are numbered and lettered: ``W13`` and ``x_A`` are positions, ``v`` is a velocity.
"""

from __future__ import annotations

import re
import unicodedata
from itertools import pairwise
from typing import NamedTuple


class NamedRole(NamedTuple):
    """What a name says."""

    role: str = ""  #: ``t``, ``y``, ``u``, ``i``, ``v``, ``r``; ``-`` for none of these.
    estimated: bool = False  #: Whether it is an estimate.
    weak: bool = False  #: Whether a single letter says it.
    drives: bool = False  #: Whether it drives a current: duty or voltage of a power stage.


_QUANTITIES = {
    "t": r"time|zeit|temps|tiempo|tempo|instante|timestamps?|seconds?|secs?|elapsed|clock|uhr|"
         r"uhrzeit|shijian|时间",
    "-": r"err|error|regelabweichung|regelfehler|temp\w*|status|state|mode|flags?|rpm|drehzahl|"
         r"omega|index|idx|count\w*|sample\w*|power|leistung|\w*kraft|force|druck|pressure|"
         r"key_?phasor\w*|kphi|tacho\w*|trigger|trig|\w*impuls\w*|pulses?|"
         r"phase|angle|winkel|beschl\w*|acc|accel\w*|fehler|fuerza|zhuansu|wendu|wucha|"
         r"转速|温度|误差",
    "v": r"vel|velocity|geschw\w*|[xyz]dot|d[xyz]|vitesse|velocidad\w*|velocit\w*|"
         r"sudu|速度",
    "i": r"cur|curr|current|(?:\w*spulen|\w*magnet|wicklungs|coil)?strom|ström\w*|amps?|iu|imag|"
         r"i?coil|spule\w*|corriente|courant|corrente|"
         r"intensidad|iout|dianliu|\w*电流",
    "stage": r"duty\w*|pwm\w*|tastgrad|tastverh\w*|aussteuer\w*|volt\w*|\w*spannung|"
             r"tensi\w*|ciclo|[uv]coil|dianya|zhankongbi|电压|占空比",
    "u": r"stell\w*|output|control|ctrl|actuat\w*|regler\w*|reglage|mando|salida|"
         r"kongzhi(?:liang)?|控制量?",
    "y": r"pos|\w*position|posi[cz]\w*|weg|\w*wegsensor|dist\w*|disp\w*|gap|"
         r"(?:luft)?spalt|airgap|entrefer|abstand\w*|\w*lage|regelgr\w*|sensor\w*|auslenkung|"
         r"probe|prox\w*|ybobina|dsb|eddy|sonde|height|hoehe|höhe|altura|despl\w*|"
         r"desloc\w*|spostam\w*|deplac\w*|entrehierro|separa\w*|traferro|"
         r"wei[yz]h?i|qixi|jianxi|juli|位移|位置|气隙|间隙",
}  # fmt: skip
_SPEED = r"speed"
_DEMAND = (
    r"soll|sollwert|ref|reference|referen[zc]\w*|consign[ea]|riferimento|set|set_?point|setpt|"
    r"sp|desired|des|target|demand\w*|comm?and\w*|cmd|vorgabe|f(?:ü|ue)hrungsgr\w*|rif|dese[aj]\w*|"
    r"desider\w*|cankao|geiding|sheding|mubiao|\w*(?:参考|给定|设定|目标)\w*"
)
_ORDER = r"comm?and\w*|cmd"  #: Demands that mean a control signal where no quantity is named.
_CONTROL = r"control|ctrl|stell\w*|kongzhi"  #: A control current is a demanded one.
_ACTUAL = (
    r"ist|istwert|act|actual|meas|measured|mess|messwert|fbk|feedback|raw|roh|"
    r"medid\w*|misur\w*|mesur\w*|celiang|shiji"
)
_ESTIMATED = (
    r"est\w*|hat|dach|obs\w*|beob\w*|[eu]?kf|kalman|filt\w*|gefiltert|(?:ge)?sch(?:ä|ae)tz\w*|model\w*|"
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
_ACCENTS = re.compile("[\u0300-\u0307\u0309-\u036f]")  #: All but the umlauts' two dots.
_SHORT = re.compile(r"([xyziuv])_?(ref|soll|set|cmd|des|d|ist|act|meas|mess|m|hat|est|kf|obs)")


def role_of(label: str) -> NamedRole:
    """Return what a name says."""
    spaced = _ACCENTS.sub("", unicodedata.normalize("NFD", label))
    spaced = unicodedata.normalize("NFC", spaced)
    spaced = re.sub(r"(?<=[a-zäöüß])(?=[A-ZÄÖÜ])", " ", spaced).lower()
    spaced = _COMPOUND.sub(r" \g<0> ", spaced.replace("_", " "))
    tokens = [w for w in re.split(r"\W+", spaced) if w]
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
    joined = [*words, *map("".join, pairwise(words))]  # x_dot, and the syllables of pinyin

    def has(form: str) -> bool:
        return any(re.fullmatch(form, word) for word in joined)

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
    demanded |= quantity == "i" and has(_CONTROL)
    drives = quantity == "stage"
    quantity = "u" if drives else quantity
    if demanded and quantity in ("y", "i", "u", "v", "", "r"):
        role = {"y": "r", "r": "r", "i": "u", "u": "u", "v": "-"}.get(quantity, "")
        return NamedRole(role or ("u" if has(_ORDER) else "r"), estimated, False, drives)
    if not quantity and has(_ACTUAL):
        quantity = "y"
    return NamedRole(quantity, estimated, weak, drives)
