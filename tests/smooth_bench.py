"""A bench and a servo whose encoder has no ticks, so that replays of two simulators can be compared closely."""

from __future__ import annotations

import mujoco
from sealegs.actuators import Drivetrain

PARAMS = {"mass": 0.5, "arm_mass": 0.03, "length": 0.12}
CHAIN = [
    {"delay": {"seconds": 0.005}},
    {"position_p": {"gain": 5.3}},
    {"duty_limit": {"limit": 0.97}},
    {"supply": {"volts": 7.4, "resistance": 0.0}},
    {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7, "armature": 0.026}},
    {"friction": {"coulomb": 0.052, "viscous": 0.059}},
    {"encoder": {"ticks": 0}},
]

# --- A pendulum in the engine, driven by a chain ---------------------------------------------------------------------

LINK = '<inertial pos="0 0 -.12" mass=".5" diaginertia="1e-9 1e-9 1e-9"/>'
PENDULUM = f"""<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>
<body><joint name="shaft" axis="0 1 0"/>{LINK}</body></worldbody></mujoco>"""


def drivetrain(chain, xml: str = PENDULUM, joint: str = "shaft") -> Drivetrain:
    return Drivetrain(mujoco.MjSpec.from_string(xml), {joint: chain})


def run(driven: Drivetrain, seconds: float, goal: float = 0.0, start: float | None = None) -> mujoco.MjData:
    data = mujoco.MjData(driven.model)
    if start is not None:
        driven.set_position(driven.coordinates[0].name, data.qpos, start)
    data.ctrl[:] = goal
    mujoco.mj_step(driven.model, data, round(seconds / driven.model.opt.timestep))
    return data
