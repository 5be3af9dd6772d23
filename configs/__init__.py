"""Configs: one folder per choice, one file per script, and the code that reads them."""

import os
import sys

# Without a screen MuJoCo can draw by EGL only. It reads this when it is imported, so it stands where scripts begin.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")
