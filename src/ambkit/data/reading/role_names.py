"""Role of a channel from its name, in eleven languages.

A name has a quantity (position, current) and perhaps a modifier: demanded, measured, estimated.
``Sollstrom`` is a demanded current, a control signal; ``Istwert`` a measured position. Planes and
axes have numbers or letters: ``W13`` and ``x_A`` are positions, ``v`` is a velocity.
"""

from __future__ import annotations

import re
import unicodedata
from itertools import pairwise
from typing import NamedTuple


class NamedRole(NamedTuple):
    """What a name says."""

    role: str = ""  #: ``t``, ``y``, ``u``, ``i``, ``v``, ``r``, ``k`` (keyphasor); ``-`` for none.
    estimated: bool = False  #: Whether it is an estimate.
    weak: bool = False  #: Whether a single letter says it.
    drives: bool = False  #: Whether it drives a current: duty or voltage of a power stage.
    of_what: bool = True  #: Whether it names a quantity; ``actual`` or ``feedback`` does not.
    demands: bool = False  #: Whether it is a demanded current.


_QUANTITIES = {
    "t": r"time|\w*zeit\w*|czas|tijd|temps|tiempo|tempo|instant\w*|istante|timestamps?|seconds?|"
         r"secs?|elapsed|clock|millis|micros|\w*uhr|shijian|sj|jikan|时间|时刻|時間|時刻|врем\w*",
    "-": r"err\w*|[fp]e|deg|math|regelabweichung|regelfehler|\w*temp\w*|status|state|mode|flags?|"
         r"n?rpm|\w*drehzahl|omega|idx|count\w*|sample\w*|tick|power|leistung|\w*kraft|force|"
         r"druck|torque|\w*moment|phase|phi|angle|winkel|beschl\w*|acc|accel\w*|fehler|fuerza|zhuansu|wendu|"
         r"wucha|pressure|enable\w*|humid\w*|ambient|ошибка|оборот\w*|темп\w*|скоростьвращения|сила|"
         r"转速|温度|误差|序号|回転数|誤差",
    "k": r"key_?ph\w*|kphi?|kph|\w*mark[ae]?|tach\w*|trigger|trig|\w*imp(?:uls)?|\w*pulses?|"
         r"perturn|toptour|revs?|index|once|脉冲|键相|パルス|метка|импульс\w*",
    "v": r"vel|velocity|geschw\w*|[xyz]dot|d[xyz]|vitesse|velocidad\w*|velocit\w*|sudu|"
         r"скорость|速度",
    "i": r"cur|curr|currents?|\w*strom|ström\w*|amps?|amperes?|iu|imag|iq|i?coil|spule\w*|"
         r"corriente|courant|corrente|intensi\w*|iout|dianliu|dl|denryuu?|stroom|prąd|prad|"
         r"ток\w*|电流|電流",
    "stage": r"duty\w*|pwm\w*|dc|tastgrad|tastverh\w*|\w*aussteuer\w*|volt\w*|\w*spannung|"
             r"tensi\w*|ciclo|rapport|[uv]coil|v_?in|dianya|zhankongbi|den.?atsu|napi[eę]ci\w*|"
             r"wype[lł]n\w*|напряж\w*|шим|скважность|"
             r"电压|占空比|電圧|デューティ",
    "u": r"stell\w*|output|control|ctrl|ctl|actuat\w*|\w*regler\w*|ansteuer\w*|reglage|mando|"
         r"salida|sortie|uscita|kongzhi(?:liang)?|управл\w*|控制|制御|操作量",
    "y": r"[afr]?pos|posn|\w*position|posi[cz]\w*|weg|\w*weg(?:sensor|aufnehmer)|dist\w*|disp\w*|"
         r"gap|clearance|\w*spalt|airgap|entrefer|\w*abstand\w*|\w*lage(?:signal)?|regelgr\w*|"
         r"sens(?:e?or\w*)?|"
         r"messgr\w*|auslenk\w*|abweichung|exzent\w*|eccent\w*|excentr\w*|ecc|hall|heni|prob[ae]|prox\w*|"
         r"ybobina|dsb|eddy|sonde|height|\w*hoehe|\w*höhe|alt\w*|hauteur\w*|jeu|verplaats\w*|"
         r"poł\w*|despl\w*|desloc\w*|spostam\w*|traslaz\w*|deplac\w*|entrehierro|separa\w*|"
         r"traferro|wei[yz]h?i|wy|qixi|jianxi|juli|положени\w*|смещени\w*|перемещ\w*|зазор|датчик|传感器|"
         r"位移|位置|气隙|间隙|変位|ギャップ|隙間|空隙|センサ",
}  # fmt: skip
_DEMAND = (
    r"\w*soll|sollwert|ref|reference|referen[zc]\w*|consign[ea]|riferimento|set|set_?po?i?n?ts?|"
    r"setp|sp|desired|des|dem|target|tgt|demand\w*|request\w*|comm?and\w*|cmd|\w*vorgabe|"
    r"f(?:ü|ue)hrungsgr\w*|rif|dese[ajo]\w*|desi[dr]\w*|richiest\w*|cible|objetivo|obiettivo|"
    r"zad(?:an\w*)?|shirei|mokuhyou?|"
    r"уставка|задан\w*|cankao|geiding|sheding|mubiao|zhiling|参考|给定|设定|目标|目標|指令"
)
_ORDER = r"comm?and\w*|cmd|zhiling|指令"  #: Of a control signal, where no quantity is named.
_CONTROL = r"control|ctrl|stell\w*|steuer\w*|regelstrom|kongzhi|управл\w*|控制|制御"
"""A control current is a demanded one."""
_ACTUAL = (
    r"ist|istwert|act|actual|meas|measure\w*|mess|messwert|fbk|feedback|fdbk|mon|monitor|raw|roh|"
    r"medid\w*|misur\w*|mesur\w*|lida|lu|измер\w*|celiang|shiji|fankui|"
    r"反馈|实测|测量|实际|実測|測定|検出"
)
_ESTIMATED = (
    r"e?stim\w*|est|hat|dach|o[bs]s\w*|beob\w*|[eu]?kf|kalman|filt\w*|gefiltert|"
    r"(?:ge)?sch(?:ä|ae)tz\w*|model\w*|logged|pred\w*|smooth\w*|оценк\w*|估计|观测|推定"
)
_FORMS = "|".join((*_QUANTITIES.values(), _DEMAND, _CONTROL, _ACTUAL, _ESTIMATED)).split("|")
_UNSPACED = re.compile("|".join(sorted({w for w in _FORMS if w >= "\u3000"}, key=len)[::-1]))
"""Words of languages that put no spaces between them."""
_LETTERS = {"t": "t", "s": "", "r": "r", "w": "r", "v": "v", "i": "i", "u": "u", "y": "y", "x": "y",
            "z": "y"}  # fmt: skip
_PLACED = re.compile(r"(?:[xyz]\d+|w\d+|v\d{2,})[a-d]?")  #: Positions in numbered planes.
_OF_A_PLANE = re.compile(r"([iu])[v-z](?:\d+|[a-d]?)")  #: Current or control of such a plane.
_COMPOUND = re.compile(
    r"\b(?:soll(?=\w{3})|ist(?=wert|strom|lage|pos|weg|spann|geschw|abstand|höhe|hoehe))|"
    r"(?:(?<=strom)|(?<=lage)|(?<=tion)|(?<=weg)|(?<=pos)|(?<=nung))(soll|ist)(?=\b|wert|_)"
)
_ACCENTS = re.compile("[\u0300-\u0307\u0309-\u036f]")  #: All but the umlauts' two dots.
_SHORT = re.compile(
    r"([xyziuv])_?(ref|soll|set|sp|cmd|dem|des|d|ist|act|meas|mess|mon|fbk?|m|hat|est|kf|obs)"
)
_SHORT_FOR = {"d": "soll", "dem": "soll", "m": "ist", "fb": "ist"}


def role_of(label: str) -> NamedRole:
    """Return what a name says."""
    spaced = _ACCENTS.sub("", unicodedata.normalize("NFD", label))
    spaced = unicodedata.normalize("NFC", spaced)
    spaced = re.sub(r"(?<=[a-zäöüß])(?=[A-ZÄÖÜ])", " ", spaced).lower()
    spaced = _UNSPACED.sub(r" \g<0> ", _COMPOUND.sub(r" \g<0> ", spaced.replace("_", " ")))
    spaced = re.sub(r"\bpower (?=amp|stage)", "", spaced)  # of an amplifier, and no power
    spaced = re.sub(r"\brpos\b", "ref pos", spaced)
    tokens = [w for w in re.split(r"\W+", spaced) if w]
    words: list[str] = []
    for token in tokens:
        short = _SHORT.fullmatch(re.sub(r"\d+", "", token))
        words += (
            [] if re.fullmatch(r"[rp]\d{3,}", token)  # a parameter of a drive
            else [token] if _PLACED.fullmatch(token)
            else [of_plane[1]] if (of_plane := _OF_A_PLANE.fullmatch(token))
            else [short[1], _SHORT_FOR.get(short[2], short[2])]
            if short and (short[2] != "d" or short[1] in "iuv" or len(tokens) == 1)  # a plane XD
            else [w for w in re.split(r"\d+", token) if w]
        )  # fmt: skip
    return _role_of(words)


def _role_of(words: list[str]) -> NamedRole:
    joined = [*words, *map("".join, pairwise(words))]  # x_dot, and the syllables of pinyin

    def has(form: str) -> bool:
        return any(re.fullmatch(form, word) for word in joined)

    if words[:1] == ["t"] and len(words) > 1 and not has(_QUANTITIES["y"] + "|" + _QUANTITIES["i"]):
        return NamedRole("t", weak=True)  # t_ctrl
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
    if not quantity and has("speed"):
        quantity = "-" if has("rotor|shaft|spindle|motor|rot|rotation\\w*") else "v"
    if not quantity:
        letters = [_LETTERS[word] for word in words if _LETTERS.get(word)]
        letters = ["r"] if letters == ["y", "r"] else letters  # x_r
        letters.sort(key=lambda letter: letter not in ("i", "u"))  # x i: the current of the axis x
        quantity, weak = (letters[0], True) if letters else ("", False)
    if quantity == "stage" and "y" in quantities:  # the voltage of a sensor
        quantity = "y"
    demanded |= quantity == "i" and has(_CONTROL)
    drives = quantity == "stage"
    quantity = "u" if drives else quantity
    if demanded and quantity in ("y", "i", "u", "v", "", "r"):
        role = {"y": "r", "r": "r", "i": "u", "u": "u", "v": "-"}.get(quantity, "")
        doubtful = weak and role == "r" and has(_ORDER)  # a command of what?
        role = role or ("u" if has(_ORDER) else "r")
        return NamedRole(role, estimated, doubtful, drives, demands=quantity == "i")
    if not quantity and has(_ACTUAL):
        return NamedRole("y", estimated, of_what=False)
    return NamedRole(quantity, estimated, weak, drives)
