"""Actuator nets: training, parity with the compiled law, and what is refused."""

from __future__ import annotations

import dataclasses
import json
import math

import mujoco
import numpy as np
import pytest
from sealegs.actuators import ChainError, Drivetrain, SealegsError, load_chain
from sealegs.actuators.chain import LIBRARY
from sealegs.actuators.law import advance, begin, torque
from sealegs.actuators.layout import P_STATE_SIZE
from sealegs.actuators.net_data import PENDULUM, commands, simulated_runs
from sealegs.actuators.net_training import (
    Settings,
    TrainingRun,
    build,
    evaluate,
    flat_weights,
    prepare,
    require_torch,
    train,
    write_net,
)
from sealegs.actuators.stages.net import Net, read_net

from tests.typed import Done, typed

SHORT = Settings(epochs=40, patience=40, hidden=(16,), history=3)
INERTIA, GRAVITY, STIFFNESS, DAMPING = 0.01, 0.4, 3.0, 0.15


def bench_runs(count: int = 4, torque_logged: bool = True, noise: float = 0.0) -> list[TrainingRun]:
    """A spring-damper servo on a pendulum, integrated here, sampled at 200 Hz; its torque is held over each sample."""
    rng = np.random.default_rng(3)
    runs = []
    for number in range(count):
        goal = commands(rng, 2400, 200.0)
        position, velocity, force = (np.empty(len(goal)) for _ in range(3))
        q = w = 0.0
        for k, command in enumerate(goal):
            held = STIFFNESS * math.tanh(command - q) - DAMPING * w
            position[k], velocity[k], force[k] = q, w, held
            for _ in range(20):
                w += 0.00025 * (held - GRAVITY * math.sin(q)) / INERTIA
                q += 0.00025 * w
        seen = position + noise * rng.standard_normal(len(goal))
        time = 0.005 * np.arange(len(goal), dtype=np.float64)
        logged = force if torque_logged else None
        runs.append(TrainingRun(f"run {number}", time, goal, seen, velocity, logged, INERTIA, GRAVITY))
    return runs


@pytest.fixture(scope="module")
def trained():
    require_torch().set_num_threads(1)
    return train(bench_runs(), dataclasses.replace(SHORT, epochs=100))


@pytest.mark.long
def test_a_net_predicts_the_torque_of_runs_it_has_not_seen(trained):
    names = {run.name for run in trained.validation}
    assert names and not names & set(trained.arrays["training_runs"].tolist())
    assert trained.r2 > 0.95


@pytest.mark.long
def test_equal_seeds_train_equal_nets():
    runs = bench_runs(2)
    settings = dataclasses.replace(SHORT, epochs=3)
    first, second, other = (train(runs, dataclasses.replace(settings, seed=seed)) for seed in (1, 1, 2))
    assert np.array_equal(first.arrays["weights"], second.arrays["weights"])
    assert not np.array_equal(first.arrays["weights"], other.arrays["weights"])


@pytest.mark.long
def test_without_a_torque_column_the_net_learns_it_from_the_motion():
    unlogged = bench_runs(torque_logged=False, noise=2e-4)
    net = train(unlogged, SHORT)
    truth = bench_runs()[0]
    inputs = prepare(truth, SHORT, 200.0).inputs
    guess = evaluate(net.arrays, inputs)[5:]
    wanted = np.asarray(truth.torque)[5 : 5 + len(guess)]
    assert np.sqrt(np.mean((guess - wanted) ** 2)) < 0.25 * wanted.std()


def test_the_weak_form_is_exact_for_torques_held_over_a_sample():
    run = bench_runs(1, torque_logged=False)[0]
    held = np.asarray(bench_runs(1)[0].torque)
    prepared = prepare(dataclasses.replace(run, gravity=0.0, inertia=0.0, armature=INERTIA), Settings(), 200.0)
    load = 0.5 * GRAVITY * (np.sin(run.position[1:]) + np.sin(run.position[:-1]))
    seen = np.convolve(held[:-1] - load, prepared.weights[::-1], mode="valid")
    assert prepared.target == pytest.approx(seen, abs=0.03 * held.std())


@pytest.mark.long
def test_the_compiled_net_is_the_torch_net(tmp_path):
    """Stepped through a history, at the net's own rate inside a finer simulation."""
    torch = require_torch()
    torch.manual_seed(5)
    history, period = 3, 0.005
    net = build(torch, 2 * history, (32, 32)).double()
    rng = np.random.default_rng(5)
    arrays = {
        "format": np.array("sealegs actuator net 1"),
        "period": np.array(period),
        "history": np.array(history),
        "layers": np.array([2 * history, 32, 32, 1]),
        "input_mean": rng.normal(size=2 * history),
        "input_std": rng.uniform(0.5, 2.0, 2 * history),
        "input_low": np.full(2 * history, -99.0),
        "input_high": np.full(2 * history, 99.0),
        "torque_scale": np.array(1.7),
        "weights": flat_weights(net),
    }
    write_net(arrays, tmp_path / "net.npz")
    program = load_chain([{"net": {"file": str(tmp_path / "net.npz")}}]).program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    errors, speeds = [0.0] * history, [0.0] * history
    begin(program, state, 0.0, 0.0, 0.0, 0.0)
    for k in range(400):
        goal, q, w = rng.normal(size=3)
        if k:
            advance(program, state, k * 0.001)
        value = torque(program, state, k * 0.001, goal, q, w, 0.0, True)
        if k % 5 == 0:
            errors, speeds = [goal - q, *errors[:-1]], [w, *speeds[:-1]]
            inputs = (np.array(errors + speeds) - arrays["input_mean"]) / arrays["input_std"]
            with torch.no_grad():
                wanted = 1.7 * float(net(torch.tensor(inputs))[0])
            assert value == pytest.approx(wanted, abs=1e-9)
            assert evaluate(arrays, np.array([errors + speeds]))[0] == pytest.approx(wanted, abs=1e-9)
        assert value == pytest.approx(wanted, abs=1e-9)  # held between its samples


def test_the_committed_net_moves_as_the_chain_it_was_trained_on():
    goal = commands(np.random.default_rng(77), 1000, 100.0)
    paths = []
    for name in ("sts3215", "net"):
        driven = Drivetrain(
            mujoco.MjSpec.from_string(PENDULUM.format(step=0.001, mass=0.5, length=0.12)), {"shaft": name}
        )
        data = mujoco.MjData(driven.model)
        paths.append([])
        for command in goal:
            data.ctrl[0] = command
            mujoco.mj_step(driven.model, data, 10)
            paths[-1].append(float(data.qpos[0]))
    sts, net = np.array(paths)
    assert np.sqrt(np.mean((sts - net) ** 2)) < 0.03 * sts.std()


def test_a_net_at_another_rate_than_the_chain_asks_for_is_refused():
    file = str(LIBRARY / "sts3215_net.npz")
    with pytest.raises(ChainError, match="was trained at 200 Hz but the chain asks for 50 Hz"):
        Net(file=file, rate=50.0)
    assert Net(file=file, rate=200.0).period() == 0.005


def test_files_that_are_no_nets_are_refused(tmp_path):
    path = tmp_path / "net.npz"
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ChainError, match="not a readable actuator net"):
        Net(file=str(path))
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    with pytest.raises(ChainError, match="not an actuator net of the format"):
        Net(file=str(tmp_path / "other.npz"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"weights": np.zeros(7)}, "weights, but it has 7"),
        ({"history": np.array(7)}, "a history of 7 needs 14 inputs"),
        ({"period": np.array(0.0)}, "its period is 0 s"),
        ({"input_mean": np.full(8, np.nan)}, "'input_mean' holds something that is no finite number"),
        ({"torque_scale": np.array("x")}, "'torque_scale' holds something"),
        ({"input_low": np.zeros(3)}, "'input_low' has 3 numbers for 8 inputs"),
    ],
)
def test_a_net_whose_arrays_do_not_fit_is_refused(change, words, tmp_path):
    path = tmp_path / "net.npz"
    np.savez(path, **{**read_net(LIBRARY / "sts3215_net.npz", 0.0), **change})
    with pytest.raises(ChainError, match="damaged actuator net") as caught:
        Net(file=str(path))
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("size", [0, 100, 2000, -50, -3])
def test_a_net_file_cut_short_is_refused(size, tmp_path):
    path = tmp_path / "net.npz"
    path.write_bytes((LIBRARY / "sts3215_net.npz").read_bytes()[:size])
    with pytest.raises(ChainError, match=r"not a readable actuator net|not an actuator net"):
        Net(file=str(path))


@pytest.mark.long
def test_a_net_file_is_never_overwritten(tmp_path, trained):
    write_net(trained.arrays, tmp_path / "net.npz")
    before = (tmp_path / "net.npz").read_bytes()
    with pytest.raises(SealegsError, match="nothing is overwritten"):
        write_net(trained.arrays, tmp_path / "net.npz")
    assert (tmp_path / "net.npz").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["net.npz"]
    assert read_net(tmp_path / "net.npz", 0.0)["layers"].tolist() == [6, 16, 1]


@pytest.mark.long
def test_ctrl_c_keeps_the_best_net_so_far():
    def stop(epoch: int, error: float, unseen: float) -> None:
        if epoch == 4:
            raise KeyboardInterrupt

    net = train(bench_runs(2), SHORT, stop)
    assert net.stopped and net.epochs == 4
    assert np.isfinite(net.arrays["weights"]).all()


@pytest.mark.long
def test_ctrl_c_before_the_first_epoch_gives_no_net(monkeypatch):
    torch = require_torch()

    def stop(*_) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(torch.optim.Adam, "step", stop)
    with pytest.raises(KeyboardInterrupt):
        train(bench_runs(2), SHORT)


@pytest.mark.long
def test_ctrl_c_at_the_end_of_the_first_epoch_keeps_what_it_learned():
    def stop(*_) -> None:
        raise KeyboardInterrupt

    runs = bench_runs(2)
    one = train(runs, dataclasses.replace(SHORT, epochs=1))
    stopped = train(runs, dataclasses.replace(SHORT, epochs=1), stop)
    assert stopped.stopped and np.array_equal(stopped.arrays["weights"], one.arrays["weights"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda runs: runs[:1], "at least two runs"),
        (lambda runs: [dataclasses.replace(run, torque=None, inertia=0.0) for run in runs], "neither a torque column"),
        (
            lambda runs: [
                dataclasses.replace(run, time=run.time[:5], goal=run.goal[:5], position=run.position[:5])
                for run in runs
            ],
            "too short",
        ),
        (lambda runs: [dataclasses.replace(run, torque=0.0 * run.torque) for run in runs], "too little usable motion"),
    ],
)
def test_runs_that_cannot_train_a_net_are_refused(change, words):
    with pytest.raises(SealegsError, match=words):
        train(change(bench_runs(2)), SHORT)


def test_a_rate_above_that_of_the_log_is_refused():
    with pytest.raises(SealegsError, match="was sampled at 200 Hz, which cannot train a net of 1000 Hz"):
        train(bench_runs(2), dataclasses.replace(SHORT, rate=1000.0))


def test_pushed_runs_visit_speeds_that_their_load_alone_would_not_tie_to_the_error():
    run = simulated_runs(load_chain("sts3215"), 1, 10.0, 200.0, 0)[0]
    correlation = np.corrcoef(run.goal - run.position, np.asarray(run.velocity))[0, 1]
    assert abs(correlation) < 0.9


def train_net(*arguments: str) -> Done:
    return typed("train-net", *arguments)


@pytest.mark.long
def test_the_script_learns_from_a_measured_log(tmp_path):
    from sealegs.gap.log import JointLog, MeasuredRun, write_run

    for run in bench_runs(3):
        log = JointLog(goal=run.goal, position=run.position, velocity=run.velocity, torque=run.torque)
        write_run(
            MeasuredRun(run.name.replace(" ", "_"), run.time, {"joint": log}, actuators={"joint": "ideal"}),
            tmp_path / "logs",
        )
    done = train_net(f"log={tmp_path}/logs", f"out={tmp_path}/net", "epochs=15", "hidden=[8]")
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "net" / "training.json").read_text())
    assert figures["rate"] == 200.0 and len(figures["validation"]["runs"]) == 1
    moved = (tmp_path / "net").rename(tmp_path / "moved")
    assert str(load_chain(moved / "chain.yaml")) == "net"
    assert (moved / "torque.png").stat().st_size > 10_000


@pytest.mark.long
def test_a_refused_run_leaves_its_folder_free_and_runs_of_different_motors_are_refused(tmp_path):
    from sealegs.gap.log import JointLog, MeasuredRun, write_run

    for number, run in enumerate(bench_runs(2)):
        log = JointLog(goal=run.goal, position=run.position, velocity=run.velocity, torque=0.0 * run.position)
        chain = [{"ideal": {"stiffness": 1.0, "armature": 0.01 * (1 + number)}}]
        write_run(MeasuredRun(f"run_{number}", run.time, {"joint": log}, actuators={"joint": chain}), tmp_path / "logs")
    done = train_net(f"log={tmp_path}/logs", f"out={tmp_path}/net")
    assert done.returncode == 2 and "armatures from 0.01 to 0.02 kg.m2" in done.stderr
    done = train_net(f"log={tmp_path}/logs", f"out={tmp_path}/net", "armature=0")
    assert done.returncode == 2 and "too little usable motion" in done.stderr
    assert not (tmp_path / "net").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give either log="),
        (("log=nowhere",), "nowhere"),
        (("actuator=sts321",), "did you mean 'sts3215'"),
        (("actuator=sts3215", "epoch=3"), "did you mean 'epochs'"),
        (("actuator=sts3215", "validation=2"), "share of the runs"),
        (("actuator=sts3215", "seed=-1"), "seed is -1; it must be at least 0"),
        (("actuator=sts3215", "simulated.rate=300"), "does not divide"),
    ],
)
def test_the_script_answers_wrong_input_with_one_sentence(arguments, words):
    done = train_net(*arguments)
    assert done.returncode == 2 and words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
