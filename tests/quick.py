"""Which of many like cases `make test` has; the others are for `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def quick(cases: Iterable[Any], every: int) -> list[Any]:
    """All cases for ``pytest.mark.parametrize``, of which every n-th is quick and the others are marked long."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*row, marks=() if k % every == 0 else pytest.mark.long) for k, row in enumerate(rows)]
