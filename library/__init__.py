"""Finds what a robot simulation gets wrong from measured data, extends the model by it, and trains on the truth.

Importing this package registers the environments with Gymnasium and loads nothing heavy.
"""

import os
import sys

# Without a screen MuJoCo can draw by EGL only, and it looks when it is imported: here, before anything can import it.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")

from sealegs.envs import register_environments

register_environments()
