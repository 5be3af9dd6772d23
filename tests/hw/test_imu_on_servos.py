"""IMUs and contact switches of robots: policies that need them, lines, chips, refusals."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.common.extras import MissingPackage
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.bus.imu import GRAVITY, ImuError, ThreadedImu, Tilt
from sealegs.hw.bus.imu_chips import CHIPS, PLAIN, LineFormat, LineImu, checked_part, open_imu
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.server import Terminal

from tests.logged_robots import FEET, switched_file
from tests.servo_runs import PATIENT, gentle_policy
from tests.waiting import wait_until

ROBOTS = Path(__file__).resolve().parents[1] / "robots"
DOG, STAND = ROBOTS / "dog.yaml", f"{ROBOTS / 'stand.py'}:Stand"
STEPPED = "hw.virtual.time=stepped"


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    return gentle_policy(path, STAND, robot=str(DOG), action_delay=0.0)


def run(policy: Path, folder: Path, *arguments: str, robot: Path = DOG) -> int:
    """Exit status of a deployment."""
    words = [f"policy={policy}", f"task={STAND}", f"robot={robot}", f"out={folder}", "name=run", *PATIENT, *arguments]
    return run_script(deploy.main, "deploy", "", [*words, *([] if "duration" in str(arguments) else ["duration=2"])])


def changed(folder: Path, **keys: Any) -> Path:
    """The dog's file with other keys; None takes one out."""
    document = {**yaml.safe_load(DOG.read_text()), "model": str(ROBOTS / "dog.xml"), "name": "dog", **keys}
    path = folder / "dog.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in document.items() if value is not None}))
    return path


def test_the_contract_says_that_the_policy_needs_to_know_how_the_base_turns(policy: Path) -> None:
    sensors = Policy(policy, STAND).contract.sensors
    assert sensors == ("floating_base.roll", "floating_base.pitch", "floating_base.yaw")


def test_a_policy_with_tilt_and_turn_rate_runs_and_its_log_has_what_the_imu_said(policy: Path, tmp_path: Path) -> None:
    assert run(policy, tmp_path, STEPPED) == 0
    log = read_measured(tmp_path / "run.csv").runs[0]
    turn = np.stack([log.base[f"imu.{key}"] for key in "wxyz"], axis=1)
    assert np.isfinite(turn[1:]).all() and np.abs(np.linalg.norm(turn[1:], axis=1) - 1.0).max() < 1e-5
    lean = Rotation.from_quat(turn[1:], scalar_first=True).apply([0.0, 0.0, 1.0])[:, 2]
    assert lean.min() > 0.95, "it stands"
    assert (np.abs(log.base["imu.age"][1:]) < 0.02).all() and log.meta["imu"]["site"] == "imu"


def test_a_robot_without_an_imu_is_refused_with_what_to_write(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(policy, tmp_path, STEPPED, robot=changed(tmp_path, imu=None)) == 2
    said = capsys.readouterr().err
    assert "an IMU gives floating_base.roll, floating_base.pitch, floating_base.yaw" in said
    assert "imu: {rate: 100}" in said


def test_a_policy_that_was_trained_before_the_robot_had_an_imu_runs_with_one(tmp_path: Path) -> None:
    """A walking policy was refused: its tilt and turn rate had to come from encoders with ids of servos."""
    bare = changed(tmp_path, imu=None)
    trained = gentle_policy(tmp_path / "policy.onnx", STAND, robot=str(bare))
    bare.unlink()
    assert run(trained, tmp_path / "log", STEPPED, "duration=0.2") == 0


def test_a_run_ends_where_the_imu_falls_silent(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "faults.yaml").write_text("- {kind: imu_silence, at: 1.5}\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.faults={tmp_path / 'faults.yaml'}", "duration=5") == 2
    assert "STOP: the IMU gave no sample for" in capsys.readouterr().err
    events = {event["event"]: event for event in read_events(tmp_path / "run.csv")}
    assert events["fault"]["name"] == "imu" and "at rest" in events


def test_a_short_silence_is_borne(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "faults.yaml").write_text("- {kind: imu_silence, at: 1.5, seconds: 0.04}\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.faults={tmp_path / 'faults.yaml'}") == 0
    empty = np.isnan(read_measured(tmp_path / "run.csv").runs[0].base["imu.w"])
    assert 1 <= empty[1:].sum() <= 4, "rows without a new sample have none"


def test_a_robot_that_falls_is_released(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(policy, tmp_path, STEPPED, "robot.imu.fallen=0.001") == 2
    said = capsys.readouterr().err
    assert "the robot has fallen: it leans by" in said and "0.001 rad are tolerated" in said and "released" in said


def test_the_machine_may_hide_that_its_imu_is_turned(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "hidden.yaml").write_text("imu.rotation: [0.0, 0.2, 0.0]\nimu.noise.orientation: 0.0\n")
    for name, more in (("plain", []), ("turned", [f"hw.virtual.hidden={tmp_path / 'hidden.yaml'}"])):
        assert run(policy, tmp_path / name, STEPPED, "robot.imu.bias.orientation=0", "duration=0.5", *more) == 0
    pitch = []
    for name in ("plain", "turned"):
        log = read_measured(tmp_path / name / "run.csv").runs[0]
        turn = Rotation.from_quat(np.stack([log.base[f"imu.{k}"][1:] for k in "wxyz"], axis=1), scalar_first=True)
        pitch.append(turn.inv().apply([0.0, 0.0, -1.0])[5])
    # the site is turned by a quarter: a turn about the IMU's y axis is one about the base's -x axis
    assert pitch[1][1] - pitch[0][1] == pytest.approx(np.sin(0.2), abs=0.03)
    assert abs(pitch[1][0] - pitch[0][0]) < 0.03


@pytest.mark.parametrize(
    "line", ["imu.dely: 0.1", "imu.delay: -1", "imu.delay: 20", "imu.rotation: 3", "imu.rotation: [0, 0, 90]"]
)
def test_what_no_imu_hides_is_refused(
    policy: Path, tmp_path: Path, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "hidden.yaml").write_text(line + "\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.hidden={tmp_path / 'hidden.yaml'}") == 2
    said = capsys.readouterr().err
    assert "imu." in said and said.strip().count("\n") == 0


@pytest.mark.long
def test_in_real_time_the_samples_come_over_a_serial_line(policy: Path, tmp_path: Path) -> None:
    assert run(policy, tmp_path, "robot.imu.silent=2.0") == 0
    log = read_measured(tmp_path / "run.csv").runs[0]
    assert np.isfinite(log.base["imu.w"]).mean() > 0.5


TURN = Rotation.from_euler("ZYX", [0.3, -0.2, 0.1])
W, X, Y, Z = TURN.as_quat(scalar_first=True)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    found = Terminal()
    yield found
    found.close()


class Sender:
    """Sends a text over a terminal, again and again, as an IMU does."""

    def __init__(self, terminal: Terminal, text: str) -> None:
        self.text, self._terminal, self._end = text.encode(), terminal, threading.Event()
        self._thread = threading.Thread(target=self._send)

    def _send(self) -> None:
        while not self._end.wait(0.005):
            self._terminal.write(self.text)

    def __enter__(self) -> Sender:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()


LINES = {
    "quaternion": (PLAIN, f"{W:.6f}, {X:.6f}, {Y:.6f}, {Z:.6f}, 0.1, -0.2, 0.3\n"),
    "angles in degrees": (
        "roll [deg], pitch [deg], yaw [deg], turn_x [deg/s], turn_y [deg/s], turn_z [deg/s]",
        f"{np.degrees(0.1):.5f},{np.degrees(-0.2):.5f},{np.degrees(0.3):.5f},5.729578,-11.459156,17.188734\r\n",
    ),
    "a word, a checksum and numbers of no use": (
        "$IMU, yaw, pitch, roll, _, turn_x, turn_y, turn_z",
        "$OTHER,1,2,3\n$IMU,0.3,-0.2,0.1,99,0.1,-0.2,0.3*5E\n",
    ),
    "blanks": ("w x y z turn_x turn_y turn_z", f"{W:.6f} {X:.6f} {Y:.6f}  {Z:.6f} 0.1 -0.2 0.3\n"),
}


@pytest.mark.parametrize("kind", LINES)
def test_lines_over_a_serial_port_are_read_as_their_format_says(kind: str, terminal: Terminal) -> None:
    line, text = LINES[kind]
    with Sender(terminal, text):
        imu = open_imu({"name": "serial", "port": terminal.path, "line": line}, 100.0)
        try:
            sample = imu.latest()
        finally:
            imu.close()
    assert sample is not None
    assert Rotation.from_quat(sample.orientation, scalar_first=True).as_matrix() == pytest.approx(
        TURN.as_matrix(), abs=1e-5
    )
    assert sample.turn_rate == pytest.approx([0.1, -0.2, 0.3], abs=1e-6)


def test_an_orientation_is_worked_out_where_the_line_has_none(terminal: Terminal) -> None:
    pull = TURN.inv().apply([0.0, 0.0, 1.0])
    text = ", ".join(f"{value:.6f}" for value in (*pull, 0.0, 0.0, 0.0)) + "\n"
    line = "acc_x [g], acc_y [g], acc_z [g], turn_x, turn_y, turn_z"
    with Sender(terminal, text):
        imu = LineImu(terminal.path, 115_200, line, 100.0)
        sample = imu.latest()
        imu.close()
    assert sample is not None
    found = Rotation.from_quat(sample.orientation, scalar_first=True)
    assert found.inv().apply([0.0, 0.0, 1.0]) == pytest.approx(pull, abs=1e-5)


def test_torn_lines_and_noise_are_passed_over(terminal: Terminal) -> None:
    _, text = LINES["quaternion"]
    with Sender(terminal, "0.1, 0.2\n\xff\xfe\n, , , , , ,\n" + text[:20] + "\n" + text):
        imu = LineImu(terminal.path, 115_200, PLAIN, 100.0)
        sample = imu.latest()
        imu.close()
    assert sample is not None and sample.turn_rate == pytest.approx([0.1, -0.2, 0.3])


def test_lines_of_another_format_are_shown_in_the_refusal(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.bus.imu.FIRST", 0.3)
    with Sender(terminal, "1.0; 2.0; 3.0\n"), pytest.raises(ImuError, match=r"no sample .* '1\.0; 2\.0; 3\.0'"):
        LineImu(terminal.path, 115_200, PLAIN, 100.0)


def test_an_imu_that_says_nothing_is_refused(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.bus.imu.FIRST", 0.2)
    with pytest.raises(ImuError, match=r"the IMU at /.* gave no sample in 0\.2 s"):
        LineImu(terminal.path, 115_200, PLAIN, 100.0)


def test_a_port_that_is_pulled_out_leaves_the_last_sample_and_says_why() -> None:
    terminal = Terminal()
    with Sender(terminal, LINES["quaternion"][1]):
        imu = LineImu(terminal.path, 115_200, PLAIN, 100.0)
    terminal.close()
    try:
        wait_until(lambda: imu.problem() != "")
        assert imu.latest() is not None
    finally:
        imu.close()


@pytest.mark.parametrize(
    ("line", "refused"),
    [
        ("w, x, y, z", "it needs turn_x, turn_y, turn_z"),
        ("turn_x, turn_y, turn_z", "how the IMU is turned"),
        ("w, x, y, z, turn_x [rpm], turn_y, turn_z", r"turn_x in 'rpm' is not known"),
        ("w, x, y, z, turn_x [deg], turn_y, turn_z", r"turn_x in 'deg' is not known.*give rad/s"),
    ],
)
def test_a_line_that_tells_too_little_is_refused(line: str, refused: str) -> None:
    with pytest.raises(ImuError, match=refused):
        LineFormat.read(line)


@pytest.mark.parametrize(
    ("part", "refused"),
    [
        ({}, r"imu\.part\.name is missing.*bno055.*serial"),
        ({"name": "bno05"}, r"did you mean 'bno055'"),
        ({"name": "bno055", "port": "x"}, r"imu\.part\.port is unknown; there are name, bus, address"),
        ({"name": "serial"}, r"imu\.part\.port is missing"),
        ({"name": "serial", "port": "/nowhere"}, "the port /nowhere of the IMU cannot be opened"),
    ],
)
def test_a_part_that_is_none_is_refused(part: dict[str, Any], refused: str) -> None:
    with pytest.raises(SealegsError, match=refused):
        open_imu(part, 100.0)


# --- chips: stand-ins with the attributes of Adafruit's drivers ------------------------------------------------------


class Driver(SimpleNamespace):
    """A driver of a chip that is turned, and says now and then that it has nothing."""

    def __init__(self, bus: Any, address: int) -> None:
        super().__init__(bus=bus, address=address, asked=0, enabled={}, mode=None)

    @property
    def gyro(self) -> tuple[float, float, float]:
        self.asked += 1
        if self.asked % 4 == 2:
            raise KeyError(123)
        return 0.1, -0.2, 0.3

    @property
    def quaternion(self) -> tuple[Any, ...]:
        self.asked += 1
        return (None,) * 4 if self.asked % 3 == 0 else (0.0,) * 4 if self.asked == 1 else (W, X, Y, Z)

    @property
    def game_quaternion(self) -> tuple[float, ...] | None:
        return X, Y, Z, W

    @property
    def acceleration(self) -> np.ndarray:
        return GRAVITY * TURN.inv().apply([0.0, 0.0, 1.0])

    def enable_feature(self, report: int, interval: int) -> None:
        self.enabled[report] = interval


@pytest.fixture
def drivers(monkeypatch: pytest.MonkeyPatch) -> list[Driver]:
    made: list[Driver] = []

    def driver(bus: Any, address: int) -> Driver:
        made.append(Driver(bus, address))
        return made[-1]

    extended: Any = ModuleType("adafruit_extended_bus")
    extended.ExtendedI2C = lambda number: SimpleNamespace(number=number, deinit=lambda: None)
    monkeypatch.setitem(sys.modules, "adafruit_extended_bus", extended)
    monkeypatch.setitem(sys.modules, "adafruit_bno08x", ModuleType("adafruit_bno08x"))
    for chip in CHIPS.values():
        module: Any = sys.modules.get(chip.module) or ModuleType(chip.module)
        setattr(module, chip.driver, driver)
        monkeypatch.setitem(sys.modules, chip.module, module)
    return made


@pytest.mark.parametrize("name", CHIPS)
def test_a_chip_is_read_through_its_driver(name: str, drivers: list[Driver]) -> None:
    imu = open_imu({"name": name, "bus": 3}, 200.0)
    try:
        sample = imu.latest()
    finally:
        imu.close()
    assert sample is not None and drivers[0].bus.number == 3 and drivers[0].address == CHIPS[name].address
    up = Rotation.from_quat(sample.orientation, scalar_first=True).inv().apply([0.0, 0.0, 1.0])
    assert up == pytest.approx(TURN.inv().apply([0.0, 0.0, 1.0]), abs=1e-6)
    assert sample.turn_rate == pytest.approx([0.1, -0.2, 0.3])
    if name == "bno055":
        assert drivers[0].mode == 8, "without the magnetometer"
    if name == "bno08x":
        assert set(drivers[0].enabled.values()) == {5000}, "its own rate of 20 Hz would be ten times too low"


def test_a_chip_that_does_not_answer_is_named_with_its_place(
    drivers: list[Driver], monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(bus: Any, address: int) -> Driver:
        raise ValueError(f"No I2C device at address: {address:#x}")

    monkeypatch.setattr(sys.modules["adafruit_mpu6050"], "MPU6050", missing)
    with pytest.raises(ImuError, match=r"the IMU mpu6050 does not answer at address 0x68 of /dev/i2c-1"):
        open_imu({"name": "mpu6050"}, 100.0)


@pytest.mark.parametrize("name", CHIPS)
def test_without_the_extra_a_chip_says_what_to_install(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "adafruit_extended_bus", None)
    with pytest.raises(MissingPackage, match=rf"the IMU {name} needs .*pip install 'sealegs\[imu\]'"):
        open_imu({"name": name}, 100.0)


def test_an_exception_that_nobody_foresaw_is_not_swallowed_by_the_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.bus.imu.FIRST", 0.2)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)

    class Broken(ThreadedImu):
        def read(self) -> None:
            raise ZeroDivisionError

    with pytest.raises(ImuError, match="gave no sample"):
        Broken("broken")


# --- a tilt that is worked out ---------------------------------------------------------------------------------------


def test_the_tilt_follows_a_motion_and_forgets_a_bias() -> None:
    """A rocking body with an accelerometer that feels its shaking, and a gyroscope with a bias."""
    random, rate = np.random.default_rng(0), 200.0
    time = np.arange(0.0, 20.0, 1.0 / rate)
    turns = Rotation.from_euler("YX", np.stack([0.4 * np.sin(3.0 * time), 0.3 * np.sin(2.0 * time + 1.0)], axis=1))
    between = (turns[:-1].inv() * turns[1:]).as_rotvec() * rate
    tilt, errors = Tilt(1.0 / rate), []
    for k in range(1, len(time)):
        pull = turns[k].inv().apply([0.0, 0.0, GRAVITY]) + random.normal(0.0, 1.0, 3)
        found = Rotation.from_quat(tilt.after(pull, between[k - 1] + [0.01, -0.01, 0.02]), scalar_first=True)
        up, true = (turn.inv().apply([0.0, 0.0, 1.0]) for turn in (found, turns[k]))
        errors.append(np.arccos(np.clip(up @ true, -1.0, 1.0)))
    assert np.mean(errors[400:]) < 0.03 and max(errors[400:]) < 0.08


# --- contact switches -------------------------------------------------------------------------------------------------


COLUMNS = [f"switch.{leg}_foot" for leg in FEET]


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return switched_file(tmp_path_factory.mktemp("dog"))


@pytest.fixture(scope="module")
def feeling(dog: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    return gentle_policy(path, "SeaLegs/Walk-v0", robot=str(dog), action_delay=0.0, switches=True)


def walked(policy: Path, robot: Path, folder: Path, *arguments: str) -> int:
    """Exit status of a deployment."""
    words = [f"policy={policy}", f"robot={robot}", f"out={folder}", "name=run", "duration=1", *PATIENT, *arguments]
    return run_script(deploy.main, "deploy", "", words)


def test_a_policy_with_switches_runs_and_its_log_has_a_column_for_each(
    feeling: Path, dog: Path, tmp_path: Path
) -> None:
    sensors = Policy(feeling).contract.sensors
    assert sensors == (*(f"floating_base.{turn}" for turn in ("roll", "pitch", "yaw")), *COLUMNS)
    assert walked(feeling, dog, tmp_path, STEPPED) == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    closed = np.stack([base[name][1:] for name in COLUMNS], axis=1)
    assert np.isin(closed, (0.0, 1.0)).all() and closed.mean() > 0.8, "it stands"


def test_a_switch_that_needs_more_than_the_robot_weighs_stays_open(feeling: Path, dog: Path, tmp_path: Path) -> None:
    assert walked(feeling, dog, tmp_path, STEPPED, "robot.imu.switches.hr_foot.threshold=500") == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    assert np.nanmax(base["switch.hr_foot"]) == 0.0 and np.nanmean(base["switch.fl_foot"]) > 0.8


def test_a_robot_without_the_switches_is_refused_with_what_to_write(
    feeling: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for switches, missing in (({}, "fl_foot, switch.fr_foot"), ({"fl_foot": {"body": "fl2"}}, "fr_foot, switch.hl")):
        assert walked(feeling, switched_file(tmp_path, switches), tmp_path, STEPPED) == 2
        said = capsys.readouterr().err
        assert f"it needs the sensors switch.{missing}" in said and "which the robot lacks" in said
        assert f"such as imu: {{switches: {{{missing.partition(',')[0]}: {{body: <its foot>}}}}}}" in said


@pytest.mark.long
def test_in_real_time_the_switches_come_over_the_serial_line_of_the_imu(
    feeling: Path, dog: Path, tmp_path: Path
) -> None:
    assert walked(feeling, dog, tmp_path, "robot.imu.silent=2.0") == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    assert np.nanmean(base["switch.fl_foot"]) > 0.8


@pytest.mark.parametrize(
    ("line", "text"),
    [(None, "1, 0, 0, 0, 0, 0, 0, 0, 1\n"), (f"switch.b, _, {PLAIN}, switch.a", "1, 7, 1, 0, 0, 0, 0, 0, 0, 0.2\n")],
)
def test_a_line_names_its_switches_or_has_them_behind_the_rest(line: str | None, text: str) -> None:
    terminal = Terminal()
    part: dict[str, Any] = {"name": "serial", "port": terminal.path, **({} if line is None else {"line": line})}
    with Sender(terminal, text):
        imu = open_imu(part, 100.0, ["a", "b"])
        sample = imu.latest()
        imu.close()
    terminal.close()
    assert sample is not None and sample.switches.tolist() == [0.0, 1.0]


def test_a_line_or_a_chip_that_tells_of_no_switch_is_refused() -> None:
    with pytest.raises(ImuError, match=r"imu\.part\.line: it needs the contact switches of the robot: switch\.a\."):
        LineFormat.read(PLAIN, ["a"])
    with pytest.raises(SealegsError, match=r"a bno055 has no contact switches; .* \(imu\.part\.name=serial\)"):
        checked_part({"name": "bno055"}, ["a"])
