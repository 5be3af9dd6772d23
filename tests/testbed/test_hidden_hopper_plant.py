"""The hidden hopper obeys closed-form physics, and logs as a leg on a boom does."""

from __future__ import annotations

import numpy as np
import pytest

from testbed import hidden_hopper
from testbed.hopper import (
    BOOM_STEP,
    GRAVITY,
    HOPPER_EFFECTS,
    MAGNITUDES,
    STEP,
    TICK,
    Body,
    Ground,
    Servo,
    hop,
    leg_rate,
    servo_step,
)

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
