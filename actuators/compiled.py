"""How the laws are compiled: by numba, once per version of their sources.

numba keeps compiled functions on disk, but looks only at the file that a function stands in: a law that calls a changed
stage would silently stay the old one. So the folder of compiled code carries a digest of this whole package, and of the
replays without an engine that call it.
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path

import numba

PACKAGE = Path(__file__).resolve().parent
REPLAYS = ("joint_model.py", "simulator.py", "driven_simulator.py")  # of the package gap: constants are compiled in


def _sources_digest() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in [*sorted(PACKAGE.rglob("*.py")), *(PACKAGE.parent / "gap" / "replay" / name for name in REPLAYS)]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


numba.config.CACHE_DIR = os.path.join(  # type: ignore[attr-defined]
    os.environ.get("NUMBA_CACHE_DIR") or PACKAGE / "__pycache__", f"laws-{_sources_digest()}"
)

# error_model: a division by zero gives infinity as in C; the check for it would cost a branch at every division
compiled = functools.partial(numba.njit, cache=True, error_model="numpy")
