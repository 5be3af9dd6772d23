"""The hopper reaches the figures of its paper (paper 004) with one controller for both cases."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.brake_bench import BenchTable
from sealegs.common.errors import SealegsError
from sealegs.envs.hopper.controller import BangBang, spring_stiffness
from sealegs.papers.hopper import rows, servo_rows
from sealegs.papers.hopper.paper import CHAINS, PRINTED, Figures, Hops, Legs, by_period, flexions, measure

from tests.typed import Done, typed


@pytest.fixture(scope="module")
def hops() -> dict[str, Hops]:
    return {name: Legs(chain).hop(6.0) for name, chain in CHAINS.items()}


@pytest.fixture(scope="module")
def figures(hops: dict[str, Hops]) -> dict[str, Figures]:
    return {name: measure(recording) for name, recording in hops.items()}


@pytest.mark.parametrize("name", list(CHAINS))
def test_hopping_frequency_is_within_a_fifth_of_the_papers(figures: dict[str, Figures], name: str) -> None:
    assert figures[name].frequency == pytest.approx(PRINTED[name].frequency, rel=0.2)


def test_the_leg_jumps_higher_and_slower_with_actuator(figures: dict[str, Figures]) -> None:
    real, ideal = figures["with actuator"], figures["without actuator"]
    for field in ("height", "rise", "clearance"):
        assert getattr(real, field) > 1.5 * getattr(ideal, field)
    assert real.frequency < ideal.frequency


def test_hopping_is_regular_and_forward(figures: dict[str, Figures]) -> None:
    for value in figures.values():
        assert value.regularity < 0.02
        assert value.speed > 0.02


def test_both_runs_have_the_printed_control_parameters() -> None:
    controllers = [Legs(chain).controller for chain in CHAINS.values()]
    assert controllers[0] == controllers[1] == BangBang(0.3, 0.23, (-0.5, 1.0), (-0.61, 0.61), 2.0)


def test_the_servo_has_the_printed_numbers() -> None:
    chain = load_chain(CHAINS["with actuator"])
    assert chain.value("position_p.gain") == 75.0
    assert chain.value("regression.duty_torque") == pytest.approx(1.80438)
    assert chain.value("regression.speed_torque") == pytest.approx(-16.96e-3 * 60 / (2 * np.pi), rel=1e-5)
    assert chain.value("regression.constant") == pytest.approx(-0.13978)
    assert chain.value("regression.armature") == 0.010
    assert chain.value("friction.viscous") == 0.35
    assert (chain.value("spring.stiffness"), chain.value("spring.damping")) == (2.0, 0.0219)


def test_the_signal_has_three_states_and_the_sign_of_the_torque() -> None:
    controller = BangBang()
    rest, weights = np.array(controller.rest), np.array(controller.weights)
    for torque, state in ((0.0, 0.0), (0.29, 0.0), (0.31, 1.0), (-0.31, -1.0)):
        deflection = torque / controller.stiffness * weights / (weights @ weights)
        goals = controller.goals(rest + deflection, rest)
        assert goals == pytest.approx(rest + state * controller.amplitude * weights)


def test_periods_start_at_the_greatest_flexion(hops: dict[str, Hops]) -> None:
    recording = hops["with actuator"]
    starts = flexions(recording)
    middles = (starts[:-1] + starts[1:]) // 2
    assert (recording.height[starts].max()) < recording.height[middles].min()
    periods = by_period(recording, recording.link)
    assert periods.shape[1:] == (200, 2)
    assert periods[:, 0, 1] == pytest.approx(recording.link[starts[:-1], 1])


def test_four_legs_in_one_model_hop_as_one_does(hops: dict[str, Hops]) -> None:
    four = Legs("sv1270tg", count=4)
    assert four.model.nu == 8
    recording = four.hop(1.0)
    assert recording.height == pytest.approx(hops["with actuator"].height[:1000], abs=1e-3)


def test_rows_compare_recordings_of_the_period(hops: dict[str, Hops]) -> None:
    real, ideal = hops.values()
    assert rows.apart(real, real) == 0.0 < rows.apart(real, ideal)
    assert rows.peaks_in_flight(ideal) == 0.0 < rows.peaks_in_flight(real), "its motor steps, and does not swing"
    assert rows.at_its_limit(real, servo_rows.servo()) > rows.at_its_limit(real, servo_rows.servo(gain=1.0)) == 0.0


def test_a_polynomial_fits_a_bench_of_its_own_degree() -> None:
    duty, speed = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.9, 0.9, 9), np.linspace(-8.0, 8.0, 30)))
    table = BenchTable(duty, speed, 1.8 * duty - 0.16 * speed + 1e-3 * speed**3, np.full(270, 40.0), duty != 0.0)
    assert servo_rows.missed(table, table, 3) < 1e-9 < 0.01 < servo_rows.missed(table, table, 1)


def test_a_leg_that_stands_has_no_figures() -> None:
    with pytest.raises(SealegsError, match="does not hop"):
        measure(Legs(load_chain("sv1270tg").with_value("position_p.gain", 0.75)).hop(4.0))


def test_the_controller_asks_for_a_spring() -> None:
    with pytest.raises(SealegsError, match="needs one"):
        spring_stiffness(load_chain("sts3215"))


def _evaluate(*arguments: str) -> Done:
    return typed("evaluate", *arguments)


@pytest.mark.long
def test_evaluate_writes_numbers_and_pictures_and_never_over_old_ones(tmp_path: Path) -> None:
    out = tmp_path / "comparison"
    first = _evaluate("paper=hopper", f"out={out}", "seconds=4")
    assert first.returncode == 0, first.stderr
    assert "frequency of the hardware" in first.stdout
    written = json.loads((out / "hopper.json").read_text())
    assert written["printed"]["with actuator"] == {"frequency": 2.5, "height": 0.12}
    marks = {row["name"]: row["mark"] for row in written["rows"]}
    assert marks["frequency with actuator"] == marks["height with actuator"] == "fitted"
    decides = [row["name"] for row in written["rows"] if row["decides"]]
    assert "frequency of the hardware" in decides, "which ideal motors miss"
    assert marks["points that are left of the protocol"] == "fitted", "one of two readings, chosen"
    judged = {row["name"]: row["holds"] for row in written["rows"]}
    assert judged["four legs with actuators over real time"] is None, "it measures the computer"
    assert written["chosen"]["upper_length"]["value"] == "0.108 m" and written["not_built"]
    assert set(written["real_time_factor"]["with actuator"]) == {"1", "4"}
    assert (out / "time.png").stat().st_size > 10_000
    assert (out / "periods.png").stat().st_size > 10_000
    again = _evaluate("paper=hopper", f"out={out}", "seconds=4")
    assert again.returncode == 2
    assert "holds a comparison already" in again.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "say what to compare: paper=arm|biped|hexapod|hopper|leg"),
        (["paper=hoper"], "no paper 'hoper' (did you mean 'hopper'?)"),
        (["paper=hopper", "ot=x"], "no key 'ot' (did you mean 'out'?)"),
        (["paper=hopper", "seconds=1"], "at least 4"),
        (["paper=hopper", "seconds=nan"], "seconds takes a number, not nan"),
        (["paper=hopper", "seconds=inf"], "seconds takes a number, not inf"),
        (["paper=hopper", "seconds=long"], "seconds takes a number"),
    ],
)
def test_a_wrong_evaluation_is_answered_in_one_sentence(arguments: list[str], sentence: str) -> None:
    done = _evaluate(*arguments)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
