"""Processes that work for another one: all end with what they work for."""

from __future__ import annotations

import multiprocessing
import time

import pytest
from sealegs.common.processes import worker_pool

from tests.waiting import wait_until


def test_no_process_of_a_pool_outlives_an_interrupt() -> None:
    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt), worker_pool(2) as pool:
        jobs = [pool.submit(time.sleep, 3600.0) for _ in range(2)]
        wait_until(lambda: all(job.running() for job in jobs))
        raise KeyboardInterrupt
    wait_until(lambda: not set(multiprocessing.active_children()) - before)
