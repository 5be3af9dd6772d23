"""A key that stands twice in a YAML file that people write is refused: YAML keeps the last and drops the others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sealegs.actuators import load_chain
from sealegs.common.documents import parse_yaml
from sealegs.common.errors import SealegsError
from sealegs.envs.engine.randomization import read_randomization
from sealegs.gap.log.importers.mapping import read_mapping
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.hw.virtual.faults import read_faults
from sealegs.hw.virtual.hidden import hide


def hidden(path: Path) -> object:
    robot: Any = None
    return hide(robot, {}, {}, str(path))


@pytest.mark.parametrize(
    ("read", "text", "key"),
    [
        (load_chain, "- delay: {seconds: 0.01}\n- friction:\n    coulomb: 0.1\n    coulomb: 0.2\n", "coulomb"),
        (
            read_sidecar,
            "robot: bench\nrobot_params: {mass: 0.1, length: 0.1}\nrobot_params: {mass: 0.2}\n",
            "robot_params",
        ),
        (read_mapping, "columns:\n  time: t\n  arm.position: a\n  arm.position: b\n", "arm.position"),
        (hidden, "delay.seconds: 0.01\ndelay.seconds: 0.02\n", "delay.seconds"),
        (read_faults, "- kind: drop\n  at: 2.0\n  at: 3.0\n", "at"),
        (read_randomization, "floor: {friction: [0.6, 1.0]}\nfloor: {friction: [0.1, 1.0]}\n", "floor"),
    ],
)
def test_it_is_refused_with_the_lines(read: Callable[[Path], Any], text: str, key: str, tmp_path: Path) -> None:
    path = tmp_path / "written.yaml"
    path.write_text(text)
    with pytest.raises(SealegsError, match=f"'{key}' stands twice, in lines? [0-9]") as said:
        read(path)
    assert "\n" not in str(said.value) and "unicode string" not in str(said.value)


def test_what_several_places_share_may_be_merged_and_overridden() -> None:
    text = "a: &a {x: 1, y: 2}\nb: &b {<<: *a, y: 3}\nc: {<<: [*a, *b], x: 4}\n"
    assert parse_yaml(text) == {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": {"x": 4, "y": 2}}
