"""A policy from its ONNX file: what deployment needs of learning, and all of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime

from ..envs.any_robot.user import trained_in
from ..envs.contract import KEY, Contract, ContractError

FILE = "policy.onnx"


class Policy:
    """A policy and the contract that it came with.

    Attributes:
        path: of its file.
        contract: what it takes for granted about the robot.
    """

    def __init__(self, path: str | Path, task: str | None = None) -> None:
        """Load the policy.

        Args:
            path: ONNX file, or a folder with a ``policy.onnx``.
            task: ``path/to/task.py:MyTask`` that it was trained in, where that is a file of one's own. It is run; the
                file that the contract names is not.

        Raises:
            ContractError: there is no such file, it is no ONNX file, or it has no contract.
            SealegsError: its task is code that nobody named.
        """
        self.path = Path(path) / FILE if Path(path).is_dir() else Path(path)
        if not self.path.is_file():
            beside = ""
            if any((self.path.parent / name).is_file() for name in ("policy.safetensors", "model.zip")):
                beside = f"; make it with: sealegs export {self.path.parent}"
            elif (final := self.path.parent / "final").is_dir():
                beside = f"; a run's policies are in its folders: {final}, or best beside it"
            raise ContractError(f"there is no policy {self.path}{beside}.")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # microseconds of work: threads only add jitter
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(self.path, options, providers=["CPUExecutionProvider"])
            metadata = self._session.get_modelmeta().custom_metadata_map
        except Exception as error:  # onnxruntime has a class of its own for each way that a file can be damaged
            reason = str(error).strip().partition("\n")[0]
            raise ContractError(f"{self.path} is no ONNX file that can be read: {reason}") from None
        if KEY not in metadata:
            raise ContractError(
                f"{self.path} has no contract, so nothing says which robot it is for; export it with sealegs export."
            )
        contract = Contract.from_json(metadata[KEY], str(self.path))
        self.contract = replace(contract, env=trained_in(contract.env, str(self.path), task))

    def act(
        self, observation: np.ndarray, command: np.ndarray, state: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The next goals; to be asked ``contract.goal_rate`` times a second.

        Args:
            observation: (n, size); what the policy knows itself (clock, memory, latest action, command) is ignored.
            command: what is asked for (n, c).
            state: ``contract.state`` at the start, then the state that the call before gave (n, s).

        Returns:
            Actions in force (n, a) in [-1, 1], goals (n, k) [rad or m], and the next state (n, s).
        """
        feeds = {
            "observation": np.asarray(observation, np.float32),
            "command": np.asarray(command, np.float64),
            "state": np.asarray(state, np.float64),
        }
        action, goal, following = self._session.run(["action", "goal", "next_state"], feeds)
        return np.asarray(action), np.asarray(goal), np.asarray(following)
