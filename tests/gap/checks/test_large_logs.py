"""Logs that are too long to be held: bounded memory, everything checked, every kind of motion replayed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyarrow import Table, parquet
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.checks.long import MAX_SET_ROWS, count_rows, read_bounded, spread, window_rows
from sealegs.gap.log import LogError
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.parts import WARM_UP, cut
from sealegs.gap.log.types import JointLog, MeasuredRun

from benchmarks.large_log import record

ROWS, HELD = 300_000, 48_000
PEAK = """
import resource, sys
from sealegs.gap.checks.long import read_bounded
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
data = read_bounded(sys.argv[1], int(sys.argv[2]))
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0)
"""


@pytest.fixture(scope="module")
def long_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """25 minutes at 200 Hz whose motion changes kind every 90 s."""
    path = tmp_path_factory.mktemp("long") / "log.parquet"
    record(path, ROWS)
    return path


def test_a_short_log_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    record(path, 3000)
    data = read_bounded(path)
    assert count_rows(path) in (3000, 3001)
    assert len(data.runs) == 1 and len(data.runs[0].time) == 3000 and not data.findings


@pytest.mark.long
def test_a_long_log_becomes_windows_of_every_kind_of_motion(long_log: Path) -> None:
    data = read_bounded(long_log, HELD)
    held = sum(len(run.time) for run in data.runs)
    assert 0.8 * HELD < held <= HELD
    # the kinds of benchmarks.large_log: slow, slow, rest, steps, slow, chirp, slow, multisine
    seen = {int(run.time[len(run.time) // 2] // 90.0) % 8 for run in data.runs}
    assert {2, 3, 5, 7} <= seen and seen & {0, 1, 4, 6}
    (note,) = [finding for finding in data.findings if finding.code == "log.excerpt"]
    assert "300,000" in note.sentence and "All of them were checked" in note.sentence


@pytest.mark.long
def test_each_part_of_the_data_gets_lively_motion_after_a_warm_up(long_log: Path) -> None:
    data = read_bounded(long_log, HELD)
    kinds: dict[int, set[int]] = {part: set() for part in range(3)}
    for unit in cut(data.runs, "servo"):
        run = data.runs[unit.run]
        kinds[unit.part].add(int(run.time[unit.start] // 90.0) % 8)
        assert run.time[unit.start + unit.judged] - run.time[unit.start] >= 0.99 * WARM_UP
    for seen in kinds.values():
        assert 3 in seen and len({5, 7} & seen) > 0 and len(seen) >= 4


@pytest.mark.long
def test_the_samples_of_a_window_are_those_of_the_log(long_log: Path) -> None:
    table = parquet.read_table(long_log).to_pandas()
    for run in read_bounded(long_log, HELD).runs[::5]:
        start, stop = (int(x) for x in run.name.split("[")[1].rstrip("]").split(":"))
        np.testing.assert_array_equal(run.time, table["time"][start:stop])
        np.testing.assert_array_equal(run.joints["servo"].position, table["servo.position"][start:stop])


@pytest.mark.long
def test_a_fault_anywhere_in_a_long_log_is_found(long_log: Path, tmp_path: Path) -> None:
    table = parquet.read_table(long_log).to_pandas()
    table.loc[250_000:, "servo.position"] += 2 * np.pi
    wrapped = tmp_path / "wrapped.parquet"
    parquet.write_table(Table.from_pandas(table, preserve_index=False), wrapped)
    wrapped.with_suffix(".yaml").write_text(long_log.with_suffix(".yaml").read_text())
    assert "position.wrap" in {finding.code for finding in read_bounded(wrapped, HELD).findings}

    table.loc[262_144, "time"] = 3.0  # the first row of the third piece
    backwards = tmp_path / "backwards.parquet"
    parquet.write_table(Table.from_pandas(table, preserve_index=False), backwards)
    backwards.with_suffix(".yaml").write_text(long_log.with_suffix(".yaml").read_text())
    with pytest.raises(LogError, match="backwards in row 262145"):
        read_bounded(backwards, HELD)


@pytest.mark.long
@pytest.mark.parametrize(("unit", "code"), [(180.0 / np.pi, "unit.degrees"), (-1.0, "position.sign")])
def test_a_fault_of_a_whole_long_log_is_mended_once(unit: float, code: str, long_log: Path, tmp_path: Path) -> None:
    table = parquet.read_table(long_log).to_pandas()
    table["servo.position"] *= unit
    wrong = tmp_path / "wrong.parquet"
    parquet.write_table(Table.from_pandas(table, preserve_index=False), wrong)
    wrong.with_suffix(".yaml").write_text(long_log.with_suffix(".yaml").read_text())
    data = read_bounded(wrong, HELD)
    mended, findings = corrected(data, [*data.findings, *check_set(data)])
    assert code in {finding.code for finding in findings}
    for run in mended.runs:
        start, stop = (int(x) for x in run.name.split("[")[1].rstrip("]").split(":"))
        right = table["servo.position"][start:stop] / unit
        np.testing.assert_allclose(run.joints["servo"].position, right, atol=1e-9)


@pytest.mark.long
def test_memory_does_not_grow_with_the_log(long_log: Path, tmp_path: Path) -> None:
    """Reading three times as many rows takes no more memory, beyond what allocators scatter."""
    shorter = tmp_path / "log.parquet"
    record(shorter, ROWS // 3)
    peaks = []
    for path in (shorter, long_log):
        command = [sys.executable, "-c", PEAK, str(path), str(HELD)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3])
        peaks.append(float(done.stdout))
    assert peaks[1] < 1.3 * peaks[0] + 15.0, f"{peaks[0]:.0f} MiB and {peaks[1]:.0f} MiB"


def test_the_findings_of_the_whole_log_reach_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from sealegs.gap.finder.diagnosis import diagnose
    from sealegs.gap.verdict.verdict import UNUSABLE

    from testbed import hidden_bench

    data, _ = hidden_bench({}, 1, runs=1, duration=2.0)
    jumps = Finding("position.spikes", "error", "servo", "servo.position", "The position jumps.", data_error=True)
    (found,) = diagnose(replace(data, findings=(jumps,)))
    assert found.verdict == UNUSABLE and "jumps" in found.text


def test_chosen_windows_leave_no_kind_out() -> None:
    rng = np.random.default_rng(0)
    common, rare = rng.normal(0.0, 1.0, (500, 4)), rng.normal(0.0, 0.1, (3, 4)) + 12.0
    table = np.concatenate([common, rare])
    chosen = spread(table, 30)
    assert len(chosen) == len({k for k, _ in chosen}) == 30
    assert {part for k, part in chosen if k >= 500} == {0, 1, 2}
    assert [k for k, _ in spread(table[:10], 30)] == list(range(10))
    assert MAX_SET_ROWS >= 30


@pytest.mark.parametrize("rate", [200.0, 1000.0, 4000.0, 20_000.0])
def test_a_window_is_long_enough_to_warm_up_whatever_the_rate(rate: float) -> None:
    rows = window_rows(1.0 / rate, MAX_SET_ROWS)
    assert 2.0 * (WARM_UP + WARM_UP) <= rows / rate <= 12.0
    time = np.arange(rows) / rate
    runs = [
        MeasuredRun("log", time, {"servo": JointLog(np.sin(time), np.sin(time))}, robot="bench", meta={"excerpt": part})
        for part in range(3)
    ]
    units = cut(runs, "servo")
    assert sorted(unit.part for unit in units) == [0, 1, 2]
    assert all(unit.judged < 0.6 * rows for unit in units)


@pytest.mark.long
def test_a_fault_of_one_long_log_is_mended_in_that_one_alone(tmp_path: Path) -> None:
    for name, unit in (("a", 1.0), ("b", 180.0 / np.pi)):
        record(tmp_path / f"{name}.parquet", 30_000)
        table = parquet.read_table(tmp_path / f"{name}.parquet").to_pandas()
        table[["servo.position", "servo.goal"]] *= unit
        parquet.write_table(Table.from_pandas(table, preserve_index=False), tmp_path / f"{name}.parquet")
    data = read_bounded(tmp_path, 40_000)
    mended, findings = corrected(data, [*data.findings, *check_set(data)])
    assert "unit.degrees" in {finding.code for finding in findings}
    sizes = {name: max(np.ptp(r.joints["servo"].position) for r in mended.runs if r.name[0] == name) for name in "ab"}
    assert sizes["a"] == pytest.approx(sizes["b"], rel=0.3) and sizes["a"] > 0.5


@pytest.mark.long
def test_logs_of_machines_with_other_joints_are_refused(tmp_path: Path) -> None:
    for name, joint in (("a", "servo"), ("b", "elbow")):
        record(tmp_path / f"{name}.csv", 30_000)
        for file in (tmp_path / f"{name}.csv", tmp_path / f"{name}.yaml"):
            file.write_text(file.read_text().replace("servo", joint))
    with pytest.raises(LogError, match=r"b\.csv has the joints elbow, a\.csv has servo; keep one machine per folder"):
        read_bounded(tmp_path, 40_000)


def test_what_grows_along_a_run_is_in_every_part_of_it() -> None:
    """The fastest sixth of a public arm's chirp was all of its test: what shows only there was never fitted."""
    time = np.arange(0.0, 120.0, 0.02)
    position = 0.1 * np.sin(np.cumsum(0.02 * (0.5 + 0.2 * time)))
    run = MeasuredRun("chirp", time, {"servo": JointLog(goal=position, position=position)})
    ends = [max(time[unit.stop - 1] for unit in cut([run], "servo") if unit.part == part) for part in range(3)]
    assert min(ends) > 105.0
