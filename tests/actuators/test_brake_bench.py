"""The virtual brake bench, the regression fitted from it, and the inertia of table I."""

from __future__ import annotations

import json

import numpy as np
import pytest
from sealegs.actuators import SealegsError, load_chain
from sealegs.actuators.brake_bench import COPPER, BenchTable, Noise, Protocol, measure
from sealegs.actuators.brake_report import chain_from
from sealegs.actuators.regression_fit import EQUATION_3, RPM, fit_regression, misses, read_table, usable, write_table
from sealegs.papers.hopper.servo_rows import (
    G_MM2,
    SV1270TG_ROTOR,
    SV1270TG_STAGES,
    GearStage,
    disk_inertia,
    output_inertia,
    total_ratio,
)

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
