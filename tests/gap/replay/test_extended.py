"""What a diagnosis changes goes where it is used: the environment moves as the extended replay, or says why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.envs.extended import Change, Extended, Mounted, Owner, read_extended
from sealegs.envs.hopper.robot import HOPPER
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.experiment import Experiment, write_experiment
from sealegs.gap.log.parts import cut
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.measure.case import Replay
from sealegs.gap.output.extension import OWNERS, extended_of, write_extended
from sealegs.gap.replay.engine import bench, replay_in_engine
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter, address
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.result import Search
from sealegs.gap.verdict.verdict import JointDiagnosis

from tests.smooth_bench import CHAIN, PARAMS

NOMINAL = JointModel(load_chain(CHAIN))
LARGE = ("drive.deadband", "drive.minimum_duty")  # whose first variant is too small to show in this motion
FIRST = {cause.name: cause.variants[1 if cause.name in LARGE else 0] for cause in catalogue(NOMINAL)}
NO_FIT = Fit({}, np.zeros((0, 4)), 0.0)
NO_SEARCH = Search((), (), (), np.zeros(0), (NO_FIT, NO_FIT))
WARM = 60.0  # [degC]
TIME = np.arange(300.0) * 0.005


def measured() -> MeasuredRun:
    goal = 1.2 * np.sin(2.0 * np.pi * 1.1 * TIME)
    log = JointLog(goal, np.zeros(300), temperature=np.full(300, WARM))
    return MeasuredRun("run", TIME, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN})


def found_values(variant: Sequence[Parameter]) -> dict[str, float]:
    """The variant at a size that shows."""
    values = {}
    for p in variant:
        away = p.start if p.start not in (0.0, 1.0) else p.from_fit(p.to_fit(p.start) + 3.0)
        values[p.path] = min(max(away, p.low), p.high)
    return values


def diagnosed(values: dict[str, float]) -> tuple[Extended, FreeProblem]:
    run = measured()
    problem = free_problem([run], "servo", [NOMINAL], cut([run], "servo", None), {"position": 1e3})
    found = JointDiagnosis.of(
        joint="servo", verdict="explained", signal="servo.position", values=values, replay=Replay(problem, problem)
    )
    changes = []
    for path, value in values.items():
        at = address(path)
        owner: Owner = OWNERS[at.target]
        before = NOMINAL.value(at.number)
        changes.append(Change("servo", at.number, before, value * before if at.factor else value, "some.cause", owner))
    plain = extended_of([found], MeasuredSet((run,), "log"))
    assert plain is not None
    return Extended(**{**vars(plain), "changes": tuple(changes)}), problem


def in_environment(extended: Extended | None) -> np.ndarray:
    """Reading and link of the bench in its environment, over the commands of the run."""
    env = sealegs.make_env("bench", extended=extended, actuator=None if extended else CHAIN, params=dict(PARAMS))
    goal = measured().joints["servo"].goal
    assert goal is not None
    return replay_in_engine(env.unwrapped.engine.drivetrain, TIME, goal, (0.0, 0.0))[:, :2]


@pytest.fixture(scope="module")
def nominal() -> np.ndarray:
    return in_environment(None)


@pytest.mark.long
@pytest.mark.parametrize("name", FIRST)
def test_an_environment_moves_as_the_extended_replay(name: str, nominal: np.ndarray) -> None:
    values = found_values(FIRST[name])
    extended, _ = diagnosed(values)
    again = Extended.from_dict(extended.to_dict())
    joint = NOMINAL.with_fitted(values)
    if name == "drive.thermal":  # the motor is as warm as it was in the log
        joint = joint.with_values({"thermal.temperature": WARM})
    goal = measured().joints["servo"].goal
    assert goal is not None
    replayed = replay_in_engine(bench(joint, PARAMS), TIME, goal, (0.0, 0.0))[:, :2]
    moved = in_environment(again)
    change = float(np.sqrt(np.mean((replayed - nominal) ** 2)))
    assert change > 5e-5
    assert float(np.sqrt(np.mean((moved - replayed) ** 2))) < 0.02 * change


def test_a_log_that_misreads_the_machine_is_to_be_corrected_before_its_model_is_used(tmp_path: Path) -> None:
    """It stood in a comment of the file: the policy was trained as if the log had been right."""
    from sealegs.agents.config import read_config
    from sealegs.hw.machine.robot import extended_robot

    extended, _ = diagnosed({"host.offset": 0.1, "host.scale": 1.2})
    assert {change.owner for change in extended.changes} == {"log"}
    says = r"some\.cause \(host\.offset 0 -> 0\.1\).*cannot be applied.*subtract 0\.1 from its position.*by 1\.2"
    with pytest.raises(SealegsError, match=says):
        in_environment(extended)
    write_extended(extended, tmp_path)
    alone = rf"actuator={tmp_path}/extended\.yaml for the actuators alone"
    with pytest.raises(SealegsError, match=alone):
        read_config(["env=bench", f"extended={tmp_path}"])
    with pytest.raises(SealegsError, match=alone):  # deploy and evaluate
        extended_robot({"name": "bench", "servo": "sts3215", "params": {}}, tmp_path)


def test_a_reading_that_was_only_tuned_within_its_tolerance_stops_nobody(nominal: np.ndarray) -> None:
    extended, _ = diagnosed({"host.offset": 0.001})
    tuned = replace(extended, changes=tuple(replace(change, cause="") for change in extended.changes))
    np.testing.assert_allclose(in_environment(tuned), nominal, atol=1e-6)


def machine(path: str, value: float, robot: str, owner: Owner = "robot") -> Extended:
    chains = {"joint": (Mounted(load_chain("sv1270tg"), "extended.yaml"),)} if robot == "bench" else {}
    return Extended(robot, None, chains, (Change("joint", path, 1.0, value, path, owner),), "diagnosis")


def test_a_load_of_the_bench_is_refused_by_another_robot() -> None:
    with pytest.raises(SealegsError, match=r"load\.mass_factor.*cannot be applied.*actuator=diagnosis/extended\.yaml"):
        sealegs.make_env("hopper", extended=machine("load.mass_factor", 1.3, "bench"))


def test_refitted_numbers_that_a_robot_has_not_are_refused_and_tuned_ones_are_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Both were dropped without a word: a load refitted threefold trained the robot as it was believed."""
    change = Change("joint", "load.mass_factor", 1.0, 3.0, "", "robot", refitted=True)
    found = replace(machine("load.mass_factor", 3.0, "bench"), changes=(change,))
    with pytest.raises(SealegsError, match=r"refitted numbers \(load\.mass_factor 1 -> 3\).*cannot be applied"):
        found.params_on(HOPPER)
    assert Extended.from_dict(found.to_dict()).changes[0].refitted
    tuned = replace(found, changes=(replace(change, after=1.04, refitted=False),))
    assert tuned.params_on(HOPPER) == {}
    assert "tuned one number within tolerance that robot 'hopper' has not" in caplog.text
    assert "load.mass_factor 1 -> 1.04" in caplog.text


def test_numbers_of_a_refitted_model_are_marked_as_refitted() -> None:
    _, problem = diagnosed({})
    found = JointDiagnosis.of(
        joint="servo",
        verdict="partly explained",
        signal="servo.position",
        values={"friction.coulomb*": 4.0},
        replay=Replay(problem, problem),
        search=NO_SEARCH,
        model="refitted",
    )
    extended = extended_of([found], MeasuredSet((measured(),), "log"))
    assert extended is not None and [(c.cause, c.refitted) for c in extended.changes] == [("", True)]


def test_a_diagnosis_without_a_model_says_so_instead_of_standing_for_the_nominal_machine() -> None:
    """It was None, which make_env takes for the machine as believed."""
    refused = JointDiagnosis.of(joint="servo", verdict="unusable log", signal="servo.position", unexplained=1.0)
    diagnosis = sealegs.Diagnosis("bench", ("run",), (refused,), MeasuredSet((measured(),), "bench"))
    with pytest.raises(SealegsError, match="the diagnosis of bench holds no extended model"):
        sealegs.make_env("bench", extended=diagnosis.extended)


def test_a_servo_alone_drives_every_joint_of_another_robot() -> None:
    env = sealegs.make_env("hopper", extended=machine("delay.seconds", 0.01, "bench", "chain"))
    assert env.unwrapped.engine.chains.keys() == {"hip", "knee"}


def test_the_ground_under_a_leg_is_applied_as_far_as_the_robot_has_it() -> None:
    numbers = machine("contact.friction", 0.4, "hopper").params_on(HOPPER)
    assert numbers == {"floor_friction": 0.4}
    with pytest.raises(SealegsError, match=r"contact\.slope.*no number for it"):
        machine("contact.slope", 0.05, "hopper").params_on(HOPPER)


def test_what_a_caller_believes_takes_the_place_of_what_the_log_believed() -> None:
    extended, _ = diagnosed({"load.mass_factor": 1.5, "load.extra_inertia": 0.004})
    robot = sealegs.load_robot("bench")
    assert extended.params_on(robot)["mass"] == pytest.approx(1.5 * PARAMS["mass"])
    numbers = extended.params_on(robot, {"mass": 0.2})
    assert numbers["mass"] == pytest.approx(0.3) and numbers["extra_inertia"] == pytest.approx(0.004)


def test_a_chain_and_a_diagnosis_cannot_both_be_given() -> None:
    with pytest.raises(SealegsError, match="give one of them"):
        sealegs.make_env("bench", extended=machine("load.mass_factor", 1.3, "bench"), actuator="ideal")


def test_training_keeps_chains_and_numbers_of_the_diagnosis_in_its_config(tmp_path: Path) -> None:
    from sealegs.agents.config import read_config

    extended, _ = diagnosed({"load.mass_factor": 1.5, "friction.coulomb": 0.1})
    write_extended(extended, tmp_path)
    config = read_config(["env=bench", f"extended={tmp_path}"]).config
    assert config is not None and config.extended == str(tmp_path)
    assert config.env["params"]["mass"] == pytest.approx(1.5 * PARAMS["mass"])
    assert (
        isinstance(config.actuator, dict)
        and {"friction": {"coulomb": 0.1, "viscous": 0.059}} in config.actuator["joint"]
    )
    with pytest.raises(SealegsError, match="give one of them"):
        read_config(["env=bench", f"extended={tmp_path}", "actuator=ideal"])


def test_a_servo_robot_is_taken_for_what_the_diagnosis_found(tmp_path: Path) -> None:
    from sealegs.hw.machine.robot import extended_robot

    extended, _ = diagnosed({"load.mass_factor": 1.5, "friction.coulomb": 0.1})
    write_extended(extended, tmp_path)
    robot = extended_robot({"name": "bench", "servo": "sts3215", "params": {}}, tmp_path)
    assert robot.params["mass"] == pytest.approx(1.5 * PARAMS["mass"])
    assert robot.chains["joint"].find("friction").coulomb == pytest.approx(0.1)


def test_runs_with_different_nominal_chains_leave_a_choice(tmp_path: Path) -> None:
    two = (Mounted(load_chain("sts3215"), "extended.yaml"), Mounted(load_chain("xl330"), "extended-2.yaml"))
    write_extended(Extended("bench", None, {"servo": two}), tmp_path)
    with pytest.raises(SealegsError, match=r"choose one: extended=.*extended-2\.yaml"):
        read_extended(tmp_path).chains_on(sealegs.load_robot("bench"))
    chosen = read_extended(tmp_path / "extended-2.yaml").chains_on(sealegs.load_robot("bench"))
    assert chosen["joint"].stages == load_chain("xl330").stages


@pytest.mark.parametrize("what", ["missing", "empty"])
def test_a_folder_without_a_diagnosis_is_refused(what: str, tmp_path: Path) -> None:
    folder = tmp_path if what == "empty" else tmp_path / "nowhere"
    with pytest.raises(SealegsError, match="sealegs diagnose wrote"):
        read_extended(folder)


def test_a_diagnosis_of_one_model_is_not_put_on_another_whose_joints_are_called_alike(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = (Path(__file__).parents[2] / "robots" / "arm.xml").read_text()
    for name, mass in (("arm.xml", "0.1"), ("other.xml", "0.3")):
        (tmp_path / name).write_text(text.replace('0.15" mass="0.1"', f'0.15" mass="{mass}"'))
    arm = sealegs.load_robot(tmp_path / "arm.xml")
    assert arm.file is not None
    chains = {
        joint: (Mounted(load_chain(arm.chains[joint]), f"{joint}-extended.yaml"),) for joint in ("shoulder", "elbow")
    }
    found = Extended(str(tmp_path / "arm.xml"), {}, chains, (), "found", digest=arm.file.model.digest)
    again = Extended.from_dict(found.to_dict(), "found")
    assert set(again.chains_on(arm)) == {"shoulder", "elbow"}
    with pytest.raises(
        SealegsError, match=r"found is of robot .*arm\.xml', and 'other\.xml' is another model; diagnose"
    ):
        again.chains_on(sealegs.load_robot(tmp_path / "other.xml"))
    (tmp_path / "arm.xml").write_text((tmp_path / "other.xml").read_text())
    assert again.chains_on(sealegs.load_robot(tmp_path / "arm.xml"))
    assert "arm.xml was changed after found was written" in caplog.text


def test_a_diagnosis_names_the_robots_file_as_it_lies_beside_it(tmp_path: Path) -> None:
    """It held the whole path on the machine where it was written."""
    model = tmp_path / "there" / "robots" / "arm.xml"
    model.parent.mkdir(parents=True)
    model.write_text("<mujoco/>")
    folder = tmp_path / "there" / "diagnosis"
    folder.mkdir()
    path = write_extended(Extended(str(model), {}, {}), folder)
    assert str(tmp_path) not in path.read_text()
    (tmp_path / "there").rename(tmp_path / "here")
    found = read_extended(tmp_path / "here" / "diagnosis")
    assert Path(found.robot) == tmp_path / "here" / "robots" / "arm.xml"


def test_so_does_the_next_experiment(tmp_path: Path) -> None:
    for name in ("arm.xml", "servo.yaml"):
        (tmp_path / name).write_text("<mujoco/>" if name == "arm.xml" else "- delay: {seconds: 0.005}\n")
    plan = Experiment("chirp", "Run it.", 1.0, np.arange(3.0), np.zeros(3), {})
    robot, chain = str(tmp_path / "arm.xml"), str(tmp_path / "servo.yaml")
    (tmp_path / "diagnosis" / "staged").mkdir(parents=True)
    files = write_experiment(
        plan, "elbow", tmp_path / "diagnosis" / "staged", chain, robot=robot, final=tmp_path / "diagnosis"
    )
    moved = [path.rename(tmp_path / "diagnosis" / path.name) for path in files.values()]
    assert str(tmp_path) not in moved[1].read_text()
    said = read_sidecar(moved[0])
    assert said.robot == robot and said.actuators == {"elbow": chain}


def test_a_learner_and_a_virtual_machine_get_what_the_diagnosis_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sealegs.commands import relevant
    from sealegs.configs.compose import compose
    from sealegs.hw.virtual import in_process
    from stable_baselines3 import PPO

    extended, _ = diagnosed({"load.mass_factor": 1.5, "friction.coulomb": 0.1})
    write_extended(extended, tmp_path)
    env = sealegs.make_env("bench", 2, extended=tmp_path, sb3=True)
    PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu").learn(16)
    mass, chain = 1.5 * PARAMS["mass"], extended.chains_on(sealegs.load_robot("bench"))["joint"].to_list()
    assert env.engine.numbers["mass"] == pytest.approx(mass) and env.engine.chains["joint"].to_list() == chain

    machines = []

    class Told(in_process.Machine):
        def __init__(self, *arguments: object) -> None:
            machines.append(arguments)
            super().__init__(*arguments)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(in_process, "Machine", Told)
    in_process.wires_of(compose("virtual", {"extended": str(tmp_path)}))
    _, chains, _, params, *_ = machines[0]
    assert params["mass"] == pytest.approx(mass) and chains["joint"].to_list() == chain
    with pytest.raises(SealegsError, match="give one of them"):
        in_process.wires_of(compose("virtual", {"extended": str(tmp_path), "actuator": "ideal"}))

    movers = []
    monkeypatch.setattr("sealegs.evaluation.relevant.Mover", lambda *given, **_: movers.append(given) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        relevant.main(["robot=bench", f"extended={tmp_path}", f"out={tmp_path / 'out'}"])
    assert movers[0][1]["joint"].to_list() == chain and movers[0][2]["mass"] == pytest.approx(mass)


def test_a_learner_that_takes_other_vector_environments_says_which() -> None:
    from stable_baselines3 import PPO

    with pytest.raises(ValueError, match=r"Stable-Baselines3 takes BatchVecEnv: make_env\(\.\.\., sb3=True\)"):
        PPO("MlpPolicy", sealegs.make_env("track", num_envs=2))
