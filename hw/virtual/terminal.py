"""The pseudo-terminal that stands for the adapter's serial port."""

from __future__ import annotations

import array
import fcntl
import os
import pty
import sys
import termios
import tty
from pathlib import Path

from ...common.errors import SealegsError

TCGETS2 = 0x802C542A  # Linux: termios with numeric speeds


class Terminal:
    """A pseudo-terminal, and optionally a link of a fixed name to it.

    Attributes:
        master: file descriptor of the servos' side.
        path: that clients open.
    """

    def __init__(self, link: Path | None = None) -> None:
        """Open it.

        Raises:
            SealegsError: the link's name is taken by something else, or cannot be made.
        """
        if link is not None and link.exists() and not link.is_symlink():
            raise SealegsError(f"the link {link} would replace a file; choose another name.")
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self._link = link
        name = os.ttyname(self._slave)
        self.path = name
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(name)
            except OSError as error:
                raise SealegsError(f"the link {link} cannot be made: {error.strerror}.") from None
            self.path = str(link)

    def baudrate(self, otherwise: int = 1_000_000) -> int:
        """Speed that the client has set [bit/s]; ``otherwise`` where the system does not say."""
        if sys.platform != "linux":
            return otherwise
        buffer = array.array("I", [0] * 11)
        try:
            fcntl.ioctl(self._slave, TCGETS2, buffer)
        except OSError:
            return otherwise
        return buffer[10]

    def write(self, data: bytes) -> None:
        """Send bytes to the client; those that nobody reads are lost, as on a real line."""
        try:
            os.write(self.master, data)
        except BlockingIOError:
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def close(self) -> None:
        """Hang up: whoever has the port open gets an error."""
        for descriptor in (self._slave, self.master):
            os.close(descriptor)
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()
