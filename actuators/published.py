"""Chains from fits that others published: the parameter files of BAM (github.com/Rhoban/bam), models M1 to M6.

Their friction budgets are those of Duclusaud et al., ICRA 2025. The budget is the largest friction torque, viscous part
included; here the viscous part is a torque and the rest a limit, which is the same wherever the joint moves.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import nearest
from .stages import ChainError

PREFIX = "bam:"


@dataclass(frozen=True)
class Drive:
    """The drive that a fit was made with: what its file does not hold.

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


DRIVES = {
    "mx64": Drive("0.158", 32.0, 0.9625, 15.0),
    "mx106": Drive("0.158", 32.0, 0.9625, 15.0),
    "xl320": Drive("0.05048199", 32.0, 1.0, 7.5, 1024),
    "sts3215": Drive("0.166", 32.0, 0.97, 7.4),
    "xl330": Drive("4096/(2*pi)/256/885", 400.0, 1.0, 7.4),
}
"""By the name that a file gives its actuator.

Source: the actuator classes of github.com/Rhoban/bam, gains measured there with an oscilloscope; XL330: the control
table of its maker, duty = P error_ticks / 256 / 885, which recordings follow to a count.
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
    try:
        fit = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ChainError(f"cannot read the fit {path}: {error.strerror}.") from None
    except ValueError:
        raise ChainError(f"{path} is not JSON; a fit of BAM is, with 'model' and 'actuator'.") from None
    if not isinstance(fit, Mapping) or fit.get("model") not in MODELS:
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
    ratio = number("error_gain_ratio") if "error_gain_ratio" in fit else 1.0
    motor = {"motor_constant": number("kt"), "resistance": number("R"), "armature": number("armature")}
    wanted = ("friction_base", "friction_viscous", *MODELS[str(fit["model"])])
    friction = {FRICTION[key]: number(key) for key in wanted if key in FRICTION}
    for key in wanted:
        if key in BEYOND:
            ours, other = BEYOND[key]
            friction[ours] = number(key) - number(other)
    return [
        *stages,
        {"position_p": {"gain": drive.gain * ratio}},
        {"duty_limit": {"limit": drive.limit}},
        {"supply": {"volts": drive.volts, "resistance": 0.0}},
        {"dc_motor": motor},
        {"friction": friction},
        {"encoder": {"ticks": drive.ticks}},
    ]


def _numbers(fit: Mapping[str, Any], path: Path) -> Any:
    def number(key: str) -> float:
        value = fit.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ChainError(f"{path}: '{key}' must be a number, not {value!r}; the fit is not complete.")
        return float(value)

    return number
