"""The page about thresholds is decided again from records alone."""

from __future__ import annotations

import json

import pytest
from sealegs.gap.search.settings import DEFAULT, SearchSettings

from benchmarks.sensitivity import RECORDS, RESULTS, disagreeing, page, tally

ROWS = [json.loads(line) for line in RECORDS.read_text().splitlines()]


def test_records_decided_again_with_the_same_settings_give_the_names_of_their_searches() -> None:
    assert ROWS and disagreeing(ROWS) == []


@pytest.mark.long
def test_the_committed_page_is_what_the_records_and_the_settings_say_now() -> None:
    written = (RESULTS / "sensitivity.md").read_text(encoding="utf-8")
    assert written == page(ROWS), "python -m benchmarks.sensitivity"


def test_each_threshold_is_halved_and_doubled_and_the_page_has_it() -> None:
    text = page(ROWS[:2])
    for name in SearchSettings.deciding():
        assert f"| `{name}` |" in text
        assert DEFAULT.scaled(name, 0.5) != DEFAULT != DEFAULT.scaled(name, 2.0)


def test_thresholds_that_nothing_passes_name_nothing() -> None:
    found = tally(ROWS, SearchSettings(least_removed=1e6))
    assert (found.right, found.false, found.nulls) == (0, 0, 0)
