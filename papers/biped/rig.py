"""The experiments of paper 003, IV to VII, on a virtual MABEL: logs with the noise and quantisation of its encoders.

What the identification of :mod:`envs.biped.identification` is tried on; on a real machine these are the experiments to
do. The rig is the engine's model with the drives' true numbers, cables that stretch included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain, load_chain
from ...actuators.gravity import GRAVITY
from ...envs.biped.drive import ANGLE, DRIVES, ENCODER, RATIO, SHAPE, SPRING_RATIO, torque_chain
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate, foot
from .hopping import JOINT_TICKS, NAMES, Hopping, quantised
from .identification import Load, Record, chirp
from .legs_together import both_segments

SEED = 3
STEP = 0.001  # [s] between samples
SUBSTEPS = 4  # of the engine in a sample; convergence in docs/results/biped.md
NOISE = 0.3  # of an encoder step, rms, assumed
LOCKED = 1e7  # [kg.m2] of what is held fast
HELD_SHAPE = 0.3  # [rad] at which the shape is locked while the angle moves
START_SHAPE = 0.5  # [rad] about which the shape moves
POSTURES = np.radians(np.linspace(4.0, 20.0, 9))  # of the motor; the loaded leg bends by half as much again, VII-A
STANDS = 4.0  # [s] until the scale is read; half as long gives the same deflections
STEADY = 5e2  # [N.s/m] with which the experimenter calms the robot's height
TOE = {"foot_radius": 0.002}  # [m] "the wheel at the toe is removed for better accuracy", VI
FINGERTIP = 3.0  # [N.m] at most with which the experimenter still holds a balanced robot, assumed
CYCLES = 10  # of each frequency of a chirp with the legs off, IV-C
SINE = (0.3, 1.0)  # [N.m, Hz] of the sine that shows an amplifier's bias, assumed
BANDS = ((0.4, 3.0), (0.5, 3.5))  # [Hz] of leg angle and leg shape at once
MAGNITUDES = {ANGLE: ((0.1, 1.0), (0.2, 1.5)), SHAPE: ((0.15, 1.5), (0.2, 4.0))}  # [N.m] of chirps: pulleys, legs


def noise_of(experiment: str) -> np.random.Generator:
    """Noise of one experiment, which no other one's length changes."""
    return np.random.default_rng([SEED, *experiment.encode()])


def _read(values: np.ndarray, ticks: float, rng: np.random.Generator) -> np.ndarray:
    step = 2.0 * np.pi / ticks
    return quantised(values + rng.normal(0.0, NOISE * step, np.shape(values)), ticks)


def pulleys_record(name: str, combination: int, rng: np.random.Generator, command: np.ndarray | None = None) -> Record:
    """Motor ``name`` with the first, second or third combination of pulleys (0 to 2), under a chirp or ``command``."""
    drive = DRIVES[name]
    chain = load_chain(
        [
            {"torque_command": {"armature": drive.lumped_inertia[combination] / drive.motor_constant}},
            {"offset": {"value": drive.bias}},
            {"scale": {"factor": 1.0 / drive.motor_constant}},
            {"friction": {"viscous": drive.lumped_friction[combination] / drive.motor_constant}},
        ]
    )
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = STEP / SUBSTEPS, (0.0, 0.0, 0.0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    shaft = spec.worldbody.add_body(mass=1e-6, ipos=(0, 0, 0), inertia=(1e-9,) * 3, explicitinertial=True)
    shaft.add_joint(name="motor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 1.0, 0.0))
    command = chirp(MAGNITUDES[drive.kind][0], cycles=CYCLES) if command is None else command
    model = Drivetrain(spec, {"motor": chain}).model
    positions = _drive(model, lambda data, torque: data.ctrl.__setitem__(0, torque), command, SUBSTEPS, 0)
    return Record(STEP * np.arange(len(command)), command, _read(positions, ENCODER, rng))


def _drive(
    model: mujoco.MjModel,
    set_command: Callable[[mujoco.MjData, float], None],
    command: np.ndarray,
    every: int,
    address: int,
    data: mujoco.MjData | None = None,
) -> np.ndarray:
    """One element of ``qpos`` at each sample of a command, which is held for ``every`` steps."""
    if data is None:
        data = mujoco.MjData(model)
    assert data is not None  # what the engine's stubs leave open
    positions = np.empty(len(command))
    for k, torque in enumerate(command):
        positions[k] = data.qpos[address]
        set_command(data, torque)
        mujoco.mj_step(model, data, every)
    return positions


def _on_stand(
    chains: Callable[[str], Chain],
    held: tuple[str, ...],
    shapes: Mapping[str, float],
    free_height: bool = False,
    substeps: int = 1,
) -> tuple[Drivetrain, mujoco.MjData]:
    """The biped with its torso held; some motors locked; legs down, at the given shapes by side."""
    params = {**TOE, "timestep": STEP / substeps}
    drivetrain = BIPED.drivetrain({name: chains(name) for name in NAMES}, params)
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    data.qpos[1] = 2.0
    for side in SIDES:
        drivetrain.set_position(coordinate(side, SHAPE), data.qpos, shapes[side])
        drivetrain.set_position(coordinate(side, ANGLE), data.qpos, 0.0)
    base = ("hip_x", "torso_pitch") if free_height else ("hip_x", "hip_z", "torso_pitch")
    for joint in (*base, *(f"{name}_motor" for name in held)):
        model.dof_armature[model.joint(joint).dofadr[0]] = LOCKED
    return drivetrain, data


def blocked(name: str, stiffer: float = 1.0) -> Chain:
    """The drive with its spring blocked, and with cables so many times as stiff."""
    chain, path = torque_chain(name).without_stage("spring"), "compliance.stiffness"
    return chain.with_value(path, stiffer * chain.value(path))


def leg_record(name: str, rng: np.random.Generator, stiffer: float = 1.0) -> Record:
    """One coordinate with its leg, springs blocked, all other motors locked, under a chirp about its rest.

    Args:
        name: of the coordinate.
        rng: of the encoder's noise.
        stiffer: how many times as stiff as printed the cables are.
    """
    drive = DRIVES[name]
    others = tuple(other for other in NAMES if other != name)
    shape = HELD_SHAPE if drive.kind == ANGLE else START_SHAPE
    # at 1 ms the engine itself damps the stretching cables as much as 7 % of the legs' friction
    drivetrain, data = _on_stand(
        lambda which: blocked(which, stiffer), others, dict.fromkeys(SIDES, shape), substeps=SUBSTEPS
    )
    load = leg_load(BIPED.parameters(), drive.kind)
    weight = load.sine * np.sin(shape) + load.cosine * np.cos(shape) if drive.kind == SHAPE else 0.0
    offset = drive.motor_constant * weight / drive.ratio
    command = offset + chirp(MAGNITUDES[drive.kind][1], (0.4, 3.0), 10, 3)
    address = int(drivetrain.model.joint(f"{name}_motor").qposadr[0])
    number = NAMES.index(name)
    positions = _drive(
        drivetrain.model,
        lambda data, torque: data.ctrl.__setitem__(number, torque * drive.ratio),
        command,
        SUBSTEPS,
        address,
        data,
    )
    return Record(STEP * np.arange(len(command)), command, _read(positions * drive.ratio, ENCODER, rng))


def drift_record(name: str, rng: np.random.Generator, seconds: float = 20.0) -> Record:
    """The motor alone under a sine without a mean, of which only the amplifier's bias makes a drift (appendix A)."""
    time = STEP * np.arange(round(seconds / STEP))
    return pulleys_record(name, 0, rng, SINE[0] * np.sin(2.0 * np.pi * SINE[1] * time))


def legs_record(side: str, rng: np.random.Generator, stiffer: float = 1.0) -> tuple[Record, Record]:
    """Leg angle and leg shape of a leg at once, springs blocked, the other leg locked, each under its own chirp."""
    angle, shape = (coordinate(side, kind) for kind in (ANGLE, SHAPE))
    others = tuple(other for other in NAMES if other not in (angle, shape))
    drivetrain, data = _on_stand(
        lambda which: blocked(which, stiffer), others, dict.fromkeys(SIDES, START_SHAPE), substeps=SUBSTEPS
    )
    model, drives = drivetrain.model, (DRIVES[angle], DRIVES[shape])
    load = both_segments(BIPED.parameters())
    up, down = (
        GRAVITY * (sign * along * np.sin(START_SHAPE) + across * np.cos(START_SHAPE))
        for sign, (along, across) in ((1.0, load.thigh_moment), (-1.0, load.shin_moment))
    )
    weights = np.array([up + down, up - down])  # that hold leg angle and leg shape where they start
    waves = [chirp(MAGNITUDES[drive.kind][1], band, 10, 3) for drive, band in zip(drives, BANDS, strict=True)]
    commands = np.stack([wave[: min(map(len, waves))] for wave in waves], axis=1)
    ratios = np.array([drive.ratio for drive in drives])
    commands += np.array([drive.motor_constant for drive in drives]) * weights / ratios
    numbers = [NAMES.index(name) for name in (angle, shape)]
    places = [int(model.joint(f"{name}_motor").qposadr[0]) for name in (angle, shape)]
    positions = np.empty_like(commands)
    for k, torque in enumerate(commands):
        positions[k] = data.qpos[places]
        data.ctrl[numbers] = torque * ratios
        mujoco.mj_step(model, data, SUBSTEPS)
    time = STEP * np.arange(len(commands))
    read = [_read(positions[:, k] * ratios[k], ENCODER, rng) for k in range(2)]
    return Record(time, commands[:, 0], read[0]), Record(time, commands[:, 1], read[1])


def leg_load(values: Mapping[str, float], kind: str) -> Load:
    """What a coordinate moves with the other one locked as in :func:`leg_record`, from the drawings (table VII)."""
    length, shin_mass, shin_centre = values["thigh_length"], values["shin_mass"], values["shin_centre"]
    moment = values["thigh_mass"] * values["thigh_centre"] + shin_mass * length
    inertia = values["thigh_inertia"] + values["shin_inertia"] + values["shin_carrier_inertia"] + shin_mass * length**2
    coupling = 2.0 * shin_mass * length * shin_centre
    thigh_forward = values["thigh_mass"] * values["thigh_forward"]
    shin_moment, shin_forward = shin_mass * shin_centre, shin_mass * values["shin_forward"]
    if kind == SHAPE:  # thigh at q, shin at -q, spring carrier at 2 q
        sine, cosine = moment + shin_moment, thigh_forward - shin_forward
        return Load(inertia + 4.0 * values["spring_carrier_inertia"], -coupling, GRAVITY * sine, GRAVITY * cosine)
    inertia += coupling * np.cos(2.0 * HELD_SHAPE)
    c, s = np.cos(HELD_SHAPE), np.sin(HELD_SHAPE)  # thigh at q + shape, shin at q - shape
    sine = (moment + shin_moment) * c - (thigh_forward - shin_forward) * s
    cosine = (moment - shin_moment) * s + (thigh_forward + shin_forward) * c
    return Load(float(inertia), 0.0, float(GRAVITY * sine), float(GRAVITY * cosine))


def spring_postures(side: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Standing on one leg (VII-A): weight on the scale [N], leg shape [rad], deflection of the pulley [rad], and
    stretch of the cable [rad at the motor]."""
    rows = []
    name = coordinate(side, SHAPE)
    for shape in POSTURES:
        shapes = {other: float(shape) if other == side else 0.9 for other in SIDES}
        drivetrain, data = _on_stand(torque_chain, NAMES, shapes, free_height=True)
        model = drivetrain.model
        number = model.geom(foot(side)).id
        model.dof_damping[model.joint("hip_z").dofadr[0]] = STEADY
        mujoco.mj_forward(model, data)
        data.qpos[1] -= data.geom_xpos[number, 2] - model.geom_size[number, 0]
        mujoco.mj_step(model, data, round(STANDS / STEP))
        force = np.zeros(6)
        weight = 0.0
        for contact in range(data.ncon):
            mujoco.mj_contactForce(model, data, contact, force)
            weight += force[0]
        link = float(_read(np.array(drivetrain.position(name, data.qpos, "link")), JOINT_TICKS, rng))
        spring = float(_read(data.joint(f"{name}_spring").qpos * SPRING_RATIO, ENCODER, rng)[0])
        stretch = RATIO[SHAPE] * (shape - link + spring / SPRING_RATIO)
        rows.append((weight + rng.normal(0.0, 1.0), link, spring, stretch))
    weight, link, spring, stretch = np.array(rows).T
    return weight, link, spring, stretch


def cable_record(hopping: Hopping, name: str, rng: np.random.Generator) -> tuple[Record, np.ndarray]:
    """A motor and the stretch of its cable in a recording of hopping, as the encoders show them (VIII-C)."""
    number, drive = NAMES.index(name), DRIVES[name]
    motor = _read(hopping.motor[:, number], ENCODER, rng)
    stretch = motor - _read(hopping.link[:, number], JOINT_TICKS, rng) * drive.ratio
    if drive.kind == SHAPE:
        spring = _read(hopping.spring[:, SIDES.index(name.partition("_")[0])], ENCODER, rng)
        stretch = stretch + spring * drive.ratio / SPRING_RATIO
    # the torque of a row was held until the positions of that row
    return Record(hopping.time[:-1], hopping.torque[1:, number], motor[:-1]), stretch[:-1]
