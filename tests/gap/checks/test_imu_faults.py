"""An IMU held against itself and against the legs that carry it: what is hidden in an independent walker's is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run as run_script
from sealegs.gap.checks.imu import Match, check_imu, imu_of
from sealegs.gap.diagnose import diagnose
from sealegs.gap.finder.imu import Carried, Legs, beside, diagnose_imu
from sealegs.gap.finder.switches import Switched
from sealegs.gap.log import read_measured
from sealegs.gap.log.types import LogError, MeasuredRun, MeasuredSet
from sealegs.gap.output.terminal import screen
from sealegs.gap.verdict.verdict import EXPLAINED, NOT_IDENTIFIABLE, NOTHING, JointDiagnosis

from testbed.logs import measured_run
from testbed.quadruped import LEGS, BoughtImu, record_walker

OWN = {leg: leg for leg in LEGS}
SWITCHES = {leg: {"geom": f"{leg}_foot", "threshold": 1.0} for leg in LEGS}
BELIEVED = {"delay": 0.01, "bias": {"orientation": 0.01, "turn_rate": 0.005}}
SWAPPED = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def rocking(imu: BoughtImu, seed: int = 0, size: float = 1.0, seconds: float = 10.0) -> MeasuredRun:
    """A body that is rocked about all axes, with nothing known of any legs."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.01)
    angles = np.zeros((len(time), 3))
    for axis in range(3):
        for rate in random.uniform(0.4, 2.5, 4):
            angles[:, axis] += 0.08 * size * random.normal() * np.sin(2.0 * np.pi * (rate * time + random.uniform()))
    turned = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)
    return MeasuredRun("rocked", time, {}, dict(imu.columns(time, turned, random)))


def walked(imu: BoughtImu, seed: int = 1, duration: float = 6.0) -> list[MeasuredRun]:
    recordings, _ = record_walker({}, seed, Path(mkdtemp()), duration=duration, runs=2, imu=imu)
    return [replace(run, meta={**run.meta, "imu": BELIEVED}) for run in map(measured_run, recordings)]


def judged(imu: BoughtImu, seed: int = 1) -> JointDiagnosis:
    return diagnose_imu(walked(imu, seed), {}, lambda text: None)


FAULTS = {
    "imu.sign": BoughtImu(axes=np.diag([1.0, -1.0, 1.0])),
    "imu.axes": BoughtImu(axes=SWAPPED),
    "imu.unit": BoughtImu(unit=np.pi / 180.0),
    "imu.inverse": BoughtImu(inverse=True),
    "imu.lag": BoughtImu(filtered=0.03),
}


@pytest.mark.parametrize("code", FAULTS)
def test_what_contradicts_itself_is_named_from_the_log_alone(code: str) -> None:
    findings, told = check_imu([rocking(FAULTS[code], seed) for seed in (1, 2)])
    assert told and [finding.code for finding in findings] == [code] and findings[0].data_error


def test_axes_are_told_by_name_and_a_lag_with_its_size() -> None:
    (axes,), _ = check_imu([rocking(FAULTS["imu.axes"])])
    assert "about x is that about y, about y is that about -x of its orientation" in axes.sentence
    (lag,), _ = check_imu([rocking(FAULTS["imu.lag"])])
    assert lag.value == pytest.approx(0.03, abs=0.004) and lag.low is not None and lag.high is not None
    (unit,), _ = check_imu([rocking(FAULTS["imu.unit"])])
    assert unit.value == pytest.approx(57.3, rel=0.03) and "deg/s" in unit.sentence


@pytest.mark.parametrize("seed", range(12))
def test_an_imu_that_is_right_is_not_doubted(seed: int) -> None:
    mount = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, 1.0, 3))
    findings, told = check_imu([rocking(BoughtImu(delay=0.05, mount=mount), seed, size=0.3 + 0.1 * seed)])
    assert told and findings == []


def test_a_body_that_hardly_turns_tells_nothing() -> None:
    assert check_imu([rocking(FAULTS["imu.axes"], size=0.01)]) == ([], False)
    found = diagnose_imu([rocking(FAULTS["imu.axes"], size=0.01)], {}, lambda text: None)
    assert found.verdict == NOT_IDENTIFIABLE and "hardly turns" in found.sentence


def test_rows_without_a_new_sample_and_samples_of_another_time_are_no_fault() -> None:
    run = rocking(BoughtImu())
    run.base["imu.age"][:] = 0.004
    for name in run.base:
        run.base[name][::3] = np.nan
    log = imu_of(run)
    assert log is not None and len(log.time) < 0.7 * len(run.time) and log.time[0] == pytest.approx(0.006)
    assert check_imu([run]) == ([], True)


def test_a_log_without_an_imu_says_nothing_of_one() -> None:
    run = rocking(BoughtImu())
    assert check_imu([replace(run, base={"z": np.zeros(len(run.time))})]) == ([], False)


@pytest.mark.parametrize(("slipping", "told"), [(0.0, True), (0.7, False)])
def test_a_turn_about_the_vertical_is_told_only_where_it_is_all_that_is_off(
    slipping: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where feet slipped, rolling went into pitching: two walks with a right IMU were told that it is turned."""
    run = rocking(BoughtImu(mount=Rotation.from_euler("z", 0.0 if slipping else 12.0, degrees=True)))
    log = imu_of(run)
    assert log is not None
    angles = Rotation.from_quat(log.orientation, scalar_first=True).as_rotvec()
    if slipping:
        angles[:, 1] += slipping * angles[:, 0]
    else:
        angles = Rotation.from_euler("z", -12.0, degrees=True).apply(angles)
    asked = Carried(log.time, Rotation.from_rotvec(angles).as_quat(scalar_first=True))
    monkeypatch.setattr("sealegs.gap.finder.imu.robot_under", lambda run: SimpleNamespace(imu=None))
    monkeypatch.setattr("sealegs.gap.finder.imu.carried", lambda robot, run, frames: [asked])
    found = diagnose_imu([run], {}, lambda text: None)
    assert any("about z" in finding.sentence for finding in found.findings) == told, found.sentence


def test_of_two_grounds_the_one_that_explains_the_imu_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Feet that creep less made a trot swing about other corners: a right IMU was said to sit turned by 4 degrees."""
    run = rocking(BoughtImu())
    log = imu_of(run)
    assert log is not None
    right = Rotation.from_quat(log.orientation, scalar_first=True)
    other = Rotation.from_rotvec(0.6 * right.as_rotvec() + [0.0, 0.08, 0.0])
    ways = [Carried(log.time, turned.as_quat(scalar_first=True)) for turned in (other, right)]
    monkeypatch.setattr("sealegs.gap.finder.imu.robot_under", lambda run: SimpleNamespace(imu=None))
    monkeypatch.setattr("sealegs.gap.finder.imu.carried", lambda robot, run, frames: ways)
    assert diagnose_imu([run], {}, lambda text: None).findings == ()


@pytest.mark.parametrize(("about_z", "axes"), [(0.01, ((0, 1), (1, 0), (2, 0))), (0.05, ((2, 1), (1, 0), (0, 1)))])
def test_an_axis_about_which_a_robot_hardly_turns_is_not_taken_for_another_that_crosstalk_follows(
    about_z: float, axes: tuple[tuple[int, int], ...]
) -> None:
    """A hexapod's right IMU was said to have its axes x and z swapped: about z it turned a fifth as much as about x."""
    crosstalk = np.array([[0.93, 0.1, 0.95], [-0.04, 0.15, 0.04], [0.95, 0.05, 0.65]])
    if about_z > 0.02:  # else each is the other one's, and its own is no better
        crosstalk[0, 0] = crosstalk[2, 2] = 0.3
    sizes = np.array([[0.052, 0.013, about_z], [0.052, 0.009, about_z]])
    assert Match(0.01, 0.0, 0.02, crosstalk, sizes, 0.87).axes == axes


@pytest.mark.parametrize(("angles", "told"), [((-12.0,), True), ((-12.0, -11.0), True), ((-12.0, 0.0), False)])
def test_a_turn_is_known_as_well_as_grounds_agree_that_explain_the_imu_alike(
    angles: tuple[float, ...], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a quadruped that turned backwards six grounds explained 98 %: 3 degrees to either side."""
    run = rocking(BoughtImu(mount=Rotation.from_euler("z", 12.0, degrees=True)))
    log = imu_of(run)
    assert log is not None
    seen = Rotation.from_quat(log.orientation, scalar_first=True).as_rotvec()
    turned = [Rotation.from_rotvec(Rotation.from_euler("z", angle, degrees=True).apply(seen)) for angle in angles]
    ways = [Carried(log.time, one.as_quat(scalar_first=True)) for one in turned]
    monkeypatch.setattr("sealegs.gap.finder.imu.robot_under", lambda run: SimpleNamespace(imu=None))
    monkeypatch.setattr("sealegs.gap.finder.imu.carried", lambda robot, run, frames: ways)
    found = diagnose_imu([run], {}, lambda text: None)
    assert any("about z" in finding.sentence for finding in found.findings) == told, found.sentence


def test_a_lag_that_swinging_in_circles_makes_a_turn_is_not_told_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a turning robot a lag of 4 ms in place of 10 was a turn by 3 degrees about the vertical."""

    def swinging(time: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * (2.0 * time + 0.1 * np.sin(time) * time)
        turned = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0.2 * np.sin(3.0 * time)], axis=1)
        return Rotation.from_rotvec(turned).as_quat(scalar_first=True)

    run = rocking(BoughtImu())
    run.base.update(BoughtImu(delay=0.0).columns(run.time, swinging(run.time), np.random.default_rng(0)))
    known = Match(0.0, -1e-3, 1e-3, np.eye(3), np.ones((2, 3)), 0.95)
    monkeypatch.setattr("sealegs.gap.finder.imu.match", lambda *given: known)
    monkeypatch.setattr("sealegs.gap.finder.imu.robot_under", lambda run: SimpleNamespace(imu=None))
    ways = [Carried(run.time, swinging(run.time + 0.006))]
    monkeypatch.setattr("sealegs.gap.finder.imu.carried", lambda robot, run, frames: ways)
    found = diagnose_imu([run], {}, lambda text: None)
    assert found.findings == () and "about z" in found.sentence


def test_a_lag_of_less_than_half_the_time_between_samples_is_not_told() -> None:
    """A trot of 20 rows a step, sampled each 10 or 30 ms: its turn rate was said to be 6 ms late."""
    logs = [rocking(BoughtImu(filtered=0.012), seed) for seed in (1, 2)]
    assert [finding.code for finding in check_imu(logs)[0]] == ["imu.lag"]
    rare = [replace(run, time=run.time[::3], base={key: c[::3] for key, c in run.base.items()}) for run in logs]
    assert check_imu(rare) == ([], True)


# --- beside the legs -------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_an_imu_that_is_right_agrees_with_the_legs() -> None:
    found = judged(BoughtImu())
    assert found.verdict == NOTHING and "agrees with itself and with the legs" in found.sentence
    assert not found.data_errors and not found.findings


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_an_imu_that_sits_turned_is_named_with_its_angle(seed: int) -> None:
    (finding,) = judged(BoughtImu(mount=Rotation.from_euler("y", 5.0, degrees=True)), seed).findings
    assert finding.code == "imu.turned" and finding.value == pytest.approx(np.radians(5.0), abs=0.015)
    assert "+5" in finding.sentence or "+4" in finding.sentence, "about y, in the direction in which it sits"


@pytest.mark.long
@pytest.mark.parametrize(
    ("mount", "says"),
    [
        (Rotation.from_euler("z", 90.0, degrees=True), "about x is that about y, about y is that about -x"),
        (Rotation.from_euler("x", 180.0, degrees=True), "about y is that about -y, about z is that about -z"),
    ],
)
def test_an_imu_that_is_mounted_another_way_is_named(mount: Rotation, says: str) -> None:
    found = judged(BoughtImu(mount=mount))
    assert found.verdict == EXPLAINED and [error.name for error in found.data_errors] == ["imu.mount"]
    assert says in found.sentence and "imu.rotation" in found.sentence


@pytest.mark.long
@pytest.mark.parametrize(
    ("hidden", "trim", "codes"), [("0.0", 0.0, []), ("0.0", 0.025, []), ("0.0873", 0.0, ["imu.turned"])]
)
def test_a_virtual_quadruped_that_turns_tells_only_an_imu_that_sits_turned(
    hidden: str, trim: float, codes: list[str], tmp_path: Path
) -> None:
    """Its legs were put onto another ground than its own: axes swapped, 7 ms early, or turned by 4 degrees."""
    (tmp_path / "hidden.yaml").write_text(f"imu.rotation: [0.0, {hidden}, 0.0]\n")
    words = [f"reference={{walk: {{turn_trim: {trim}}}}}", "command={forward: -0.1, turn: -0.5}"]
    words += [
        "robot=quadruped",
        "hw.virtual.time=stepped",
        "hw.virtual.seed=16",
        f"hw.virtual.hidden={tmp_path / 'hidden.yaml'}",
        "duration=10",
        "live=false",
    ]
    assert run_script(deploy.main, "deploy", "", [*words, f"out={tmp_path}", "name=run"]) == 0
    runs = read_measured(tmp_path / "run.csv").runs
    found = diagnose_imu(list(runs), {}, lambda text: None)
    assert [finding.code for finding in found.findings] == codes, found.sentence


@pytest.mark.long
def test_a_delay_beyond_the_believed_one_is_named_with_its_size() -> None:
    (finding,) = judged(BoughtImu(delay=0.05)).findings
    assert finding.code == "imu.delay" and finding.value == pytest.approx(0.05, abs=0.012)


@pytest.mark.long
def test_a_diagnosis_of_the_imu_alone_takes_no_joint_and_a_screen_says_it_once() -> None:
    runs = walked(BoughtImu(mount=Rotation.from_euler("z", 90.0, degrees=True)))
    found = diagnose([replace(run, source=None) for run in runs], joints=["imu"])
    (imu,) = found.joints
    assert imu.joint == "imu" and found.verdict == EXPLAINED
    assert " ".join(screen(found.joints, {}, 100)).count("swapped") == 1
    with pytest.raises(LogError, match=r"no IMU that can be judged: it lacks base\.imu\.w, "):
        diagnose([replace(run, base={}) for run in runs], joints=["imu"])


def test_of_an_imu_that_is_asked_for_the_columns_that_the_log_lacks_are_named() -> None:
    run = rocking(BoughtImu())
    lame = replace(run, base={key: column for key, column in run.base.items() if key != "imu.turn_z"})
    with pytest.raises(LogError, match=r"no IMU that can be judged: it lacks base\.imu\.turn_z\."):
        beside([lame], ["imu"])
    with pytest.raises(LogError, match=r"it lacks base\.imu\.w, .*base\.imu\.turn_z\."):
        beside([replace(run, base={})], ["imu"])
    assert beside([lame]) == beside([lame], ["hip"]) == () and beside([run], ["imu"]) == ("imu",)


@pytest.mark.long
def test_a_sidecar_whose_imu_is_none_is_refused_in_a_sentence() -> None:
    runs = [replace(run, meta={**run.meta, "imu": {"delay": "soon"}}) for run in walked(BoughtImu())]
    with pytest.raises(SealegsError, match=r"meta\.imu of its sidecar is .*soon"):
        diagnose_imu(MeasuredSet(tuple(runs), "walk").runs, {}, lambda text: None)


@pytest.mark.parametrize(("low", "high", "told"), [(-0.03, 0.001, False), (-0.02, 0.001, True), (0.04, 0.06, True)])
def test_a_delay_whose_interval_ends_where_the_search_does_is_not_told(low: float, high: float, told: bool) -> None:
    """Of a trot its lag was known to a period: a right IMU was said to be 15 ms early."""
    rates = Match(0.5 * (low + high), low, high, np.eye(3), np.ones((2, 3)), 0.9)
    legs = Legs(rates, np.zeros(3), np.full(3, 0.01), (0.015, 0.01))
    assert ("imu.delay" in [finding.code for finding in legs.findings()]) == told


# --- contact switches beside the feet --------------------------------------------------------------------------------


def beside_feet(change: str, seconds: int = 12) -> list[str]:
    """Findings of three feet that step in turn, whose switches bounce, beside what is made of the first two."""
    random = np.random.default_rng(0)
    phase = np.arange(0.0, seconds, 0.01)[:, None] + np.array([0.0, 0.35, 0.6])
    feet = (phase % 1.0 < 0.5).astype(float)
    said = np.where(random.random(feet.shape) < 0.1, 1.0 - feet, feet)
    said = {
        "nothing": said,
        "swapped": said[:, [1, 0, 2]],
        "inverted": np.stack([1.0 - said[:, 0], *said.T[1:]], axis=1),
        "never closes": np.stack([0.0 * said[:, 0], *said.T[1:]], axis=1),
        "never opens": np.stack([0.0 * said[:, 0] + 1.0, *said.T[1:]], axis=1),
        "none ever closes": 0.0 * said,
    }[change]
    blocks = list(zip(np.array_split(said, seconds), np.array_split(feet, seconds), strict=True))
    return [finding.sentence for finding in Switched(("left", "right", "rear"), blocks).findings()]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("swapped", ["swapped: left is on the foot of right", "right is on the foot of left"]),
        ("inverted", ["left is closed where its foot is in the air", "Read it the other way round"]),
        ("never closes", ["left never closes, and the legs stand on its foot in 50 % of the time"]),
        ("never opens", ["left never opens, and the legs lift its foot in 50 % of the time"]),
    ],
)
def test_a_switch_that_the_feet_contradict_is_named_with_what_it_does(change: str, says: list[str]) -> None:
    (sentence,) = beside_feet(change)
    assert all(word in sentence for word in says), sentence


def test_switches_that_only_bounce_or_of_which_nothing_tells_right_from_wrong_are_not_doubted() -> None:
    assert beside_feet("nothing") == [] and beside_feet("none ever closes") == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("feet", "opened", "code"),
    [
        ({}, (), None),
        ({"front_left": "rear_left", "rear_left": "front_left"}, (), "imu.switches"),
        ({"front_left": ""}, ("front_left",), "imu.switch_stuck"),
        ({}, ("rear_right",), "imu.switch_inverted"),
    ],
)
def test_what_is_wrong_with_the_switches_of_a_walker_is_told_beside_its_imu(
    feet: dict[str, str], opened: tuple[str, ...], code: str | None
) -> None:
    runs = walked(BoughtImu(feet=OWN | feet, opened=opened))
    runs = [replace(run, meta={"imu": {**BELIEVED, "switches": SWITCHES}}) for run in runs]
    found = diagnose_imu(runs, {}, lambda text: None)
    assert [error.name for error in found.data_errors] == ([] if code is None else [code]), found.sentence
    assert code is not None or "contact switches" in found.sentence


def test_switches_of_a_sidecar_that_are_nowhere_on_the_robot_are_refused_with_the_run(tmp_path: Path) -> None:
    recordings, _ = record_walker({}, 1, tmp_path, duration=4.0, runs=1, imu=BoughtImu(feet=OWN))
    said = {**BELIEVED, "switches": {"front_left": {"geom": "hoof"}}}
    runs = [replace(run, meta={"imu": said}) for run in map(measured_run, recordings)]
    with pytest.raises(SealegsError, match=r"meta\.imu of its sidecar: .*the model has no geom 'hoof'"):
        diagnose_imu(runs, {}, lambda text: None)
