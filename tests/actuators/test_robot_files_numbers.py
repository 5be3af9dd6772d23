"""Numbers of a robot file in the model: stops of an attached file, and inertia below that of the file."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.actuators.engine import install
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError

INNER = """<mujoco model="inner"><compiler angle="{angle}"{more}/><worldbody><body name="b">{inertial}
<joint name="j" axis="0 1 0" range="{range}"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body>
</worldbody></mujoco>"""
OUTER = """<mujoco><compiler angle="{angle}"/><asset><model name="inner" file="inner.xml"/></asset><worldbody>
<body name="base"><attach model="inner" body="b" prefix="L_"/></body></worldbody></mujoco>"""
CART = """<mujoco><worldbody><body name="cart"><joint name="s" type="slide" axis="1 0 0" range="-.4 .4"/>
<geom size=".1" mass="2"/></body></worldbody>
<actuator><position joint="s" kp="600" kv="30" forcerange="-200 200"/></actuator></mujoco>"""


def attached(folder: Path, outer: str, inner: str, ends: str, inertial: str = "", more: str = "") -> Path:
    (folder / "inner.xml").write_text(INNER.format(angle=inner, range=ends, inertial=inertial, more=more))
    (folder / "outer.xml").write_text(OUTER.format(angle=outer))
    return folder / "outer.xml"


@pytest.mark.parametrize(
    ("outer", "inner", "ends", "low"), [("degree", "radian", "-1 1", -1.0), ("radian", "degree", "-60 60", -np.pi / 3)]
)
def test_stops_are_written_in_the_unit_of_the_file_that_holds_the_joint(
    outer: str, inner: str, ends: str, low: float, tmp_path: Path
) -> None:
    """They were 57 times too far, or as much too near."""
    robot = as_robot(load_robot_file(attached(tmp_path, outer, inner, ends)))
    model = robot.build_spec({"L_j_upper_stop": 0.5}).compile()
    assert model.jnt_range[0] == pytest.approx((low, 0.5))


def test_a_mass_is_written_where_an_attached_file_takes_its_own_from_shapes(tmp_path: Path) -> None:
    inertial = '<inertial pos="0 0 0" mass="7" diaginertia="1 1 1"/>'
    path = attached(tmp_path, "radian", "radian", "-1 1", inertial, ' inertiafromgeom="true"')
    model = as_robot(load_robot_file(path)).build_spec({"L_b_mass": 0.9}).compile()
    assert model.body("L_b").mass == pytest.approx(0.9)


def mass(model: mujoco.MjModel) -> float:
    data = mujoco.MjData(model)
    install()
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return float(full[0, 0])


def test_inertia_that_a_slide_has_too_much_of_is_taken_from_it(tmp_path: Path) -> None:
    """A mass that was found to be less than the file's stayed as it was in what was handed over."""
    (tmp_path / "cart.xml").write_text(CART)
    robot = as_robot(load_robot_file(tmp_path / "cart.xml"))
    for more in (-0.6, 0.0, 0.6):
        drivetrain = robot.drivetrain({}, {"s_inertia": more})
        assert mass(drivetrain.model) == pytest.approx(2.0 + more)
    heavy = load_chain(robot.chains["s"]).with_value("ideal.armature", 0.3)
    drivetrain = robot.drivetrain({"s": heavy}, {"s_inertia": -0.6})
    assert mass(drivetrain.model) == pytest.approx(1.7)


def test_a_slide_with_nothing_left_of_its_inertia_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    robot = as_robot(load_robot_file(tmp_path / "cart.xml"))
    with pytest.raises(RobotError, match="joint 's' would have a negative inertia: what was found at it is more than"):
        robot.build_spec({"s_inertia": -2.1})
