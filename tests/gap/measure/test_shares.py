"""A share is what the final model owes to a part: all else is refitted without it, and the tuned numbers are a part."""

from __future__ import annotations

from pathlib import Path

import pytest
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.reader import read_measured
from sealegs.gap.measure.shares import Owed
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


def test_shares_split_what_is_explained_by_how_much_each_part_is_missed() -> None:
    debts = Owed(causes=(6.0, 3.0), tuned=1.0, without=(7.0, 4.0))
    shares, tuned = debts.shares(0.8)
    assert shares == pytest.approx((0.48, 0.24)) and tuned == pytest.approx(0.08)


def test_parts_that_nobody_misses_share_alike() -> None:
    assert Owed(causes=(0.0, 0.0), tuned=0.0, without=(1.0, 1.0)).shares(0.5) == ((0.25, 0.25), 0.0)
