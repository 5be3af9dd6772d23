"""The ways of a user with Dynamixels: calibration by hand, and a diagnosis of what the bus logged."""

from __future__ import annotations

import functools
import io
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.configs.script import run
from sealegs.envs.bench.robot import BENCH
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log import read_measured
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.machine import calibration
from sealegs.hw.machine.calibration_file import read_joints
from sealegs.hw.machine.robot import ServoRobot
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.virtual.server import Server

from tests.simulated_dynamixels import RATE, wired
from tests.simulated_runs import Simulation
from tests.waiting import wait_until

CHAIN = ("robot.servo=xl330_m288", "robot.actuator=xl330", "robot.params.mass=0.05", "robot.params.length=0.05")
QUIET = {"speed": 99.0, "range_margin": 9.0, "following_error": 9.0}


@pytest.mark.long
def test_a_joint_with_a_dynamixel_is_calibrated_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``sealegs calibrate`` on the virtual bus; the servo's own motor stands in for the hand."""
    monkeypatch.setattr("sealegs.hw.machine.calibration.MOVED", 0.03)
    buses: list[ServoBus] = []
    readings: list[int] = []
    scan, read = ServoBus.scan, ServoBus.read_register

    def near(self: ServoBus) -> dict[int, int]:  # the others are known to be absent, and cost time
        buses.append(self)
        return scan(self, range(4))

    def counted(self: ServoBus, servo: int, name: str) -> int:
        readings.append(value := read(self, servo, name))
        return value

    patient = functools.partial(ServoBus, timeout=1.0)  # other programs may hold the machine for longer than a servo
    monkeypatch.setattr("sealegs.hw.bus.servo_bus.ServoBus", patient)
    monkeypatch.setattr(ServoBus, "scan", near)
    monkeypatch.setattr(ServoBus, "read_register", counted)

    def push(angle: float) -> None:
        bus = buses[-1]
        bus.torque_on([1])
        bus.write_goals([1], [angle])
        for _ in range(120):  # the machine moves while bytes are on the wire
            bus.read_state([1])

    def sweep() -> None:
        for angle in (-0.8, 0.8):
            push(angle)
            seen = len(readings)
            wait_until(lambda seen=seen: len(readings) >= seen + 2)  # whoever watches has seen it there

    script = [lambda: push(0.0), lambda: push(0.5), sweep]  # 0 rad, its positive direction, from stop to stop

    class Person(io.StringIO):
        def readline(self, size: int = -1, /) -> str:
            script.pop(0)()
            return "\n"

    monkeypatch.setattr("sys.stdin", Person())
    out = tmp_path / "bench.yaml"
    with Server(wired("bench"), stepped=True) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        words = ["robot=bench", "robot.servo=xl330_m288", f"port={server.port}", f"baudrate={RATE}", f"out={out}"]
        status = run(calibration.main, "calibrate", "", words)
        server.stop()
        thread.join(5.0)
    assert status == 0, capsys.readouterr().err
    (joint,) = read_joints(out, BENCH, load_model("xl330_m288"))
    assert (joint.id, joint.direction, joint.homing_offset) == (1, 1, 0) and abs(joint.zero - 2048) < 20
    # told to go to 0.8 rad, the weak servo swings its load about as far, a little more or less each time
    assert -1.2 < joint.low < -0.3 and 0.3 < joint.high < 1.2
    assert yaml.safe_load(out.read_text())["servo"] == "xl330_m288"


def motion(seed: int) -> Trajectory:
    """A sum of sines, then steps [rad]."""
    random, at = np.random.default_rng(seed), np.arange(0.0, 12.0, 0.01)
    waves = [
        random.uniform(0.1, 0.35) * np.sin(2.0 * np.pi * hertz * at + random.uniform(0.0, 6.0))
        for hertz in (0.2, 0.5, 1.1, 2.3)
    ]
    goal = np.sum(waves, axis=0)
    goal[at > 7.0] = 0.4 * np.sign(np.sin(np.pi * at[at > 7.0]))
    return Trajectory("motion", at, goal[:, None])


@pytest.mark.long
def test_friction_hidden_in_a_virtual_dynamixel_is_named_from_its_log(tmp_path: Path) -> None:
    hidden = tmp_path / "hidden.yaml"
    hidden.write_text("friction.coulomb: 0.05\n")  # the chain believes 0.02
    logs = tmp_path / "logs"
    logs.mkdir()
    for k in range(3):
        folder = tmp_path / str(k)

        def moved(robot: ServoRobot, seed: int = k) -> Trajectory:
            return motion(seed)

        simulation = Simulation("bench", *CHAIN, commands=moved, folder=folder, hidden=str(hidden), limits=QUIET)
        assert simulation.run(10.0).ending == "finished"
        for file in folder.iterdir():
            shutil.copy(file, logs / file.name.replace("run", f"run{k}"))
    data = read_measured(logs)
    found = diagnose(data, causes=["friction.coulomb", "friction.viscous", "drive.delay"]).joint("joint")
    assert found.verdict == "explained", found
    causes = {cause.name: cause for cause in found.causes}
    assert causes["friction.coulomb"].parameters["friction.coulomb"].value == pytest.approx(0.05, rel=0.1)
    late = causes.pop("drive.delay", None)  # of the goals' bytes on the wire
    assert late is None or late.parameters["delay.seconds"].value < 1.5e-3
    assert set(causes) == {"friction.coulomb"}
