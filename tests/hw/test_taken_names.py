"""A log whose name another run takes at the same moment is refused, and the other run's files stay."""

from __future__ import annotations

from pathlib import Path

import pytest
from sealegs.gap.log import LogError
from sealegs.hw.run import measured_log
from sealegs.hw.run.measured_log import MeasuredLog, make_sidecar

OTHERS = "of another run"


@pytest.mark.parametrize("theirs", [("run.yaml", "run.csv"), ("run.yaml",), ("run.csv",)])
def test_files_that_another_run_made_meanwhile_are_not_deleted(
    theirs: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second run that began in the same second deleted table and sidecar of the first."""
    write = measured_log.write_text

    def meanwhile(path: Path, text: str) -> None:
        for name in theirs:
            (tmp_path / name).write_text(OTHERS)
        write(path, text)

    monkeypatch.setattr(measured_log, "write_text", meanwhile)
    with pytest.raises(LogError, match=r"run\.\w+: exists already and a recording is never overwritten; choose"):
        MeasuredLog(tmp_path, "run", make_sidecar("bench", {}, {"a": "sts3215"}, {}), ["a"], ["position"], ())
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(theirs, OTHERS)
