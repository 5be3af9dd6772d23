"""A hopper that exists only in the engine, whose leg or ground hides an effect: legged logs to try the tools on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from ...actuators import load_chain
from ...actuators.engine import install
from ...actuators.layout import S_CURRENT, S_DUTY
from ...envs.hopper.controller import BangBang, spring_stiffness
from ...envs.hopper.robot import HIP, KNEE
from ..ground.leg_model import GROUND_JOINT, LegModel
from ..log.reader import write_run
from ..log.types import JointLog, MeasuredRun
from ..replay.joint_model import JointModel
from ..replay.parameters import Target, address
from .bench import CURRENT_STEP, ENCODER_NOISE, ENCODER_TICKS, ENGINE_STEP, SAMPLE_RATE, STAMP_JITTER

BOOM_STEP, BOOM_NOISE = 1e-4, 1e-4  # [m] of the boom encoder, at the hip
CONTACT_TIME = 0.002  # [s] a hard floor
JOINTS = (HIP, KNEE)
PIECE_SECONDS = 2.0  # [s] after which the gait changes


def record(
    folder: Path,
    hidden: Mapping[str, float] | None = None,
    seed: int = 0,
    actuator: str = "sv1270tg",
    runs: int = 3,
    duration: float = 20.0,
) -> list[Path]:
    """Write runs of a hopper under the reference controller; the sidecars know the nominal leg only.

    Args:
        folder: to write into; existing logs are never overwritten.
        hidden: what leg and ground really are: ``<joint>.stage.parameter`` or ``contact.*``
            (:data:`sealegs.gap.ground.leg_model.GROUND`).
        seed: of gaits and noise.
        actuator: chain that the sidecars believe in, for both joints.
        runs, duration: how many, and how long each is [s].
    """
    hidden = dict(hidden or {})
    chain = load_chain(actuator)
    chains = {}
    for name in JOINTS:
        own = {path.partition(".")[2]: value for path, value in hidden.items() if path.startswith(f"{name}.")}
        chains[name] = JointModel(chain).with_values(own).chain
    ground = {path: value for path, value in hidden.items() if address(path).target is Target.GROUND}
    leg = LegModel.of({"contact_time": CONTACT_TIME}, chains).with_fitted(ground)
    written = []
    for number in range(runs):
        rng = np.random.default_rng([seed, number])
        run = _record(leg, f"run{number}", duration, rng, spring_stiffness(chain))
        run.actuators.update(dict.fromkeys(JOINTS, actuator))
        written.append(write_run(run, folder))
    return written


def _record(leg: LegModel, name: str, duration: float, rng: np.random.Generator, stiffness: float) -> MeasuredRun:
    drivetrain = leg.drivetrain()
    model = drivetrain.model
    install()
    data = mujoco.MjData(model)
    rest = (leg.params["hip_rest"], leg.params["knee_rest"])
    for joint, angle in zip(JOINTS, rest, strict=True):
        drivetrain.set_position(joint, data.qpos, angle)
        data.ctrl[drivetrain.actuator_ids[joint]] = angle
    base = {axis: int(model.joint(f"base_{axis}").qposadr[0]) for axis in "xz"}
    data.qpos[base["z"]] += 0.02 + leg.value("contact.height")
    data.qpos[int(model.joint(GROUND_JOINT).qposadr[0])] = 0.0
    grid = np.arange(1, int(duration * SAMPLE_RATE)) / SAMPLE_RATE
    time = grid + np.clip(rng.normal(0.0, STAMP_JITTER, len(grid)), -3 * STAMP_JITTER, 3 * STAMP_JITTER)
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("goal", "motor", "link", "duty", "current", "base")}
    controller, lean = BangBang(rest=rest, stiffness=stiffness), np.zeros(2)
    for k, at in enumerate(time):
        if k % int(PIECE_SECONDS * SAMPLE_RATE) == 0:
            weights = (float(rng.uniform(-0.65, -0.4)), 1.0)
            controller = BangBang(0.3, float(rng.uniform(0.2, 0.3)), weights, rest, stiffness)
            lean = np.full(2, rng.uniform(-0.1, 0.1))
        count = max(int(np.ceil((at - data.time) / ENGINE_STEP)), 1)
        model.opt.timestep = (at - data.time) / count
        mujoco.mj_step(model, data, count)
        motor, link = (
            np.array([float(drivetrain.position(joint, data.qpos, side)) for joint in JOINTS])
            for side in ("motor", "link")
        )
        goal = controller.goals(motor, link) + lean
        for j, joint in enumerate(JOINTS):
            data.ctrl[drivetrain.actuator_ids[joint]] = goal[j]
        slots = {"duty": S_DUTY, "current": S_CURRENT}
        values = {
            key: np.array([float(drivetrain.state(joint, data.userdata, slot)) for joint in JOINTS])
            for key, slot in slots.items()
        }
        place = np.array([data.qpos[base["x"]], data.qpos[base["z"]]])
        for key, value in {"goal": goal, "motor": motor, "link": link, "base": place, **values}.items():
            rows[key].append(value)
    table = {key: np.array(value) for key, value in rows.items()}
    has_current = leg.chains[HIP].find("dc_motor") is not None
    joints = {
        joint: JointLog(
            goal=table["goal"][:, j],
            position=_rounded(table["motor"][:, j], 2.0 * np.pi / ENCODER_TICKS, ENCODER_NOISE, rng),
            link_position=_rounded(table["link"][:, j], 2.0 * np.pi / ENCODER_TICKS, ENCODER_NOISE, rng),
            duty=np.asarray(np.round(table["duty"][:, j], 3), np.float64),
            current=_rounded(table["current"][:, j], CURRENT_STEP, CURRENT_STEP, rng) if has_current else None,
        )
        for j, joint in enumerate(JOINTS)
    }
    return MeasuredRun(
        name=name,
        time=time,
        joints=joints,
        base={axis: _rounded(table["base"][:, k], BOOM_STEP, BOOM_NOISE, rng) for k, axis in enumerate("xz")},
        robot="hopper",
        robot_params={"contact_time": CONTACT_TIME},
        meta={"machine": "virtual hopper"},
    )


def _rounded(values: np.ndarray, step: float, noise: float, rng: np.random.Generator) -> np.ndarray:
    return step * np.round((values + rng.normal(0.0, noise, len(values))) / step)
