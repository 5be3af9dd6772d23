"""The loop's steps run with the machine that the loop was given, and its end tells slides as well as hinges."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from sealegs.agents.config import read_config
from sealegs.commands import demo, deploy, diagnose, evaluate, loop, train
from sealegs.configs.compose import compose, split
from sealegs.evaluation import pictures as comparison_picture
from sealegs.hw.machine.own_robot import READERS

SHORT = ["excitations=[chirp]", "loads=[{mass:0.3,length:0.1}]"]


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[list[str]]]:
    """Arguments of each step of a loop in which nothing runs."""
    asked: dict[str, list[list[str]]] = {"deploy": [], "diagnose": [], "train": [], "evaluate": []}
    for command in (deploy, diagnose, train, evaluate):
        monkeypatch.setattr(command, "main", asked[command.__name__.rpartition(".")[2]].append)
    monkeypatch.setattr(loop, "tell", lambda *_: None)
    monkeypatch.setattr("builtins.input", lambda _: "")
    return asked


def composed(steps: dict[str, list[list[str]]], command: str) -> dict[str, Any]:
    """Config of a step's only run."""
    (arguments,) = steps[command]
    plain = {"deploy": deploy.PLAIN, "evaluate": evaluate.PLAIN}[command]
    return compose(command, split(arguments, plain), readers=READERS)


@pytest.mark.long
@pytest.mark.parametrize("step", ["deploy", "evaluate"])
def test_what_is_said_of_bus_and_servos_holds_in_every_step(
    step: str, steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    """Both were measured as Feetech's, at 1 Mbit/s."""
    given = ["hw=dynamixel", "hw.baudrate=57600", "hw.watchdog=null", "hw.timeout=0.1"]
    given += ["robot.servo=xl330_m288", "robot.actuator=xl330", "robot.rest=sit", "robot.park={joint:0.0}"]
    given += ["robot.safety.speed=9", "robot.safety.log_only=[following]", "port=/dev/ttyUSB1"]
    loop.main([*SHORT, *given, f"out={tmp_path / 'loop'}"])
    config = composed(steps, step)
    assert "hw=dynamixel" in steps[step][0] and config["port"] == "/dev/ttyUSB1"
    assert config["hw"] == {"baudrate": 57600, "timeout": 0.1, "watchdog": None, "virtual": None}
    robot = config["robot"]
    assert (robot["servo"], robot["actuator"], robot["rest"]) == ("xl330_m288", "xl330", "sit")
    assert robot["park"] == {"joint": 0.0}
    assert robot["safety"]["speed"] == 9 and robot["safety"]["log_only"] == ["following"]
    assert "actuator=xl330" in steps["train"][0]


@pytest.mark.long
def test_numbers_of_the_robot_hold_in_every_step_and_a_load_comes_on_top(
    steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    loop.main([*SHORT, "robot.params={arm_mass:0.02,mass:0.9}", "robot.params.length=0.2", f"out={tmp_path / 'loop'}"])
    assert composed(steps, "deploy")["robot"]["params"] == {"arm_mass": 0.02, "mass": 0.3, "length": 0.1}
    believed = {"arm_mass": 0.02, "mass": 0.9, "length": 0.2}
    assert composed(steps, "evaluate")["robot"]["params"] == believed
    trained = read_config(steps["train"][0]).config
    assert trained is not None and trained.env["params"] == believed


def test_a_chain_for_each_joint_reaches_training_as_it_was_given(
    steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    loop.main([*SHORT, 'robot.actuator={"joint": "sts3250"}', f"out={tmp_path / 'loop'}"])
    trained = read_config(steps["train"][0]).config
    assert trained is not None and trained.actuator == {"joint": "sts3250"}
    assert composed(steps, "deploy")["robot"]["actuator"] == {"joint": "sts3250"}


@pytest.mark.long
@pytest.mark.parametrize("step", ["deploy", "evaluate"])
def test_a_virtual_machine_is_the_one_that_was_asked_for(
    step: str, steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    faults = tmp_path / "it's late.yaml"
    given = ["hw.virtual.latency=0.001", "hw.virtual.time=real", f"hw.virtual.faults={faults}"]
    own = ["silence=7", "calibration=mine.yaml", "hidden={friction.coulomb: 0.2}", "seed=5"]
    loop.main([*SHORT, *given, *own, f"out={tmp_path / 'loop'}"])
    hidden, config = tmp_path / "loop" / "hidden.yaml", composed(steps, step)
    machine = {"latency": 0.001, "time": "real", "faults": str(faults), "hidden": str(hidden)}
    assert config["hw"]["virtual"] == machine
    assert yaml.safe_load(hidden.read_text()) == {"friction.coulomb": 0.2}
    assert (config["silence"], config["calibration"], config["seed"]) == (7, "mine.yaml", 5)


@pytest.mark.parametrize("step", ["deploy", "evaluate"])
def test_what_a_virtual_machine_hides_may_be_a_file(
    step: str, steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    loop.main([*SHORT, "stepped=false", "hw.virtual.hidden=secret.yaml", f"out={tmp_path / 'loop'}"])
    assert composed(steps, step)["hw"]["virtual"] == {"hidden": "secret.yaml", "time": "real"}


def test_a_port_is_named_to_the_steps_only_where_there_is_one(
    steps: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    """Without port= the first step was given port=None, a file of that name."""
    loop.main([*SHORT, "hw=feetech", f"out={tmp_path / 'loop'}"])
    assert composed(steps, "deploy")["port"] is None


TURNS, SLIDES = "position error, same goals [mrad]", "position error, same goals [mm]"
ROBOTS = {
    "slides only": (
        {"same_goals": None, "same_goals_of_slides": 0.0023},
        "off by 2.3 mm in the nominal model",
        [SLIDES],
    ),
    "turning joints only": ({"same_goals": 0.012, "same_goals_of_slides": None}, "off by 12 mrad in the", [TURNS]),
    "an arm with a gripper": (
        {"same_goals": 0.012, "same_goals_of_slides": 0.0004},
        "off by 12 mrad and 0.4 mm in the nominal model",
        [TURNS, SLIDES],
    ),
    "a comparison of before slides were told": ({"same_goals": 0.012}, "off by 12 mrad in the nominal model", [TURNS]),
}


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures that were drawn."""
    drawn, plain = [], comparison_picture.figure

    def kept(*size: float) -> Any:
        drawn.append(plain(*size))
        return drawn[-1]

    monkeypatch.setattr(comparison_picture, "figure", kept)
    return drawn


@pytest.mark.long
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_gap_is_told_and_drawn_in_the_unit_of_each_kind_of_joint(
    robot: str, images: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot of slides ended a loop in a traceback, and the slides of others were left out."""
    errors, said, labels = ROBOTS[robot]
    figures = {name: {"reward": 3.0, **errors} for name in ("nominal", "extended", "machine")}
    folders = {name: tmp_path / name for name in ("nominal", "extended")}
    for folder in folders.values():
        folder.mkdir()
        (folder / "comparison.json").write_text(json.dumps({"figures": figures}))
    loop.tell(tmp_path, folders)
    assert said in capsys.readouterr().out and (tmp_path / "gap.png").exists()
    (image,) = images
    assert [axes.get_ylabel() for axes in image.axes] == [*labels, "reward per second"]
    for axes, label in zip(image.axes, labels, strict=False):
        error = errors["same_goals" if label == TURNS else "same_goals_of_slides"]
        assert [bar.get_height() for bar in axes.patches] == pytest.approx([1e3 * error] * 4)


# --- the demo from the log to policies that are tried on the machine -------------------------------------------------


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
