"""Laws that the hexapod brought along: bristles, smoothed dry friction, a digital controller with a band."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError

SLIDE = """<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
<joint name="x" type="slide" axis="1 0 0"/><geom size="0.1" mass="7"/></body></worldbody></mujoco>"""
LUGRE = {"coulomb": 150.0, "stribeck": 100.0, "stribeck_velocity": 1e-4, "stribeck_exponent": 2.0, "lugre": 1}
BRISTLES = {"bristle_stiffness": 1e9, "bristle_damping": 0.02}


def pushed(
    friction: dict,
    force: float,
    seconds: float = 0.5,
    step: float = 1e-3,
    integrator: str = "implicitfast",
    rise: float = 0.0,
):
    from sealegs.actuators import Drivetrain

    spec = mujoco.MjSpec.from_string(SLIDE.format(step=step, integrator=integrator))
    driven = Drivetrain(spec, {"x": [{"torque_command": {}}, {"friction": friction}]})
    data = mujoco.MjData(driven.model)
    for k in range(round(seconds / step)):
        data.qfrc_applied[0] = force * min(k * step / rise, 1.0) if rise else force
        mujoco.mj_step(driven.model, data)
    return data


@pytest.mark.parametrize("step", [2e-3, 1e-3, 1e-4])
@pytest.mark.parametrize("integrator", ["implicitfast", "RK4", "Euler"])
def test_bristles_of_the_printed_stiffness_hold_slip_and_are_stable_at_any_step(step: float, integrator: str) -> None:
    held = pushed({**LUGRE, **BRISTLES}, 200.0, 0.3, step, integrator, rise=0.15)  # below breakaway, above Coulomb
    assert abs(held.qpos[0]) < 2e-6
    assert abs(held.qvel[0]) < 1e-7
    assert held.qfrc_constraint[0] == pytest.approx(-200.0, rel=1e-3)
    slipping = pushed({**LUGRE, **BRISTLES}, 300.0, 0.3, step, integrator, rise=0.15)
    assert slipping.qvel[0] == pytest.approx((3.125 + 22.5) / 7.0, rel=0.03)  # breaks away at 250 N, after 0.125 s


def test_bristles_follow_their_differential_equation() -> None:
    # soft bristles, so that their transient is slow: equations (26) to (28) integrated on their own in fine steps
    stiffness, coulomb, mass, force, step = 2e4, 10.0, 7.0, 9.0, 1e-5
    z = v = q = 0.0
    for _ in range(round(0.2 / step)):
        slip = v - abs(v) / (coulomb / stiffness) * z
        v += step * (force - stiffness * z - 5.0 * slip) / mass
        z += step * slip
        q += step * v
    data = pushed(
        {"coulomb": coulomb, "lugre": 1, "bristle_stiffness": stiffness, "bristle_damping": 5.0}, force, 0.2, 2e-4
    )
    assert data.qpos[0] == pytest.approx(q, rel=0.03)


def test_smoothed_dry_friction_creeps_as_its_equation_says() -> None:
    data = pushed({"coulomb": 150.0, "viscous": 2000.0, "slip_speed": 1e-4}, 100.0)
    slope = (150.0 + 2000.0 * 1e-4) / 1e-4  # (34) between the slip speeds
    assert data.qvel[0] == pytest.approx(100.0 / slope, rel=1e-3)


def test_a_digital_controller_holds_its_duty_and_its_integral_runs_out_within_the_band() -> None:
    from sealegs.actuators.law import begin, torque
    from sealegs.actuators.layout import P_STATE_SIZE, S_DUTY

    controller = {"gain": 2.0, "integral": 4.0, "period": 0.01, "band": 0.01, "integral_limit": 0.05}
    chain = load_chain(
        [
            {"position_pi": controller},
            {"supply": {"volts": 10.0}},
            {"dc_motor": {"motor_constant": 1.0, "resistance": 1.0}},
        ]
    )
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, 0.1, 0.0, 0.0)
    duties = []
    for k in range(200):
        torque(program, state, 1e-3 * k, 0.1, 0.0 if k < 100 else 0.0995, 0.0, 0.0, True)
        duties.append(state[S_DUTY])
    assert all(len(set(duties[k : k + 10])) == 1 for k in range(0, 200, 10))  # (24) every 10 ms
    assert duties[:30:10] == pytest.approx([0.2 + 0.004 * k for k in (1, 2, 3)])  # (25)
    assert duties[99] == pytest.approx(0.2 + 0.04)
    assert duties[199] == pytest.approx(0.04 * (1.0 - 0.02) ** 10)


@pytest.mark.parametrize(
    ("friction", "sentence"),
    [
        ({"lugre": 1}, "needs a bristle_stiffness"),
        ({"bristle_stiffness": 1e3, "slip_speed": 1e-4}, "exclude each other"),
        ({"bristle_damping": 1.0}, "only LuGre bristles have"),
    ],
)
def test_joint_frictions_that_exclude_each_other_are_refused(friction: dict, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        load_chain([{"torque_command": {}}, {"friction": friction}])


def test_a_band_without_a_period_is_refused() -> None:
    with pytest.raises(SealegsError, match="add its period"):
        load_chain(
            [
                {"position_pi": {"gain": 1.0, "integral": 1.0, "band": 0.1}},
                {"supply": {"volts": 1.0}},
                {"dc_motor": {"motor_constant": 1.0, "resistance": 1.0}},
            ]
        )
