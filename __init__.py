"""Finds from measured logs what a robot simulation gets wrong, extends the model by it, and trains on the result.

    import sealegs

    diagnosis = sealegs.diagnose("logs/bench")
    diagnosis.save("diagnosis")
    env = sealegs.make_env("bench", extended=diagnosis.extended)

Importing this package registers the environments with Gymnasium and loads nothing heavy.
"""

import importlib
import os
import sys
from typing import TYPE_CHECKING, Any

# Without a screen MuJoCo can draw by EGL only, and it looks when it is imported: here, before anything can import it.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")

from .envs import register_environments

if TYPE_CHECKING:
    from .actuators import load_chain
    from .agents.export import export
    from .common.errors import SealegsError
    from .common.plugins import add as add_plugins
    from .envs.extended import Extended
    from .envs.make import load_robot, make_env
    from .gap.diagnose import diagnose
    from .gap.diagnosis import Diagnosis
    from .gap.fit import fit
    from .gap.log import read_measured as read_log
    from .hw.run.deploy import deploy

__all__ = [
    "Diagnosis",
    "Extended",
    "SealegsError",
    "add_plugins",
    "deploy",
    "diagnose",
    "export",
    "fit",
    "load_chain",
    "load_robot",
    "make_env",
    "read_log",
]

_HOMES = {
    "Diagnosis": ("sealegs.gap.diagnosis", "Diagnosis"),
    "Extended": ("sealegs.envs.extended", "Extended"),
    "SealegsError": ("sealegs.common.errors", "SealegsError"),
    "add_plugins": ("sealegs.common.plugins", "add"),
    "deploy": ("sealegs.hw.run.deploy", "deploy"),
    "diagnose": ("sealegs.gap.diagnose", "diagnose"),
    "export": ("sealegs.agents.export", "export"),
    "fit": ("sealegs.gap.fit", "fit"),
    "load_chain": ("sealegs.actuators", "load_chain"),
    "load_robot": ("sealegs.envs.make", "load_robot"),
    "make_env": ("sealegs.envs.make", "make_env"),
    "read_log": ("sealegs.gap.log", "read_measured"),
}
"""Module and attribute of each public name, loaded when it is first used."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("sealegs")
    if name not in _HOMES:
        raise AttributeError(f"module 'sealegs' has no attribute '{name}'")
    module, attribute = _HOMES[name]
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({"__version__", *__all__, *(name for name in globals() if name.startswith("__"))})


register_environments()
