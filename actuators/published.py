"""Chains from fits that others published: the parameter files of BAM (github.com/Rhoban/bam), models M1 to M6.

Their friction budgets are those of Duclusaud et al., ICRA 2025. The budget is the largest friction torque, viscous part
included; here the viscous part is a torque and the rest a limit, which is the same wherever the joint moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.documents import DocumentError, read_json
from ..common.errors import nearest
from .stages import ChainError

PREFIX = "bam:"


@dataclass(frozen=True)
class VoltageDrive:
    """A firmware that turns the error of the position into a duty: what the file of a fit does not hold.

    Attributes:
        duty_per_kp: duty per rad and unit of the register P, an expression.
        kp: register P that the tool assumes [register].
        limit: largest duty.
        volts: supply [V].
        ticks: of the encoder, a turn.
    """

    duty_per_kp: str
    kp: float
    limit: float
    volts: float
    ticks: int = 4096

    @property
    def gain(self) -> float:
        """Duty per rad at the assumed P."""
        number, *divisors = self.duty_per_kp.replace("(2*pi)", "6.283185307179586").split("/")
        value = float(number)
        for divisor in divisors:
            value /= float(divisor)
        return self.kp * value

    def stages(self, fit: Mapping[str, Any], number: Callable[[str], float]) -> list[dict[str, Any]]:
        """From the goal to the torque of the motor."""
        ratio = number("error_gain_ratio") if "error_gain_ratio" in fit else 1.0
        motor = {"motor_constant": number("kt"), "resistance": number("R"), "armature": number("armature")}
        return [
            {"position_p": {"gain": self.gain * ratio}},
            {"duty_limit": {"limit": self.limit}},
            {"supply": {"volts": self.volts, "resistance": 0.0}},
            {"dc_motor": motor},
        ]

    def as_recorded(self, stages: Stages, said: Container[str]) -> dict[str, dict[str, Any]]:
        """What a recording says of a chain of this drive, as expressions of its numbers."""
        changed: dict[str, dict[str, Any]] = {"duty_limit": {"limit": self.limit}}
        if "kp" in said:
            ratio = _value(stages, "position_p", "gain") / self.gain
            times = "" if abs(ratio - 1.0) < ROUNDED else f"*{ratio:.6g}"
            changed["position_p"] = {"gain": f"${{kp*{self.duty_per_kp}{times}}}"}
        if "vin" in said:
            changed["supply"] = {"volts": "${vin}"}
        return changed


@dataclass(frozen=True)
class CurrentDrive:
    """A controller of the motor's current: kp (goal - position) - damping sqrt(kp) speed, within a limit.

    The voltage that bounds the torque at high speed is left out: not every fit has the winding's resistance.

    Attributes:
        kp: that the tool assumes [A/rad].
        damping: that the tool assumes [A^0.5.s/rad^0.5].
        amps: largest current [A].
        ticks: of the encoder, a turn.
    """

    kp: float
    damping: float
    amps: float
    ticks: int = 4096

    def stages(self, fit: Mapping[str, Any], number: Callable[[str], float]) -> list[dict[str, Any]]:
        """From the goal to the torque of the motor."""
        del fit
        constant = number("kt")
        servo = {
            "stiffness": constant * self.kp,
            "damping": constant * self.damping * math.sqrt(self.kp),
            "torque_limit": constant * self.amps,
            "armature": number("armature"),
        }
        return [{"ideal": servo}]

    def as_recorded(self, stages: Stages, said: Container[str]) -> dict[str, dict[str, Any]]:
        """What a recording says of a chain of this drive, as expressions of its numbers."""
        constant = f"{_value(stages, 'ideal', 'torque_limit') / self.amps:.6g}"
        servo: dict[str, str] = {}
        if "kp" in said:
            damping = "damping" if "damping" in said else f"{self.damping:g}"
            servo = {"stiffness": f"${{kp*{constant}}}", "damping": f"${{{damping}*sqrt(kp)*{constant}}}"}
        if "max_amps" in said:
            servo["torque_limit"] = f"${{max_amps*{constant}}}"
        return {"ideal": servo}


Stages = Sequence[Mapping[str, Any]]
Drive = VoltageDrive | CurrentDrive
ROUNDED = 0.005  # relative, by which shipped chains round the gain

DRIVES: dict[str, Drive] = {
    "mx64": VoltageDrive("0.158", 32.0, 0.9625, 15.0),
    "mx106": VoltageDrive("0.158", 32.0, 0.9625, 15.0),
    "xl320": VoltageDrive("0.05048199", 32.0, 1.0, 7.5, 1024),
    "sts3215": VoltageDrive("0.166", 32.0, 0.97, 7.4),
    "sts3250": VoltageDrive("0.166", 32.0, 0.97, 12.0),
    "waveshare_st3025": VoltageDrive("0.166", 32.0, 1.0, 12.0),
    "xl330": VoltageDrive("4096/(2*pi)/256/885", 400.0, 1.0, 7.4),
    "xc330m288t": VoltageDrive("0.00575504", 1100.0, 1.0, 5.1),
    "erob80_50": CurrentDrive(10.0, 1.0, 12.0, 2**19),
    "erob80_100": CurrentDrive(10.0, 2.0, 12.0, 2**19),
    "feetech_hls": CurrentDrive(3.0, 0.08, 0.36),
}
"""By the name that a file gives its actuator.

Source: the actuator and recorder classes of github.com/Rhoban/bam, gains of MX, XL-320 and STS3215 measured there with
an oscilloscope; STS3250: as the STS3215, at 12 V (assumed); XL330: the control table of its maker, duty = P
error_ticks / 256 / 885, which recordings follow to a count; ticks of eRob: 19 bits, of its maker.
"""

FRICTION = {
    "friction_base": "coulomb",
    "friction_viscous": "viscous",
    "friction_stribeck": "stribeck",
    "load_friction_base": "load",
    "load_friction_stribeck": "load_stribeck",
    "dtheta_stribeck": "stribeck_velocity",
    "alpha": "stribeck_exponent",
    "load_friction_motor": "load",
    "load_friction_motor_stribeck": "load_stribeck",
    "load_friction_motor_quad": "quadratic_motor",
    "load_friction_external_quad": "quadratic_external",
}
"""Parameters of their friction budgets that are one of ours."""
BEYOND = {
    "load_friction_external": ("load_external", "load_friction_motor"),
    "load_friction_external_stribeck": ("load_stribeck_external", "load_friction_motor_stribeck"),
}
"""Parameters that are ours beyond another one of theirs."""
MODELS = {
    "m1": (),
    "m2": ("friction_stribeck", "dtheta_stribeck", "alpha"),
    "m3": ("load_friction_base",),
    "m4": ("friction_stribeck", "dtheta_stribeck", "alpha", "load_friction_base", "load_friction_stribeck"),
    "m5": (
        "friction_stribeck",
        "dtheta_stribeck",
        "alpha",
        *BEYOND,
        "load_friction_motor",
        "load_friction_motor_stribeck",
    ),
}
MODELS["m6"] = (*MODELS["m5"], "load_friction_motor_quad", "load_friction_external_quad")
"""What each model has beside ``friction_base`` and ``friction_viscous``."""


def bam_file(source: Any) -> Path | None:
    """Path of the file that ``bam:<path>`` names; None for any other source."""
    return Path(source.removeprefix(PREFIX)) if isinstance(source, str) and source.startswith(PREFIX) else None


def bam_stages(path: Path) -> list[dict[str, Any]]:
    """The stages of a fit.

    Its ``q_offset`` is of the rig that it was fitted on, and is left out.

    Raises:
        ChainError: the file is not there or no such fit, or of an actuator whose drive is not known.
    """
    if path.suffix.lower() != ".json":
        raise ChainError(f"{path} is no fit of BAM: the name of one ends in .json.")
    try:
        fit = read_json(path, name=f"the fit {path}")
    except DocumentError as error:
        raise ChainError(f"{error}; a fit of BAM is JSON, with 'model' and 'actuator'.") from None
    if not isinstance(fit, Mapping) or str(fit.get("model")) not in MODELS:
        raise ChainError(f"{path} is no fit of BAM: its 'model' must be one of {', '.join(MODELS)}.")
    name = str(fit.get("actuator"))
    if name not in DRIVES:
        raise ChainError(
            f"{path} is of the actuator '{name}', whose drive is not known{nearest(name, DRIVES)}; there are "
            f"{', '.join(DRIVES)}. Write a chain with its friction instead."
        )
    drive, number = DRIVES[name], _numbers(fit, path)
    stages: list[dict[str, Any]] = []
    if "command_delay" in fit:
        stages.append({"delay": {"seconds": number("command_delay")}})
    if "max_velocity" in fit:
        stages.append({"rate_limit": {"speed": number("max_velocity")}})
    wanted = ("friction_base", "friction_viscous", *MODELS[str(fit["model"])])
    friction = {FRICTION[key]: number(key) for key in wanted if key in FRICTION}
    for key in wanted:
        if key in BEYOND:
            ours, other = BEYOND[key]
            friction[ours] = number(key) - number(other)
    return [*stages, *drive.stages(fit, number), {"friction": friction}, {"encoder": {"ticks": drive.ticks}}]


def drive_of(source: str) -> Drive | None:
    """The drive of a fit or of a shipped chain by their word; None where it is not known.

    Args:
        source: ``bam:<path>``, or a word such as ``sts3215`` or ``sts3215_m6``.
    """
    if (path := bam_file(source)) and path.suffix.lower() == ".json":
        try:
            return DRIVES.get(str(read_json(path).get("actuator")))
        except (DocumentError, AttributeError):  # reading the chain says it
            return None
    word, _, model = source.rpartition("_")
    return DRIVES.get(word if model in MODELS else source)


def as_recorded(drive: Drive, stages: Stages, said: Container[str]) -> list[dict[str, Any]]:
    """A chain whose gain, supply and limits are those of a recording, as expressions of its numbers.

    Args:
        drive: of the chain.
        stages: of the chain.
        said: names of the numbers that the recording has: kp, vin, damping, max_amps.
    """
    changed = drive.as_recorded(stages, said)
    return [{name: {**(values or {}), **changed.get(name, {})} for name, values in stage.items()} for stage in stages]


def _value(stages: Stages, name: str, parameter: str) -> float:
    return next(float(stage[name][parameter]) for stage in stages if name in stage)


def _numbers(fit: Mapping[str, Any], path: Path) -> Callable[[str], float]:
    def number(key: str) -> float:
        value = fit.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ChainError(f"{path}: '{key}' must be a number, not {value!r}; the fit is not complete.")
        return float(value)

    return number
