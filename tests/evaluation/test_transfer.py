"""The transfer study: its figures, its order, and a machine that is no simulation of sealegs as a task's robot."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.actuators import load_chain
from sealegs.commands.transfer import main
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.engine.sb3 import EngineVecEnv
from sealegs.evaluation.comparison import MACHINE, Comparison, compare, find_departures, table, verdict
from sealegs.evaluation.figures import hop_height, measure, strongest_frequency
from sealegs.evaluation.page import columns, write_comparison
from sealegs.evaluation.transfer.cells import EXTENDED, HAND, LIMIT, NOMINAL, PlantEngine, on_plant
from sealegs.evaluation.transfer.figures import figures_of, interquartile_mean, interval
from sealegs.evaluation.transfer.machines import Hidden, case_of, publish, running
from sealegs.gap.log import read_measured
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.simulated import Recording

from testbed.everyday.machines import links_of
from testbed.everyday.physics import simulate
from tests.servo_runs import config, gentle_policy


def errors(extended: float) -> dict[str, dict[str, np.ndarray]]:
    return {
        f"bench-{k}": {
            NOMINAL: np.array([5.0, 5.2]) + 0.1 * k,
            HAND: np.array([4.0, 4.4]),
            EXTENDED: np.array([extended, extended + 0.1]),
            LIMIT: np.array([2.0, 2.0]),
        }
        for k in range(5)
    }


def test_the_way_to_the_limit_is_counted_from_nominal() -> None:
    found = figures_of(errors(2.5), EXTENDED)
    assert found is not None
    assert found.closed == pytest.approx((5.3 - 2.55) / (5.3 - 2.0))
    assert found.better == found.machines == 5
    assert found.worse == ()
    assert found.share[1] <= found.share[0] <= found.share[2] <= 0.8


def test_a_machine_on_which_the_extension_harms_is_named() -> None:
    found = figures_of(errors(9.0), EXTENDED)
    assert found is not None
    assert found.better == 0
    assert len(found.worse) == 5


def test_an_interquartile_mean_leaves_the_outer_quarters_out() -> None:
    assert interquartile_mean(np.array([-100.0, 1.0, 2.0, 100.0])) == 1.5
    middle, low, high = interval([np.array([0.5, 0.7]), np.array([0.4, 0.6]), np.array([0.9, 1.0])])
    assert low < middle < high


def machine(tmp_path: Path, count: int = 2) -> PlantEngine:
    hidden = Hidden("pan_tilt", 0, 100)
    task = TrackTask.on(publish(hidden, tmp_path))(lead=0.0)
    return PlantEngine(task, running(hidden, count, 0.02, 0), count, 0.02, 25)


def test_a_machine_that_runs_moves_as_the_one_that_was_recorded(tmp_path: Path) -> None:
    hidden = Hidden("leg", 0, 100)
    case = case_of(hidden)
    random = np.random.default_rng(0)
    goals = np.array(case.machine.middle) + random.uniform(-0.2, 0.2, (20, 3))
    plant = running(hidden, 1, 0.02, 0)
    plant.place(np.array([0]), goals[:1])
    for goal in goals:
        plant.step(goal[None])
    servos, tip = case.with_effects(case.effects)
    links = links_of(case.machine, case.masses, tip)
    _, _, angles, *_ = simulate(links, servos, 0.02 * np.arange(20), goals, 0.4)
    np.testing.assert_allclose(plant.links[0], angles[-1], atol=1e-6)


def test_a_task_on_a_machine_sees_what_its_encoders_say(tmp_path: Path) -> None:
    engine = machine(tmp_path)
    engine.seed(3)
    seen = engine.reset()
    names = engine.task.observation_names()
    assert seen.shape == (2, len(names))
    reading = seen[:, [names.index(f"motor reading of {joint} [rad]") for joint in ("pan", "tilt")]]
    assert np.abs(reading - engine.motion(np.zeros((2, 2))).link).max() < 5e-3
    total, error, _ = on_plant(lambda seen: np.zeros((len(seen), 2)), engine)
    assert (total > 0.0).all() and (total <= 25.0).all()
    assert (error > 1e-4).all() and (error < 0.5).all()


def test_episodes_on_a_machine_end_and_begin_as_stable_baselines_expects(tmp_path: Path) -> None:
    env = EngineVecEnv(machine(tmp_path))
    env.reset()
    for step in range(25):
        _, _, done, infos = env.step(np.zeros((2, 2)))
        assert done.all() == (step == 24)
    assert {"terminal_observation", "episode", "TimeLimit.truncated"} <= infos[0].keys()
    episode = infos[0]["episode"]
    terms = sum(value for name, value in episode.items() if name.startswith("reward_"))
    assert episode["r"] == pytest.approx(terms, abs=1e-5)


def test_a_number_of_the_task_is_set_on_a_machine_as_on_simulations(tmp_path: Path) -> None:
    env = EngineVecEnv(machine(tmp_path))
    env.set_attr("tracking_weight", 0.0)
    env.reset()
    assert env.get_attr("tracking_weight") == [0.0, 0.0]
    assert (env.step(np.zeros((2, 2)))[1] <= 0.0).all()  # the other terms are costs
    with pytest.raises(SealegsError, match="tracking_weight takes a number"):
        env.set_attr("tracking_weight", "much")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["robots=[spider]"], "no hidden machines 'spider'"),
        (["least_loss=1.5"], "least_loss is 1.5; it is a share"),
        (["treatments=[extended]"], "treatments must have 'nominal' and 'limit'"),
        (["treatments=[nominal,limit,none]"], "there is no treatment 'none'"),
    ],
)
def test_a_wrong_study_is_answered_in_one_sentence(arguments: list[str], sentence: str, tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match=sentence):
        main([*arguments, f"out={tmp_path / 'study'}"])


@pytest.mark.long
def test_a_small_study_goes_from_machines_to_a_table_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    out = tmp_path / "study"
    small = ["robots=[bench]", "machines=2", "seeds=1", "seed=100", "least_loss=0", "workers=1", "episodes=4"]
    small += ["total_timesteps=3200", "n_envs=16", f"out={out}"]
    main(small)
    document = json.loads((out / "transfer.json").read_text())
    assert len(document["errors"]) == 2
    assert all(len(own) == 10 for own in document["errors"].values()), "two references and eight treatments"
    assert (out / "bench.png").is_file()
    assert "| limit | 1.00" in (out / "transfer.md").read_text()
    cell = next((out / next(iter(document["errors"]))).glob("nominal-0.json"))
    before = {file: file.stat().st_mtime_ns for file in out.glob("*/*.json") if file != cell}
    kept = json.loads(cell.read_text())
    cell.unlink()
    main(small)
    assert json.loads(cell.read_text())["reward"] == kept["reward"], "the same cell gives the same figures"
    assert {file: file.stat().st_mtime_ns for file in before} == before, "what is done is not done again"
    with pytest.raises(SealegsError, match="was begun with seed=100"):
        main([*(word for word in small if not word.startswith("seed=")), "seed=7"])


# --- one policy in its models and on the machine: the model that has the hidden effect is nearer, and it is said
# where.

HIDDEN = {"friction.coulomb": 0.25, "delay.seconds": 0.04}


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> tuple[Comparison, Path]:
    """A gentle policy on a machine that hides friction and delay, in stepped time."""
    folder = tmp_path_factory.mktemp("comparison")
    hidden, extended = folder / "hidden.yaml", folder / "extended.yaml"
    hidden.write_text(yaml.safe_dump(HIDDEN))
    chain = load_chain("sts3215")
    for path, value in HIDDEN.items():
        chain = chain.with_value(path, value)
    extended.write_text(chain.to_yaml())
    policy = gentle_policy(folder / "policy.onnx")
    settings = config(f"hw.virtual.hidden={hidden}", "hw.virtual.time=stepped", "silence=20")
    settings |= {"policy": str(policy), "nominal": None, "extended": str(extended), "seconds": 4.0, "seed": 0}
    return compare(settings, folder, lambda _: None), folder


@pytest.mark.long
def test_the_model_with_the_hidden_effect_is_nearer_to_the_machine(comparison: tuple[Comparison, Path]) -> None:
    figures = comparison[0].figures
    assert comparison[0].ending == "finished"
    nominal, extended = figures["nominal"], figures["extended"]
    assert extended.same_goals < 0.5 * nominal.same_goals
    assert nominal.gap is not None and nominal.gap_at == "joint" and "a gap" in verdict(nominal)
    assert extended.gap is None and "no gap" in verdict(extended), "nothing is hidden from the extended model"
    assert figures[MACHINE].same_goals == 0.0 and figures[MACHINE].departs is None
    assert nominal.departs is not None and nominal.departs_at is not None and nominal.departs_at < 4.0
    assert extended.departs is None
    assert math.isfinite(figures[MACHINE].reward) and set(figures[MACHINE].terms) == {
        "reward_tracking",
        "reward_energy",
    }
    log = read_measured(comparison[0].log).runs[0]
    moved = np.diff(log.joints["joint"].position) / np.diff(log.time).mean()
    assert comparison[0].runs[MACHINE].velocity[1 : len(moved) + 1, 0] == pytest.approx(moved), "as the models have it"
    assert math.isfinite(figures[MACHINE].energy) and math.isnan(figures[MACHINE].height), "the bench has no base"


@pytest.mark.long
def test_table_and_page_are_written_once_and_ask_no_network(comparison: tuple[Comparison, Path]) -> None:
    result, folder = comparison
    lines: list[str] = []
    written = write_comparison(result, folder, lines.append)
    document = json.loads(written["json"].read_text())
    assert document["figures"]["nominal"]["height"] is None, "JSON knows no NaN"
    page = written["page"].read_text()
    assert "joint: velocity" in page, "whatever may be named as first to depart is drawn"
    assert "Signals over time" in page and 'src="http' not in page and "same start and goals" in page
    header, rows = table(result)
    assert header == ["", "nominal", "extended", "machine"]
    labels = [row[0] for row in rows]
    assert "reward per second" in labels and "first to depart" in labels and "height of a hop [mm]" not in labels
    assert any("gap" in line for line in lines)
    with pytest.raises(FileExistsError):
        write_comparison(result, folder, lines.append)


def recording(position: np.ndarray, base: np.ndarray | None = None, **values: np.ndarray) -> Recording:
    time = np.arange(len(position)) / 100.0
    flat = np.ones((len(position), 1))
    columns: dict[str, Any] = {"goal": position, "position": position, "velocity": flat, "duty": flat, "current": flat}
    columns["voltage"] = flat
    columns = {name: np.reshape((columns | values)[name], (-1, 1)) for name in columns}
    return Recording(time, **columns, base=np.zeros((len(time), 0)) if base is None else base, rewards={})


def test_frequency_and_height_of_a_hop_are_those_of_the_motion() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    height = 0.18 + 0.04 * np.abs(np.sin(np.pi * 2.4 * time))
    assert strongest_frequency(height, 0.01) == pytest.approx(2.4, abs=0.05)
    assert hop_height(height, 0.01) == pytest.approx(0.04, abs=0.003)
    figures = measure(recording(np.sin(time), np.stack([time, height], axis=1)), build_robot(config()["robot"]))
    assert figures.frequency == pytest.approx(2.4, abs=0.05) and figures.height == pytest.approx(0.04, abs=0.003)
    assert math.isnan(strongest_frequency(np.zeros(100), 0.01)) and math.isnan(hop_height(np.ones(100), 0.01))


def test_the_signal_that_departs_first_is_named_with_its_time() -> None:
    robot = build_robot(config()["robot"])
    time = np.arange(0.0, 4.0, 0.01)
    truth, duty = np.sin(5.0 * time), np.cos(5.0 * time)
    machine = recording(truth, duty=duty)
    assert find_departures(machine, recording(truth + 0.01, duty=duty), robot) == {}
    late = recording(truth + 0.5 * (time > 2.5), duty=duty + 0.6 * (time > 1.5), goal=truth)
    departures = find_departures(machine, late, robot)
    assert list(departures) == ["joint.duty", "joint.position"]
    assert departures["joint.duty"] == pytest.approx(1.51) and departures["joint.position"] == pytest.approx(2.51)


def test_a_spike_is_no_departure() -> None:
    robot = build_robot(config()["robot"])
    truth = np.sin(np.arange(0.0, 4.0, 0.05))
    spiked = truth.copy()
    spiked[40] += 5.0
    assert find_departures(recording(truth), recording(spiked, goal=truth), robot) == {}


def test_long_names_do_not_run_into_the_next_column() -> None:
    lines = columns([["", "nominal", "extended"], ["departs first", "elbow_flex.current", "elbow_flex.current"]])
    assert "elbow_flex.current  elbow_flex.current" in lines[1] and len(set(map(len, lines))) == 1
