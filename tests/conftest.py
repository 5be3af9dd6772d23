"""What several test files share: the measured data folder, and a skip where nothing can be drawn."""

from __future__ import annotations

import functools
from pathlib import Path

import sealegs  # isort: skip  # noqa: F401 chooses how MuJoCo draws, before that is imported
import mujoco
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder with logs of real servos, which the project does not ship."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs the measured logs in {folder.parent.name}/{folder.name} beside the checkout")
    return folder


@functools.cache
def _drawing_fails_because() -> str | None:
    try:
        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
    except Exception as error:  # each OpenGL back end raises its own
        return str(error) or type(error).__name__
    return None


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("rendering") and (reason := _drawing_fails_because()):
        pytest.skip(f"MuJoCo cannot draw here ({reason}); on Debian, `apt-get install libegl1` helps")
