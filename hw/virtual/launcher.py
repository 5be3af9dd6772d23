"""Starts a virtual bus in a process of its own, from Python."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...common.errors import SealegsError
from .control import Control

LINGER = 5.0  # [s] that the servos outlive a killed parent


class VirtualBus:
    """A virtual bus for the length of a ``with``: a process, its port, and its control channel.

    The process ends with the block. If whoever started it is killed, the servos live on for some seconds, in which
    another process can still reach them, and then end too.

    Attributes:
        port: path to give to :class:`sealegs.hw.bus.servo_bus.ServoBus` or to any other client.
        control_path: of the control socket, for another process.
        ports: paths by name of the line; "" is the first.
        imu_port: path that the lines of its IMU come from; "": the robot has none.
    """

    def __init__(self, **keys: Any) -> None:
        """Start the process; keys are those of ``configs/virtual.yaml``, such as ``robot="bench"``.

        Files are looked for from the current folder.

        Raises:
            SealegsError: what the process said in refusing its arguments.
        """
        arguments = words({"linger": LINGER, **keys})
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 no pipe, which nobody would empty
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sealegs.hw.virtual", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            start_new_session=True,  # a Ctrl-C in the terminal is the loop's: the servos must be there to be released
        )
        assert self._process.stdout is not None
        facts = {}
        for name in ("port", "control"):
            key, _, value = self._process.stdout.readline().strip().partition(": ")
            if key != name:
                self._process.communicate()
                self._errors.seek(0)
                said = self._errors.read().strip().splitlines()
                raise SealegsError(said[-1] if said else "the virtual bus did not start, and did not say why.")
            facts[key] = value
        self.port, self.control_path = facts["port"], facts["control"]
        self.ports = {"": self.port}
        for name in keys.get("buses") or {}:
            _, _, self.ports[name] = self._process.stdout.readline().strip().partition(": ")
        self.imu_port = ""
        if keys.get("imu"):
            _, _, self.imu_port = self._process.stdout.readline().strip().partition(": ")
        self._control = Control(self.control_path)

    def __enter__(self) -> VirtualBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process.

        Raises:
            SealegsError: it had ended before; the sentence is what it said.
        """
        self._control.close()
        died = self._process.poll()
        self._process.terminate()
        try:
            self._process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        self._errors.seek(0)
        said = self._errors.read().strip().splitlines()
        self._errors.close()
        if died is not None:
            raise SealegsError(f"the virtual bus ended by itself: {said[-1] if said else f'exit status {died}'}")

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def status(self) -> dict[str, Any]:
        """What only a simulation can know: see ``docs/virtual-bus.md``."""
        return self._control.order("status")

    def fault(self, kind: str, **values: Any) -> float:
        """Plant a fault from now on, or ``at`` seconds from now; see :mod:`hw.virtual.faults`.

        Returns:
            Now, on the machine's clock [s].
        """
        return float(self._control.order("fault", kind=kind, **values)["time"])

    def clear(self) -> None:
        """Take all faults away."""
        self.port = self._control.order("clear")["port"]

    def let_go(self) -> None:
        """Take away the hand that holds the robot."""
        self._control.order("let_go")

    def advance(self, seconds: float) -> None:
        """Let time pass, in stepped time."""
        self._control.order("advance", seconds=seconds)


def words(keys: Mapping[str, Any]) -> list[str]:
    """Keys of ``configs/virtual.yaml`` as on the command line, files as they are called from anywhere."""
    return [f"{key}={_written(_from_here(key, value))}" for key, value in keys.items()]


def _from_here(key: str, value: Any) -> Any:
    """The value; a file's name as it is called from anywhere, since the process runs in the checkout."""
    named = key in ("hidden", "faults", "link") or str(value).endswith((".yaml", ".yml"))
    return str(Path(value).absolute()) if named and isinstance(value, str | Path) else value


def _written(value: Any) -> str:
    """A value as :func:`sealegs.configs.compose.compose` reads it: names in mappings and lists may have any sign."""
    if isinstance(value, Mapping | list | tuple):
        return json.dumps(value, default=str)
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
