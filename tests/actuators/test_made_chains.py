"""Chains that are made: of brake benches, and of published fits."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import Chain, SealegsError, load_chain, load_chain_set
from sealegs.actuators.brake_bench import COPPER, BenchTable, Noise, Protocol, measure
from sealegs.actuators.brake_report import chain_from
from sealegs.actuators.chain import LIBRARY, names, set_names
from sealegs.actuators.law import advance, begin, torque
from sealegs.actuators.layout import P_STATE_SIZE, S_STEP
from sealegs.actuators.published import DRIVES, VoltageDrive
from sealegs.actuators.regression_fit import EQUATION_3, RPM, fit_regression, misses, read_table, usable, write_table
from sealegs.actuators.stages import ChainError
from sealegs.gap.log import read_measured
from sealegs.gap.log.importers import answered, import_logs, propose_for
from sealegs.papers.hopper.servo_rows import (
    G_MM2,
    SV1270TG_ROTOR,
    SV1270TG_STAGES,
    GearStage,
    disk_inertia,
    output_inertia,
    total_ratio,
)

from tests.actuators.test_laws import limit
from tests.quick import quick
from tests.typed import Done, typed

SILENT = Noise(0.0, 0.0, 0.0)


def test_the_printed_protocol_has_every_point_three_times_in_random_order():
    points = Protocol().points(np.random.default_rng(0))
    assert len(points) == 37 * 25 * 3 * 3
    values, counts = np.unique(points, axis=0, return_counts=True)
    assert (counts == 3).all()
    assert values.min(axis=0) == pytest.approx([-0.9, 0.0, 40.0])
    assert values.max(axis=0) == pytest.approx([0.9, 1.2, 70.0])
    assert np.abs(np.corrcoef(np.arange(len(points)), points[:, 0])[0, 1]) < 0.05


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.long
def test_the_coefficients_of_equation_3_come_back_within_a_percent(seed):
    table = measure(load_chain("sv1270tg_bench"), Protocol(), Noise(), seed)
    assert 0.2 < np.mean(~table.valid) < 0.6  # the servo does stall
    fit = fit_regression(table)
    for name in ("duty_torque", "speed_torque", "constant"):
        assert getattr(fit, name) == pytest.approx(getattr(EQUATION_3, name), rel=0.01)
    assert fit.r2 > 0.999


@pytest.mark.long
def test_wrong_measurements_are_dropped_but_for_those_within_two_deviations():
    chain = load_chain("sv1270tg_bench")
    table = measure(chain, Protocol(), Noise(spurious=0.02), 0)
    clean = measure(chain, Protocol(), Noise(spurious=0.0), 0)
    residual = np.abs(table.torque - EQUATION_3.torque(table.duty, table.speed))
    wrong = table.valid & (residual > 0.2)
    assert wrong.sum() > 20 and not usable(table)[wrong].any()
    assert usable(clean).sum() > 0.9 * clean.valid.sum()


@pytest.mark.long
def test_a_dc_motor_runs_where_its_equations_balance():
    chain = load_chain(
        [
            {"position_p": {"gain": 5.0}},
            {"supply": {"volts": 7.4}},
            {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7}},
            {"friction": {"coulomb": 0.05, "viscous": 0.06}},
        ]
    )
    table = measure(chain, Protocol(), SILENT, 0)
    ohm = 2.7 * (1.0 + COPPER * (table.temperature - 25.0))
    way = np.sign(table.duty)
    driving = 1.2 * (7.4 * table.duty - 1.2 * table.speed) / ohm
    rest = driving - 0.06 * table.speed - 0.05 * way - table.torque
    assert np.abs(rest[table.valid]).max() < 1e-9
    stalled = way * 1.2 * 7.4 * table.duty / ohm - 0.05
    points = Protocol().points(np.random.default_rng(0))
    assert np.array_equal(table.valid, (stalled > points[:, 1]) & (table.duty != 0.0))


def test_a_line_misses_a_motor_where_it_pulls_hard_and_slowly_and_a_line_nowhere():
    off = {}
    for name in ("sv1270tg_motor", "sv1270tg_bench"):
        table = measure(load_chain(name), Protocol(repeats=1), Noise(), 0)
        off[name] = misses(table, fit_regression(table))
        assert list(off[name]) == ["high PWM, low speed", "below 0.8 N.m", "above 0.8 N.m"]
    corner, small, large = off["sv1270tg_motor"].values()
    assert min(corner, large) > 1.3 * small > 0.01
    assert max(off["sv1270tg_bench"].values()) < 1.5 * Noise().torque


MOTOR = [{"supply": {"volts": 7.4}}, {"dc_motor": {"motor_constant": 1.2, "resistance": 2.7}}]


def test_what_stood_in_front_of_the_map_is_not_counted_twice():
    before = [{"scale": {"factor": 0.7}}, {"offset": {"value": 0.05}}, {"duty_limit": {"limit": 0.9}}]
    chain = load_chain([{"delay": {"seconds": 0.01}}, {"position_p": {"gain": 5.0}}, *before, *MOTOR])
    table = measure(chain, Protocol(repeats=1), SILENT, 0)
    fit = fit_regression(table)
    written = chain_from(fit, table, chain, 0.0, 0.0)
    assert str(written) == "delay > position_p > duty_limit > regression"
    again = fit_regression(measure(written, Protocol(repeats=1), SILENT, 0))
    for name in ("duty_torque", "speed_torque", "constant"):
        assert getattr(again, name) == pytest.approx(getattr(fit, name), rel=1e-3)


def test_presliding_changes_nothing_on_the_bench():
    tables = []
    for stiffness in (0.0, 5.0):
        friction = {"friction": {"coulomb": 0.2, "bristle_stiffness": stiffness}}
        tables.append(measure(load_chain([{"position_p": {"gain": 5.0}}, *MOTOR, friction]), Protocol(), SILENT, 0))
    assert np.array_equal(tables[0].speed, tables[1].speed, equal_nan=True)


def test_a_warm_motor_with_weak_magnets_is_measured_at_the_temperature_of_the_protocol():
    chain = load_chain([{"position_p": {"gain": 5.0}}, *MOTOR, {"thermal": {"loss": 0.004}}])
    table = measure(chain, Protocol(repeats=1), SILENT, 0)
    constant = 1.2 * (1.0 - 0.004 * (table.temperature - 25.0))
    ohm = 2.7 * (1.0 + COPPER * (table.temperature - 25.0))
    driving = constant * (7.4 * table.duty - constant * table.speed) / ohm
    assert np.abs(driving - table.torque)[table.valid].max() < 1e-9


def test_a_chain_without_a_duty_is_refused():
    with pytest.raises(SealegsError, match="'ideal' has no duty"):
        measure(load_chain("ideal"), Protocol(), SILENT, 0)


def test_a_real_table_in_rpm_and_newton_millimetres_gives_the_same_fit(tmp_path):
    table = measure(load_chain("sv1270tg_bench"), Protocol(repeats=1), Noise(), 1)
    write_table(table, tmp_path / "si.csv")
    lines = ["duty,torque_nmm,speed_rpm"]
    rows = table.where(table.valid)
    lines += [f"{d},{1e3 * t},{w / RPM}" for d, t, w in zip(rows.duty, rows.torque, rows.speed, strict=True)]
    (tmp_path / "bench.csv").write_text("\n".join(lines))
    si, other = fit_regression(read_table(tmp_path / "si.csv")), fit_regression(read_table(tmp_path / "bench.csv"))
    assert si.duty_torque == pytest.approx(other.duty_torque, rel=1e-6)
    assert si.speed_torque == pytest.approx(other.speed_torque, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duty,speed\n0.5,1\n", "lacks the column 'torque'"),
        ("duty,sped,torque\n0.5,1,1\n", "unknown column 'sped' (did you mean 'speed'?)"),
        ("duty,speed,torque\n0.5,fast,1\n", "line 2: speed is 'fast', not a number"),
        ("duty,speed,torque\n0.5,1,1\n0.5,,1\n", "line 3: speed is missing in a valid measurement"),
        ("duty,speed,torque\n50,1,1\n", "give it as a share of full, 0.5 for 50 %"),
        ("duty,speed,torque,valid\n0.5,1,1,0\n", "no measurement is marked valid"),
        ("duty,speed,torque\n0.5,-1,1\n0.4,-2,1\n", "opposite signs"),
        ("duty,speed,speed_rpm,torque\n0.5,1,1,1\n", "gives speed twice"),
        ("duty,speed,torque\n", "holds no measurements"),
    ],
)
def test_a_wrong_table_is_refused_with_one_sentence(tmp_path, text, words):
    path = tmp_path / "bench.csv"
    path.write_text(text)
    with pytest.raises(SealegsError) as caught:
        read_table(path)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_measurements_that_do_not_tell_duty_from_speed_are_refused():
    ones = np.ones(50)
    table = BenchTable(0.5 * ones, np.linspace(1, 2, 50), np.linspace(1, 0, 50), 40 * ones, ones > 0)
    with pytest.raises(SealegsError, match="does not tell duty and speed apart"):
        fit_regression(table)
    with pytest.raises(SealegsError, match="at least 3"):
        fit_regression(table.where(np.arange(50) < 2))


def test_table_1_gives_the_printed_ratio_and_inertia():
    assert total_ratio(SV1270TG_STAGES) == pytest.approx(287.74, abs=0.005)
    inertia = output_inertia(SV1270TG_ROTOR, SV1270TG_STAGES)
    assert inertia / G_MM2 == pytest.approx(9578657.94, rel=2e-6)
    assert inertia == pytest.approx(0.009579, abs=5e-7)


def test_a_disk_and_a_single_stage():
    assert disk_inertia(0.2, 0.1) == pytest.approx(0.5 * 0.2 * 0.05**2)
    stage = GearStage(10, 30, pinion=1.0, wheel=2.0, shaft=0.5)
    assert output_inertia(4.0, [stage]) == pytest.approx((4.0 + 1.0) * 9.0 + 2.5)


def characterize(*arguments: str) -> Done:
    return typed("characterize", *arguments)


@pytest.mark.long
def test_the_script_writes_a_chain_that_can_be_loaded_and_overwrites_nothing(tmp_path):
    out = tmp_path / "out"
    done = characterize("actuator=sts3215", f"out={out}", "repeats=1")
    assert done.returncode == 0, done.stderr
    chain = load_chain(out / "chain.yaml")
    assert str(chain) == "delay > position_p > duty_limit > regression > encoder"
    assert chain.armature() == 0.026
    assert json.loads((out / "fit.json").read_text())["points"] > 1000
    assert (out / "fit.png").stat().st_size > 10_000
    before = (out / "table.csv").read_bytes()
    again = characterize(f"out={out}")
    assert again.returncode == 2 and "nothing is overwritten" in again.stderr
    assert (out / "table.csv").read_bytes() == before
    real = characterize(f"table={out}/table.csv", f"out={tmp_path}/real", "gain=4", "armature=0.01")
    assert real.returncode == 0, real.stderr
    assert load_chain(tmp_path / "real" / "chain.yaml").value("position_p.gain") == 4.0


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("actuator=ideal", "has no duty"),
        ("noise.torqe=1", "did you mean 'noise.torque'"),
        ("repeats=0", "at least once"),
        ("seed=-1", "seed is -1; it must not be negative"),
        ("table=missing.csv", "cannot read the table"),
    ],
)
def test_the_script_answers_wrong_input_with_one_sentence(argument, words):
    done = characterize(argument)
    assert done.returncode == 2 and words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


# --- published fits ------------------------------------------------------------------------------------------------


DATA = Path(__file__).resolve().parents[2] / "../shared/data"
PLAIN: dict[str, Any] = {
    "kt": 1.2,
    "R": 2.7,
    "armature": 0.02,
    "friction_base": 0.05,
    "friction_viscous": 0.03,
    "actuator": "mx106",
}
AT_REST = {"friction_stribeck": 0.04, "dtheta_stribeck": 0.3, "alpha": 1.4}
LOAD = {"load_friction_base": 0.1}
BOTH = {**AT_REST, **LOAD, "load_friction_stribeck": 0.15}
DIRECTIONAL = {
    **AT_REST, "load_friction_motor": 0.04, "load_friction_external": 0.24, "load_friction_motor_stribeck": 0.1,
    "load_friction_external_stribeck": 0.03,
}  # fmt: skip
QUADRATIC = {**DIRECTIONAL, "load_friction_motor_quad": 0.008, "load_friction_external_quad": 0.003}
MODELS = {"m1": {}, "m2": AT_REST, "m3": LOAD, "m4": BOTH, "m5": DIRECTIONAL, "m6": QUADRATIC}


def budget(model: str, fit: dict[str, Any], w: float, tm: float, te: float) -> float:
    """Friction budget [N.m] as published (Duclusaud et al., ICRA 2025), of speed, motor and external torque."""
    b = fit["friction_viscous"] * abs(w) + fit["friction_base"]
    if model == "m1":
        return b
    if model == "m3":
        return b + fit["load_friction_base"] * abs(tm - te)
    s = math.exp(-(abs(w / fit["dtheta_stribeck"]) ** fit["alpha"]))
    if model == "m2":
        return b + s * fit["friction_stribeck"]
    if model == "m4":
        load = abs(tm - te)
        return (
            b + fit["load_friction_base"] * load + s * (fit["friction_stribeck"] + fit["load_friction_stribeck"] * load)
        )
    b += abs(fit["load_friction_motor"] * tm - fit["load_friction_external"] * te)
    b += s * fit["friction_stribeck"]
    b += s * abs(fit["load_friction_motor_stribeck"] * tm - fit["load_friction_external_stribeck"] * te)
    if model == "m6" and np.sign(tm) != np.sign(te):
        if abs(te) < abs(tm):
            b += s * fit["load_friction_external_quad"] * te**2
        else:
            b += s * fit["load_friction_motor_quad"] * tm**2
    return b


def written(folder: Path, model: str, changed: dict[str, object] | None = None) -> str:
    path = folder / f"{model}.json"
    path.write_text(json.dumps({**PLAIN, **MODELS[model], "model": model, **(changed or {})}))
    return f"bam:{path}"


def assert_same_budget(source: str, model: str, fit: dict[str, Any]) -> None:
    rng = np.random.default_rng(3)
    friction = next(stage["friction"] for stage in load_chain(source).to_list() if "friction" in stage)
    for w, tm, te in rng.uniform(-1.5, 1.5, (60, 3)):
        ours = limit(friction, motor=tm, external=te, w=w) + friction["viscous"] * abs(w)
        assert ours == pytest.approx(budget(model, fit, w, tm, te), abs=1e-9), (w, tm, te)


@pytest.mark.parametrize("model", MODELS)
def test_the_law_gives_the_published_friction_budget(tmp_path: Path, model: str) -> None:
    assert_same_budget(written(tmp_path, model), model, {**PLAIN, **MODELS[model]})


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")
def test_a_published_file_is_read_whole() -> None:
    path = DATA / "bam_sts3215_m6.json"
    fit = json.loads(path.read_text())
    assert_same_budget(f"bam:{path}", "m6", fit)
    chain, shipped = load_chain(f"bam:{path}"), load_chain("sts3215_m6")
    assert chain.value("position_p.gain") == pytest.approx(32 * 0.166 * fit["error_gain_ratio"])
    assert [stage.name for stage in chain.stages] == [stage.name for stage in shipped.stages]
    for name in (
        "dc_motor.motor_constant",
        "friction.load",
        "friction.load_external",
        "friction.load_stribeck_external",
    ):
        assert shipped.value(name) == pytest.approx(chain.value(name), rel=1e-3)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"model": "m7"}, "its 'model' must be one of m1"),
        ({"actuator": "mx16"}, "whose drive is not known .did you mean"),
        ({"kt": None}, "'kt' must be a number"),
    ],
)
def test_a_fit_that_is_none_gets_one_sentence(tmp_path: Path, changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(ChainError, match=sentence):
        load_chain(written(tmp_path, "m4", changed))
    with pytest.raises(ChainError, match=r"the fit .* cannot be read"):
        load_chain(f"bam:{tmp_path / 'absent.json'}")


RECORDED: dict[str, float] = {"mass": 1.5, "length": 0.15, "arm_mass": 0.1, "kp": 8, "vin": 12.0}


def recorded(folder: Path, motor: str, **said: float) -> Path:
    """A recording as the recorders of BAM write it, of a servo that is set otherwise than its chain assumes."""
    time = np.arange(200) / 50.0
    entries = [
        {"timestamp": t, "position": 0.3 * math.sin(2 * t - 0.2), "speed": 0.6 * math.cos(2 * t - 0.2), "temp": 30.0,
         "goal_position": 0.3 * math.sin(2 * t), "torque_enable": True, "measured_current": 0.1 * math.sin(2 * t)}
        for t in time.tolist()
    ]  # fmt: skip
    folder.mkdir()
    path = folder / "a.json"
    path.write_text(json.dumps({**RECORDED, **said, "motor": motor, "trajectory": "sin_sin", "entries": entries}))
    return path


def imported(source: Path, out: Path, actuator: str | None) -> Any:
    return import_logs(source, out, propose_for(source, out, actuator=actuator).certain)


def chain_of(out: Path) -> Chain:
    [log] = read_measured(out).runs
    [chain] = log.actuators.values()
    return load_chain(chain)


@pytest.mark.parametrize("actuator", [None, "mx106", "bam:fit"])
def test_a_chain_has_the_gain_and_the_supply_that_the_recording_says(tmp_path: Path, actuator: str | None) -> None:
    word = written(tmp_path, "m1") if actuator == "bam:fit" else actuator
    imported(recorded(tmp_path / "raw", "mx106"), tmp_path / "log", word)
    chain = chain_of(tmp_path / "log")
    assert chain.value("position_p.gain") == pytest.approx(8 * 0.158)
    assert chain.value("supply.volts") == 12.0
    assert chain.value("dc_motor.motor_constant") == (PLAIN["kt"] if actuator == "bam:fit" else 2.1914)


def test_a_mapping_with_a_fit_has_the_gain_of_the_recording_too(tmp_path: Path) -> None:
    source, out = recorded(tmp_path / "raw", "mx106"), tmp_path / "log"
    mapping = propose_for(source, out, robot="bench").mapping
    import_logs(source, out, answered(mapping, out, None, written(tmp_path, "m1"), None, source))
    assert chain_of(out).value("position_p.gain") == pytest.approx(8 * 0.158)


@pytest.mark.parametrize("actuator", [None, "bam:fit"])
def test_a_controller_of_the_current_is_set_as_recorded(tmp_path: Path, actuator: str | None) -> None:
    fit = {"kt": 8.0, "R": None, "armature": 0.7, "actuator": "erob80_100"}
    word = written(tmp_path, "m5", fit) if actuator else None
    imported(recorded(tmp_path / "raw", "erob80_100", kp=50, damping=1.5), tmp_path / "log", word)
    chain, constant = chain_of(tmp_path / "log"), 8.0 if actuator else 7.6578
    assert chain.value("ideal.stiffness") == pytest.approx(50 * constant, rel=1e-4)
    assert chain.value("ideal.damping") == pytest.approx(1.5 * math.sqrt(50) * constant, rel=1e-4)
    assert chain.value("ideal.torque_limit") == pytest.approx(12 * constant, rel=1e-4)
    assert chain.value("friction.coulomb") == (PLAIN["friction_base"] if actuator else 5.611)


def test_the_limit_of_the_current_is_the_one_recorded(tmp_path: Path) -> None:
    word = written(tmp_path, "m1", {"kt": 1.5, "actuator": "feetech_hls"})
    assert load_chain(word).value("ideal.torque_limit") == pytest.approx(1.5 * 0.36)
    imported(recorded(tmp_path / "raw", "feetech_hls", kp=3, damping=0.08, max_amps=0.5), tmp_path / "log", word)
    assert chain_of(tmp_path / "log").value("ideal.torque_limit") == pytest.approx(1.5 * 0.5)
    [log] = read_measured(tmp_path / "log").runs
    current = log.joints["servo"].current
    assert current is not None and np.max(current) == pytest.approx(0.1, rel=1e-3)


def test_a_fit_that_is_elsewhere_is_found_beside_the_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path, "m1")
    source = tmp_path / "run.csv"
    source.write_text("t,pos_rad,goal_rad\n" + "".join(f"{k / 50},0.{k % 7},0.{k % 5}\n" for k in range(99)))
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "deep" / "log"
    import_logs(source, out, propose_for(source, out, robot="bench", actuator="bam:m1.json").certain)
    monkeypatch.chdir(tmp_path / "deep")
    assert chain_of(out).value("dc_motor.motor_constant") == PLAIN["kt"]


@pytest.mark.parametrize("word", [word for word in DRIVES if (LIBRARY / f"{word}.yaml").is_file()])
def test_a_shipped_chain_is_set_as_its_drive(word: str) -> None:
    chain = load_chain(word)
    drive = DRIVES[word]
    assert chain.value("encoder.ticks") == drive.ticks
    if isinstance(drive, VoltageDrive):
        assert chain.value("position_p.gain") == pytest.approx(drive.gain, rel=0.15)
        assert chain.value("supply.volts") == drive.volts
    else:
        assert chain.value("ideal.stiffness") / chain.value("ideal.torque_limit") == pytest.approx(
            drive.kp / drive.amps, rel=1e-3
        )


TRAJECTORIES = Path(__file__).parents[1] / "trajectories.json"
STEP, SAMPLES, EVERY = 0.005, 600, 50


def chains() -> dict[str, Chain]:
    """Every chain of ``configs/actuator``, those of a set by ``set:pattern``."""
    found = {name: load_chain(name) for name in names()}
    for name in set_names():
        found |= {f"{name}:{pattern}": chain for pattern, chain in (load_chain_set(name) or {}).items()}
    return found


def torques(chain: Chain) -> list[float]:
    """Torque of a chain [N.m] at every so many samples of a motion that is given."""
    time = np.arange(SAMPLES) * STEP
    goal = 0.4 * np.sin(2 * np.pi * 0.9 * time) + 0.2 * np.sign(np.sin(2 * np.pi * 0.37 * time)) * (time > 0.3)
    q = 0.35 * np.sin(2 * np.pi * 0.9 * time - 0.3)
    w = np.gradient(q, time)
    a = np.gradient(w, time)
    external = 0.3 * np.cos(3 * time)
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, goal[0], q[0], w[0])
    state[S_STEP] = STEP
    found, half = [], 0.5 * STEP
    for k in range(SAMPLES):
        if k:
            advance(program, state, time[k])
        value = torque(program, state, time[k], goal[k], q[k], w[k], external[k], True)
        torque(program, state, time[k] + half, goal[k], q[k] + half * w[k], w[k] + half * a[k], external[k], False)
        if k % EVERY == 0:
            found.append(float(value))
    return found


@pytest.mark.parametrize("name", quick(sorted(chains()), 8))
def test_a_chain_computes_the_torques_that_were_recorded(name):
    recorded = json.loads(TRAJECTORIES.read_text(encoding="utf-8"))
    assert name in recorded, "record it: python -m tests.actuators.test_published_chains"
    assert torques(chains()[name]) == pytest.approx(recorded[name], rel=1e-9, abs=1e-12)


def record() -> None:
    """Record chains that are new: ``python -m tests.actuators.test_published_chains``; what is recorded stays."""
    recorded = json.loads(TRAJECTORIES.read_text(encoding="utf-8"))
    found = {name: torques(chain) for name, chain in chains().items() if name not in recorded}
    rows = [f" {json.dumps(name)}: {json.dumps(values)}" for name, values in sorted({**found, **recorded}.items())]
    TRAJECTORIES.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
    print(f"Recorded: {', '.join(sorted(found)) or 'nothing new'}")


if __name__ == "__main__":
    record()
