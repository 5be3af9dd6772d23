"""What the name of a column says by plain words: the signal, commanded or measured, its unit, its joint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from ....common.documents import read_yaml
from .expression import ALONE, LIKE, TEMPERATURES, UNIT_OR_NAME, WORDS, like_a_unit, measure, measures, unit_of

LOGGED = {
    "position": "goal",
    "velocity": "goal_velocity",
    "torque": "torque_command",
    "time": "time",
    "enabled": "enabled",
}
"""What is commanded, by what it is of."""
MOVING = ("position", "velocity", "torque", "acceleration")
"""Signals that a tool has as well as a joint."""
BY_UNIT = {"angle": "position", "rate": "velocity", "torque": "torque", "current": "current", "voltage": "voltage",
           "tick": "position", "degC": "temperature", "erpm": "velocity"}  # fmt: skip
"""Signals by the quantity of a unit, where a name says nothing else; turns and ways are too common."""
OF_SIGNAL = {"time": {"min": "min", "mins": "min", "minute": "min", "h": "h", "hr": "h", "hrs": "h", "hour": "h"},
             "temperature": {"f": "degF", "k": "K", "dc": "0.1 degC"}}  # fmt: skip
"""Words that are units in the names of one signal alone."""
CASED = re.compile(r"(?<![A-Za-z])([nuµμmcdk](?:A|V|C|N|Nm|Ncm|Nmm)|Nm|Ncm|Nmm|degC)(?![a-z])")
"""Units in which a capital follows a small letter, or does not begin a word."""
ANYWHERE = ("ms", "us", "ns", "ma", "ua", "mv", "mm", "cm")
"""Words of two letters that are units wherever they stand; others, and single letters, only at the end of a name."""
NUMBERED = re.compile(r"(?:(?<![A-Za-z0-9.])10+|(?<![0-9.])\d*\.\d+[ _]?)[A-Za-zµμ°]+(?![A-Za-z0-9])")
"""A unit with its number, as in ``time_10us`` and ``current_2.69mA``; ``pos_2deg`` is joint 2."""
RATING = re.compile(r"[1-9]\d*\.\d+[ _]?(?:V|A|Nm)")
"""What a supply or a motor is rated at, more likely than a unit: ``rail_3.3V``."""
FACTOR = re.compile(
    r"[\[(]\s*(?:(?:[x×*·/÷]|times|div)\s*[\d.]+|\d*\.\d+|\d+e[-+]?\d+)\s*[\])]"  # (x10), (0.01)
    r"|(?:(?<![^\W\d_])|(?<=[a-z])(?=[A-Z]))(?i:times|div(?:ided)?(?:[ _]?by)?|mult?)[ _]?[\d.]+"
    r"|(?:(?<![^\W_])|(?<=[a-z])(?=X)|(?<=deg|rad|rpm))[xX] ?(?:\d*\.\d+|\d{2,})"  # deg_x10; x1 is an axis
    r"|(?<=deg_|rad_|rpm_)x_\d{2,}|[*×·]\s*\d{2,}|(?<![\w.])[\d.]+\s*[*×·]\s*(?=[a-z])"
    r"|(?<![^\W_])pi(?=[ _]rad)|(?<![^\W\d_])scaled\Z"
    r"|(?<![^\W\d_])(?i:tenth|hundredth|thousandth|deci|centi|milli|micro)s?(?![a-z])"
    r"|(?<![^\W_])(?<![.,/\d])1/\d+(?=[ _]?[a-z°])"
)
"""What a column was multiplied or divided by, whichever it was."""


@dataclass(frozen=True)
class Claim:
    """What somebody says of a column.

    Attributes:
        column: its name.
        signal: of the log (``goal``, ``torque_command``, ``load``, ``time``); empty where nothing is said.
        unit: as ``deg`` or ``N.m``; empty where none is said, ``?`` where a format leaves it open.
        joint: the rest of the name, empty where there is none.
        aside: why the column is none of a log, where it says something else.
        how: the word that says the signal.
        by: who says it, for people.
        formula: of its line where the dialect gives it.
        ask: the question about it, where there is one.
        rest: word of its name that names neither its joint nor anything else that is known, and may be a unit.
        words: of the name, small.
        sure: whether a format or a dialect says the joint.
    """

    column: str = ""
    signal: str = ""
    unit: str = ""
    joint: str = ""
    aside: str = ""
    how: str = ""
    by: str = "the name"
    formula: str = ""
    ask: str = ""
    rest: str = ""
    words: frozenset[str] = frozenset()
    sure: bool = False


@dataclass(frozen=True)
class Vocabulary:
    """The words of ``words.yaml``: signals in their order, classes by word, phrases with what stands for them."""

    signals: dict[str, frozenset[str]]
    classes: dict[str, frozenset[str]]
    phrases: tuple[tuple[re.Pattern[str], str], ...]
    asides: dict[str, str]


@cache
def vocabulary() -> Vocabulary:
    content = read_yaml(Path(__file__).with_name("words.yaml"))
    signals = {signal: frozenset(words.split()) for signal, words in content["signals"].items()}
    classes = {name: frozenset(words.split()) for name, words in content.items() if isinstance(words, str)}
    phrases = tuple((re.compile(pattern), to) for pattern, to in content["phrases"].items())
    return Vocabulary(signals, classes, phrases, content["asides"])


def is_a(kind: str, *words: str) -> bool:
    """Whether one of some words is of a class of the vocabulary."""
    return not vocabulary().classes[kind].isdisjoint(words)


@cache
def said(name: str) -> Claim:
    """Read a column's name."""
    if (found := _with_factor(name)) is not None:
        return found
    unit, text = _bracketed(name)
    words = words_of(text)
    low = {word.lower() for word in words}
    if not unit and ("kp" not in low or low & vocabulary().signals["torque"] or "load" in low):  # a kilopond, or a gain
        unit, at = _unit(words)
        del words[at]
    line = " ".join(words)
    for pattern, to in vocabulary().phrases:
        line = pattern.sub(to, line)
    return replace(_Name(line.split(), unit).said(), column=name)


class _Name:
    """Words of a name by what they say; those that say nothing name the joint."""

    def __init__(self, words: list[str], unit: str) -> None:
        self.words, self.low, self.unit = words, [word.lower() for word in words], unit
        self.known = vocabulary()
        self.used = {
            k
            for k, word in enumerate(self.low)
            if self._of(word, "commanded", "measured", "weak", "filtered", "fillers")
        }

    def said(self) -> Claim:
        low, own = self.low, set(self.low)
        aside = next((why for word, why in self.known.asides.items() if word in own), "")
        signal, how = self._signal()
        part = {word for word in own if self._of(word, "part")}
        forward = bool(part) and part <= {"ff", "feedforward"} and signal == "torque"  # commanded beside a goal
        commanded = forward or any(self._of(word, "commanded") for word in low)
        measured = any(self._of(word, "measured") for word in low)
        measured |= not commanded and any(self._of(word, "weak") for word in low)
        if not signal:
            signal, how = self._by_less(commanded, measured)
        unit = self._own_unit(signal)
        if part and not forward:
            aside = f"{signal or min(part)} of a controller or model"
        elif commanded and not measured:
            aside = aside or ("" if signal in ("", *LOGGED) else f"commanded {signal}")
            signal = LOGGED.get(signal, "")
        elif signal == "position" and own & {"link", "output"} and "motor" not in own:
            signal = "link_position"
        if any(self._of(word, "tool") for word in low) and not any(self._of(word, "of_joints") for word in low):
            moving = signal in (*MOVING, *LOGGED.values()) or not (signal or unit)
            aside = aside or (f"{signal.replace('_', ' ') or 'pose'} of the tool, no joint" if moving else "")
        if signal == "acceleration":
            aside = aside or signal
        self.used |= {k for k, word in enumerate(low) if word in ("ff", "feedforward", *self.known.asides)}
        return Claim("", "" if aside else signal, unit, self._joint(), aside, how, words=frozenset(own))

    def _joint(self) -> str:
        """Words that say nothing else; a number goes with the word before it, or with ``joint``."""
        out = ""
        for word in (word for k, word in enumerate(self.words) if k not in self.used):
            out = (out or "joint") + word if word.isdigit() else out + ("_" if out else "") + word
        return out

    def _of(self, word: str, *kinds: str) -> bool:
        return any(word in self.known.classes[kind] for kind in kinds)

    def _signal(self) -> tuple[str, str]:
        """The signal that a word says, and the word."""
        for signal, spoken in self.known.signals.items():
            hits = [k for k, word in enumerate(self.low) if word in spoken and (word != "t" or self._is_time(k))]
            if hits:
                self.used |= set(hits)
                if self.low[hits[0]] == "q_current" and measures(self.unit, "current"):
                    return "current", "q"
                return signal, self.words[hits[0]]
        return "", ""

    def _is_time(self, k: int) -> bool:
        letters = [place for place, word in enumerate(self.words) if not word.isdigit()]
        return k == letters[-1] or (k == letters[0] and self.words[k] == "t")

    def _by_less(self, commanded: bool, measured: bool) -> tuple[str, str]:
        """The signal of a name without a word for one: a sign, a unit, or only that it was commanded."""
        low, of_volts = self.low, any(self._of(word, "supply") or word == "bus" for word in self.low)
        for k, word in enumerate(low):
            rate = self._of(word, "rates") and (commanded or (measured and (word not in "vw" or not of_volts)))
            if rate and not measures(self.unit, "angle", "way"):
                self.used.add(k)
                return "velocity", word
        if len(low) == 1 and self._of(low[0], "clocks"):
            self.used.add(0)
            return "time", low[0]
        supply = [k for k, word in enumerate(low) if self._of(word, "supply")]
        if supply and not commanded and (not self.unit or measures(self.unit, "voltage")):
            self.used |= set(supply)
            return "voltage", low[supply[0]]
        known = measure(self.unit) if self.unit != "turn" else None
        if only := BY_UNIT.get(known.quantity if known else self.unit, ""):
            self.used |= {len(low) - 1} if only == "current" and low[-1:] == ["i"] else set()
            return only, f"[{self.unit}]"
        if low.count("p") == 1 and (commanded or measured):
            self.used.add(low.index("p"))
            return "position", "p"
        whole = bool(low) and all(self._of(word, "alone") for word in low)
        if whole or (commanded and not measures(self.unit, "time")):  # a latency may be logged with an action
            return "position", next(word for word in low if whole or self._of(word, "commanded"))
        return "", ""

    def _own_unit(self, signal: str) -> str:
        own = OF_SIGNAL.get(signal, {})
        if not self.unit and len(self.low) > 1 and self.low[-1] in own:
            self.used.add(len(self.low) - 1)
            return own[self.low[-1]]
        return self.unit


def _with_factor(name: str) -> Claim | None:
    """What a name says beside a factor of its unit; the unit is then one that is asked about."""
    brackets = [match.span() for match in re.finditer(r"[\[(][^\])]*[\])]", name)]
    for match in FACTOR.finditer(name):
        start, end = match.span()
        if any(low < end and start < high and (low < start or end < high) for low, high in brackets):
            continue  # a part of what brackets say, which is understood as a whole or not at all
        found = said(f"{name[:start].rstrip(' _.-')} {name[end:].lstrip(' _.-')}".strip())
        text = match[0].strip(" _.-[]()")
        if found.unit or (found.signal and not re.fullmatch(r"(?i:x(?!10+\Z)\d+|scaled|[a-z]+|1/\d+)", text)):
            return replace(found, column=name, unit=f"{found.unit} {text}".strip())
    return None


def _bracketed(name: str) -> tuple[str, str]:
    """A unit in brackets or with its number, understood or not, and the name without it."""
    brackets = list(re.finditer(r"[\[(]([^\])]*)[\])]", name))
    found = [(unit_of(match[1]), match) for match in brackets]
    for one in NUMBERED.finditer(name):
        if not any(other.start() < one.start() < other.end() for other in brackets):
            found.append((one[0] if RATING.fullmatch(one[0]) else unit_of(one[0].replace("_", "")), one))
    found += [(match[1].strip(), match) for match in brackets if like_a_unit(match[1])]
    for unit, match in found:
        if unit:
            return unit, f"{name[: match.start()]} {name[match.end() :]}"
    return "", name


def words_of(text: str) -> list[str]:
    """Words of a name: parted by signs, by digits, and where a capital follows a small letter."""
    text = CASED.sub(lambda unit: unit[0].lower(), text)
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", text)
    plain = "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))
    return re.findall(r"[^\W\d_]+|°|\d+", plain)


def _unit(words: list[str]) -> tuple[str, slice]:
    """Unit that words say, and which: the last of them behind another word, of up to three words."""
    low = [word.lower() for word in words]
    spoken = {signal for signal, own in vocabulary().signals.items() if own & set(low)}
    spoken |= {"voltage"} if is_a("supply", *low) else set()
    for k in range(len(low) - 1, 0, -1):
        last = all(other.isdigit() for other in low[k + 1 :])
        for start in (k - 2, k - 1):
            if start > 0 and (unit := _of_several(low[start : k + 1], last, spoken)):
                return unit, slice(start, k + 1)
        unit = _of_one(low[k], last, spoken)
        numbered = low[k].isalpha() and len(low[k]) == 1 and k + 1 < len(low)  # m1 is the first motor
        of_motor = measures(unit, "way") and is_a("angles", *low)  # as theta_m
        if unit and low[k + 1 : k + 2] == ["per"]:  # and not per second: of that it is not known what it is
            return " ".join(low[k:]), slice(k, len(low))
        if unit and not (numbered or of_motor):
            return unit, slice(k, k + 1)
    alone = len(low) == 1 and is_a("clocks", low[0])
    return (unit_of(low[0]) if alone else ""), slice(0, 0)


def _of_several(words: list[str], last: bool, spoken: set[str]) -> str:
    """A unit of two or three words: ``rad s``, ``deg per sec``, ``kg cm``."""
    first, end = words[0], words[-1]
    if end in ("s", "sec") or (end == "min" and "velocity" in spoken):  # min is the least, too
        return unit_of(f"{first}/{end}") if len(words) == 2 or words[1] == "per" else ""
    unit = unit_of("".join(words)) if words[-2] == "°" else unit_of(" ".join(words)) if last else ""
    return unit if measures(unit, "torque") or unit in TEMPERATURES else ""


def _of_one(word: str, last: bool, spoken: set[str]) -> str:
    """The unit that one word is; at the end of a name also one that is not understood, as it stands."""
    if word in WORDS and (last or len(word) > 1):
        return WORDS[word]
    if word in ALONE or word in UNIT_OR_NAME or len(word) < 2:
        return ""
    if unit := unit_of(word):
        known = measure(unit)
        if len(word) > 2 and not measures(unit, "torque"):
            return unit
        quantity = known.quantity if known else ""
        meant = quantity not in ("current", "voltage", "force") or quantity.replace("force", "torque") in spoken
        return unit if word in ANYWHERE or (last and meant) else ""
    return word if last and (LIKE.match(word) or like_a_unit(word)) else ""
