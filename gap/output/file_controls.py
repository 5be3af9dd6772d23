"""What controls in a robot's model file mean to the actuators that a diagnosis writes: goals or torques of a joint."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from ...envs.described.model_drives import ModelDrive
from ...envs.described.model_file import ModelFile
from ...envs.described.robot_described import FileJoint

SAME = 1e-9  # of a control: what differs by less is the same


class FileControls:
    """The controls of the actuators of a model file.

    Attributes:
        names: of the actuators; of one without a name, what it acts on.
        count: of controls.
    """

    def __init__(self, full: mujoco.MjSpec) -> None:
        """Of the specification as the file has it, which is left as it is."""
        spec = full.copy()
        for key in list(spec.keys):  # of another size than the model, they would stop the compiler
            spec.delete(key)
        self._model = spec.compile()
        self.count = len(self._model.actuator_ctrlrange)
        self.names = [actuator.name or actuator.target for actuator in spec.actuators]

    def goal(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """Where controls of all actuators ask a driven coordinate to be [rad or m]; None: they say no position."""
        if drive.stiffness <= 0.0 or (force := self._force(drive, controls)) is None:
            return None
        return force / drive.stiffness

    def torque(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """The torque or force that controls of all actuators ask for [N.m or N]; None: they ask for none."""
        return self._force(drive, controls) if drive.motor else None

    def torques(self, drive: ModelDrive) -> tuple[float, float] | None:
        """Lowest and highest torque or force that the control ranges of motors allow [N.m or N]; None: any."""
        addresses = [int(self._model.actuator_ctrladr[number]) for number in self._numbers(drive)]
        if not drive.motor or not all(self._model.actuator_ctrllimited[at] for at in addresses):
            return None
        ends = [np.zeros(self.count) for _ in range(2)]
        for number, at in zip(self._numbers(drive), addresses, strict=True):
            low, high = self._model.actuator_ctrlrange[at]
            ends[0][at], ends[1][at] = (low, high) if self._gain(number) > 0.0 else (high, low)
        low, high = (self._force(drive, end) for end in ends)
        return None if low is None or high is None else (low, high)

    def same(self, drive: ModelDrive, torque: bool) -> bool:
        """Whether a control of the file's one actuator is the goal, or the torque, that it asks for."""
        if len(self._numbers(drive)) > 1:
            return False
        for control in (0.0, 1.0):
            controls = np.full(self.count, control)
            asked = self.torque(drive, controls) if torque else self.goal(drive, controls)
            if asked is None or not math.isclose(asked, control, abs_tol=SAME):
                return False
        return True

    def _numbers(self, drive: ModelDrive) -> list[int]:
        return [number for number, name in enumerate(self.names) if name in drive.actuators]

    def _gain(self, number: int) -> float:
        model = self._model
        return float(model.actuator_gear[int(model.actuator_outadr[number]), 0] * model.actuator_gainprm[number, 0])

    def _force(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """Force of controls on a coordinate at 0 [N.m or N]; None: it hangs on more than these."""
        if drive.tied:  # forces of some act on another joint
            return None
        model, total = self._model, 0.0
        for number in self._numbers(drive):
            fixed = int(model.actuator_gaintype[number]) == int(mujoco.mjtGain.mjGAIN_FIXED)
            if not fixed or int(model.actuator_dyntype[number]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
                return None
            total += self._gain(number) * float(controls[int(model.actuator_ctrladr[number])])
            if int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_AFFINE):
                gear = float(model.actuator_gear[int(model.actuator_outadr[number]), 0])
                total += gear * float(model.actuator_biasprm[number, 0])
        return total


def drive_of(model: ModelFile, item: FileJoint) -> ModelDrive | None:
    """What actuators of the file make of a driven coordinate; None where they do not drive it."""
    return next((d for d in model.drives if d.name in (item.name, item.joint) and d.terms == item.terms), None)
