"""Hidden arms: what they are, what their nominal model file says, and what they log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .arm_effects import EFFECTS, FURTHER, STRANGERS, end_of
from .arm_physics import Links, Servos, simulate
from .excitation import SEGMENT, trajectory
from .recording import Recording

SAMPLE_PERIOD = 0.005
JITTER = 3e-4
ENCODER_NOISE = 3.9e-4
TICK = 2 * np.pi / 4096
CURRENT_STEP = 0.0065
GRAVITY = 9.81

UPRIGHT = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Body:
    """One link as its maker has it: where its joint lies in the link before, and its mass.

    Attributes:
        joint: name of the joint that carries it.
        place: of the joint [m].
        quaternion: of the link at zero, (w, x, y, z).
        mass: [kg].
        centre: of it [m].
        inertia: xx, yy, zz, xy, xz, yz about it, in the link's frame [kg.m2].
    """

    joint: str
    place: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


SWING = math.sqrt(0.5)
TWO_LINK = (
    Body("shoulder", (0.0, 0.0, 0.5), (SWING, SWING, 0.0, 0.0), 0.25, (0.0, -0.108, 0.0), (7e-4, 1e-5, 7e-4, 0, 0, 0)),
    Body("elbow", (0.0, -0.18, 0.0), (1.0, 0.0, 0.0, 0.0), 0.18, (0.0, -0.09, 0.0), (3.4e-4, 1e-5, 3.4e-4, 0, 0, 0)),
)
"""A two-link arm that hangs; numbers assumed."""

SIX_JOINT = (
    Body(
        "shoulder_pan", (0.0388, 0.0, 0.0624), (0.0, 0.0, -1.0, 0.0), 0.1,
        (-0.0308, 0.0, -0.0253), (8.4e-05, 8.1e-05, 2.4e-05, 0, -1.2e-06, 0),
    ),
    Body(
        "shoulder_lift", (-0.0304, -0.0183, -0.0542), (0.5, -0.5, -0.5, -0.5), 0.103,
        (-0.0898, -0.0084, 0.0184), (4.1e-05, 0.000147, 0.000142, -2e-05, 0, 0),
    ),
    Body(
        "elbow_flex", (-0.1126, -0.028, 0.0), (SWING, 0.0, 0.0, SWING), 0.104,
        (-0.0981, 0.0032, 0.0183), (2.9e-05, 0.00016, 0.000145, 7.4e-06, 1.3e-06, 0),
    ),
    Body(
        "wrist_flex", (-0.1349, 0.0052, 0.0), (SWING, 0.0, 0.0, -SWING), 0.079,
        (-0.0001, -0.0386, 0.0281), (3.7e-05, 2.5e-05, 2.1e-05, 0, 0, 3.6e-06),
    ),
    Body(
        "wrist_roll", (0.0, -0.0611, 0.0181), (0.0172, -0.0172, 0.7069, 0.7069), 0.087,
        (0.0002, 0.0002, -0.0252), (2.8e-05, 4.3e-05, 3.5e-05, 0, -5.7e-06, 0),
    ),
    Body(
        "gripper", (0.0202, 0.0188, -0.0234), (SWING, SWING, 0.0, 0.0), 0.012,
        (-0.0016, -0.03, 0.0193), (6.6e-06, 1.9e-06, 5.3e-06, 0, 0, 0),
    ),
)  # fmt: skip
"""Rounded from the MJCF of the SO-101 arm (TheRobotStudio/SO-ARM100 at fda892cba810, Apache-2.0)."""

ARMS = {"two_link": TWO_LINK, "six_joint": SIX_JOINT}

LEG = (
    Body("joint_1", (0.0, 0.0, 0.45), (1.0, 0.0, 0.0, 0.0), 1.22, (0.048, 0.0, -0.05), (6e-3, 6e-3, 2e-3, 0, 0, 0)),
    Body("joint_2", (0.06, 0.0, 0.0), (SWING, SWING, 0.0, 0.0), 1.26, (0.129, 0.0, 0.0), (1e-3, 7e-3, 7e-3, 0, 0, 0)),
    Body("joint_3", (0.2384, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.63, (0.154, 0.0, 0.0), (4e-4, 6e-3, 6e-3, 0, 0, 0)),
)
"""A leg of SILO4's masses and lengths (paper 000, table I); inertias of rods, assumed."""

FLAT = (
    Body("joint_1", (0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), 2.0, (0.25, 0.0, 0.0), (2e-3, 5e-2, 5e-2, 0, 0, 0)),
    Body("joint_2", (0.5, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.6, (0.15, 0.0, 0.0), (5e-4, 6e-3, 6e-3, 0, 0, 0)),
)
"""An arm that moves level, so that gravity does nothing; numbers assumed."""

GRIPPER = (
    *TWO_LINK,
    Body("jaw", (0.0, -0.18, 0.0), (1.0, 0.0, 0.0, 0.0), 0.01, (0.0, -0.02, 0.0), (1e-6, 1e-7, 1e-6, 0, 0, 0)),
)
"""The two-link arm with a light jaw; numbers assumed."""
SWINGING = (
    *TWO_LINK,
    Body("swing", (0.0, -0.18, 0.0), (1.0, 0.0, 0.0, 0.0), 0.06, (0.0, -0.05, 0.0), (2e-5, 1e-6, 2e-5, 0, 0, 0)),
)
"""The two-link arm with a pendulum on a bearing at its end; numbers assumed."""
BEARING = {"motor_constant": 0.0, "armature": 1e-6, "coulomb": 0.0, "viscous": 5e-4}
"""Of a joint that nothing drives; assumed."""

MACHINES = {**ARMS, "leg": LEG, "flat": FLAT, "gripper": GRIPPER, "swinging": SWINGING}

SERVO = {
    "gain": 5.3,
    "duty_limit": 0.97,
    "volts": 7.4,
    "motor_constant": 1.2,
    "resistance": 2.7,
    "armature": 0.026,
    "coulomb": 0.052,
    "viscous": 0.059,
}
"""Of every joint, like an STS3215; assumed."""
SERVOS: dict[str, dict[str, float]] = {
    "leg": {
        "gain": 2.0, "duty_limit": 1.0, "volts": 24.0, "motor_constant": 11.8, "resistance": 5.5, "armature": 0.4,
        "coulomb": 2.0, "viscous": 10.5,
    },
    "flat": SERVO | {"gain": 12.0, "motor_constant": 2.4},
}  # fmt: skip
"""Of machines whose servos are others: the leg's are motor 3 of paper 000 behind 287:1, under a softer loop."""
DELAY = 0.005
DRIVEN_COULOMB, DRIVEN_VISCOUS = 0.05, 0.02  # of an arm that is driven by torque, without a gear; assumed
KINDS = ("chirp", "steps", "triangle", "multisine")
UNCERTAIN = ("motor_constant", "resistance", "armature", "coulomb", "viscous")


def rotation(quaternion: tuple[float, float, float, float]) -> np.ndarray:
    """The matrix (3, 3) of a quaternion (w, x, y, z), which need not have length one."""
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def links_of(bodies: tuple[Body, ...], masses: np.ndarray) -> Links:
    """The links as the physics takes them, with these masses (n,) and inertias in proportion."""
    inertia = np.zeros((len(bodies), 3, 3))
    for k, body in enumerate(bodies):
        xx, yy, zz, xy, xz, yz = body.inertia
        inertia[k] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * masses[k] / body.mass
    return Links(
        np.array([rotation(body.quaternion) for body in bodies]),
        np.array([body.place for body in bodies]),
        masses,
        np.array([body.centre for body in bodies], float),
        inertia,
        np.array([0.0, 0.0, -GRAVITY]),
        end_of(np.array(bodies[-1].centre)),
        -math.inf,
    )


def servos_of(count: int, by_torque: bool = False, servo: Mapping[str, float] = SERVO) -> Servos:
    """Nominal servos of so many joints."""

    def each(value: float) -> np.ndarray:
        return np.full(count, value)

    servos = Servos(
        **{name: each(value) for name, value in servo.items()},
        load=each(0.0),
        drift=each(0.0),
        cable=each(0.0),
        ripple=each(0.0),
        ripple_count=each(0.0),
        ripple_phase=each(0.0),
        upper_stop=each(math.inf),
        encoder_scale=each(1.0),
        delay=DELAY,
        play=0.0,
        play_joint=-1,
        soft=0.0,
        by_torque=by_torque,
    )
    if by_torque:
        servos = servos._replace(
            motor_constant=each(1.0), armature=each(0.005), coulomb=each(DRIVEN_COULOMB), viscous=each(DRIVEN_VISCOUS)
        )
    return servos


def nominal_chain(by_torque: bool = False, servo: Mapping[str, float] = SERVO) -> list[dict[str, dict[str, float]]]:
    """The chain that the sidecar believes in."""
    if by_torque:
        return [
            {"delay": {"seconds": DELAY}},
            {"torque_command": {"armature": 0.005}},
            {"friction": {"coulomb": DRIVEN_COULOMB, "viscous": DRIVEN_VISCOUS}},
        ]
    motor = {key: servo[key] for key in ("motor_constant", "resistance", "armature")}
    return [
        {"delay": {"seconds": DELAY}},
        {"position_p": {"gain": servo["gain"]}},
        {"duty_limit": {"limit": servo["duty_limit"]}},
        {"supply": {"volts": servo["volts"], "resistance": 0.0}},
        {"dc_motor": motor},
        {"friction": {"coulomb": servo["coulomb"], "viscous": servo["viscous"]}},
        {"encoder": {"ticks": 4096}},
    ]


def mjcf(bodies: tuple[Body, ...], *, passive: str = "", actuators: bool = False) -> str:
    """The model file that the arm's maker publishes: bodies and joints, without friction or armature.

    Args:
        bodies: of the arm.
        passive: further attributes of every joint, such as ``damping="0.5"``.
        actuators: whether it has position actuators of its own.
    """
    lines, ends = [], ""
    for body in bodies:
        text = {
            key: " ".join(f"{x:.9g}" for x in getattr(body, key))
            for key in ("place", "quaternion", "centre", "inertia")
        }
        lines += [
            f'<body name="{body.joint}_link" pos="{text["place"]}" quat="{text["quaternion"]}">',
            f'<joint name="{body.joint}" type="hinge" axis="0 0 1" {passive}/>',
            f'<inertial pos="{text["centre"]}" mass="{body.mass:.9g}" fullinertia="{text["inertia"]}"/>',
        ]
        ends += "</body>"
    point = " ".join(f"{x:.9g}" for x in end_of(np.array(bodies[-1].centre)))
    lines.append(f'<site name="end" pos="{point}"/>')
    driven = "".join(f'<position joint="{body.joint}" kp="17"/>' for body in bodies) if actuators else ""
    return (
        '<mujoco model="arm"><compiler angle="radian"/><worldbody>' + "".join(lines) + ends
        + f"</worldbody><actuator>{driven}</actuator></mujoco>"
    )  # fmt: skip


def record_arm(
    folder: Path,
    arm: str = "two_link",
    effects: Mapping[str, tuple[str, str | float]] | None = None,
    seed: int = 0,
    *,
    runs: int = 3,
    duration: float = 24.0,
    nominal_error: float = 0.05,
    by_torque: bool = False,
    faults: Mapping[str, str] | None = None,
    passive: tuple[str, ...] = (),
    kinds: tuple[str, ...] = KINDS,
    goals: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None,
) -> tuple[list[Recording], dict[str, Any]]:
    """Record runs of an arm that hides effects, and write the model file that is believed of it.

    Args:
        folder: where ``arm.xml`` goes.
        arm: one of :data:`MACHINES`.
        effects: by name, the joint that has it and ``clear``, ``moderate`` or a value.
        seed: of everything random.
        runs, duration: how many, and how long [s].
        nominal_error: largest relative error of nominal numbers and masses.
        by_torque: whether the joints are commanded by torques.
        faults: of columns: ``degrees`` or ``reversed`` by joint.
        passive: joints that nothing drives; only their position is logged.
        kinds: of excitation of each joint, in an order of its own.
        goals: in place of these: of times (k,) and a source of chance the goals (k, n) of all joints [rad].

    Returns:
        The recordings, and the truth.
    """
    bodies, servo = MACHINES[arm], SERVOS.get(arm, SERVO)
    rng = np.random.default_rng([seed, 11])
    names = [body.joint for body in bodies]
    masses = np.array([body.mass for body in bodies]) * (1.0 + nominal_error * rng.uniform(-1, 1, len(bodies)))
    links, servos = links_of(bodies, masses), servos_of(len(bodies), by_torque, servo)
    for name in UNCERTAIN:
        values = getattr(servos, name) * (1.0 + nominal_error * rng.uniform(-1, 1, len(bodies)))
        servos = servos._replace(**{name: values})
    servos = servos._replace(delay=DELAY * (1.0 + nominal_error * rng.uniform(-1, 1)))
    for name in passive:
        for key, value in BEARING.items():
            getattr(servos, key)[names.index(name)] = value
    truth: dict[str, Any] = {"seed": seed, "effects": {}, "masses": masses}
    for name, (joint, size) in (effects or {}).items():
        hidden = (EFFECTS | FURTHER | STRANGERS)[name]
        value = hidden.sizes[("clear", "moderate").index(size)] if isinstance(size, str) else size
        links, servos = hidden.apply(links, servos, names.index(joint), value)
        truth["effects"][name] = {
            "cause": hidden.cause,
            "joint": joint,
            "value": value,
            "number": hidden.true_number(servos, names.index(joint), value),
            "everywhere": hidden.everywhere,
        }
    truth["links"], truth["servos"] = links, servos
    (folder / "arm.xml").write_text(mjcf(bodies), encoding="utf-8")
    chain = nominal_chain(by_torque, servo)
    recorded = [
        Recording(
            f"run{k}",
            *_run(
                links, servos, names, duration, np.random.default_rng([seed, 12, k]), k, dict(faults or {}), passive,
                kinds, goals,
            ),
            {}, str(folder / "arm.xml"), {}, {name: chain for name in names if name not in passive},
        )
        for k in range(runs)
    ]  # fmt: skip
    return recorded, truth


def goals_of(
    count: int,
    time: np.ndarray,
    rng: np.random.Generator,
    run: int,
    by_torque: bool = False,
    kinds: tuple[str, ...] = KINDS,
) -> np.ndarray:
    """Goals (k, n) [rad] of all joints, each with an order of excitations of its own; or torques [N.m]."""
    goal = np.empty((len(time), count))
    for joint in range(count):
        if by_torque:
            f = rng.uniform(0.2, 1.3, 5)
            phase = rng.uniform(0, 2 * np.pi, 5)
            size = 0.15 / (1.0 + 2.0 * joint)
            goal[:, joint] = size * np.sin(2 * np.pi * f * time[:, None] + phase).sum(axis=1) * np.minimum(time, 1.0)
            continue
        order = np.roll(kinds, joint + run)
        names = tuple(str(name) for name in order)
        goal[:, joint] = 0.8 * trajectory(names, np.minimum(time, SEGMENT * len(names)), rng)
    return goal


def _run(
    links: Links,
    servos: Servos,
    names: list[str],
    duration: float,
    rng: np.random.Generator,
    run: int,
    faults: dict[str, str],
    passive: tuple[str, ...],
    kinds: tuple[str, ...],
    goals: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None,
) -> tuple[np.ndarray, dict[str, dict[str, np.ndarray]]]:
    count = int(duration / SAMPLE_PERIOD)
    jitter = np.clip(rng.normal(0.0, JITTER, count), -0.3 * SAMPLE_PERIOD, 0.3 * SAMPLE_PERIOD)
    time = SAMPLE_PERIOD * (1.0 + np.arange(count)) + jitter
    goal = goals_of(len(names), time, rng, run, servos.by_torque, kinds) if goals is None else goals(time, rng)
    at, angle, speed, duty, current, _ = simulate(links, servos, time, goal, float(time[-1]) + 2e-3)
    held = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 1)
    joints = {}
    for j, name in enumerate(names):
        scale = servos.encoder_scale[j]
        clean = scale * np.interp(time, at, angle[:, j])
        position = TICK * np.round((clean + rng.normal(0.0, ENCODER_NOISE, count)) / TICK)
        sent = goal[:, j]
        if faults.get(name) == "degrees":
            position, sent = np.degrees(position), sent
        elif faults.get(name) == "reversed":
            position = -position
        velocity = scale * np.interp(time, at, speed[:, j]) + rng.normal(0.0, 0.02, count)
        signals = {"torque_command" if servos.by_torque else "goal": sent, "position": position, "velocity": velocity}
        if not servos.by_torque:
            signals["duty"] = np.round(duty[held, j], 3)
            amperes = current[held, j] + rng.normal(0.0, CURRENT_STEP, count)
            signals["current"] = CURRENT_STEP * np.round(amperes / CURRENT_STEP)
        joints[name] = {"position": position} if name in passive else signals
    return time, joints
