"""What the name of a column says: the signal, commanded or measured, its unit, its joint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from itertools import pairwise

COMMANDED = frozenset(
    [
        "goal",
        "target",
        "desired",
        "des",
        "ref",
        "reference",
        "setpoint",
        "sp",
        "cmd",
        "command",
        "commanded",
        "con",
        "set",
        "action",
        "demand",
        "requested",
        "wanted",
        "soll",
        "sollwert",
        "sollwinkel",
        "sollposition",
        "commands",
        "goals",
        "targets",
        "setpoints",
        "references",
        "consigne",
        "consigna",
        "referencia",
    ]
)
MEASURED = frozenset(
    [
        "meas",
        "measured",
        "act",
        "actual",
        "present",
        "fb",
        "feedback",
        "ist",
        "istwert",
        "istwinkel",
        "istposition",
        "real",
        "observation",
        "state",
        "states",
        "sensor",
        "read",
        "est",
        "estimate",
        "estimated",
        "mesure",
        "medida",
        "misura",
    ]
)
WEAK = frozenset(["state", "states", "sensor", "observation"])
"""Measured, where nothing else of the name says that it was commanded."""
ALONE = frozenset(
    ["actual", "act", "measured", "meas", "feedback", "fb", "ist", "istwert", "mesure", "medida", "misura"]
)
"""A position, where they are the whole name."""
FILTERED = frozenset(["filt", "filtered", "smooth", "smoothed", "lp", "lowpass"])
DROPPED = frozenset(
    [
        "error",
        "err",
        "fric",
        "friction",
        "ff",
        "feedforward",
        "integral",
        "kp",
        "ki",
        "kd",
        "gain",
        "stiffness",
        "damping",
    ]
)
"""Parts of a controller or of a model: no signal of the log, whatever else the name says."""
FILLERS = frozenset(
    [
        "observation",
        "data",
        "robot",
        "value",
        "values",
        "msg",
        "the",
        "of",
        "in",
        "per",
        "and",
        "input",
        "supply",
        "bus",
        "battery",
        "field",
        "header",
        "controller",
        "control",
    ]
)
SIGNALS: tuple[tuple[str, frozenset[str]], ...] = (
    ("enabled", frozenset(["enable", "enabled"])),
    ("acceleration", frozenset(["acc", "accel", "acceleration", "ddq", "qdd", "qddot", "ddtheta", "jerk"])),
    ("velocity", frozenset(["vel", "velocity", "speed", "dq", "qdot", "qvel", "dtheta", "thetadot", "omega", "dpos",
                            "geschwindigkeit", "winkelgeschwindigkeit", "drehzahl", "velocities", "vitesse",
                            "velocidad", "velocita"])),
    ("temperature", frozenset(["temp", "temperature", "temperatur", "temper", "temperatura", "temperatures"])),
    ("voltage", frozenset(["volt", "volts", "voltage", "vin", "vbus", "ubat", "spannung"])),
    ("duty", frozenset(["duty", "pwm"])),
    ("torque", frozenset(["torque", "tau", "effort", "force", "trq", "moment", "drehmoment", "efforts", "torques",
                          "couple"])),
    ("position", frozenset(["pos", "position", "angle", "q", "theta", "phi", "qpos", "encoder", "enc", "positions",
                            "angles", "posicion", "posizione", "angulo", "angolo", "winkel", "sollwinkel",
                            "istwinkel", "sollposition", "istposition"])),
    ("current", frozenset(["current", "curr", "amps", "ampere", "iq", "strom", "currents", "courant", "corriente",
                           "corrente"])),
    ("load", frozenset(("load",))),
    ("time", frozenset(["time", "timestamp", "stamp", "t", "ts", "clock", "elapsed", "zeit", "temps", "tiempo",
                        "tempo"])),
)  # fmt: skip
"""Signals by the words that say them; the first one that a name has is its signal."""
SUPPLY = frozenset(["supply", "vsupply", "battery", "batt", "bat", "vbat", "vbatt", "vcc", "vdd", "psu", "versorgung"])
"""What a voltage is of; a name that says no other signal and no other unit means the voltage."""
UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "degs": "deg", "grad": "deg", "rad": "rad", "rads": "rad",
    "radian": "rad", "radians": "rad", "mrad": "mrad", "turn": "turn", "turns": "turn", "rev": "turn",
    "revs": "turn", "rpm": "rpm",
    "dps": "deg/s", "rps": "turn/s", "tick": "tick", "ticks": "tick", "count": "tick", "counts": "tick",
    "steps": "tick", "raw": "tick", "ms": "ms", "msec": "ms",
    "millis": "ms", "us": "us", "usec": "us", "micros": "us", "ns": "ns",
    "nsec": "ns", "nanosec": "ns", "s": "s", "sec": "s", "secs": "s", "seconds": "s", "nm": "N.m", "mnm": "mN.m",
    "n": "N", "newton": "N", "ma": "mA", "a": "A", "amps": "A",
    "amp": "A", "mv": "mV", "v": "V", "volts": "V", "percent": "%",
    "pct": "%", "mm": "mm", "cm": "cm", "m": "m", "meter": "m", "meters": "m", "degc": "degC", "celsius": "degC",
    "normalized": "%", "norm": "%", "grados": "deg", "degres": "deg", "gradi": "deg", "fahrenheit": "degF",
    "degf": "degF",
}  # fmt: skip
"""Units by the words that say them."""
CLOCK_WORDS = frozenset(["ms", "seconds", "sec", "secs", "us", "ns", "millis", "micros"])
"""Units that are the whole name of a clock."""
SPELT = {
    "rad/s": "rad/s", "rad/sec": "rad/s", "rads/s": "rad/s", "deg/s": "deg/s", "deg/sec": "deg/s", "°/s": "deg/s",
    "grad/s": "deg/s", "u/min": "rpm",
    "°": "deg", "°c": "degC", "n.m": "N.m", "n*m": "N.m", "nm": "N.m", "n m": "N.m", "mm/s": "mm/s", "m/s": "m/s",
    "rev/s": "turn/s", "rev/min": "rpm", "1/min": "rpm", "%": "%", "µs": "us", "n·m": "N.m", "c": "degC",
    "tr/min": "rpm", "g/min": "rpm", "degrés": "deg", "°f": "degF", "f": "degF",
}  # fmt: skip
"""Units as they stand in brackets."""
SHORT = re.compile(r"(q|theta|phi|x)(m|meas|a|act|g|r|ref|d|des|c|cmd|goal)")
"""Signs of control theory: ``qm`` measured, ``qg`` goal, ``qd`` desired (or the derivative: the data tell)."""
ONLY_UNIT = {
    "deg": "position", "rad": "position", "tick": "position", "rpm": "velocity", "N.m": "torque", "mA": "current",
    "A": "current", "V": "voltage", "mV": "voltage", "degC": "temperature",
}  # fmt: skip
ODRIVE = re.compile(r"(?:.*[._/])?(pos_estimate|input_pos|pos_setpoint|vel_estimate|input_vel|vel_setpoint)")
"""Names of ODrive, which counts turns."""
SINGLE = frozenset(["s", "a", "n", "m", "v", "c", "t", "q"])
"""Words of one letter: a unit only at the end of a name."""


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
    """

    signal: str
    unit: str
    joint: str
    filtered: bool = False
    how: str = ""


def said(name: str) -> Said:
    """Read a column's name."""
    unit, text = _bracketed(name)
    words = _words(text)
    low = [word.lower() for word in words]
    if not unit:
        unit, at = _unit(low)
        if at is not None:
            words, low = words[:at] + words[at + 1 :], low[:at] + low[at + 1 :]
            if unit in ("rad", "deg") and at < len(low) and low[at] in ("s", "sec"):
                unit += "/s"
                words, low = words[:at] + words[at + 1 :], low[:at] + low[at + 1 :]
    sides = set(low)
    commanded, measured = bool(sides & COMMANDED), bool(sides & (MEASURED - WEAK))
    measured |= not commanded and bool(sides & WEAK)
    used = {k for k, word in enumerate(low) if word in COMMANDED | MEASURED | FILTERED | FILLERS}
    signal, how = "", ""
    for candidate, spoken in SIGNALS:
        hits = [k for k, word in enumerate(low) if word in spoken]
        if hits:
            signal, how = candidate, words[hits[0]]
            used |= set(hits)
            break
    if signal == "position" and "current" in low and unit in ("A", "mA"):  # q_current (A)
        signal, used = "current", used | {low.index("current"), *(k for k, word in enumerate(low) if word == "q")}
    if signal in ("position", "velocity", "torque") and {"input", "control"} & set(low):
        commanded = True
    if signal in ("position", "velocity") and "current" in low:  # as against the one wanted
        measured, used = True, used | {low.index("current")}
    if signal == "enabled":
        used |= {k for k, word in enumerate(low) if word == "torque"}
    if not signal:
        for k, word in enumerate(low):
            if match := SHORT.fullmatch(word):
                signal, how = "position", words[k]
                used.add(k)
                commanded, measured = match[2] in ("g", "r", "ref", "d", "des", "c", "cmd", "goal"), match[2][0] in "ma"
                break
    if not signal and len(words) == 1 and low[0] in CLOCK_WORDS:
        signal, how = "time", words[0]
        used.add(0)
    if not signal and not commanded and unit in ("", "V", "mV") and (named := [w for w in low if w in SUPPLY]):
        signal, how = "voltage", named[0]
        used |= {k for k, word in enumerate(low) if word in SUPPLY}
    if not signal and unit in ONLY_UNIT:
        signal, how = ONLY_UNIT[unit], f"[{unit}]"
        if signal == "current" and low[-1:] == ["i"]:  # beside its unit, as in elbow_I_mA: of no joint
            used.add(len(low) - 1)
    if not signal and commanded:
        signal, how = "position", next(word for word in words if word.lower() in COMMANDED)
    if not signal and sides and sides <= ALONE:
        signal, how = "position", words[0]
    if signal == "temperature" and not unit and low[-1] == "f":
        unit, used = "degF", used | {len(low) - 1}
    if not unit and ODRIVE.fullmatch(name.lower()):
        unit = "turn/s" if signal == "velocity" else "turn"
    used |= {k for k, (one, two) in enumerate(pairwise(low)) if one == "joint" and two in ("state", "states")}
    if sides & DROPPED:
        signal = f"{signal or 'value'} of a controller or model"
    elif commanded and not measured:
        known = {"position": "goal", "torque": "torque_command", "time": "time", "enabled": "enabled"}
        signal = known.get(signal, f"commanded {signal}" if signal else "")
    elif signal == "position" and {"link", "output"} & sides and {"motor", "link"} & sides:
        signal = "link_position" if "motor" not in sides else "position"
    joint = _joined([word for k, word in enumerate(words) if k not in used])
    return Said(signal, unit, joint, bool(sides & FILTERED), how)


def unit_of(text: str) -> str:
    """Unit that a text is, in brackets or without; empty where it is none."""
    text = text.strip().strip("[]()").strip().lower()
    return SPELT.get(text) or UNITS.get(text, "")


def _bracketed(name: str) -> tuple[str, str]:
    """A unit in brackets or after a slash, and the name without it."""
    for match in re.finditer(r"[\[(]([^\])]*)[\])]", name):
        text = match[1].strip().lower()
        unit = SPELT.get(text) or UNITS.get(text, "")
        if unit:
            return unit, name[: match.start()] + name[match.end() :]
    return "", name


def _words(text: str) -> list[str]:
    """Words of a name: parted by signs, by digits, and where a capital follows a small letter."""
    text = re.sub(r"(?<![A-Za-z])(mA|mV|mNm|Nm|degC)(?![a-z])", lambda unit: unit[0].lower(), text)
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", text)
    plain = "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))
    return re.findall(r"[^\W\d_]+|°|\d+", plain)


def _unit(words: list[str]) -> tuple[str, int | None]:
    """Unit that a word says, and which: the last one; a single letter only at the end, behind another word."""
    for k in range(len(words) - 1, 0, -1):
        word = words[k]
        last = all(other.isdigit() for other in words[k + 1 :])
        if word in UNITS and (word not in SINGLE or last):
            if word == "s" and words[k - 1] in ("rad", "deg", "grad"):
                continue
            return UNITS[word], k
    if len(words) == 1 and words[0] in CLOCK_WORDS:
        return UNITS[words[0]], None
    return "", None


def _joined(words: list[str]) -> str:
    """Words of a joint's name; a number goes with the word before it, or with ``joint``."""
    out = ""
    for word in words:
        if word.isdigit():
            out = (out or "joint") + word
        else:
            out += ("_" if out else "") + word
    return out
