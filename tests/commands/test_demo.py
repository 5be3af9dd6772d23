"""The demo from the log to policies that are tried on the machine."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from sealegs.commands import demo


@pytest.mark.long
def test_the_demo_ends_with_policies_of_both_models_on_the_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "demo"
    demo.main([f"out={out}", "seed=0", "seeds=2", "total_timesteps=4096"])
    said = capsys.readouterr().out
    assert "Hidden in the servo: drive.delay" in said and "drive.delay, delay.seconds" in said
    rows = re.findall(r"(nominal|extended) +model: +(-?\d+) \((-?\d+) to (-?\d+)\)", said)
    assert [name for name, *_ in rows] == ["nominal", "extended"]
    for _, mean, low, high in rows:
        assert int(low) <= int(mean) <= int(high)
    assert (out / "nominal-and-extended.mp4").stat().st_size > 10_000
    assert (out / "extended" / "seed1" / "final" / "policy.onnx").is_file()
