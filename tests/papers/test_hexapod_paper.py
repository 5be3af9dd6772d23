"""The hexapod behaves as its paper (paper 001) says, as far as assumed numbers allow."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.hexapod.gait import Tripod
from sealegs.envs.hexapod.robot import VERTICAL, coordinate
from sealegs.papers.hexapod.choices import OVERCOME
from sealegs.papers.hexapod.experiments import AT_REST_FORCE, REGULARISED, STICKS, by_leg, laws
from sealegs.papers.hexapod.friction_bench import breakaway, largest_bristle_damping, steady
from sealegs.papers.hexapod.leg_model import coupling, gravity
from sealegs.papers.hexapod.measures import at_rest, breaking_loose, drawing, landing, motors, slip
from sealegs.papers.hexapod.paper import (
    Machine,
    Standing,
    Walk,
    chains_with,
    friction_at_rest,
    limit_by_speed,
    stand_unpowered,
    walk,
)
from sealegs.papers.hexapod.rows import arithmetic_rows

from tests.typed import Done, typed

FAST = 0.03  # [m/s] a cycle takes 6 s


@pytest.fixture(scope="module")
def standing() -> dict[str, Standing]:
    return {name: stand_unpowered(name, 2.0) for name in ("none", "dry/viscous", "LuGre")}


@pytest.fixture(scope="module")
def walks() -> dict[str, Walk]:
    return {name: walk(name, Tripod(FAST), 2.25) for name in ("dry/viscous", "LuGre", "dry/viscous 2")}


def test_only_bristles_hold_an_unpowered_robot_up(standing: dict[str, Standing]) -> None:
    assert standing["LuGre"].sinking < 2e-4
    last = slice(-50, None)
    assert np.ptp(standing["LuGre"].height[last]) < 1e-6  # it has come to rest
    for name in ("none", "dry/viscous"):
        assert standing[name].sinking > 2e-3  # 10 mm in 10 s
        rate = np.gradient(standing[name].height[last], standing[name].time[last])
        assert rate == pytest.approx(rate.mean(), rel=0.05)  # and it goes on


def test_bristles_come_to_balance_gravity(standing: dict[str, Standing]) -> None:
    row = standing["LuGre"]
    assert row.friction[-1] == pytest.approx(row.load[-1], rel=0.01)
    assert row.friction[-1] > 300.0
    assert standing["dry/viscous"].friction[-1] == pytest.approx(110.0)  # all that dry friction has


def test_the_robot_walks_at_its_speed_without_a_fall(walks: dict[str, Walk]) -> None:
    for of in walks.values():
        assert of.speed() == pytest.approx(FAST, rel=0.05)
        assert abs(of.place[-1, 1]) < 2e-3
        assert np.ptp(of.place[:, 2]) < 3e-3
        assert of.contact.sum(axis=1).mean() == pytest.approx(of.weight, rel=0.02)


def test_a_force_that_dry_friction_of_the_paper_creeps_under_is_held_by_friction_that_sticks() -> None:
    sunk = {law: stand_unpowered(name, 1.0, to).sinking for law, (name, to) in laws(AT_REST_FORCE).items()}
    assert sunk[REGULARISED] > 5.0 * max(sunk[STICKS], sunk["LuGre"])


def test_only_bristles_spare_the_vertical_motor_its_current_in_support(walks: dict[str, Walk]) -> None:
    held = {name: [drawing(of, leg) for leg in range(1, 6)] for name, of in walks.items()}
    assert max(held["LuGre"]) < 0.05
    assert min(*held["dry/viscous"], *held["dry/viscous 2"]) > 0.9


def test_a_joint_under_more_load_than_its_breakaway_force_draws_current_and_under_less_it_does_not() -> None:
    fast, force = Tripod(FAST), "vertical.friction.stribeck"
    weak, strong = (walk("LuGre", fast, 2.25, {force: value}) for value in (330.0, 900.0))
    assert min(drawing(weak, leg) for leg in range(6)) > 0.5
    assert max(drawing(strong, leg) for leg in range(6)) < 0.05
    share, _, load = breaking_loose(strong)
    assert share < 0.05 and (np.isnan(load) or load > 0.0)


def test_feet_slip_little_and_carry_at_once_where_they_land_fast(walks: dict[str, Walk]) -> None:
    assert slip(walks["LuGre"]) < 0.15 * FAST
    assert landing(walks["LuGre"]) < 0.02
    assert landing(walk("LuGre", cycles=1.25)) > 0.05


def test_gravity_and_coupling_of_a_leg() -> None:
    rotation, vertical, horizontal = gravity()
    assert rotation == pytest.approx(0.0, abs=1e-9) and vertical < 3.0 * horizontal < 0.0
    with_rotors, without = coupling()
    assert with_rotors < 0.01 and without > 0.3


def test_load_dependence_raises_the_horizontal_current_in_support_alone(walks: dict[str, Walk]) -> None:
    plain, loaded = (motors(walks[name])["horizontal current"] for name in ("dry/viscous", "dry/viscous 2"))
    assert loaded["support"] > 1.5 * plain["support"]
    assert loaded["transfer"] == pytest.approx(plain["transfer"], rel=0.15)


def test_specific_resistance_is_alike_for_bristles_and_a_third_less_without_load_dependence(
    walks: dict[str, Walk],
) -> None:
    dry, lugre, loaded = (of.resistance() for of in walks.values())
    assert lugre == pytest.approx(dry, rel=0.1)
    assert 1.0 - dry / loaded == pytest.approx(0.35, abs=0.05)


def test_friction_of_a_leg_is_found_for_each_direction_from_the_motors_current() -> None:
    planted = {"coulomb": 100.0, "stribeck": 700.0, "asymmetry": 15.0}
    found = steady(planted, (0.003, 0.008))
    assert found.coulomb == pytest.approx((115.0, 85.0), rel=0.01)
    assert found.viscous == pytest.approx((3000.0, 3000.0), rel=0.1)
    assert breakaway(planted, 5.0) == pytest.approx((815.0, 785.0), rel=0.01), "whatever the foot carries"


def test_a_load_that_overcomes_the_joint_is_told() -> None:
    with pytest.raises(SealegsError, match="a load of 20 kg overcomes the joint"):
        breakaway({"coulomb": 100.0, "stribeck": 700.0}, 20.0)


def test_the_limit_of_bristles_falls_with_speed_and_changes_sides_with_its_sign() -> None:
    rest = friction_at_rest()
    limit = limit_by_speed(rest, np.array([0.0, 1e-5, 1e-2, -1e-2]))
    assert limit[0] == pytest.approx(rest.coulomb + rest.stribeck) and 0.98 < limit[1] / limit[0] < 1.0
    assert limit[2] == pytest.approx(rest.coulomb) == pytest.approx(-limit[3])


def test_each_leg_has_a_friction_of_its_own_and_two_give_way_under_ten_kilograms() -> None:
    chains = chains_with("LuGre", by_leg())
    vertical = [chains[coordinate(leg, VERTICAL)] for leg in range(6)]
    assert len({chain.value("friction.coulomb") for chain in vertical}) == 6
    assert all(chain.value("friction.asymmetry") != 0.0 for chain in vertical)
    weak = {leg for leg, chain in enumerate(vertical) if chain.value("friction.stribeck") < 500.0}
    assert weak == {1, 3}
    for kind in ("rotation", "horizontal"):
        assert len({chains[coordinate(leg, kind)].value("friction.coulomb") for leg in range(6)}) == 6


def test_an_unknown_friction_is_named() -> None:
    with pytest.raises(SealegsError, match="no joint friction 'lugre'"):
        Machine("lugre")


def _evaluate(*arguments: str) -> Done:
    return typed("evaluate", "paper=hexapod", *arguments)


def test_only_the_support_counts_for_joints_that_stand_still_in_support() -> None:
    gait = Tripod(FAST)
    time = 0.01 * np.arange(round(gait.cycle / 0.01))
    moves = np.stack([gait.in_transfer(leg, time) for leg in range(6)], axis=1)
    blank = np.zeros((len(time), 18))

    def recorded(moving: np.ndarray) -> Walk:
        position = blank.copy()
        feet = np.zeros((len(time), 6, 2))
        position[:, 1::3] = np.cumsum(np.where(moving, 1e-3, 0.0), axis=0)
        return Walk(gait, time, blank[:, :3], blank, position, blank, blank, blank, blank[:, :6], feet, 1.0)

    assert at_rest(recorded(moves)) > 0.98
    assert at_rest(recorded(~moves)) < 0.02


def test_viscous_friction_as_assumed_is_not_small_and_bristles_are_dissipative() -> None:
    holds = {row.name: row.holds for row in arithmetic_rows()}
    assert holds["bristle damping of 0.02 N.s/m is dissipative"]
    assert not holds["viscous friction is small beside dry friction"]


def test_bristles_give_back_no_more_than_they_stored_up_to_the_bound_and_do_beyond_it() -> None:
    coulomb, stribeck, viscous, stribeck_speed = 110.0, 740.0, 3000.0, 1e-4
    force = np.linspace(-coulomb - stribeck, coulomb + stribeck, 401)[:, None]
    speed = np.concatenate([-np.logspace(-8.0, 3.0, 200), np.logspace(-8.0, 3.0, 200)])
    limit = coulomb + stribeck * np.exp(-((speed / stribeck_speed) ** 2))
    bristles = speed - np.abs(speed) * force / limit
    bound = largest_bristle_damping(coulomb, stribeck, viscous)

    def lost(damping: float) -> float:
        power = (force + damping * bristles + viscous * speed) * speed
        return float((power - force * bristles).min())

    assert lost(0.999 * bound) >= 0.0
    assert lost(1.1 * bound) < 0.0


@pytest.mark.weekly
@pytest.mark.timeout(1800)
def test_evaluate_writes_numbers_and_pictures_and_never_over_old_ones(tmp_path: Path) -> None:
    out = tmp_path / "comparison"
    first = _evaluate(f"out={out}", "seconds=1")
    assert first.returncode == 0, first.stderr
    written = json.loads((out / "hexapod.json").read_text())
    rows = {row["name"]: row for row in written["rows"]}
    fitted = [name for name, row in rows.items() if row["mark"] == "fitted"]
    assert {"no vertical current in support with LuGre", "but with dry/viscous, for regulation"} < set(fitted)
    assert {"vertical joints stand still in support", OVERCOME} < set(fitted)
    decided = {next(iter(row["rival"])) for row in rows.values() if row["decides"]}
    assert decided == {f"{STICKS}, 1010 N", f"{REGULARISED}, 1010 N"}, "to sink at 440 N takes longer than a second"
    alone = rows["no vertical current in support with LuGre"]["sensitivity"]["legs 1 and 3 there"]
    assert min(float(part) for part in alone.removesuffix("%").split("% and ")) > 50.0, "they cannot hold their load"
    for name in ("height", "friction", "limit", "vertical", "horizontal", "resistance"):
        assert (out / f"{name}.png").stat().st_size > 10_000
    again = _evaluate(f"out={out}", "seconds=1")
    assert again.returncode == 2
    assert "holds a comparison already" in again.stderr


def test_a_run_too_short_to_sink_is_refused(tmp_path: Path) -> None:
    done = _evaluate(f"out={tmp_path}", "seconds=0.1")
    assert done.returncode == 2
    assert "at least 1 is needed" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
