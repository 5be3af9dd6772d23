"""Sensors in a robot's file: what has no effect is refused, with what to write instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.hw.machine.joints import CalibrationError, Sensor
from sealegs.hw.machine.own_robot import own_robot
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.commands import Reference


def hopper(row: Any) -> tuple[Sensor, ...]:
    """Sensors of a hopper whose file has one at the hip, with these keys."""
    return build_robot({**compose("deploy", {"robot": "hopper"})["robot"], "sensors": {"hip.link": row}}).sensors


def test_keys_of_a_sensor_count() -> None:
    (sensor,) = hopper({"id": 9, "zero": 100, "per_radian": -0.5})
    assert (sensor.id, sensor.zero, sensor.per_radian) == (9, 100, -0.5)


def test_a_direction_of_a_sensor_is_refused_with_the_sign_to_write_in_its_place() -> None:
    """An encoder that counts the other way was read as if it did not, and a policy saw its spring bend backwards."""
    with pytest.raises(CalibrationError, match=r"robot\.sensors\.hip\.link\.direction is unknown: .*per_radian: -1"):
        hopper({"id": 9, "direction": -1})


def test_a_mistyped_key_of_a_sensor_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(CalibrationError, match=r"hip\.link\.zro is unknown \(did you mean 'zero'\?\); there are id, "):
        hopper({"id": 9, "zro": 5})


def test_a_sensor_without_its_id_is_refused_as_before() -> None:
    for row in ({}, {"zero": 5}, 9, None):
        with pytest.raises(CalibrationError, match="it needs an id, and takes zero, per_radian"):
            hopper(row)


@pytest.mark.parametrize(
    ("sensors", "says"),
    [
        ({"hipp.link": {"id": 3}}, r"hipp\.link measures nothing of this robot \(did you mean 'hip\.link'\?\)"),
        ({"bse_x": {"id": 3}}, r"did you mean 'base_x'"),
        ({"hip.link": {"id": 300}}, r"hip\.link\.id is 300; ids are 0 to 252"),
        ({"hip.link": {"id": 3.9}}, r"hip\.link\.id takes a whole number, not 3\.9"),
        ({"hip.link": {"id": 3, "zero": 1.5}}, r"hip\.link\.zero takes a whole number"),
        ({"hip.link": {"id": 3, "per_radian": 0}}, r"per_radian is 0"),
    ],
)
def test_a_sensor_of_nothing_or_nowhere_is_refused(sensors: dict[str, Any], says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        build_robot({**compose("deploy", {"robot": "hopper"})["robot"], "sensors": sensors})


def test_the_reference_controller_needs_encoders_behind_the_springs() -> None:
    config = compose("deploy", {"robot": "hopper"})["robot"]
    Reference(build_robot(config))
    for sensors, missing in (({}, "hip.link, knee.link"), ({"hip.link": {"id": 3}}, "knee.link")):
        with pytest.raises(SealegsError, match=f"robot.sensors lacks {missing};"):
            Reference(build_robot({**config, "sensors": sensors}))


@pytest.mark.parametrize("key", ["sensors", "gears", "registers", "params"])
def test_a_list_in_place_of_a_table_is_refused(key: str) -> None:
    with pytest.raises(SealegsError, match=f"robot.{key} takes a mapping, not "):
        build_robot({**compose("deploy", {"robot": "hopper"})["robot"], key: [1]})


def test_limits_of_an_own_robot_that_are_a_list_are_refused(tmp_path: Path) -> None:
    (tmp_path / "my.xml").write_text(
        '<mujoco><worldbody><body><joint name="elbow" range="-1 1"/><geom size="0.1" mass="1"/></body></worldbody>'
        '<actuator><position joint="elbow" kp="10"/></actuator></mujoco>'
    )
    (tmp_path / "my.yaml").write_text("model: my.xml\njoints: {elbow: {chain: sts3215}}\ndeploy: {safety: [1]}\n")
    with pytest.raises(SealegsError, match=r"my\.yaml: deploy\.safety takes a mapping, not \[1\]"):
        own_robot(str(tmp_path / "my.yaml"))
