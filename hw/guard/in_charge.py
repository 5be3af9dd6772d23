"""Who watches servos: of several processes that could, the one whose run switched their torque on last.

Held servos are watched on after their run. The next run on them gets a supervisor of its own: two would take turns at
the port, and the older one could release what the newer one was told to hold. So each leaves its mark in a file.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import uuid
from collections.abc import Sequence
from pathlib import Path

from ...common.atomic import write_text
from ..bus.adapters import Whereabouts
from .supervisor import Charge


class InCharge:
    """The claim of one process on the servos of one bus.

    It holds among the processes of one user, on the same servos behind the same adapter, or the same name of a port
    where the system does not know the adapter. Elsewhere, or without a place for files, several watch as if each were
    alone.
    """

    def __init__(self, adapter: str, ids: Sequence[int], folder: Path | None = None) -> None:
        """Claim nothing yet; ``folder``: for the file, None: that of temporary ones."""
        servos = f"{adapter} {sorted(ids)} {os.getuid()}"
        place = Path(tempfile.gettempdir()) if folder is None else folder
        self._path = place / f".sealegs-{hashlib.sha256(servos.encode()).hexdigest()[:16]}"
        self._mark = uuid.uuid4().hex
        self._claimed = False

    def claim(self) -> None:
        """From now on these servos are this process's."""
        with contextlib.suppress(OSError):
            write_text(self._path, self._mark, replace=True)
            self._claimed = True

    @property
    def lost(self) -> bool:
        """Whether another process has claimed them since."""
        if not self._claimed:
            return False
        try:
            return self._path.read_text(encoding="utf-8") != self._mark
        except (OSError, UnicodeDecodeError):  # temporary files are cleared away now and then
            return False


def claims(charge: Charge) -> dict[str, InCharge]:
    """A claim on the servos of each bus, by its name; none on a virtual machine, which ends with its run."""
    if not charge.lasting:
        return {}
    rows = [("", charge.port, charge.ids), *((row["bus"], row["port"], row["ids"]) for row in charge.others)]
    homes = {name: charge.homes.get(name, Whereabouts(port)) for name, port, _ in rows}
    return {name: InCharge(homes[name].name, ids) for name, _, ids in rows if ids}
