"""Largest forces that actuators of a model file have, where their ranges are not the same both ways."""

from pathlib import Path

import pytest
from sealegs.envs.described.robot_file import load_robot_file

ARM = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" range="-60 60" {joint}/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/></body></worldbody>
<actuator>{actuators}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuators", "force"),
    [
        ('<motor joint="j" ctrlrange="-2 2" forcerange="-50 50"/>', 2.0),
        ('<motor joint="j" ctrlrange="-90 90" forcerange="-50 50" gear="2"/>', 100.0),
        ('<general joint="j" gainprm="3" ctrlrange="-2 2" forcerange="-50 50" gear="-1"/>', 6.0),
        ('<position joint="j" kp="20" kv="1" ctrlrange="-1 1" forcerange="-5 5"/>', 5.0),
        ('<motor joint="j" ctrlrange="0 4"/><motor joint="j" ctrlrange="0 4" gear="-1"/>', 4.0),
    ],
)
def test_a_motor_gives_no_more_than_its_controls_and_its_range_let_it(
    actuators: str, force: float, tmp_path: Path
) -> None:
    (tmp_path / "arm.xml").write_text(ARM.format(joint="", actuators=actuators))
    robot = load_robot_file(tmp_path / "arm.xml")
    assert robot.joints[0].chain.value("ideal.torque_limit") == pytest.approx(force)
    assert not any("is read as" in sentence for sentence in robot.said)


@pytest.mark.parametrize(
    ("ends", "force", "why"),
    [
        ("-2 10", 2.0, "-2 to 10 N.m, is read as -2 to 2: the smaller end counts both ways."),
        ("0 10", 10.0, "0 to 10 N.m, is read as -10 to 10: a drive that acts one way only is not known here."),
    ],
)
def test_a_range_of_forces_is_read_alike_at_joints_and_actuators(
    ends: str, force: float, why: str, tmp_path: Path
) -> None:
    servo = '<position joint="j" kp="20" kv="1" {}/>'
    for name, joint, actuators in (
        ("joint", f'actuatorfrcrange="{ends}"', servo.format("")),
        ("actuator", "", servo.format(f'forcerange="{ends}"')),
        ("motor", "", f'<motor joint="j" ctrlrange="{ends}"/>'),
    ):
        path = tmp_path / f"{name}.xml"
        path.write_text(ARM.format(joint=joint, actuators=actuators))
        robot = load_robot_file(path)
        assert robot.joints[0].chain.value("ideal.torque_limit") == pytest.approx(force), name
        assert any(why in sentence and sentence.startswith("Warning: ") for sentence in robot.said), name
