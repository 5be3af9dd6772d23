"""How high the hexapod lifts its feet, and how far they slide: its reference gait, and the learned ones.

    python -m benchmarks.hexapod_feet           what has no row yet, some minutes
    python -m benchmarks.hexapod_feet --again   all anew

A short look of two cycles from one start, with the drives of the training. Each policy is measured once more with the
gait's lift held at the least that lifts feet as a gait is to: what that would cost without another training.
"""

from __future__ import annotations

import sys

import numpy as np
from sealegs.agents.policy_files import load_policy
from sealegs.common.markdown import page, table
from sealegs.envs.hexapod.env import TOUCH
from sealegs.envs.hexapod.gait import MODULATED
from sealegs.envs.hexapod.parameters import LEGS
from sealegs.envs.hexapod.robot import foot

from benchmarks.kept import POLICIES, command, read, study, write
from benchmarks.learned import GAIT
from benchmarks.rollouts import Act, Moved, walked

HEIGHT, SLIP = 20.0, 0.05  # [mm] and share of the way, what a gait is to reach; slip as of the walkers
HELD = 0.03  # [m] of the gait's lift: feet sink, and lag behind
WINDOW, SEED = 12.0, 40_000
REFERENCE, HIGHER = "reference", ", lift held"


class Feet:
    """Heights and slip of all feet, seen at each goal."""

    def __init__(self) -> None:
        self._before: np.ndarray | None = None
        self._top, self._slid = np.zeros(LEGS), np.zeros(LEGS)
        self._peaks: list[float] = []

    def __call__(self, moved: Moved) -> None:
        """One simulation, 10 ms later."""
        model = moved.engine.drivetrain.model
        geoms = [int(model.geom(foot(leg)).id) for leg in range(LEGS)]
        places = moved.geoms[0, geoms] - [0.0, 0.0, moved.engine.numbers["foot_radius"]]
        down = places[:, 2] < TOUCH
        if moved.counts and self._before is not None:
            landed = down & (self._top > 0.0)
            self._peaks += self._top[landed].tolist()
            stood = down & (self._before[:, 2] < TOUCH)
            self._slid += np.where(stood, np.hypot(*(places - self._before)[:, :2].T), 0.0)
        self._top = np.where(down, 0.0, np.maximum(self._top, places[:, 2]))
        self._before = places.copy()

    def figures(self, way: float) -> dict[str, float]:
        """Median peak of the swings [mm], and the mean slip of a foot over the way [m]."""
        return {
            "swings, median [mm]": 1e3 * float(np.median(self._peaks)) if self._peaks else 0.0,
            "slip over the way": float(self._slid.mean() / way),
        }


def held(act: Act) -> Act:
    """A policy with the gait's lift at :data:`HELD` at least."""
    names = list(MODULATED)
    middle, per_action, *_ = MODULATED["lift"]
    least, at = (HELD - middle) / per_action, names.index("lift")

    def higher(seen: np.ndarray) -> np.ndarray:
        action = np.array(act(seen))
        action[:, at] = np.maximum(action[:, at], least)
        return action

    return higher


def measure(name: str) -> dict[str, float]:
    """Figures of the reference gait, or of a policy."""
    seed = name.removesuffix(HIGHER)
    act, description = load_policy(POLICIES / "hexapod" / ("seed0" if seed == REFERENCE else seed))
    chosen: Act = held(act) if name.endswith(HIGHER) else GAIT if seed == REFERENCE else act
    feet = Feet()
    found = walked(
        description["env"], description["actuators"], chosen, starts=1, window=WINDOW, seed=SEED, watch=feet
    )  # fmt: skip
    way = float(found.way[0, 0])
    return {
        **feet.figures(way),
        "specific resistance": float(found.resistance[0]),
        "speed [cm/s]": 100.0 * way / WINDOW,
    }


def told(rows: dict[str, dict[str, float]]) -> str:
    """The rows as a page of Markdown."""
    cells = (
        (name, f"{row['swings, median [mm]']:.1f} mm", f"{row['slip over the way']:.1%}",
         f"{row['specific resistance']:.2f}", f"{row['speed [cm/s]']:.2f}",
         "yes" if row["swings, median [mm]"] >= HEIGHT else "**no**",
         "yes" if row["slip over the way"] < SLIP else "**no**")
        for name, row in rows.items()
    )  # fmt: skip
    return page(
        "Feet of the hexapod",
        f"{WINDOW:g} s from one start, at 3 cm/s with the drives of the training. A gait lifts feet over {HEIGHT:g} mm "
        f"and slides less than {SLIP:.0%} of the way. Lift held: the policy with the gait's lift at "
        f"{1e3 * HELD:g} mm at least. `python -m benchmarks.hexapod_feet`",
        table(("gait", "swings", "slip", "specific resistance", "speed [cm/s]", "lifts", "slides little"), cells),
    )


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    rows = {} if parser.parse_args().again else read("hexapod_feet", {})
    seeds = sorted(path.parent.name for path in POLICIES.glob("hexapod/*/policy.json"))
    for name in (REFERENCE, *seeds, *(f"{seed}{HIGHER}" for seed in seeds)):
        if name in rows:
            continue
        rows[name] = measure(name)
        print(f"{name}: {rows[name]}", flush=True)
        write("hexapod_feet", None, rows)
    write("hexapod_feet", told(rows))


if __name__ == "__main__":
    sys.exit(main())
