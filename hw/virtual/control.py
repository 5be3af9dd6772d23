"""Control channel of the virtual bus: one JSON object a line over a local socket, an answer for each."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...common.documents import parse_json
from ...common.errors import SealegsError

Handler = Callable[[dict[str, Any]], dict[str, Any]]


class ControlSocket:
    """The server's end."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp(prefix="virtual-bus-")
        self.path = os.path.join(self._folder, "control")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(self.path)
        self._listener.listen()
        self._peers: dict[socket.socket, bytes] = {}

    def readers(self) -> list[Any]:
        """Sockets to wait for."""
        return [self._listener, *self._peers]

    def serve(self, ready: Sequence[Any], handle: Handler) -> None:
        """Answer what has come in on the sockets that are ready."""
        if self._listener in ready:
            self._peers[self._listener.accept()[0]] = b""
        for peer in [peer for peer in self._peers if peer in ready]:
            try:
                data = peer.recv(65536)
                if not data:
                    raise OSError("closed")
                *lines, self._peers[peer] = (self._peers[peer] + data).split(b"\n")
                for line in lines:
                    peer.sendall(json.dumps(_answer(line, handle)).encode() + b"\n")
            except OSError:
                peer.close()
                del self._peers[peer]

    def close(self) -> None:
        """Close, and remove the socket's file."""
        for item in (self._listener, *self._peers):
            item.close()
        with contextlib.suppress(OSError):
            os.unlink(self.path)
            os.rmdir(self._folder)


def _answer(line: bytes, handle: Handler) -> dict[str, Any]:
    try:
        order = parse_json(line, "the order")
        return handle(order) if isinstance(order, dict) else {"error": "an order is a mapping with its name as 'do'."}
    except (ValueError, TypeError) as error:  # a SealegsError is a ValueError
        return {"error": str(error)}


class Control:
    """The client's end, for tests and for people who plant faults."""

    def __init__(self, path: str | Path) -> None:
        """Connect.

        Raises:
            SealegsError: nobody listens there.
        """
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            raise SealegsError(f"no virtual bus listens at {path} ({error.strerror}); start one.") from None
        self._file = self._socket.makefile("rwb")

    def order(self, do: str, **arguments: Any) -> dict[str, Any]:
        """Give an order and return its answer.

        Raises:
            SealegsError: the virtual bus refuses it, or is gone.
        """
        try:
            self._file.write(json.dumps({"do": do, **arguments}).encode() + b"\n")
            self._file.flush()
            line = self._file.readline()
        except OSError:
            line = b""
        if not line:
            raise SealegsError("the virtual bus has ended; start it again.")
        answer = parse_json(line)
        if "error" in answer:
            raise SealegsError(answer["error"])
        return answer

    def close(self) -> None:
        """Hang up."""
        self._file.close()
        self._socket.close()


# --- starts a virtual bus in a process of its own, from Python -------------------------------------------------------

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
