"""A share is what the final model owes to a part by its effect, and the tuned numbers are a part."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.reader import read_measured
from sealegs.gap.measure.shares import by_effect
from sealegs.gap.output.pictures.first_look import budget_slices
from sealegs.gap.virtual.bench import LOADS, record

DELAY = 0.0225  # [s]
SHOWN = ("steps", "multisine", "slow triangle")


@pytest.mark.long
def test_a_delay_that_is_all_of_the_gap_gets_all_of_what_is_explained(tmp_path: Path) -> None:
    """Tuned numbers took a third of it: alone, they imitate a delay; beside it, they stay where they were."""
    record(tmp_path, "sv1270tg", {"delay.seconds": DELAY}, seed=0, loads=LOADS[:1], excitations=SHOWN)
    (found,) = diagnose(read_measured(tmp_path), causes=("drive.delay", "friction.viscous"))
    (delay,) = found.causes
    assert delay.name == "drive.delay"
    assert delay.parameters["delay.seconds"].value == pytest.approx(DELAY, rel=0.03)
    assert delay.share > 0.95 * (1.0 - found.unexplained)
    assert delay.share + found.tuned_share + found.unexplained == pytest.approx(1.0)
    slices = {piece.label: piece.share for piece in budget_slices(found)}
    assert slices["drive.delay"] > 20.0 * slices.get("tuned numbers", 0.0)


def test_a_part_has_its_share_by_how_far_it_moves_the_replay_whatever_would_make_up_for_it() -> None:
    """Of a gain and an offset that moved a hip by 38 and 37 mrad, the offset had 73 % and the gain 26 %."""

    def simulate(rows: list[dict[str, float]]) -> np.ndarray:
        return np.array(
            [[row.get("gain", 0.0), row.get("offset", 0.0), row.get("a", 0.0) + row.get("b", 0.0)] for row in rows]
        )

    problem: Any = SimpleNamespace(simulate=simulate, position_error=lambda row: row)
    values = {"gain": 4.0, "offset": 2.0, "a": 3.0, "b": -2.0}
    assert by_effect(problem, values, [{"gain"}, {"offset"}, {"a", "b"}]) == pytest.approx([16 / 21, 4 / 21, 1 / 21])
    assert by_effect(problem, {}, [set(), set()]) == pytest.approx([0.0, 0.0])
