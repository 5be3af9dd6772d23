"""What the name of a column says: the signal, commanded or measured, its unit, its joint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace
from itertools import pairwise

from .factors import factor_in
from .name_words import (
    ALONE,
    ANGLE_WORDS,
    CLOCK_WORDS,
    COMMANDED,
    DAMPING,
    DROPPED,
    FILLERS,
    FILTERED,
    FORWARD,
    MEASURED,
    MODELLED,
    OF_JOINTS,
    ONLY_UNIT,
    RATES,
    SHORT,
    SIGNALS,
    SIGNS,
    STIFFNESS,
    SUPPLY,
    TOOL,
    VOLTS,
    WEAK,
)
from .unit_words import OF_TEMPERATURE, OF_TIME, SPELT, UNITS, like_a_unit, measure, measures, unit_of

ODRIVE = re.compile(r"(?:.*[._/])?(pos_estimate|input_pos|pos_setpoint|vel_estimate|input_vel|vel_setpoint)")
"""Names of ODrive, which counts turns."""
ANYWHERE = frozenset(["ms", "us", "ns", "ma", "ua", "mv", "mm", "cm"])
"""Words of two letters that are units wherever they stand; others, and single letters, only at the end of a name."""
NUMBERED = re.compile(r"(?:(?<![A-Za-z0-9.])10+|(?<![0-9.])\d*\.\d+[ _]?)[A-Za-zµμ°]+(?![A-Za-z0-9])")
"""A unit with its number, as in ``time_10us`` and ``current_2.69mA``; ``pos_2deg`` is joint 2."""
RATING = re.compile(r"[1-9]\d*\.\d+[ _]?(?:V|A|Nm)")
"""What a supply or a motor is rated at, more likely than a unit: ``rail_3.3V``."""
TRANSFORM = re.compile(r"(?<![A-Za-z])[A-Z]+_T_[A-Z]+(?![A-Za-z])")
"""``F_T_NE``: where one frame stands in another."""
MOVING = frozenset(["goal", "position", "velocity", "goal_velocity", "torque", "torque_command", "acceleration",
                    "commanded acceleration"])  # fmt: skip
"""Signals that a tool has as well as a joint."""
CASED = re.compile(r"(?<![A-Za-z])([nuµμmcdk](?:A|V|C|N|Nm|Ncm|Nmm)|Nm|Ncm|Nmm|degC)(?![a-z])")
"""Units in which a capital follows a small letter, or does not begin a word."""


@dataclass(frozen=True)
class Said:
    """What a column's name says.

    Attributes:
        signal: of the log (``goal``, ``position``, ``torque_command``, ...), or one that the log has no place for;
            empty where the name says nothing.
        unit: as ``deg`` or ``N.m``; empty where the name says none.
        joint: the rest of the name, empty where there is none.
        filtered: whether it says that it was processed.
        how: the word that says the signal, for people.
        by: who says the unit, for people.
    """

    signal: str
    unit: str
    joint: str
    filtered: bool = False
    how: str = ""
    by: str = "the name"


def said(name: str) -> Said:
    """Read a column's name."""
    if (factor := factor_in(name)) is not None:
        found = said(factor.rest)
        if found.unit or (found.signal and not factor.of_unit):
            share = factor.share and measure(found.unit) and " " not in found.unit
            unit = f"{factor.share} {found.unit}" if share else f"{found.unit} {factor.text}".strip()
            return replace(found, unit=unit)
    unit, text = _bracketed(name)
    words = words_of(text)
    low = [word.lower() for word in words]
    gains = DROPPED & set(low)  # kp is a kilopond, too
    if not unit:
        unit, at = _unit(low)
        del words[at], low[at]
    sides = set(low)
    part = sides & DROPPED
    if sides & FORWARD and not sides & {word for _, own in SIGNALS for word in own - {"t"}}:
        sides, low = (sides - {"t"}) | {"tau"}, ["tau" if word == "t" else word for word in low]  # t_ff
        part = sides & DROPPED
    torques = any(sides & own for one, own in SIGNALS if one == "torque")
    if part and part <= FORWARD and torques:  # which is commanded beside a goal
        part, sides = set(), sides | {"commanded"}
    if torques and MODELLED in sides:
        sides |= {"commanded"}
    if "kp" in gains - part and not torques and "load" not in sides:
        part, unit = {"kp"}, ""
    commanded, measured = bool(sides & COMMANDED), bool(sides & (MEASURED - WEAK))
    beside = (
        set() if part else {k for k, (one, two) in enumerate(pairwise(words), 1) if (one.lower(), two) == ("tau", "J")}
    )
    wanted = _wanted(words) if not (part or measured) else None
    if wanted is not None and (not commanded or words[-1].isdigit()):  # cmd_q_d may be of a joint d, cmd.q_d[0] is not
        commanded, beside = True, beside | {wanted}
    measured |= not commanded and bool(sides & WEAK)
    used = beside | {k for k, word in enumerate(low) if word in COMMANDED | MEASURED | FILTERED | FILLERS | FORWARD}
    if torques and MODELLED in low:
        used.add(low.index(MODELLED))
    field = ""
    if (at := _field(low, unit)) is not None:  # its words are no angle q and no joint
        field, low[at : at + 2] = low[at], ["iq" if low[at] == "q" else "", ""]
        used |= {at, at + 1}
    if ("i", "q") in pairwise(low):  # of a motor's two axes, the one that makes torque
        low = ["iq" if word == "i" else "" if word == "q" else word for word in low]
        used |= {k for k, word in enumerate(low) if not word}
    signal, how = "", ""
    for candidate, spoken in SIGNALS:
        hits = [k for k, word in enumerate(low) if word in spoken and (word != "t" or _is_time(words, k))]
        if hits:
            signal, how = candidate, words[hits[0]]
            used |= set(hits)
            break
    if low[-1:] == ["m"] and ANGLE_WORDS & set(low):  # theta_m: measured, or of the motor
        measured, used = True, used | {len(low) - 1}
    if signal == "position" and "current" in low and measures(unit, "current"):  # q_current (A)
        signal, used = "current", used | {low.index("current"), *(k for k, word in enumerate(low) if word == "q")}
    if signal in ("position", "velocity", "torque") and {"input", "control"} & set(low):
        commanded = True
    if signal in ("position", "velocity") and "current" in low:  # as against the one wanted
        measured, used = True, used | {low.index("current")}
    if signal == "enabled":
        used |= {k for k, word in enumerate(low) if word == "torque"}
    if not signal:
        for k, word in enumerate(low):
            rate = word in RATES and (commanded or (measured and word in ("v", "w") and not VOLTS & set(low)))
            if rate and not measures(unit, "angle", "way"):  # qd_des: the derivative
                signal, how = "velocity", words[k]
                used.add(k)
                break
            if match := SHORT.fullmatch(word):
                signal, how = "position", words[k]
                used.add(k)
                commanded, measured = match[2] in ("g", "r", "ref", "d", "des", "c", "cmd", "goal"), match[2][0] in "ma"
                break
    if not signal and len(words) == 1 and low[0] in CLOCK_WORDS:
        signal, how = "time", words[0]
        used.add(0)
    if (
        not signal
        and not commanded
        and (not unit or measures(unit, "voltage"))
        and (named := [w for w in low if w in SUPPLY])
    ):
        signal, how = "voltage", named[0]
        used |= {k for k, word in enumerate(low) if word in SUPPLY}
    if not signal and (only := _only(unit)):
        signal, how = only, f"[{unit}]"
        if signal == "current" and low[-1:] == ["i"]:  # beside its unit, as in elbow_I_mA: of no joint
            used.add(len(low) - 1)
    if not signal and low.count("p") == 1 and (commanded or measured):
        signal, how = "position", "p"
        used.add(low.index("p"))
    if not signal and commanded and not measures(unit, "time"):  # a latency that was logged with an action
        signal, how = "position", next(word for word in words if word.lower() in COMMANDED)
    if not signal and sides and sides <= ALONE:
        signal, how = "position", words[0]
    own = {"temperature": OF_TEMPERATURE, "time": OF_TIME}.get(signal, {})
    if not unit and len(low) > 1 and low[-1] in own:
        unit, used = own[low[-1]], used | {len(low) - 1}
    if not unit and ODRIVE.fullmatch(name.lower()):
        unit = "turn/s" if signal == "velocity" else "turn"
    used |= {k for k, (one, two) in enumerate(pairwise(low)) if one == "joint" and two in ("state", "states")}
    if part:
        gain = next((word for word in (*STIFFNESS, *DAMPING) if word in part), "")
        used |= {k for k, word in enumerate(low) if word == gain}
        signal = f"{gain or signal or 'value'} of a controller or model"
    elif commanded and not measured:
        known = {
            "position": "goal",
            "velocity": "goal_velocity",
            "torque": "torque_command",
            "time": "time",
            "enabled": "enabled",
        }
        signal = known.get(signal, f"commanded {signal}" if signal else "")
    elif signal == "position" and {"link", "output"} & sides and {"motor", "link"} & sides:
        signal = "link_position" if "motor" not in sides else "position"
    if field and signal in ("current", "commanded current", "voltage", "commanded voltage"):
        signal = signal if (field, signal) == ("q", "current") else f"{signal} of a motor's {field} axis"
    if (
        (TOOL & sides or TRANSFORM.search(name))
        and not OF_JOINTS & set(low)
        and (signal in MOVING or not (signal or unit))
    ):
        signal = f"{(signal or 'pose').replace('_', ' ')} of the tool, no joint"
    joint = _joined([word for k, word in enumerate(words) if k not in used])
    return Said(signal, unit, joint, bool(sides & FILTERED), how)


def _is_time(words: list[str], k: int) -> bool:
    """Whether a ``t`` is the time: no frame's transform, as in the ``O_T_EE`` of libfranka."""
    letters = [place for place, word in enumerate(words) if not word.isdigit()]
    return k == letters[-1] or (k == letters[0] and words[k] == "t")


def _field(words: list[str], unit: str) -> int | None:
    """Place of the axis of a motor's field, ``q axis`` or ``d axis``, that a current or voltage is of."""
    own = {word for signal, spoken in SIGNALS if signal in ("current", "voltage") for word in spoken}
    if not (own & set(words) or measures(unit, "current", "voltage")):
        return None
    pairs = (k for k, pair in enumerate(pairwise(words)) if pair in (("q", "axis"), ("d", "axis")))
    return next((k for k in pairs if not "".join(words[k + 2 : k + 3]).isdigit()), None)  # q_axis1: the angle of axis 1


def _wanted(words: list[str]) -> int | None:
    """Place of a ``d`` for desired: the last word, behind a sign and maybe a ``J``, an index at either side of it."""
    letters = [k for k, word in enumerate(words) if not word.isdigit()]
    signs = [k for k in letters[:-1] if words[k] != "J"][-1:]
    found = bool(signs) and words[letters[-1]] == "d" and words[signs[0]].lower() in SIGNS
    return letters[-1] if found else None


def _only(unit: str) -> str:
    """The signal that a unit says on its own; turns and ways are too common to."""
    measured = measure(unit) if unit != "turn" else None
    by_word = {"tick": "position", "degC": "temperature", "erpm": "velocity"}
    return ONLY_UNIT.get(measured.quantity, "") if measured else by_word.get(unit, "")


def _bracketed(name: str) -> tuple[str, str]:
    """A unit in brackets or with its number, understood or not, and the name without it."""
    brackets = list(re.finditer(r"[\[(]([^\])]*)[\])]", name))
    found = [(unit_of(match[1]), match) for match in brackets]
    numbered = [one for one in NUMBERED.finditer(name) if not any(b.start() < one.start() < b.end() for b in brackets)]
    found += [
        (match[0] if RATING.fullmatch(match[0]) else unit_of(match[0].replace("_", "")), match) for match in numbered
    ]
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
    """Unit that words say, and which: the last of them, behind another word."""
    spoken = {signal for signal, own in SIGNALS if own & set(words)}
    spoken |= {"voltage"} if SUPPLY & set(words) else set()
    for k in range(len(words) - 1, 0, -1):
        last = all(other.isdigit() for other in words[k + 1 :])
        if found := _of_several(words, k, last, spoken):
            return found
        found = _of_one(words[k], last, spoken)
        numbered = words[k].isalpha() and len(words[k]) == 1 and k + 1 < len(words)  # m1 is the first motor
        of_motor = measures(found, "way") and ANGLE_WORDS & set(words)  # as theta_m
        if found and words[k + 1 : k + 2] == ["per"]:  # and not per second: of that it is not known what it is
            return " ".join(words[k:]), slice(k, len(words))
        if found and not (numbered or of_motor):
            return found, slice(k, k + 1)
    if len(words) == 1 and words[0] in CLOCK_WORDS:
        return unit_of(words[0]), slice(0, 0)
    return "", slice(0, 0)


def _of_several(words: list[str], k: int, last: bool, spoken: set[str]) -> tuple[str, slice] | None:
    """A unit of two or three words that end at one: ``rad s``, ``deg per sec``, ``kg cm``."""
    start = k - 2 if words[k - 1] == "per" else k - 1
    if start < 1:
        return None
    if words[k] in ("s", "sec") or (words[k] == "min" and "velocity" in spoken):  # min is the least, too
        unit = unit_of(f"{words[start]}/{words[k]}")
    elif words[k - 1] == "°" and words[k] in ("c", "f"):
        unit = unit_of("".join(words[start : k + 1]))
    else:
        unit = unit_of(" ".join(words[start : k + 1])) if last else ""
        unit = unit if measures(unit, "torque") else ""
    return (unit, slice(start, k + 1)) if unit else None


def _of_one(word: str, last: bool, spoken: set[str]) -> str:
    """The unit that one word is; at the end of a name also one that is not understood, as it stands."""
    if word in UNITS and (last or len(word) > 1):
        return UNITS[word]
    if word == "°":
        return "deg"
    if word in SPELT or len(word) < 2:
        return ""
    if unit := unit_of(word):
        if len(word) > 2 and not measures(unit, "torque"):
            return unit
        measured = measure(unit)
        quantity = measured.quantity if measured else ""
        meant = quantity not in ("current", "voltage", "force") or quantity.replace("force", "torque") in spoken
        return unit if word in ANYWHERE or (last and meant) else ""
    return word if last and like_a_unit(word) else ""


def _joined(words: list[str]) -> str:
    """Words of a joint's name; a number goes with the word before it, or with ``joint``."""
    out = ""
    for word in words:
        if word.isdigit():
            out = (out or "joint") + word
        else:
            out += ("_" if out else "") + word
    return out
