"""Words that laboratories use in the names of columns: commands and places outside a body, and English words for those
of other languages.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Sequence
from functools import lru_cache

from pliant.units import METRE, NEWTON, PASCAL, PIXEL, RADIAN, SECOND, standard_unit

ENGLISH = {  # word: the same in other languages, in lower case
    "time": "zeit zeitstempel uhrzeit temps horodatage tiempo tempo tid tijd 时间 时刻 時間 時刻 時間戳 时间戳",
    "base": "basis fuß fuss sockel pied embase 基座 底座 基部 根部 根元 固定端 ベース",
    "mid": "mitte milieu medio 中间 中部 中点 中央",
    "tip": "spitze ende extrémité pointe punta extremo ponta 末端 尖端 先端 顶端 手先",
    "pressure": "druck luftdruck überdruck pression presión pressão pressione 压力 压强 气压 圧力 気圧",
    "target": "vorgabe consigne consigna 目标 目標 设定 設定 给定 指令",
    "measured": "gemessen mesuré mesurée medido medida 实测 实际 実測 測定",
    "motor": "moteur 电机 马达 モータ モーター", "date": "fecha 日期 日付", "steps": "schritte 步数",
    "angle": "winkel ángulo 角度", "tension": "zugkraft 张力 拉力 張力", "displacement": "位移 変位",
    "frame": "帧 帧号 フレーム",
}  # fmt: skip
NARROW = {code: code - 0xFEE0 for code in range(0xFF01, 0xFF5F)}  # full-width signs
LETTERS = re.compile(r"[^\W\d_]+")
SLASHED = re.compile(r"([^/]*[^/\s])\s*/\s*([^\W\d_]+)")  # tip x / mm, as standards of quantities have it
UNITS = {*METRE, *PASCAL, *RADIAN, *NEWTON, *SECOND, PIXEL}
AIR = r"atm\w*|ambient|barom\w*"  # around a body
DES = r"des(?![\W_]+[a-z]+s(?![a-z]))"  # p_des, not pression des tubes
PLAIN_COMMANDS = rf"set\w*|cmd|command\w*|ref\w*|target|{DES}|desired|goal|soll|consigne"
COMMANDS = rf"{PLAIN_COMMANDS}|target\w*|soll\w*"
ELSEWHERE = rf"{COMMANDS}|supply|tank|{AIR}"  # no chamber
OTHERS = re.compile(r"forces?|acc\w*|gyr\w*|mag(?!nets?$)\w*|vel\w*|speed|twist|torques?|moments?|wrench\w*|load_?cell|"
                    r"rot\w*|ang|angles?|angular|orient\w*|ori|quat\w*|grav\w*|imu\w*|euler\w*|omega|target|goal|ref|"
                    r"reference|cmd|command\w*|des|desired|setpoint|set_point")  # fmt: skip
AMBIENT = re.compile(rf"(?:.*[\W_])?(?:{AIR})(?:[\W_].*)?", re.IGNORECASE)
PRESSED = re.compile(r"p[0-9]*|(?:.*[\W_])?pressures?[0-9]*(?:[\W_].*)?", re.IGNORECASE)  # names that say pressure
FLUID = re.compile(r"(?!.*baro)(?:.*[./])?fluid_pressure", re.IGNORECASE)  # the field of a message of ROS, in Pa
PLAINLY_OUTSIDE = re.compile(rf"(.*[\W_])?({PLAIN_COMMANDS}|supply|tank|{AIR})([\W_].*)?", re.IGNORECASE)
NOT_INSIDE = re.compile(rf"(.*[\W_])?({ELSEWHERE})([\W_].*)?", re.IGNORECASE)
COMMAND = re.compile(rf"(?!.*(?:supply|tank|{AIR}))(.*[\W_])?({COMMANDS})([\W_].*)?", re.IGNORECASE)
WHOLE = rf"set|set_?points?|cmd|command|commanded|ref|reference|target|{DES}|desired|goal|soll|sollwerte?"
SET_POINT = re.compile(rf"(?!.*(?:supply|tank|{AIR}))(.*[\W_])?({WHOLE})([\W_].*)?", re.IGNORECASE)  # not settle
REFERENCE = re.compile(r"(?:^|[\W_])ref", re.IGNORECASE)
PERHAPS_MEASURED = re.compile(r"(?:^|[\W_])(?:ist(?:wert)?|act(?:ual)?|meas\w*|raw|press\w*)(?:[\W_\d]|$)",
                              re.IGNORECASE)  # fmt: skip
ABSOLUTE = re.compile(r"(?:^|[\W_])abs(?:olute)?(?:[\W_]|$)", re.IGNORECASE)  # a pressure that is no gauge pressure
AT_BASE, AT_TIP = {"base", "root", "mount", "ground"}, {"tip", "end", "ee", "effector", "endeffector", "distal"}


def without_accents(text: str) -> str:
    """Return a text with letters and brackets in their plain forms: é as e, and full-width signs narrow; ² stays."""
    parts = (c if "<su" in unicodedata.decomposition(c) else unicodedata.normalize("NFKD", c) for c in text)
    return "".join(c for c in "".join(parts) if not unicodedata.combining(c))


TRANSLATED = {without_accents(word): english for english, words in ENGLISH.items() for word in words.split()}
JOINED = re.compile("|".join(sorted((w for w in TRANSLATED if not w.isascii()), key=len, reverse=True)))


@lru_cache(maxsize=4096)
def as_written(name: str) -> str:
    """Return the name of a column in the words of its file, with narrow signs instead of full-width ones, and with its
    unit in brackets if it is behind a slash: ``Spitze x / mm`` gives ``Spitze x [mm]``.
    """
    plain = unicodedata.normalize("NFC", name.translate(NARROW))
    match = SLASHED.fullmatch(plain)
    slashed = match and standard_unit(match[2]) in UNITS and match[1].split()[-1].lower() not in UNITS  # no m/s
    return f"{match[1]} [{match[2]}]" if match and slashed else plain


@lru_cache(maxsize=4096)
def in_english(name: str) -> str:
    """Return the name of a column as `as_written`, with English words for those of other languages in `ENGLISH`, and
    without accents: what it says, not what its station is called.
    """
    plain = without_accents(as_written(name))
    plain = JOINED.sub(lambda match: f" {TRANSLATED[match[0]]} ", plain).strip() if not plain.isascii() else plain
    return LETTERS.sub(lambda match: TRANSLATED.get(match[0].lower(), match[0]), plain)


def base_to_tip(stations: Sequence[str]) -> list[str]:
    """Return the names of stations with the only one that says base first, and the only one that says tip or end last.
    Where several say so, each of a segment of its own, the order stays.
    """
    bases = _saying(stations, AT_BASE)
    tips = [name for name in _saying(stations, AT_TIP) if not _precedes(name, stations)]
    first, last = (names if len(names) == 1 else [] for names in (bases, tips))
    if first == last:
        return list(stations)
    return [*first, *(name for name in stations if name not in (*first, *last)), *last]


def says_base(name: str) -> bool:
    """Return whether the name of a station says base."""
    return "base" in name.lower() or _says(in_english(name), AT_BASE)


def says_end(name: str) -> bool:
    """Return whether the name of a column or station says base or tip."""
    return _says(in_english(name), AT_BASE | AT_TIP)


def _saying(stations: Sequence[str], words: Collection[str]) -> list[str]:
    """Return the stations whose names hold one of the words: as written or, if no name does, in English."""
    return [name for name in stations if _says(name, words)] or [s for s in stations if _says(in_english(s), words)]


def _says(name: str, words: Collection[str]) -> bool:
    return bool({word.lower() for word in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)} & set(words))


def _precedes(name: str, stations: Sequence[str]) -> bool:
    """Return whether a station such as seg1_end is the end of a segment before the last, as seg2_mid shows."""
    segment = re.match(r"\D*(\d{1,9})(?=\D)", name)
    others = [int(number) for station in stations for number in re.findall(r"\d{1,9}", station)]
    return segment is not None and int(segment[1]) < max(others)
