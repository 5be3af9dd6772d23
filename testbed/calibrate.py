"""Print the effect sizes that move the measured position by the wanted number of noise floors."""

from __future__ import annotations

import functools

import numpy as np

from .bench import JOINT, NOISE_FLOOR, record_bench
from .effects import EFFECTS, GAP_IN_NOISE_FLOORS, STRANGERS
from .recording import Recording


@functools.cache
def reference(name: str, seed: int) -> list[Recording]:
    """The same bench with nothing hidden; for the spring, the one with a spring that is as believed."""
    return record_bench({name: 1.0} if name == "spring.stiffness" else {}, seed)[0]


def gap(name: str, value: float, seeds: tuple[int, ...] = (0, 1)) -> float:
    """Rms shift of the measured position that an effect causes, in noise floors."""
    shifts = []
    for seed in seeds:
        hidden, _ = record_bench({name: value}, seed)
        for run, other in zip(hidden, reference(name, seed), strict=True):
            # Equal seeds give equal noise: what differs is the effect, up to quantisation.
            shifts.append(run.joints[JOINT]["position"] - other.joints[JOINT]["position"])
    return float(np.sqrt(np.mean(np.concatenate(shifts) ** 2))) / NOISE_FLOOR


def main() -> None:
    """Bisect every effect for every magnitude."""
    for name, effect in (EFFECTS | STRANGERS).items():
        sizes = []
        for wanted in GAP_IN_NOISE_FLOORS.values():
            low, high = 0.0, 1.0
            for _ in range(9):
                middle = 0.5 * (low + high)
                value = interpolate(effect.span, middle)
                low, high = (low, middle) if gap(name, value) > wanted else (middle, high)
            value = interpolate(effect.span, 0.5 * (low + high))
            sizes.append((float(f"{value:.3g}"), round(gap(name, value), 1)))
        print(name, tuple(size for size, _ in sizes), "gap", tuple(reached for _, reached in sizes), flush=True)


def interpolate(span: tuple[float, float], x: float) -> float:
    """Value between no effect (0) and the largest plausible one (1); geometric where both ends are positive."""
    none, most = span
    return none * (most / none) ** x if none > 0 else none + (most - none) * x**2


if __name__ == "__main__":
    main()
