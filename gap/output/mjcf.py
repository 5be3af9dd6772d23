"""A bench with an extended chain as MJCF that plain MuJoCo simulates by itself, without sealegs.

Motor, gains, limits and delay become MuJoCo's own ``dcmotor`` actuator, whose control is the position goal [rad]; what
the mounted chain has as parts of the model (armature, friction, spring, play) stays. A ``dcmotor`` commands a torque
``kp e - kd w`` at constant ``K`` and resistance ``R``, drives it with the voltage ``(R/K) torque + K w`` and clamps
that at ``Vmax``; a servo whose duty is ``gain e - damping w`` on a supply of ``V`` volts is the same with
``kp = K/R V gain``, ``kd = K/R V damping + K^2/R`` and ``Vmax = duty limit V``. The actuator's delay and rate limit act
in whole time steps: a command may be late by one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from xml.etree import ElementTree

from ...actuators import Chain
from ...actuators.mounting import coupling_element
from ...actuators.stages.controller import UNLIMITED
from ..replay.engine import bench
from ..replay.joint_model import JointModel

MODEL = {
    "friction": ("coulomb", "viscous"),
    "dc_motor": ("armature",),
    "regression": ("armature",),
    "ideal": ("armature",),
    "torque_command": ("armature",),
    "net": ("armature",),
    "gear": ("ratio",),
    "spring": ("stiffness", "damping"),
    "compliance": ("stiffness", "damping"),
    "backlash": ("width",),
}
"""Parameters that become parts of the model, whatever drives it."""
ACTUATOR = {
    "delay": ("seconds",),
    "rate_limit": ("speed",),
    "position_p": ("gain",),
    "position_pd": ("gain", "damping"),
    "position_pi": ("gain", "damping", "integral", "integral_limit"),
    "duty_limit": ("limit",),
    "supply": ("volts",),
    "current_limit": ("limit",),
    "dc_motor": ("motor_constant", "resistance"),
    "torque_limit": ("limit",),
    "ideal": ("stiffness", "damping", "torque_limit", "strength"),
}
"""Parameters that MuJoCo's own actuators have."""
POSITION_ACTUATOR = ("delay", "ideal", "torque_limit")
"""Stages of them that act with an ideal servo, whose actuator is simpler."""
TORQUE_ACTUATOR = {"delay": ("seconds",), "scale": ("factor",), "offset": ("value",), "torque_limit": ("limit",)}
"""Parameters of stages between a torque that is commanded and the joint that MuJoCo's own actuator has."""
SHAPES = {
    "friction.stribeck_velocity",
    "friction.stribeck_exponent",
    "friction.ripple_count",
    "friction.ripple_phase",
}
"""Friction parameters that say where another one acts and are nothing alone."""


def drives_natively(chain: Chain) -> bool:
    """Whether MuJoCo has an actuator for the chain: a position controller with a DC motor, or an ideal servo."""
    controller = any(chain.find(name) for name in ("position_p", "position_pd", "position_pi"))
    return (controller and None not in (chain.find("dc_motor"), chain.find("supply"))) or (
        chain.find("ideal") is not None
    )


def not_native(chain: Chain) -> list[str]:
    """Parameters of a chain, as ``stage.parameter``, that :func:`native_mjcf` leaves out."""
    driven, found = drives_natively(chain), []
    position = chain.find("ideal") is not None
    by_torque = chain.find("torque_command") is not None
    for stage in chain.stages:
        native = driven and (stage.name in POSITION_ACTUATOR or not position)
        known = MODEL.get(stage.name, ()) + (ACTUATOR.get(stage.name, ()) if native else ())
        known += TORQUE_ACTUATOR.get(stage.name, ()) if by_torque else ()
        neutral = {item.name: item.metadata.get("neutral") for item in dataclasses.fields(stage)}
        for key, value in stage.parameters().items():
            path = f"{stage.name}.{key}"
            if value == (neutral[key] or 0.0) or key in known or path in SHAPES:
                continue
            if stage.name == "thermal" and key != "loss":
                continue
            if stage.name == "backlash" and key != "width" and coupling_element(chain) is None:
                continue
            found.append(path)
    return found


def native_mjcf(joint: JointModel, params: Mapping[str, float]) -> str:
    """The bench with the joint's chain as MJCF text; its one control is the position goal [rad].

    Where MuJoCo has no actuator for the chain, the joint moves freely and has no control.
    """
    drivetrain = bench(joint, params)
    return native_text(drivetrain.spec.to_xml(), drivetrain.chains)


def native_text(xml: str, chains: Mapping[str, Chain]) -> str:
    """A model with chains on it, by the name of what each drives, as MJCF text that plain MuJoCo simulates."""
    root = ElementTree.fromstring(xml)
    size = root.find("size")
    if size is not None:
        root.remove(size)  # memory of the law
    actuators = root.find("actuator")
    assert actuators is not None
    for defaults in root.iter("default"):  # of the file's own actuators: those written here would take their limits
        for general in defaults.findall("general"):
            defaults.remove(general)
    option = root.find("option")
    timestep = float("0.002" if option is None else option.get("timestep", "0.002"))
    for law in list(actuators):
        actuators.remove(law)
        chain = chains[law.attrib["name"]]
        if drives_natively(chain):
            actuators.append(_actuator(chain, law, timestep))
        elif chain.find("torque_command") is not None:
            actuators.append(_torque_actuator(chain, law, timestep))
    if len(actuators) == 0:
        root.remove(actuators)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _common(chain: Chain, law: ElementTree.Element, timestep: float) -> dict[str, str]:
    """What an actuator drives, and how late its command comes."""
    attributes = {key: law.attrib[key] for key in ("name", "joint", "tendon") if key in law.attrib}
    delay = chain.find("delay")
    if delay is not None and delay.seconds > 0.0:
        # a hair less: a command that is due exactly now counts, whatever the rounding of its time
        attributes["delay"] = _text(delay.seconds - min(1e-6, 0.5 * delay.seconds))
        attributes["nsample"] = str(math.ceil(delay.seconds / timestep) + 2)
    return attributes


def _torque_actuator(chain: Chain, law: ElementTree.Element, timestep: float) -> ElementTree.Element:
    """A motor whose control is a torque, with the factor, the bias and the limit of its amplifier."""
    attributes, factor, bias, limit = _common(chain, law, timestep), 1.0, 0.0, math.inf
    for stage in chain.stages:
        if stage.name == "scale":
            factor, bias, limit = (value * stage.parameters()["factor"] for value in (factor, bias, limit))
        elif stage.name == "offset":
            bias += stage.parameters()["value"]
        elif stage.name == "torque_limit":
            limit = min(abs(limit), stage.law_values(chain)["limit"])
    if math.isfinite(limit):
        attributes["forcerange"] = f"{-abs(limit):.9g} {abs(limit):.9g}"
    if (factor, bias) == (1.0, 0.0):
        return ElementTree.Element("motor", attributes)
    return ElementTree.Element(
        "general", {**attributes, "gainprm": _text(factor), "biastype": "affine", "biasprm": f"{_text(bias)} 0 0"}
    )


def _actuator(chain: Chain, law: ElementTree.Element, timestep: float) -> ElementTree.Element:
    attributes = _common(chain, law, timestep)
    torques = [
        stage.law_values(chain)["limit"] for stage in chain.stages if stage.name == "torque_limit"
    ]  # at the joint
    if (ideal := chain.find("ideal")) is not None:
        torques.append(ideal.strength * ideal.torque_limit)
        attributes |= {"kp": _text(ideal.strength * ideal.stiffness), "kv": _text(ideal.strength * ideal.damping)}
        if min(torques) < ideal.strength * UNLIMITED:
            attributes["forcerange"] = f"{-min(torques):.9g} {min(torques):.9g}"
        return ElementTree.Element("position", attributes)
    constant = chain.gear_ratio() * chain.find("dc_motor").motor_constant * chain.magnetisation()
    resistance, volts = chain.find("dc_motor").resistance, chain.find("supply").volts
    stage = next(s for s in chain.stages if s.name in ("position_p", "position_pd", "position_pi"))
    per_duty = constant / resistance * volts  # torque of full duty at rest [N.m]
    gains = stage.parameters()
    integral, limit = gains.get("integral", 0.0), gains.get("integral_limit", 1.0)
    speed = chain.find("rate_limit")
    duty = chain.find("duty_limit")
    controller = (
        per_duty * gains["gain"],
        per_duty * integral,
        per_duty * gains.get("damping", 0.0) + constant**2 / resistance,
        speed.speed if speed is not None else 0.0,
        limit / integral if integral > 0.0 else 0.0,
        volts * (duty.limit if duty is not None else 1.0),
    )
    current = chain.find("current_limit")
    if current is not None:
        torques.append(constant * current.limit)
    if torques:
        attributes["saturation"] = f"{min(torques):.9g} 0 0"
    return ElementTree.Element(
        "dcmotor",
        {
            **attributes,
            "input": "pos",
            "motorconst": f"{constant:.9g} {constant:.9g}",
            "resistance": _text(resistance),
            "controller": " ".join(_text(value) for value in controller),
        },
    )


def _text(value: float) -> str:
    return f"{value:.9g}"
