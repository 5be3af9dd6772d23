"""Laws from outside, and compiled ones: kept as long as they and what they import say the same."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
import sealegs
from sealegs.actuators import Drivetrain, law, load_chain
from sealegs.actuators import compiled as compiling
from sealegs.actuators.compiled import digest
from sealegs.actuators.layout import S_TORQUE
from sealegs.actuators.stages.base import STAGES
from sealegs.actuators.turning import apart
from sealegs.common import plugins
from sealegs.common.errors import SealegsError
from sealegs.envs.robots import get_robot
from sealegs.gap.causes.cause import ENTRIES
from sealegs.gap.log.reader import write_run
from sealegs.gap.replay import simulator
from sealegs.hw.bus.registers import load_model, model_names
from sealegs.hw.machine.own_robot import own_robot

from testbed import hidden_bench, nominal_chain
from tests.doc_blocks import REPOSITORY, blocks
from tests.gap.replay.test_driven_replay import drive

PAGE = {block.title: block.text for block in blocks(REPOSITORY / "docs" / "build-on-it.md") if block.title}
COGGING = {"amplitude": 0.1, "count": 7, "phase": 0.3}
HIDDEN = {"cogging": 0.12, "cogging_count": 7.0, "cogging_phase": 0.4}
SERVO, ENCODER = nominal_chain()[:-1], nominal_chain()[-1]
CHAIN = [*SERVO[:-1], {"cogging": COGGING}, SERVO[-1], ENCODER]


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test adds goes with it."""
    monkeypatch.setenv(plugins.TO_CHILDREN, "")
    before = set(sys.modules)
    with patch.dict(STAGES), patch.dict(ENTRIES):
        yield
    for name in set(sys.modules) - before:
        if name.startswith("sealegs_plugin_"):
            del sys.modules[name]


@pytest.fixture
def cogging(tmp_path: Path, forgotten: None) -> Path:
    """The file of the page, which is all that somebody writes, loaded."""
    path = tmp_path / "cogging.py"
    path.write_text(PAGE["cogging.py"])
    plugins.add(path)
    return path


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path in which a distribution is installed that adds one of each."""
    folder = tmp_path / "site"
    information = folder / "others-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(
        "[sealegs.stages]\ncogging = others_cogging\n[sealegs.causes]\ncogging = others_cogging\n"
        "[sealegs.servos]\nsts_mine = others_servos\nbroken = others_broken\n"
        "[sealegs.robots]\ndog = others_robot:DOG\n[sealegs.tasks]\nrest = others_task:Rest\nnone = others_robot:DOG\n"
    )
    (folder / "others_cogging.py").write_text(PAGE["cogging.py"])
    (folder / "others_servos").mkdir()
    (folder / "others_servos" / "__init__.py").write_text("")
    (folder / "others_servos" / "sts_mine.yaml").write_text(PAGE["sts_mine.yaml"])
    (folder / "others_broken.py").write_text("import there_is_no_such_module\n")
    (folder / "others_robot.py").write_text("from sealegs.envs.bench.robot import BENCH\n\nDOG = BENCH\n")
    (folder / "others_task.py").write_text(
        "from sealegs.envs.bench.env import BenchTask\n\n\nclass Rest(BenchTask):\n    pass\n"
    )
    monkeypatch.syspath_prepend(folder)
    return folder


# --- a stage --------------------------------------------------------------------------------------------------------


def test_a_stage_of_a_file_acts_in_the_engine_and_in_the_driven_loop(cogging: Path) -> None:
    with_it, without = load_chain(CHAIN), load_chain([*SERVO, ENCODER])
    for angle in (-0.4, 0.1, 0.9):
        pull = COGGING["amplitude"] * math.sin(COGGING["count"] * angle + COGGING["phase"])
        assert held_torque(with_it, angle) - held_torque(without, angle) == pytest.approx(pull, abs=1e-12)
    time = np.arange(0.0, 1.0, 0.005)
    link = np.stack([0.5 * np.sin(3.0 * time), 1.5 * np.cos(3.0 * time), -4.5 * np.sin(3.0 * time)], axis=1)
    torques = [drive(chain.to_list(), link[:, 0] + 0.05, link, time)[:, 1] for chain in (with_it, without)]
    pull = COGGING["amplitude"] * np.sin(COGGING["count"] * link[:, 0] + COGGING["phase"])
    np.testing.assert_allclose(torques[0] - torques[1], pull, atol=1e-9)


def held_torque(chain: sealegs.actuators.Chain, angle: float) -> float:
    """Torque of a chain on a joint at an angle, in the engine [N.m]."""
    spec = mujoco.MjSpec()
    arm = spec.worldbody.add_body(name="arm")
    arm.add_joint(name="joint", axis=(0.0, 1.0, 0.0))
    arm.add_geom(size=(0.02, 0.0, 0.0), pos=(0.0, 0.0, -0.1), mass=0.3)
    drivetrain = Drivetrain(spec, {"joint": chain})
    data = mujoco.MjData(drivetrain.model)
    data.qpos[0], data.ctrl[0] = angle, angle + 0.02
    mujoco.mj_forward(drivetrain.model, data)
    return float(drivetrain.state("joint", data.userdata, S_TORQUE))


def test_a_stage_of_a_file_turns_with_its_joint_and_comes_back_from_its_yaml(cogging: Path, tmp_path: Path) -> None:
    chain = load_chain([*CHAIN[:-1], {"encoder": {}}])
    for zero, sign in ((0.0, -1.0), (0.4, 1.0), (-0.3, -1.0)):
        assert apart(chain, zero, sign) < 1e-9
    path = tmp_path / "chain.yaml"
    path.write_text(chain.to_yaml())
    assert load_chain(path).to_list() == chain.to_list()
    assert [stage.name for stage in load_chain("sts3215").with_stage(STAGES["cogging"].neutral()).stages] == [
        "delay", "position_p", "duty_limit", "supply", "dc_motor", "cogging", "friction", "encoder",
    ]  # fmt: skip


def test_single_and_vector_environments_are_equal_with_a_stage_of_a_file(cogging: Path) -> None:
    single = sealegs.make_env("bench", actuator=CHAIN)
    vector = sealegs.make_env("bench", num_envs=2, actuator=CHAIN)
    one, _ = single.reset(seed=3)
    both, _ = vector.reset(seed=[3, 4])
    for k in range(20):
        action = np.full(single.action_space.shape, 0.5 * math.sin(0.3 * k), np.float32)
        np.testing.assert_array_equal(one, both[0])
        one = single.step(action)[0]
        both = vector.step(np.stack([action, -action]))[0]
    np.testing.assert_array_equal(one, both[0])


def test_compiled_code_of_a_file_counts_as_long_as_it_and_what_it_imports_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "numbers_of_mine.py").write_text("TEETH = 7\n")
    file = tmp_path / "law_of_mine.py"
    file.write_text("from numbers_of_mine import TEETH\nfrom sealegs.actuators.layout import S_TIME\n")
    script = (
        "import sys\nsys.path.insert(0, sys.argv[1])\nimport law_of_mine\nfrom pathlib import Path\n"
        "from sealegs.actuators.compiled import digest, imported\nfile = Path(law_of_mine.__file__)\n"
        "print(digest(file), *sorted(path.name for path in imported(file)))"
    )

    def said() -> list[str]:
        done = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True)
        return done.stdout.split()

    before = said()
    assert before[1:] == ["law_of_mine.py", "layout.py", "numbers_of_mine.py"]
    (tmp_path / "numbers_of_mine.py").write_text("TEETH = 8\n")
    assert said()[0] != before[0]
    file.write_text("# a comment\n" + file.read_text())
    assert digest(file) == digest(file)


# --- a cause --------------------------------------------------------------------------------------------------------


def test_numbers_of_a_stage_of_a_file_are_fitted_to_a_machine_that_has_the_effect(cogging: Path) -> None:
    data, _ = hidden_bench(constants=HIDDEN, seed=3, runs=1, duration=6.0, nominal_error=0.0)
    asked = {"cogging.amplitude": (0.0, 0.4), "cogging.count": (6.6, 7.4), "cogging.phase": None}
    found = sealegs.fit(data, asked)
    assert found.values["cogging.amplitude"].value == pytest.approx(HIDDEN["cogging"], rel=0.05)
    assert found.error < 0.3 * found.error_before


@pytest.mark.long
@pytest.mark.parametrize("way", ["named", pytest.param("installed", marks=pytest.mark.weekly)])
def test_a_hidden_effect_of_no_catalogue_is_named_by_one_file_from_outside(
    way: str, tmp_path: Path, installed: Path
) -> None:
    """The effect is planted by the testbed, which shares no code with sealegs; nothing of sealegs knows it."""
    data, _ = hidden_bench(constants=HIDDEN, seed=3, runs=3, duration=16.0)
    for run in data.runs:
        write_run(run, tmp_path / "logs")
    (tmp_path / "cogging.py").write_text(PAGE["cogging.py"])
    words = ["plugins=cogging.py"] if way == "named" else []
    environment = {**os.environ, "PYTHONPATH": str(installed)} if way == "installed" else dict(os.environ)

    def typed(*command: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", "sealegs", *command]
        return subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    told = typed("diagnose", "log=logs", "out=diagnosis", *words)
    assert told.returncode == 0, told.stderr
    found = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())
    assert found["verdict"] == "explained" and [cause["name"] for cause in found["causes"]] == ["drive.cogging"]
    assert found["causes"][0]["parameters"]["cogging.amplitude"]["value"] == pytest.approx(0.12, rel=0.05)
    assert found["extension"]["engine"]["distance"] < 2e-4
    train = ["train", "env=bench", "extended=diagnosis", "total_timesteps=64", "n_envs=2", "evaluate.every=0"]
    small = ["evaluate.episodes=1", "video.seconds=0", "agent.n_steps=16", "agent.batch_size=16"]
    trained = typed(*train, *small, *words)
    assert trained.returncode == 0, trained.stderr
    if way == "named":
        assert f"plugins={tmp_path / 'cogging.py'}" in told.stdout
        refused = typed(*train, *small)
        assert refused.returncode == 2 and "no stage 'cogging'" in refused.stderr and "plugins=" in refused.stderr


@pytest.mark.long
def test_processes_that_are_started_know_the_files_that_were_named(tmp_path: Path) -> None:
    (tmp_path / "cogging.py").write_text(PAGE["cogging.py"])
    (tmp_path / "parent.py").write_text(
        "import multiprocessing\nimport sealegs\nfrom sealegs.common import plugins\n\n\n"
        "def known(chain):\n    from sealegs.gap.causes.catalogue import catalogue, JointModel\n"
        "    return len(chain.program()), 'drive.cogging' in [c.name for c in catalogue(JointModel(chain))]\n\n\n"
        "if __name__ == '__main__':\n    sealegs.add_plugins('cogging.py')\n"
        f"    chain = sealegs.load_chain({CHAIN!r})\n"
        "    with multiprocessing.get_context('spawn').Pool(1, plugins.load, ('causes',)) as pool:\n"
        "        print(pool.apply(known, (chain,)) == (len(chain.program()), True))\n"
    )
    done = subprocess.run([sys.executable, "parent.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "True", done.stderr


# --- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("1 / 0\n", r"bad.py cannot be run: ZeroDivisionError"),
        (PAGE["cogging.py"].replace('"cogging"', '"friction"'), r"there is a stage 'friction' already"),
        (PAGE["cogging.py"].replace('"drive.cogging"', '"drive.delay"'), r"has a cause 'drive.delay' already"),
        (PAGE["cogging.py"].replace(', parity=Phase("count")', ""), r"bad.py: cogging.phase does not state"),
    ],
)
def test_a_file_that_cannot_be_used_ends_in_a_sentence(
    text: str, sentence: str, tmp_path: Path, forgotten: None
) -> None:
    (tmp_path / "bad.py").write_text(text)
    with pytest.raises(SealegsError, match=sentence):
        plugins.add(tmp_path / "bad.py")
    assert not plugins.arguments()


def test_a_file_that_is_not_there_and_a_stage_that_no_file_adds_end_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match=r"plugins=.*missing.py: there is no Python file"):
        plugins.add(tmp_path / "missing.py")
    with pytest.raises(SealegsError, match=r"no stage 'cogging'.*plugins="):
        load_chain(CHAIN)


@pytest.mark.parametrize(
    ("law", "sentence"),
    [
        ("def pulled(p, i, value, w, temperature):\n    return value\n", r"takes 'temperature' in 'act'"),
        ("def pulled(p, i, value, q):\n    return value + 'x'\n", r"law of 'cogging' does not compile in 'act'"),
    ],
)
def test_a_law_that_cannot_be_compiled_ends_in_a_sentence(
    law: str, sentence: str, tmp_path: Path, forgotten: None
) -> None:
    head, tail = PAGE["cogging.py"].split("@compiled()\ndef pulled")
    file = tmp_path / "cogging.py"
    file.write_text(f"{head}@compiled()\n{law}\n\nCogging.law = {tail.partition('Cogging.law = ')[2]}")
    plugins.add(file)
    with pytest.raises(SealegsError, match=sentence):
        load_chain(CHAIN).program()


@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        (["log=x"], []),
        (["plugins=a.py", "log=x"], ["a.py"]),
        (["plugins=[a.py, 'b.py']"], ["a.py", "b.py"]),
        (["plugins=null"], []),
    ],
)
def test_the_files_of_a_command_line(arguments: list[str], files: list[str]) -> None:
    assert plugins.named_by(arguments) == files


# --- installed distributions ----------------------------------------------------------------------------------------


def test_an_installed_robot_and_task_are_found_by_their_names(installed: Path) -> None:
    assert get_robot("dog").name == "bench"
    env = sealegs.make_env("plugins/rest")
    assert env.reset(seed=0)[0].shape == sealegs.make_env("bench").reset(seed=0)[0].shape
    with pytest.raises(SealegsError, match=r"no installed package adds a task 'rset' \(did you mean 'rest'"):
        sealegs.make_env("plugins/rset")
    with pytest.raises(SealegsError, match=r"others_robot:DOG is no task"):
        sealegs.make_env("plugins/none")


def test_an_installed_servo_is_a_model_and_a_broken_package_is_named(installed: Path) -> None:
    assert "sts_mine" in model_names()
    assert load_model("sts_mine").model_number == 4321
    with pytest.raises(SealegsError, match=r"installed others adds as 'broken'.*cannot be imported.*no_such_module"):
        load_model("broken")


# --- servo models ---------------------------------------------------------------------------------------------------


def test_a_servo_model_is_given_by_the_path_of_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sts_mine.yaml").write_text(PAGE["sts_mine.yaml"])
    monkeypatch.chdir(tmp_path)
    model = load_model("sts_mine.yaml")
    assert (model.model_number, model["max_torque"].high) == (4321, 800)
    assert "velocity_p_gain" not in model.registers and model["p_gain"].address == 21
    assert load_model(model.name) is model  # by the name that goes into logs and to other processes


def test_a_robots_file_names_a_table_from_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "sts_mine.yaml").write_text(PAGE["sts_mine.yaml"])
    (tmp_path / "leg.xml").write_text(
        '<mujoco><worldbody><body><joint name="knee" axis="0 1 0"/><geom size="0.02 0.1" mass="0.2" type="capsule"/>'
        "</body></worldbody></mujoco>"
    )
    (tmp_path / "leg.yaml").write_text(
        "model: leg.xml\njoints: {knee: {chain: sts3215}}\ndeploy: {servo: sts_mine.yaml, "
        "buses: {hand: {servo: sts_mine.yaml, port: /dev/x, joints: []}}}\n"
    )
    config = own_robot(str(tmp_path / "leg.yaml"))
    assert config["servo"] == config["buses"]["hand"]["servo"] == str(tmp_path / "sts_mine.yaml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("model_number: 3\n", r"no register table of a servo: it lacks 'registers'"),
        ("like: sts3216\nmodel_number: 3\n", r"no register table for the servo model 'sts3216'"),
        ("like: sts_mine.yaml\n", r"no register table of a servo"),
        ("like: sts3215\nregisters: {p_gain: {address: 3}}\n", r"it lacks 'bytes'"),
        ("like: sts3215\nregisters: {p_gain: {adress: 3, bytes: 1}}\n", r"adress"),
    ],
)
def test_a_table_that_is_none_ends_in_a_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "sts_mine.yaml").write_text(text)
    with pytest.raises(SealegsError, match=sentence):
        load_model(str(tmp_path / "sts_mine.yaml"))


# --- three numbers --------------------------------------------------------------------------------------------------


def test_numbers_are_fitted_with_their_intervals() -> None:
    data, truth = hidden_bench({"friction.viscous": 0.05}, seed=5, runs=1, duration=6.0, nominal_error=0.0)
    found = sealegs.fit(data, ["friction.viscous", "friction.coulomb"])
    viscous = found.values["friction.viscous"]
    true = truth["machines"][0].viscous
    assert viscous.believed < viscous.low < true < viscous.high and viscous.value == pytest.approx(true, rel=0.05)
    assert (viscous.unit, found.joint, found.signal) == ("N.m.s/rad", "servo", "servo.position")
    assert found.error < 1.5 * truth["noise_floor"] < found.error_before
    assert "friction.viscous = " in str(found)


@pytest.mark.parametrize(
    ("parameters", "joint", "sentence"),
    [
        (["friction.columb"], None, r"no number 'friction.columb'"),
        (["friction.load_external"], None, r"has no 'friction.load_external'.*bounds"),
        ({"friction.coulomb": (2.0, 1.0)}, None, r"bounds 2 and 1; the lower one comes first"),
        ([], None, r"names no number"),
        (["friction.coulomb"], "elbow", r"no joint 'elbow'; there are servo"),
    ],
)
def test_numbers_that_cannot_be_fitted_end_in_a_sentence(parameters, joint: str | None, sentence: str) -> None:
    data, _ = hidden_bench(seed=5, runs=1, duration=6.0)
    with pytest.raises(SealegsError, match=sentence):
        sealegs.fit(data, parameters, joint=joint)


# --- compiled laws ----------------------------------------------------------------------------------------------------


MODULE = '''"""A law."""

from .numbers import FACTOR
from sealegs.actuators.compiled import Compiler

compiled = Compiler("a small law", "a moment")


@compiled()
def law(x):
    """Twice as much."""
    return FACTOR * x  # or thrice
'''
RUN = "import small.law, sys; print(small.law.law(float(sys.argv[1])), len(small.law.law.stats.cache_misses))"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with a small law and a number in a file of its own."""
    folder = tmp_path / "small"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "numbers.py").write_text("FACTOR = 2.0\n")
    (folder / "law.py").write_text(MODULE)
    return folder


def start(package: Path, value: float = 3.0) -> subprocess.Popen[str]:
    """A process that calls the law and prints its value and how often nothing was found on disk."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(package.parent / "cache"), "PYTHONPATH": str(package.parent)}
    return subprocess.Popen(
        [sys.executable, "-c", RUN, str(value)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[float, int, str]:
    """Value of the law, how often it was compiled, and what a person was told."""
    out, error = process.communicate()
    assert process.returncode == 0, error
    value, misses = out.split()
    return float(value), int(misses), error


@pytest.mark.long
def test_the_first_compilation_says_what_it_does_and_the_next_process_finds_it_done(package):
    value, misses, told = finish(start(package))
    assert (value, misses) == (6.0, 1)
    assert told == "Compiling a small law once (a moment) ...\n"
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_processes_that_compile_at_once_all_get_their_own_result(package):
    values = (1.0, 2.0, 3.0)
    running = [start(package, value) for value in values]
    assert [finish(process)[0] for process in running] == [2.0 * value for value in values]
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_a_comment_a_docstring_and_a_line_further_down_compile_nothing_anew(package):
    assert finish(start(package))[1] == 1
    text = MODULE.replace("# or thrice", "# or not").replace("Twice as much.", "Double.").replace("@", "\n\n\n@")
    (package / "law.py").write_text(text)
    assert finish(start(package)) == (6.0, 0, "")


@pytest.mark.long
def test_a_changed_number_in_a_file_that_the_law_imports_compiles_it_anew(package):
    assert finish(start(package))[0] == 6.0
    (package / "numbers.py").write_text("FACTOR = 5.0\n")
    assert finish(start(package))[:2] == (15.0, 1)


@pytest.mark.long
def test_without_a_writable_package_folder_the_laws_are_kept_in_the_cache_of_the_user(tmp_path):
    run = (
        "import tempfile\n"
        "def refuse(**where): raise PermissionError\n"
        "tempfile.TemporaryFile = refuse\n"
        "from sealegs.actuators import compiled\n"
        "assert compiled.folder() == compiled.user_folder()\n"
        "print(compiled.folder())"
    )
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(tmp_path)
    done = subprocess.run([sys.executable, "-c", run], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    if sys.platform.startswith("linux"):
        assert Path(done.stdout.strip()) == tmp_path / "sealegs"


def test_the_laws_depend_on_their_stages_and_on_nothing_that_they_are_used_by():
    files = {path.name for path in compiling.imported(Path(law.__file__))}
    assert {"law.py", "layout.py", "friction.py", "motor.py"} <= files
    assert not files & {"simulator.py", "engine.py", "chain.py", "joint_model.py"}
    assert {"law.py", "friction.py", "constants.py"} <= {
        path.name for path in compiling.imported(Path(simulator.__file__))
    }
