"""What a virtual machine hides: how its chains and its robot differ from what everybody believes.

The file is YAML, in one of three forms:

- a list: the chain that is really on every joint, such as the ``extended.yaml`` of a diagnosis;
- a mapping with keys ``stage.parameter``, which change or add a stage on every joint, ``robot.number``, which change a
  number of the robot, and ``imu.delay`` and the like (:mod:`sealegs.hw.virtual.imu`);
- under the name of a joint, either of the two for that joint alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...actuators import Chain, load_chain
from ...actuators.stages import build_stage
from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError, nearest
from ...envs.engine.robot import Robot

IMU = "imu."
"""Before the keys of an IMU."""


def hide(
    robot: Robot, chains: Mapping[str, Any], params: dict[str, float], path: str | None
) -> tuple[dict[str, Chain], dict[str, float]]:
    """Chains and numbers as the machine really has them.

    Args:
        robot: what they belong to.
        chains: chain of each joint, as believed.
        params: numbers of the robot, as believed.
        path: of the file; None: nothing is hidden.

    Raises:
        SealegsError: the file cannot be read, or names what robot or chain do not have.
    """
    believed = {name: load_chain(chain) for name, chain in chains.items()}
    if path is None:
        return believed, params
    content = _content(path)
    if isinstance(content, list):
        return {name: load_chain(path) for name in believed}, params
    if not isinstance(content, dict):
        raise SealegsError(f"{path} holds neither a chain nor changes such as 'delay.seconds: 0.025'.")
    numbers = dict(params)
    for key, value in content.items():
        key = str(key)
        if key in believed:
            if isinstance(value, list):
                believed[key] = load_chain(value)
            elif isinstance(value, dict):
                for inner, number in value.items():
                    believed[key] = changed(believed[key], str(inner), number, path)
            else:
                raise SealegsError(f"{path}: under '{key}' stands neither a chain nor changes of one.")
        elif key.startswith(IMU):
            if robot.imu is None:
                raise SealegsError(f"{path}: {key} is of an IMU, and robot '{robot.name}' has none.")
        elif key.startswith("robot."):
            numbers[key.removeprefix("robot.")] = value
        elif "." in key:
            believed = {name: changed(chain, key, value, path) for name, chain in believed.items()}
        else:
            raise SealegsError(
                f"{path}: '{key}' is no joint of {robot.name}{nearest(key, believed)}, and no path such as "
                "'delay.seconds' or 'robot.mass'."
            )
    return believed, numbers


def of_imu(path: str | None) -> dict[str, Any]:
    """What a file of hidden effects says of the IMU, by key after ``imu.``.

    Raises:
        SealegsError: the file cannot be read.
    """
    content = None if path is None else _content(path)
    rows = content.items() if isinstance(content, dict) else ()
    return {str(key).removeprefix(IMU): value for key, value in rows if str(key).startswith(IMU)}


def _content(path: str) -> Any:
    try:
        return read_yaml(path, f"the file of hidden effects {path}")
    except DocumentError as error:
        raise SealegsError(f"{error}.") from None


def changed(chain: Chain, path: str, value: Any, where: str) -> Chain:
    """The chain with one parameter changed; a stage that it lacks is added, its other parameters at their defaults."""
    stage, _, key = path.partition(".")
    if chain.find(stage) is None:
        return chain.with_stage(build_stage(stage, {key: value}, where))
    return chain.with_value(path, value)
