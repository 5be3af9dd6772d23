"""Where nothing is hidden, ``evaluate`` says that there is no gap: of every robot with its committed policy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from sealegs.hw import comparison
from sealegs.hw.commands import PolicyCommands
from sealegs.hw.comparison import compare, verdict
from sealegs.hw.deployment import Deployment

from tests.committed_policies import committed
from tests.servo_runs import config
from tests.simulated_runs import Simulation


@pytest.mark.long
@pytest.mark.parametrize(("robot", "seconds"), [("hopper", 4.0), ("biped", 3.0), ("hexapod", 2.0)])
def test_a_machine_that_hides_nothing_has_no_gap(
    robot: str, seconds: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulated(prepared: Deployment, say: Callable[[str], None]) -> tuple[str, Path]:
        """The machine in this process, on the clock of its own line: other programs do not delay it."""
        del say
        commands = prepared.commands
        assert isinstance(commands, PolicyCommands)
        run = Simulation(robot, commands=lambda _: commands, rate=prepared.rate, folder=tmp_path, pose=commands.pose)
        outcome = run.run(prepared.duration)
        assert run.log is not None
        return outcome.ending if outcome.fault is None else outcome.fault.sentence, run.log.path

    monkeypatch.setattr(comparison, "on_machine", simulated)
    settings = config(f"robot={robot}", patient=False)
    settings |= {"policy": str(committed(robot).path), "nominal": None, "extended": None, "seconds": seconds, "seed": 0}
    found = compare(settings, tmp_path, lambda _: None)
    assert found.ending == "finished"
    nominal = found.figures["nominal"]
    assert nominal.gap is None, (nominal.gap, nominal.gap_at)
    assert verdict(nominal).startswith("no gap") and nominal.departs is None
