"""One policy in its models and on the machine: the model that has the hidden effect is nearer, and it is said where."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.actuators import load_chain
from sealegs.evaluation.comparison import MACHINE, Comparison, compare, find_departures, table, verdict
from sealegs.evaluation.figures import hop_height, measure, strongest_frequency
from sealegs.evaluation.page import columns, write_comparison
from sealegs.gap.log import read_measured
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.simulated import Recording

from tests.servo_runs import config, gentle_policy

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
