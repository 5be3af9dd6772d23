"""A joint behind an impedance drive (MIT mode), by equations of its own: goal, goal velocity and torque together."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.causes.catalogue import adjustable, catalogue
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.checks.stops import stops_of
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.robot import Machine
from sealegs.gap.log import read_measured
from sealegs.gap.log.importers import import_logs, propose_for
from sealegs.gap.log.reader import measured_set
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.prepare.checking import check_log, with_whole_goals
from sealegs.gap.prepare.columns import commanded
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import TIGHT

from tests.importers.importing import motion

GRAVITY, STEP, EVERY = 9.81, 1e-4, 50
MASS, LENGTH, BODY, ROTOR = 1.2, 0.22, 4e-3, 0.012  # [kg], [m], [kg.m2], [kg.m2]
STIFFNESS, DAMPING = 18.0, 0.6  # [N.m/rad], [N.m.s/rad]: of a leg that walks softly
DRIVE = {"stiffness": STIFFNESS, "damping": DAMPING, "torque_limit": 17.0, "armature": ROTOR}
MODEL = f"""<mujoco model="thigh"><worldbody><body><joint name="thigh" axis="0 1 0"/>
<inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="{BODY} {BODY} {BODY}"/></body></worldbody></mujoco>"""


def moved(seed: int, coulomb: float, weak: float, seconds: float = 12.0) -> dict[str, np.ndarray]:
    """One run at 200 Hz: what the host sent, and where the joint was."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(1.5, 9.0, 3), rng.uniform(0.0, 6.0, 3)
    inertia, hangs = BODY + MASS * LENGTH**2 + ROTOR, MASS * GRAVITY * LENGTH
    stops = STEP * coulomb / inertia
    goal = speed = forward = q = v = 0.0
    rows = []

    def pushed(q: float, v: float) -> float:
        torque = STIFFNESS * (goal - q) + DAMPING * (speed - v) + forward
        return (weak * max(min(torque, 17.0), -17.0) - hangs * math.sin(q)) / inertia

    for k in range(int(seconds / STEP)):
        if k % EVERY == 0:
            now = k * STEP
            way = 0.25 * np.sin(rate * now + phase)
            goal, speed = float(way.sum()), float((0.25 * rate * np.cos(rate * now + phase)).sum())
            forward = hangs * math.sin(goal) - inertia * float((way * rate**2).sum())
            rows.append((now, goal, speed, forward, q + rng.normal(0.0, 2e-4)))
        half_q, half_v = q + 0.5 * STEP * v, v + 0.5 * STEP * pushed(q, v)  # Euler's step would err by its noise
        free = v + STEP * pushed(half_q, half_v)
        before, v = v, free - max(min(free, stops), -stops)
        q += 0.5 * STEP * (before + v)
    names = ("time", "thigh.goal", "thigh.goal_velocity", "thigh.torque_command", "thigh.position")
    return dict(zip(names, np.array(rows).T, strict=True))


def leg(
    folder: Path, coulomb: float = 0.0, weak: float = 1.0, feedforward: float = 1.0, seconds: float = 12.0
) -> MeasuredSet:
    """Three runs of a thigh whose file knows of no friction."""
    path = folder / "thigh.xml"
    path.write_text(MODEL, encoding="utf-8")
    chain = [{"delay": {"seconds": 0.0}}, {"ideal": {**DRIVE, "feedforward": feedforward}}]
    sidecar = {"robot": str(path), "actuators": {"thigh": chain}}
    return measured_set([moved(seed, coulomb, weak, seconds) for seed in (1, 2, 3)], sidecar, "leg")


def test_one_goal_asks_for_what_goal_velocity_and_torque_ask_for_together(tmp_path: Path) -> None:
    before = leg(tmp_path, seconds=1.0).runs[0]
    (after, *_), (note,) = with_whole_goals(Machine.of([before]))
    log, whole = before.joints["thigh"], after.joints["thigh"]
    assert log.goal is not None and log.goal_velocity is not None and log.torque_command is not None
    asked = STIFFNESS * log.goal + DAMPING * log.goal_velocity + log.torque_command
    np.testing.assert_allclose(STIFFNESS * np.asarray(whole.goal), asked)
    assert whole.goal_velocity is None and whole.torque_command is None and note.code == "command.beside"


def test_a_log_without_an_impedance_drive_keeps_its_goals_and_says_what_is_unused(tmp_path: Path) -> None:
    before = leg(tmp_path, feedforward=0.0, seconds=1.0).runs[0]
    (after, *_), (note,) = with_whole_goals(Machine.of([before]))
    assert after.joints["thigh"].goal is before.joints["thigh"].goal
    assert (
        note.code == "command.unused" and "thigh.goal_velocity and thigh.torque_command are not used" in note.sentence
    )


def test_a_drive_without_stiffness_has_no_goal_to_feed_forward_to() -> None:
    with pytest.raises(SealegsError, match="no goal asks for its torque"):
        load_chain([{"ideal": {"stiffness": 0.0, "damping": 1.0, "feedforward": 1.0}}])


@pytest.mark.parametrize("stage", [{"scale": {"factor": 2.0}}, {"rate_limit": {"speed": 1.0}}])
def test_nothing_may_shape_the_torque_that_is_commanded_beside_a_goal(stage: dict[str, dict[str, float]]) -> None:
    """A limit of the goal's speed would have limited the torque."""
    drive = {"ideal": {"stiffness": 5.0, "feedforward": 1.0}}
    with pytest.raises(SealegsError, match="would change the torque that is commanded beside the goal"):
        load_chain([stage, drive])
    model = JointModel(load_chain([{"delay": {"seconds": 0.0}}, drive]))
    assert not {"drive.rate_limit", "drive.goal_filter", "drive.gain"} & {cause.name for cause in catalogue(model)}


def test_gains_that_a_host_sends_are_known_and_the_torque_is_not() -> None:
    """Turned gains would turn what was folded into the goal with the others."""
    drive = {"ideal": {"stiffness": 5.0, "damping": 0.1, "feedforward": 1.0}}
    numbers = {p.number: p for p in adjustable(JointModel(load_chain([drive])), 4.0)}
    assert "ideal.stiffness" not in numbers and "ideal.damping" not in numbers
    assert numbers["ideal.strength"].high == pytest.approx(1.0 + TIGHT)


def test_columns_are_checked_as_they_were_recorded_and_folded_after(tmp_path: Path) -> None:
    """A goal that held the torque of a fast motion went against it: the position of a right log was turned about."""
    time = np.arange(0.0, 6.0, 0.005)
    way = 0.4 * np.sin(9.0 * time)
    columns = {"time": time, "thigh.goal": way, "thigh.position": np.roll(way, 1), "thigh.goal_velocity": 0.0 * time}
    columns["thigh.torque_command"] = -0.074 * 81.0 * way
    (tmp_path / "thigh.xml").write_text(MODEL, encoding="utf-8")
    chain = [{"ideal": {"stiffness": 3.0, "feedforward": 1.0}}]
    sidecar = {"robot": str(tmp_path / "thigh.xml"), "actuators": {"thigh": chain}}
    data = measured_set([columns], sidecar, "fast")
    checked, findings, _ = check_log(data, lambda text: None)
    assert {finding.code for finding in findings} >= {"command.beside"}
    np.testing.assert_array_equal(checked.runs[0].joints["thigh"].position, columns["thigh.position"])
    degrees = {name: np.degrees(cells) if name in ("thigh.goal", "thigh.position") else cells
               for name, cells in columns.items()}  # fmt: skip
    mended, findings, _ = check_log(measured_set([degrees], sidecar, "fast"), lambda text: None)
    assert {"unit.degrees", "command.beside"} <= {finding.code for finding in findings}
    np.testing.assert_allclose(np.asarray(mended.runs[0].joints["thigh"].goal), way - 0.074 * 27.0 * way, atol=1e-9)


def test_a_stop_is_read_off_the_goal_and_not_off_the_torque_beside_it(tmp_path: Path) -> None:
    """A joint that held a pose against changing torques stood "against a stop"."""
    time = np.arange(0.0, 30.0, 0.005)
    way = 0.8 * np.clip(np.floor(time) / 10.0, 0.0, 1.0)  # steps with rests between, and a pose that is held
    columns = {"time": time, "thigh.goal": way, "thigh.position": way + 1e-4 * np.cos(9.0 * time)}
    columns["thigh.torque_command"] = np.where(time > 10.0, 1.5 + 1.4 * np.sin(2.0 * time), 0.0)
    (tmp_path / "thigh.xml").write_text(MODEL, encoding="utf-8")
    sidecar = {"robot": str(tmp_path / "thigh.xml"), "actuators": {"thigh": [{"ideal": DRIVE | {"feedforward": 1.0}}]}}
    (run,), _ = with_whole_goals(Machine.of(measured_set([columns], sidecar, "held").runs))
    assert not stops_of([run], "thigh")
    folded = replace(run.joints["thigh"], goal_alone=None)
    assert stops_of([replace(run, joints={"thigh": folded})], "thigh"), "what the test is about"


@pytest.mark.long
def test_a_right_leg_behind_an_impedance_drive_leaves_nothing_to_explain(tmp_path: Path) -> None:
    """Its goal alone was replayed: 65 mrad of gap, and a gain as the cause of a good part."""
    (found,) = diagnose(leg(tmp_path), only=["thigh"], causes=["friction.coulomb", "drive.motor_constant"])
    assert found.verdict == "nothing to explain" and not found.causes
    assert found.gap["nominal"].rmse < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(
    "hidden",
    [
        {"friction.coulomb": 0.4},
        {"drive.motor_constant": 0.8},
        {"friction.coulomb": 0.4, "drive.motor_constant": 0.8},
    ],
)
def test_what_a_leg_behind_an_impedance_drive_hides_is_named(hidden: dict[str, float], tmp_path: Path) -> None:
    """Of both, friction of 2 N.m was certain where 0.4 was hidden: drive and mass had grown fivefold with it."""
    data = leg(tmp_path, hidden.get("friction.coulomb", 0.0), hidden.get("drive.motor_constant", 1.0))
    found = diagnose(data)[0]
    assert [cause.name for cause in found.causes] == list(hidden)
    for cause in found.causes:
        (value,) = cause.parameters.values()
        assert value.low <= hidden[cause.name] <= value.high and value.high < 1.35 * value.low


def test_a_goal_that_stands_still_is_not_all_that_a_drive_was_told(tmp_path: Path) -> None:
    """It was warned of a goal that never moves, and its torque was left out."""
    data = leg(tmp_path, seconds=3.0)
    still = []
    for run in data.runs:
        log = run.joints["thigh"]
        assert log.goal is not None and log.torque_command is not None
        torque = log.torque_command + STIFFNESS * (log.goal - 0.1)  # tells the same
        still.append(
            replace(run, joints={"thigh": replace(log, goal=np.full_like(torque, 0.1), torque_command=torque)})
        )
    checked, findings, stop = check_log(replace(data, runs=tuple(still)), lambda text: None)
    codes = {finding.code for finding in findings}
    assert stop is None and "command.beside" in codes and "goal.still" not in codes
    moves = checked.runs[0].joints["thigh"].goal
    assert moves is not None and np.ptp(moves) > 0.5


def test_what_a_mapping_leaves_out_is_no_command(tmp_path: Path) -> None:
    """A goal alone is what it was."""
    run = leg(tmp_path, seconds=1.0).runs[0]
    alone = replace(run, joints={"thigh": replace(run.joints["thigh"], goal_velocity=None, torque_command=None)})
    (after, *_), notes = with_whole_goals(Machine.of([alone]))
    assert after.joints["thigh"].goal is alone.joints["thigh"].goal and not notes


def foreign(path: Path, **gains: float | np.ndarray) -> Path:
    """A log as hosts of such drives write it: everything that was sent, with the gains in every row."""
    own = moved(1, 0.0, 1.0, seconds=3.0)
    names = ("time", "motor_cmd[0].q", "motor_cmd[0].dq", "motor_cmd[0].tau", "motor_state[0].q")
    columns = dict(zip(names, own.values(), strict=True))
    columns |= {f"motor_cmd[0].{gain}": value + 0.0 * own["time"] for gain, value in gains.items()}
    np.savetxt(path, np.stack(list(columns.values()), axis=1), "%.7f", ",", header=",".join(columns), comments="")
    return path


def test_what_a_host_of_impedance_drives_wrote_is_imported_beside_the_chain_that_one_writes(tmp_path: Path) -> None:
    """The goal velocity had no column, and kp was a force in kiloponds."""
    source = foreign(tmp_path / "low.csv", kp=STIFFNESS, kd=DAMPING)
    (tmp_path / "leg.xml").write_text(MODEL.replace('name="thigh"', 'name="motor0"'), encoding="utf-8")
    found = propose_for(source, tmp_path / "out", robot=str(tmp_path / "leg.xml"))
    assert {"motor0.goal", "motor0.goal_velocity", "motor0.torque_command"} <= found.mapping.columns.keys()
    assert "motor_cmd[0].kp: stiffness of a controller or model" in found.text
    drive = {"stiffness": STIFFNESS, "damping": DAMPING, "feedforward": 1}
    sidecar = found.mapping.sidecar | {"actuators": {"motor0": [{"ideal": drive}]}}
    import_logs(source, tmp_path / "out", replace(found.mapping, sidecar=sidecar))
    (run,) = read_measured(tmp_path / "out").runs
    (whole,), (note,) = with_whole_goals(Machine.of([run]))
    assert note.code == "command.beside" and whole.joints["motor0"].goal_velocity is None


@pytest.mark.parametrize(
    "names",
    [("hip_q_des", "hip_dq_des", "hip_tau_ff", "hip_kp", "hip_kd", "hip_q"),
     ("q_des", "qd_des", "tau_ff", "kp", "kd", "q"),
     ("q_ref", "v_ref", "tau_feedforward", "stiffness", "damping", "q"),
     ("haa/p_des", "haa/v_des", "haa/t_ff", "haa/Kp", "haa/Kd", "haa/p_meas")],
)  # fmt: skip
def test_other_names_of_the_same_columns_are_read_too(names: tuple[str, ...], tmp_path: Path) -> None:
    """The torque was left out, and gravity compensation had been a gap then."""
    own = moved(1, 0.0, 1.0, seconds=3.0)
    columns = [own["thigh.goal"], own["thigh.goal_velocity"], own["thigh.torque_command"]]
    columns += [np.full_like(own["time"], gain) for gain in (STIFFNESS, DAMPING)] + [own["thigh.position"]]
    table, header = np.stack([own["time"], *columns], axis=1), ",".join(("time", *names))
    np.savetxt(tmp_path / "low.csv", table, "%.7f", ",", header=header, comments="")
    found = propose_for(tmp_path / "low.csv", tmp_path / "out").mapping
    (joint,) = {name.rpartition(".")[0] for name in found.columns} - {""}
    read = [found.columns[f"{joint}.{signal}"] for signal in ("goal", "goal_velocity", "torque_command", "position")]
    assert [name.strip("`") for name in read] == [names[0], names[1], names[2], names[5]]


# --- A joint that is held, stalled or sags says nothing of its unit or its direction, and is left as it was recorded.

MOVED = motion(20.0, 100.0, 0.05, seed=3)
TIME = MOVED["time"]
RNG = np.random.default_rng(0)


def run(name: str, **joints: tuple[np.ndarray, np.ndarray]) -> MeasuredRun:
    logs = {joint: JointLog(goal=goal, position=position) for joint, (goal, position) in joints.items()}
    return MeasuredRun(name, TIME, logs, robot="unknown", actuators=dict.fromkeys(joints, "ideal"))


def shaken(at: float, goal: float, position: float, rate: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """Goal and position of a joint that is held, each shaking by so much [rad]."""
    noise = RNG.normal(0.0, 1e-4, len(TIME))
    held = at + goal * np.sin(2.0 * np.pi * 0.3 * TIME)
    return held, at - 0.01 + position * np.sin(2.0 * np.pi * rate * TIME) + noise


def after_checks(*runs: MeasuredRun) -> MeasuredSet:
    data = MeasuredSet(tuple(runs), "log")
    return corrected(data, check_set(data))[0]


@pytest.mark.parametrize("at", [0.9, 0.0])
def test_a_held_joint_that_shakes_more_than_its_goal_is_not_in_degrees(at: float) -> None:
    """0.9 rad became 0.0157 rad, and so did a run in which the joint really moved."""
    held = run("hold", wrist=shaken(at, 5e-5, 2.5e-3), elbow=(MOVED["goal"], MOVED["smooth"]))
    moves = run("move", wrist=(MOVED["goal"], MOVED["smooth"]), elbow=(MOVED["goal"], MOVED["smooth"]))
    found = after_checks(held, moves)
    for before, now in zip((held, moves), found.runs, strict=True):
        np.testing.assert_array_equal(now.joints["wrist"].position, before.joints["wrist"].position)


def test_a_moving_joint_in_degrees_is_still_found() -> None:
    degrees = run("move", wrist=(MOVED["goal"], np.degrees(MOVED["smooth"])))
    np.testing.assert_allclose(after_checks(degrees).runs[0].joints["wrist"].position, MOVED["smooth"])


def test_a_held_joint_that_sags_against_its_goal_is_not_mirrored() -> None:
    """The mean of the position became -0.88 at a goal of 0.9."""
    goal = 0.9 + 0.002 * np.sin(2.0 * np.pi * 0.3 * TIME)
    position = 0.88 - 0.004 * np.sin(2.0 * np.pi * 0.3 * TIME) + RNG.normal(0.0, 1e-4, len(TIME))
    data = MeasuredSet((run("hold", wrist=(goal, position)),), "log")
    found, findings = corrected(data, check_set(data))
    np.testing.assert_array_equal(found.runs[0].joints["wrist"].position, position)
    assert any(f.code == "position.against" and "held" in f.sentence for f in findings)


def test_a_mirrored_joint_is_still_found() -> None:
    mirrored = run("move", wrist=(MOVED["goal"], -MOVED["smooth"]))
    np.testing.assert_allclose(after_checks(mirrored).runs[0].joints["wrist"].position, MOVED["smooth"])


@pytest.mark.parametrize(("goal", "position"), [(0.6, 0.04), (0.0005, 0.006)])
def test_a_stalled_or_sagging_joint_has_no_other_unit_than_its_goal(
    goal: float, position: float, tmp_path: Path
) -> None:
    """0.5 +- 0.04 rad beside a goal of 0.5 +- 0.6 was imported with a goal in degrees, and the gap was gone."""
    swing = np.sin(2.0 * np.pi * 0.3 * TIME)
    columns = {
        "t": TIME, "elbow_goal": MOVED["goal"], "elbow_pos_rad": MOVED["smooth"],
        "wrist_goal": 0.5 + goal * swing, "wrist_pos_rad": 0.5 + position * swing + RNG.normal(0.0, 1e-4, len(TIME)),
    }  # fmt: skip
    source = tmp_path / "log.csv"
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(source, table, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    found = propose_for(source, tmp_path / "out", robot="bench", actuator="ideal")
    assert found.mapping.columns["wrist.goal"] == "wrist_goal", found.text
    assert "is this the goal of the position beside it?" in found.text


def test_runs_that_agree_on_degrees_are_still_all_found() -> None:
    one = run("a", wrist=(MOVED["goal"], np.degrees(MOVED["smooth"])))
    found = after_checks(one, replace(one, name="b"))
    for each in found.runs:
        np.testing.assert_allclose(each.joints["wrist"].position, MOVED["smooth"])


def test_a_joint_whose_goal_echoes_its_state_does_not_refuse_the_others() -> None:
    """A mocked gripper made each joint of the arm unusable, also those that were asked for alone."""
    noise = RNG.normal(0.0, 1e-4, len(TIME))
    arm = run("a", gripper=(MOVED["smooth"], MOVED["smooth"]), elbow=(MOVED["goal"], MOVED["smooth"] + noise))
    data, findings, stop = check_log(MeasuredSet((arm,), "log"), lambda text: None)
    assert stop is None
    assert commanded(data.runs) == ["elbow"] and "gripper" in data.runs[0].joints
    (said,) = [f for f in findings if f.code == "goal.is_position"]
    assert said.severity == "warning" and "not judged" in said.sentence
    _, _, alone = check_log(
        MeasuredSet((run("a", gripper=(MOVED["smooth"], MOVED["smooth"])),), "log"), lambda text: None
    )
    assert alone is not None
