"""The hidden plants move as their physics says, alike for equal seeds, and hide what they promise."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.hidden import NUMBERS, Case, bounded, within_tolerance
from testbed import (
    EFFECTS,
    LOADS,
    MAGNITUDES,
    NOISE_FLOOR,
    STRANGERS,
    Machine,
    drawn,
    drawn_constants,
    hidden_bench,
    hidden_hopper,
    simulate,
)
from testbed.arm import DELAY, MACHINES, SERVOS, mjcf
from testbed.effects import BOTH_SIGNS, BY_HAND, GAP_IN_NOISE_FLOORS, SPREAD
from testbed.hopper import (
    BOOM_STEP,
    HOPPER_EFFECTS,
    STEP,
    TICK,
    Body,
    Ground,
    Servo,
    hop,
    leg_rate,
    servo_step,
)
from testbed.logs import hidden_arm
from testbed.physics import GRAVITY
from tests.quick import quick

SIZED_BY_HAND = (
    "friction.presliding",
    "transmission.backlash",
    "contact.blocked",
    "drive.overload",
    "drive.acceleration_limit",
)
NO_JAMS = np.zeros(0)
FREE = Machine(gain=0.0, motor_constant=1e-9, coulomb=0.0, viscous=0.0, armature=0.0)


def swing(machine: Machine, start: float, duration: float) -> np.ndarray:
    return simulate(machine, np.zeros(1), np.array([start]), NO_JAMS, NO_JAMS, duration, 25.0)


def test_a_free_pendulum_keeps_its_energy_and_period() -> None:
    record = swing(FREE, 0.05, 10.0)
    energy = 0.5 * FREE.link_inertia * record[:, 2] ** 2 + FREE.mass * GRAVITY * FREE.length * (
        1 - np.cos(record[:, 1])
    )
    assert np.ptp(energy) < 1e-5 * energy[0]
    rising = np.flatnonzero((record[:-1, 1] < 0) & (record[1:, 1] >= 0))
    period = np.diff(record[rising, 0]).mean()
    assert period == pytest.approx(2 * np.pi * np.sqrt(FREE.length / GRAVITY) * (1 + 0.05**2 / 16), rel=1e-4)


def test_dry_friction_takes_a_fixed_angle_per_swing_and_then_holds() -> None:
    machine = FREE._replace(coulomb=0.01, armature=0.02)
    record = swing(machine, 0.2, 12.0)
    loss = 2 * 0.01 / (machine.mass * GRAVITY * machine.length)
    turning = np.flatnonzero(np.diff(np.sign(record[:, 2])) != 0)
    heights = np.abs(record[turning, 1])
    heights = heights[np.concatenate([[True], np.abs(np.diff(heights)) > 1e-3])][:4]
    np.testing.assert_allclose(-np.diff(heights), loss, rtol=0.05)
    assert record[-1, 2] == 0.0 and abs(record[-1, 1]) < loss / 2


def test_the_torque_of_a_cable_relaxes_with_its_time_constant() -> None:
    plain = Machine(gain=40.0, viscous=2.0, coulomb=0.0, mass=0.0, encoder_ticks=0.0, cable_stiffness=0.5)
    for elastic in (False, True):
        machine = plain._replace(joint_stiffness=200.0, joint_damping=0.5, extra_inertia=1e-3) if elastic else plain
        record = simulate(machine, np.zeros(2), np.array([0.0, 0.02]), NO_JAMS, NO_JAMS, 1.0, 25.0)
        time, duty = record[:, 0], record[:, 4]
        early, late = (float(np.interp(t, time, duty)) for t in (0.5, 0.8))
        assert late / early == pytest.approx(np.exp(-0.3 / machine.cable_time), rel=0.02)
        held = 0.5 * 0.02 * np.exp(-0.5 / machine.cable_time)  # [N.m]
        assert early * machine.volts * machine.motor_constant / machine.resistance == pytest.approx(
            held, rel=0.25
        )  # it begins a little late


def test_steady_speed_of_the_motor_is_that_of_its_equations() -> None:
    machine = Machine(gain=1e6, duty_limit=0.5, mass=0.0, encoder_ticks=0.0)
    record = simulate(machine, np.zeros(2), np.array([0.0, 1e6]), NO_JAMS, NO_JAMS, 3.0, 25.0)
    k, r = machine.motor_constant, machine.resistance
    speed = (k * 0.5 * machine.volts / r - machine.coulomb) / (k * k / r + machine.viscous)
    assert record[-1, 2] == pytest.approx(speed, rel=1e-4)


def test_a_held_pose_is_where_gravity_and_firmware_balance() -> None:
    machine = Machine(coulomb=0.0, encoder_ticks=0.0, command_delay=0.0)
    record = simulate(machine, np.zeros(2), np.array([0.0, 0.8]), NO_JAMS, NO_JAMS, 5.0, 25.0)
    q = record[-1, 1]
    torque = machine.motor_constant * machine.gain * (0.8 - q) * machine.volts / machine.resistance
    assert torque == pytest.approx(machine.mass * GRAVITY * machine.length * np.sin(q), rel=1e-4)


def test_a_stiff_joint_moves_as_a_rigid_one_and_play_lets_the_link_move() -> None:
    t = np.arange(0, 3, 0.005)
    goal = 0.4 * np.sin(2 * np.pi * 0.7 * t)
    rigid, stiff, loose = (
        simulate(machine, t, goal, NO_JAMS, NO_JAMS, 3.0, 25.0)
        for machine in (Machine(), Machine(joint_stiffness=5000.0, joint_damping=1.0), Machine(backlash=0.05))
    )
    assert np.sqrt(np.mean((rigid[:, 1] - stiff[:, 1]) ** 2)) < 1e-3
    gap = loose[:, 1] - loose[:, 3]
    assert 0.045 < np.ptp(gap) < 0.056


def test_a_log_looks_like_that_of_a_real_bench() -> None:
    data, truth = hidden_bench({}, 5)
    assert len(data.runs) == 3
    for run, angle in zip(data.runs, truth["clean_position"], strict=True):
        log = run.joints["servo"]
        assert run.duration == pytest.approx(24.0, abs=0.05)
        assert 2e-4 < np.std(np.diff(run.time)) < 6e-4
        assert np.sqrt(np.mean((log.position - angle) ** 2)) == pytest.approx(NOISE_FLOOR, rel=0.05)
        assert log.current is not None
        steps = log.current / 0.0065
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_equal_seeds_give_equal_logs_and_others_do_not() -> None:
    first, again, other = (hidden_bench({"friction.stribeck": "clear"}, seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.runs[0].joints["servo"].position, again.runs[0].joints["servo"].position)
    assert not np.array_equal(first.runs[0].joints["servo"].position, other.runs[0].joints["servo"].position)


def test_loads_and_nominal_errors_are_what_they_say() -> None:
    data, truth = hidden_bench({"load.mass": "clear"}, 3, load=tuple(LOADS), nominal_error=0.05)
    for run, machine, (mass, length, _) in zip(data.runs, truth["machines"], LOADS.values(), strict=True):
        assert run.robot_params["mass"] == mass and run.robot_params["length"] == length
        assert machine.mass == pytest.approx(mass * truth["effects"]["load.mass"]["value"])
    assert all(abs(factor - 1) <= 0.05 for factor in truth["nominal_factors"].values())


@pytest.mark.parametrize("name", quick([name for name in EFFECTS if name not in SIZED_BY_HAND], 15))
def test_effects_have_the_promised_size(name: str) -> None:
    from testbed.calibrate import gap

    effect = EFFECTS[name]
    clear, moderate, faint = (gap(name, size, seeds=(0,)) for size in effect.sizes)
    assert clear > 6.0 and 2.5 < moderate < 7.0 and 0.8 < faint < 2.6
    assert clear > moderate > faint


@pytest.mark.long
def test_effects_that_are_sized_by_hand_still_order_by_size() -> None:
    from testbed.calibrate import gap

    for name in (*SIZED_BY_HAND, *STRANGERS):
        clear, moderate, faint = (gap(name, size, seeds=(0,)) for size in (EFFECTS | STRANGERS)[name].sizes)
        assert clear > moderate > faint > 0.5, name
    assert set(GAP_IN_NOISE_FLOORS) == set(MAGNITUDES)


def test_several_effects_hide_at_once_and_an_unknown_one_is_refused() -> None:
    _, truth = hidden_bench({"drive.delay": 0.01, "friction.coulomb": {"coulomb_extra": 0.05}}, 0, runs=1, duration=6.0)
    assert truth["effects"]["drive.delay"]["value"] == 0.01
    with pytest.raises(KeyError, match="knows no effect"):
        hidden_bench({"friction.magic": "clear"}, 0)


@pytest.mark.parametrize("name", NUMBERS)
def test_an_effect_that_only_changes_numbers_is_a_machine_with_other_numbers(name: str) -> None:
    value, wrong = EFFECTS[name].sizes[1], 0.96
    numbers = dict.fromkeys(NUMBERS[name], wrong)
    machine = Machine()._replace(**{number: wrong * getattr(Machine(), number) for number in numbers})
    hidden = EFFECTS[name].apply(machine, value)
    other = Machine()._replace(
        **{number: factor(value, wrong) * getattr(Machine(), number) for number, factor in NUMBERS[name].items()}
    )
    goal_time, goal = np.arange(0.0, 1.0, 0.01), 0.5 * np.sin(7.0 * np.arange(0.0, 1.0, 0.01))
    a, b, bare = (simulate(m, goal_time, goal, NO_JAMS, NO_JAMS, 1.0, 25.0)[:, 1] for m in (hidden, other, machine))
    assert np.abs(a - b).max() < 1e-6 * np.abs(a - bare).max()


@pytest.mark.parametrize(
    ("limits", "honest"),
    [
        ({}, None),
        ({"sensor.scale": [0.97, 1.03, 1.0]}, True),
        ({"sensor.scale": [0.99, 1.01, 1.0]}, False),
        ({"sensor.scale": [None, 1.01, 1.0]}, False),
        ({"sensor.scale": [0.99, None, 1.0]}, None),
        ({"sensor.scale": [None, None, 1.0]}, None),
        ({"drive.gain": [0.5, 2.0, 1.0]}, None),
    ],
)
def test_nothing_to_explain_is_honest_where_a_bound_is_told_that_holds(
    limits: dict[str, list[float | None]], honest: bool | None
) -> None:
    row = {"effects": {"sensor.scale": {"value": 1.02}}, "factors": {}, "limits": limits}
    assert bounded(row) is honest


def test_a_number_within_its_tolerance_is_told_from_an_effect() -> None:
    def row(value: float, **factors: float) -> dict[str, Any]:
        return {"effects": {"friction.coulomb": {"value": value}}, "factors": {"coulomb": 1.0, **factors}}

    assert within_tolerance(row(0.002)) and not within_tolerance(row(0.02))
    assert not within_tolerance(row(0.002, coulomb=1.04))
    pair = {**row(0.002)["effects"], "drive.delay": {"value": 1e-5}}
    assert not within_tolerance({"effects": pair, "factors": {"coulomb": 1.0, "command_delay": 1.0}})
    assert not within_tolerance({"effects": {"drive.offset": {"value": 0.0}}, "factors": {}})


@pytest.mark.parametrize("name", [*EFFECTS, *STRANGERS])
def test_a_drawn_effect_has_its_size_within_a_factor_and_either_sign_where_that_makes_sense(name: str) -> None:
    effect = (EFFECTS | STRANGERS)[name]
    for magnitude, size in zip(MAGNITUDES, effect.sizes, strict=True):
        values = [drawn(name, magnitude, np.random.default_rng(seed)) for seed in range(40)]
        none = 0.0 if effect.span[0] >= 400.0 or name in BY_HAND else effect.span[0]
        ratio = (np.array(values) - none) / (size - none)
        assert np.abs(ratio).max() <= SPREAD + 1e-9 and np.abs(ratio).min() >= 1.0 / SPREAD - 1e-9
        assert (ratio.min() < 0.0) == (name in BOTH_SIGNS)
        assert len(set(values)) == 40


def test_numbers_beside_an_effect_change_nothing_until_it_is_there() -> None:
    constants = drawn_constants(np.random.default_rng(3))
    assert constants == drawn_constants(np.random.default_rng(3)) != drawn_constants(np.random.default_rng(4))

    def recorded(effects: dict[str, Any], constants: dict[str, float]) -> np.ndarray:
        data, _ = hidden_bench(effects, 3, duration=4.0, runs=1, constants=constants)
        return data.runs[0].joints["servo"].position

    np.testing.assert_array_equal(recorded({}, constants), recorded({}, {}))
    for name in ("friction.stribeck", "friction.position_dependent", "transmission.backlash"):
        assert not np.array_equal(recorded({name: "clear"}, constants), recorded({name: "clear"}, {})), name


def test_a_drawn_case_says_so_and_is_the_same_again() -> None:
    case, plain = (Case((("load.mass", "clear"),), 7, drawn) for drawn in (True, False))
    assert case.key == "load.mass:clear drawn #7" and plain.values() == {"load.mass": "clear"}
    assert case.values() == case.values() != plain.values()


REPOSITORY = Path(__file__).resolve().parents[2]
FILES = sorted((REPOSITORY / "testbed").glob("*.py"))


def imported(path: Path) -> set[str]:
    """Modules that a file imports, those of its own package left out."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_the_testbed_knows_nothing_of_sealegs_but_the_type_of_a_log(path: Path) -> None:
    known = {"sealegs.gap.log.types"} if path.name == "logs.py" else set()
    assert {name for name in imported(path) if name.split(".")[0] in ("sealegs", "tests", "benchmarks")} == known


# --- A leg and an arm without gravity that hide something at one joint, for the finder to name -----------------------


@pytest.mark.long
def test_what_the_machines_hide_is_seen_at_the_joint_that_has_it(tmp_path: Path) -> None:
    for machine, effect, joint in (("leg", "meshing", "joint_3"), ("flat", "softer", "joint_2")):
        runs = []
        for effects in ({}, {effect: (joint, "clear")}):
            folder = tmp_path / f"{machine}{len(runs)}{len(effects)}"
            folder.mkdir()
            data, _ = hidden_arm(folder, machine, effects, seed=3, runs=1, duration=3.0, nominal_error=0.0)
            runs.append(data.runs[0])
        off = {
            name: float(abs(runs[0].joints[name].position - runs[1].joints[name].position).max())
            for name in runs[0].joints
        }
        assert off[joint] > 3e-3 and (machine == "flat" or off[joint] == max(off.values())), (
            off
        )  # a level arm swings along
    assert DELAY > 0.0 and set(SERVOS) <= set(MACHINES) and "joint_3" in mjcf(MACHINES["leg"])


# --- the hopper -------------------------------------------------------------------------------------------------------


LIMP = Servo()._replace(stiffness=0.0, damping=0.0)


def centre_of_mass(s: np.ndarray) -> np.ndarray:
    body = Body()
    first = (0.5 * body.upper_mass + body.lower_mass) * body.upper_length / body.total_mass
    second = 0.5 * body.lower_mass * body.lower_length / body.total_mass
    return np.array(
        [s[0] + first * np.sin(s[2]) + second * np.sin(s[3]), s[1] - first * np.cos(s[2]) - second * np.cos(s[3])]
    )


def fall(servo: Servo, steps: int, s: np.ndarray) -> np.ndarray:
    """The leg in the air, motors held at zero."""
    motors, k = np.zeros(4), [np.zeros(8) for _ in range(4)]
    for _ in range(steps):
        leg_rate(Ground(), Body(), servo, servo, motors, s, np.nan, k[0])
        leg_rate(Ground(), Body(), servo, servo, motors, s + 0.5 * STEP * k[0], np.nan, k[1])
        leg_rate(Ground(), Body(), servo, servo, motors, s + 0.5 * STEP * k[1], np.nan, k[2])
        leg_rate(Ground(), Body(), servo, servo, motors, s + STEP * k[2], np.nan, k[3])
        s = s + STEP / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
    return s


def test_the_centre_of_mass_falls_freely_whatever_the_leg_does() -> None:
    start = np.array([0.0, 2.0, -0.5, 0.8, 0.3, 0.1, 4.0, -6.0])
    time = 0.2
    end = fall(Servo(), int(time / STEP), start)
    just_after = fall(Servo(), 1, start)
    speed = (centre_of_mass(just_after) - centre_of_mass(start)) / STEP
    wanted = centre_of_mass(start) + time * speed - [0.0, 0.5 * GRAVITY * time * (time - STEP)]
    np.testing.assert_allclose(centre_of_mass(end), wanted, atol=2e-6)


def test_a_limp_leg_in_the_air_keeps_its_energy() -> None:
    body = Body()

    def energy(s: np.ndarray) -> float:
        ahead = fall(LIMP, 1, s)
        rates = (ahead - s) / STEP
        speed = (centre_of_mass(ahead) - centre_of_mass(s)) / STEP
        upper, lower = rates[2], rates[3]
        knee = np.array([rates[0] + 0.108 * np.cos(s[2]) * upper, rates[1] + 0.108 * np.sin(s[2]) * upper])
        mid_upper = np.array([rates[0] + 0.054 * np.cos(s[2]) * upper, rates[1] + 0.054 * np.sin(s[2]) * upper])
        mid_lower = knee + 0.046 * lower * np.array([np.cos(s[3]), np.sin(s[3])])
        base = body.total_mass - body.upper_mass - body.lower_mass
        kinetic = 0.5 * base * (rates[0] ** 2 + rates[1] ** 2)
        kinetic += 0.5 * body.upper_mass * (mid_upper @ mid_upper) + 0.5 * body.lower_mass * (mid_lower @ mid_lower)
        kinetic += 0.5 * body.upper_mass * 0.108**2 / 12 * upper**2 + 0.5 * body.lower_mass * 0.092**2 / 12 * lower**2
        del speed
        return kinetic + body.total_mass * GRAVITY * centre_of_mass(s)[1]

    start = np.array([0.0, 2.0, -0.5, 0.8, 0.3, 0.1, 4.0, -6.0])
    assert energy(fall(LIMP, 4000, start)) == pytest.approx(energy(start), rel=1e-3)


def test_a_servo_holds_within_its_dry_friction_and_slides_beyond_it() -> None:
    servo = Servo()._replace(gain=0.0)
    assert servo_step(servo, 0.0, 0.0, 0.0, 0.9 * servo.coulomb)[1] == 0.0
    assert servo_step(servo, 0.0, 0.0, 0.0, 1.1 * servo.coulomb)[1] > 0.0


def standing(ground: Ground, seconds: float = 2.0) -> np.ndarray:
    """Record of a leg that is let down and left alone."""
    n = round(200 * seconds)
    time = 0.005 * (1.0 + np.arange(n))
    shape = np.tile([0.0, -0.5, 1.0, 9.0, 0.0, 0.0], (n, 1))
    return hop(ground, Body(), Servo(), Servo(), time, shape, np.zeros((n, 4)), 0.0)


def test_a_standing_leg_presses_its_weight_on_the_ground_and_does_not_slide() -> None:
    out = standing(Ground(), seconds=6.0)  # by then it swings on its springs no more
    assert out[-1, 12] == pytest.approx(Body().total_mass * GRAVITY, rel=1e-3)
    assert abs(out[-1, 10] - out[-100, 10]) < 1e-5


def test_a_leg_slides_down_a_slope_that_is_steeper_than_its_friction() -> None:
    stays, slides = (standing(Ground(friction=friction, slope=0.1))[-1, 10] for friction in (0.2, 0.05))
    assert abs(stays) < 0.03
    assert slides < -0.05


@pytest.mark.long
@pytest.mark.parametrize("name", HOPPER_EFFECTS)
def test_every_effect_changes_the_log_the_more_the_clearer_it_is(name: str) -> None:
    def early(effects: dict) -> np.ndarray:
        (run,) = hidden_hopper(effects, 3, runs=1, duration=1.5)[0].runs
        return np.concatenate([run.joints["knee"].position, run.base["z"], run.base["x"]])

    plain = early({})
    gaps = [float(np.sqrt(np.mean((early({name: size}) - plain) ** 2))) for size in MAGNITUDES]
    assert gaps[0] > 1e-3
    assert gaps[0] > gaps[2]


def test_equal_seeds_give_equal_logs_on_the_lattice_of_their_encoders() -> None:
    (a,), (b,) = (hidden_hopper({}, 4, runs=1, duration=2.0)[0].runs for _ in range(2))
    np.testing.assert_array_equal(a.joints["hip"].position, b.joints["hip"].position)
    ticks = a.joints["hip"].position / TICK
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    heights = a.base["z"] / BOOM_STEP
    np.testing.assert_allclose(heights, np.round(heights), atol=1e-6)
    assert np.ptp(np.diff(a.time)) > 1e-4
