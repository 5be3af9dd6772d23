"""What several test files share: one folder for what is made once, laws that are compiled once, one core per worker."""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
import zlib
from pathlib import Path

import sealegs  # isort: skip  # noqa: F401 chooses how MuJoCo draws, before that is imported
import mujoco
import pytest

from tests.compile_laws import compile_laws
from tests.made_once import SHARED

REPOSITORY = Path(__file__).resolve().parents[1]
WORKER = "PYTEST_XDIST_WORKER" in os.environ


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--share",
        metavar="K/N",
        help="run the K-th (from 0) of N shares; a test is always of the same one",
    )


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before any worker starts: the folder that they share, and the laws compiled, which each would do on its own."""
    if WORKER:
        return
    os.environ[SHARED] = tempfile.mkdtemp(prefix="sealegs-tests-")
    if session.config.getoption("numprocesses", None):
        for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):  # a worker per core: more threads would wait for each other
            os.environ.setdefault(f"{library}_NUM_THREADS", "1")
        compile_laws()


def pytest_unconfigure() -> None:
    if not WORKER and (folder := os.environ.pop(SHARED, None)):
        shutil.rmtree(folder, ignore_errors=True)


def in_share(name: str, share: str) -> bool:
    which, of = (int(number) for number in share.split("/"))
    return zlib.crc32(name.encode()) % of == which


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """A weekly test is a long one; of all tests, the share that was asked for."""
    for item in items:
        if item.get_closest_marker("weekly"):
            item.add_marker(pytest.mark.long)
    if share := config.getoption("share"):
        others = [item for item in items if not in_share(item.nodeid, share)]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in set(others)]


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
