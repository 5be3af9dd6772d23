"""``sealegs.deploy``: a policy on servos from Python, with a function of the caller's that says what it is to do."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...common.errors import SealegsError
from ...configs.compose import compose, split
from ..machine.own_robot import READERS
from . import deployment
from .deployment import Run


def deploy(
    policy: str | Path,
    robot: str | Path,
    command: Callable[[float], Any] | Mapping[str, float] | float | str | None = None,
    say: Callable[[str], None] = print,
    **settings: Any,
) -> Run:
    """Run a policy on servos, real or virtual, and log it, as the command ``sealegs deploy`` does.

    Args:
        policy: ONNX file, or a folder with one.
        robot: its name or its file.
        command: what it is asked for: a function from time [s] to numbers or to a mapping by name, called in each cycle
            (keep it short: the loop waits for it), and held within the range of training; or what ``command=`` takes.
        say: prints a line.
        settings: further keys of ``configs/deploy.yaml``, such as ``duration=5.0``, or ``**{"hw.virtual.time":
            "stepped"}``.

    Returns:
        The run: its outcome, and its measured log.

    Raises:
        SealegsError: something does not fit, or the run ended by a fault.
    """
    if settings.get("dry_run"):
        raise SealegsError("dry_run is for the command line: leave it out.")
    words = {"policy": str(policy), "robot": str(robot), **settings}
    given = {key: value if isinstance(value, str) else json.dumps(value) for key, value in words.items()}
    texts = [key for key, value in words.items() if isinstance(value, str)]
    config = compose("deploy", split([f"{key}={value}" for key, value in given.items()], texts), readers=READERS)
    prepared = deployment.prepare({**config, "command": command})
    done = deployment.run(prepared, say)
    assert done is not None
    deployment.report(prepared, done, say)
    return done
