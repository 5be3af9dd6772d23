"""A chain too stiff for its time step is refused before it oscillates ever wilder; one that is not, is simulated."""

import re
from itertools import pairwise
from pathlib import Path

import mujoco
import pytest
from sealegs.actuators import ChainError
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file

from tests.pendulum_on_a_chain import PENDULUM, drivetrain, run

INERTIA = 0.5 * 0.12**2  # of the pendulum [kg.m2]
IDEAL = {"ideal": {"stiffness": 1e5}}
DAMPED = {"ideal": {"stiffness": 2e4, "damping": 8.0}}
GEARED = [
    {"position_p": {"gain": 1000.0}},
    {"supply": {"volts": 12.0}},
    {"dc_motor": {"motor_constant": 0.02, "resistance": 1.0, "emf_ratio": 0.1}},
    {"gear": {"ratio": 250.0, "efficiency": 1.0}},
]
REGRESSION = [{"position_p": {"gain": 100.0}}, {"regression": {"duty_torque": 500.0, "speed_torque": -0.1}}]


def longest(chain: list, xml: str) -> float:
    """Step [s] that the refusal of a chain asks for."""
    with pytest.raises(ChainError, match=r"controller holds with .* N\.m/rad on an inertia") as caught:
        drivetrain(chain, xml)
    assert "\n" not in str(caught.value)
    found = re.search(r"shorter than (\S+) s", str(caught.value))
    assert found is not None
    return float(found[1])


def reached(model: mujoco.MjModel) -> float:
    """Largest position of a pendulum that starts at 0.01 rad and is held at 0 [rad]."""
    data = mujoco.MjData(model)
    data.qpos[0] = 0.01
    positions = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        positions.append(abs(float(data.qpos[0])))
    return max(positions)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast", "Euler"])
@pytest.mark.parametrize("chain", [[IDEAL], GEARED, REGRESSION], ids=["ideal", "geared", "regression"])
def test_a_controller_too_stiff_for_the_step_is_refused(chain: list, integrator: str) -> None:
    xml = PENDULUM.replace("RK4", integrator).replace("0.001", "0.002")
    step = 0.95 * longest(chain, xml)
    stable = drivetrain(chain, xml.replace("0.002", f"{step:g}")).model
    assert reached(stable) < 0.05
    stable.opt.timestep = 1.5 * step
    assert reached(stable) > 1.0


def test_stiffness_and_damping_count_together_where_the_engine_has_one_stage() -> None:
    semi = PENDULUM.replace("RK4", "implicitfast")
    step = longest([DAMPED], semi)
    parts = [{"ideal": {**DAMPED["ideal"], key: 0.0}} for key in ("stiffness", "damping")]
    for part in parts:
        drivetrain([part], semi)
    stable = drivetrain([DAMPED], semi.replace("0.001", f"{0.95 * step:g}")).model
    assert reached(stable) < 0.05
    drivetrain([DAMPED])  # Runge-Kutta, at the step that was refused


def test_native_damping_lets_a_stiff_light_joint_be() -> None:
    semi = PENDULUM.replace("RK4", "implicitfast")
    assert longest([IDEAL], semi) < 0.001
    driven = drivetrain([IDEAL, {"friction": {"viscous": 100.0}}], semi)
    assert reached(driven.model) < 0.05


def test_a_digital_controller_is_not_told_to_shorten_the_step() -> None:
    """It oscillates by its own period, which a shorter step does not change."""
    digital = [{"position_pi": {"gain": 1000.0, "integral": 0.0, "period": 0.005}}, *GEARED[1:]]
    run(drivetrain(digital), 0.01)


def test_the_assumed_step_of_a_file_is_short_enough_for_its_stiff_servos(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    steps = []
    for stiffness in (10, 20000, 100000):
        model.write_text(f"""<mujoco><worldbody><body><joint name="elbow" axis="0 1 0" range="-60 60"/>
            <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body></worldbody>
            <actuator><position joint="elbow" kp="{stiffness}" kv="1"/></actuator></mujoco>""")
        robot = load_robot_file(model)
        steps.append(robot.timestep)
        assert reached(as_robot(robot).drivetrain().model) < 0.05
    assert all(later < earlier for earlier, later in pairwise(steps))
