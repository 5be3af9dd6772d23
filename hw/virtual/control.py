"""Control channel of the virtual bus: one JSON object a line over a local socket, an answer for each."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import tempfile
from collections.abc import Callable, Sequence
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
