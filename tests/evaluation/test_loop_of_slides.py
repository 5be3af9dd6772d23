"""The end of a loop tells and draws the gap of joints that slide as well as that of joints that turn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sealegs.commands import loop
from sealegs.evaluation import picture as comparison_picture

TURNS, SLIDES = "position error, same goals [mrad]", "position error, same goals [mm]"
ROBOTS = {
    "slides only": (
        {"same_goals": None, "same_goals_of_slides": 0.0023},
        "off by 2.3 mm in the nominal model",
        [SLIDES],
    ),
    "turning joints only": ({"same_goals": 0.012, "same_goals_of_slides": None}, "off by 12 mrad in the", [TURNS]),
    "an arm with a gripper": (
        {"same_goals": 0.012, "same_goals_of_slides": 0.0004},
        "off by 12 mrad and 0.4 mm in the nominal model",
        [TURNS, SLIDES],
    ),
    "a comparison of before slides were told": ({"same_goals": 0.012}, "off by 12 mrad in the nominal model", [TURNS]),
}


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures that were drawn."""
    drawn, plain = [], comparison_picture.figure

    def kept(*size: float) -> Any:
        drawn.append(plain(*size))
        return drawn[-1]

    monkeypatch.setattr(comparison_picture, "figure", kept)
    return drawn


@pytest.mark.long
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_gap_is_told_and_drawn_in_the_unit_of_each_kind_of_joint(
    robot: str, images: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot of slides ended a loop in a traceback, and the slides of others were left out."""
    errors, said, labels = ROBOTS[robot]
    figures = {name: {"reward": 3.0, **errors} for name in ("nominal", "extended", "machine")}
    folders = {name: tmp_path / name for name in ("nominal", "extended")}
    for folder in folders.values():
        folder.mkdir()
        (folder / "comparison.json").write_text(json.dumps({"figures": figures}))
    loop.tell(tmp_path, folders)
    assert said in capsys.readouterr().out and (tmp_path / "gap.png").exists()
    (image,) = images
    assert [axes.get_ylabel() for axes in image.axes] == [*labels, "reward per second"]
    for axes, label in zip(image.axes, labels, strict=False):
        error = errors["same_goals" if label == TURNS else "same_goals_of_slides"]
        assert [bar.get_height() for bar in axes.patches] == pytest.approx([1e3 * error] * 4)
