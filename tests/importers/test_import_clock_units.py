"""Clocks without a unit that may be of a slow log or of a fast one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.expression import evaluate

from tests.importers.test_import_units import DEG, table


def motion(time: np.ndarray) -> np.ndarray:
    """A motion [rad] of some seconds."""
    return 0.6 * np.sin(2.0 * time) + 0.2 * np.sin(5.1 * time)


def recorded(period: float, duration: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Time [s], and goal and position of a joint."""
    time = np.arange(0.0, duration, period)
    return time, {"goal": motion(time), "position": motion(time - 0.04)}


@pytest.mark.parametrize(("period", "per"), [(5e-4, 1e3), (1e-4, 1e3), (2.5e-4, 1e6)])
def test_a_clock_of_a_fast_log_is_not_read_as_a_slow_one_in_silence(tmp_path: Path, period: float, per: float) -> None:
    """2 kHz in ms were 2 Hz in s: ten seconds became three hours."""
    time, columns = recorded(period, 1.0)
    (question,) = propose_for(table(tmp_path, {"time": per * time, **columns}), tmp_path / "out").mapping.questions
    unit = {1e3: "ms", 1e6: "us"}[per]
    assert question.about == ("time",) and f"{1.0 / period:.0f} Hz in {unit}" in question.ask
    found = propose_for(table(tmp_path, {f"time_{unit}": per * time, **columns}), tmp_path / "out").mapping
    assert not found.questions


@pytest.mark.parametrize("scale", [1.0, DEG])
@pytest.mark.parametrize(("name", "size"), [("velocity", 1.0), ("velocity", DEG), ("velocity_rpm", 60.0 / (2 * np.pi))])
@pytest.mark.parametrize(("period", "per"), [(5e-4, 1e3), (5e-4, 1e6), (0.1, 1.0), (0.1, 1e3)])
def test_a_velocity_tells_the_unit_of_the_clock(
    tmp_path: Path, period: float, per: float, name: str, size: float, scale: float
) -> None:
    time, columns = recorded(period, 2000 * period)
    slow = period / 0.1 if period < 0.1 else 0.5
    columns = {signal: scale * np.sin(slow * 30.0 * time / (60.0 * slow)) for signal in columns}
    columns["goal"] = scale * np.sin(0.5 * (time + 0.04))
    columns[name] = size * 0.5 * np.cos(0.5 * time)
    found = propose_for(table(tmp_path, {"time": per * time, **columns}), tmp_path / "out")
    asked = [question for question in found.mapping.questions if "time" in question.about]
    assert not asked
    (recording,) = found.recordings
    clock = evaluate(found.mapping.columns["time"], recording.columns, "test")
    assert clock[-1] - clock[0] == pytest.approx(time[-1], rel=1e-6)


def test_a_slow_log_is_told_by_how_far_a_joint_moves_in_a_sample(tmp_path: Path) -> None:
    """At 10 Hz a motion of a second goes far from sample to sample, as in 0.1 ms none does."""
    time, columns = recorded(0.1, 60.0)
    for per in (1.0, 1e3):
        found = propose_for(table(tmp_path, {"time": per * time, **columns}), tmp_path / "out")
        assert not found.mapping.questions and "too far in one sample" in " ".join(found.text.replace("#", "").split())


def test_noise_at_a_high_rate_is_no_slow_log(tmp_path: Path) -> None:
    time, columns = recorded(5e-4, 1.0)
    columns["position"] = columns["position"] + 0.2 * np.random.default_rng(0).normal(size=len(time))
    (question, *_) = propose_for(table(tmp_path, {"time": 1e3 * time, **columns}), tmp_path / "out").mapping.questions
    assert question.about == ("time",)


def test_stamps_since_1970_tell_their_unit(tmp_path: Path) -> None:
    time, columns = recorded(0.1, 300.0)
    columns = {name: motion(0.01 * time) for name in columns}
    for per in (1.0, 1e3):
        stamps = np.round(per * (1.7e9 + time), 3)
        path = tmp_path / "run.csv"
        rows = np.stack([stamps, columns["goal"], columns["position"]], axis=1)
        np.savetxt(path, rows, delimiter=",", header="time,goal,position", comments="", fmt="%.6f")
        found = propose_for(path, tmp_path / "out").mapping
        assert not [question for question in found.questions if "time" in question.about]
        assert found.columns["time"].endswith("*1e-3") == (per > 1.0)
