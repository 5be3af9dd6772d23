"""Whether the biped's learned walks are gaits: how high each foot swings, how far it slides, whether both do alike.

    python -m benchmarks.biped_gaits              all walkers of policies/, but those that have a row
    python -m benchmarks.biped_gaits biped/seed0  some of them
    python -m benchmarks.biped_gaits --again      all anew

A short look of 20 s from four starts, told to walk at 0.6 m/s; `python -m benchmarks.learning biped` measures the same
over 60 s from sixteen.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks import study
from benchmarks.biped_motion import load
from benchmarks.learned_biped import ALIKE, HEIGHT, JUDGED, SLIP, is_a_gait, walk
from benchmarks.speed import RESULTS

POLICIES = Path(__file__).resolve().parents[1] / "policies"
KINDS = ("biped",)
STARTS, SECONDS = 4, 20.0
OTHERS = ("ideal", "regression", "net")  # actuator models that no walker was trained with
COLUMNS = (
    "left swings, median [mm]",
    "right swings, median [mm]",
    "left slip over the way",
    "right slip over the way",
    "heights differ by",
)


def measure(policy: Path) -> dict[str, float]:
    """Figures of a policy."""
    env, actuator, act = load(policy)
    asked = {**env, "speed": JUDGED}
    others = {f"{word}, shortest [s]": walk(asked, word, act, STARTS, SECONDS)["shortest [s]"] for word in OTHERS}
    return walk(asked, actuator, act, STARTS, SECONDS) | others


def table(rows: dict[str, dict[str, float]]) -> str:
    """The rows as a page of Markdown."""
    lines = [
        "# Feet of the learned walkers",
        "",
        f"{SECONDS:g} s from {STARTS} starts, told to walk at {JUDGED:g} m/s. A gait lifts both feet over {HEIGHT:g} "
        f"mm, slides less than {SLIP:.0%} of the way on either, and swings both alike within {ALIKE:.0%}. "
        "The last columns: "
        f"seconds until the first fall, of {SECONDS:g}, with drives that the policy was not trained with. "
        "`python -m benchmarks.biped_gaits`",
        "",
        "| policy | left swings [mm] | right swings [mm] | left slip | right slip | differ by | falls | speed [m/s] | "
        f"gait | {' | '.join(OTHERS)} |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        high = " | ".join(f"{row[column]:.0f}" for column in COLUMNS[:2])
        shares = " | ".join(f"{row[column]:.0%}" for column in COLUMNS[2:])
        judged = is_a_gait({f"{key} at {JUDGED:g} m/s": value for key, value in row.items()})
        lines.append(
            f"| {name} | {high} | {shares} | {row['falls']:.0f} | {row['speed [m/s]']:.2f} | "
            f"{'yes' if judged else '**no**'} | "
            + " | ".join(f"{row[f'{word}, shortest [s]']:.1f}" for word in OTHERS)
            + " |"
        )
    return "\n".join(lines) + "\n"


@study
def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.biped_gaits", description=__doc__)
    parser.add_argument("policies", nargs="*", help="such as biped/seed0; default: all")
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    arguments = parser.parse_args()
    file = RESULTS / "biped_gaits.json"
    rows = json.loads(file.read_text()) if file.is_file() else {}
    folders = [
        f"{kind}/{path.parent.name}" for kind in KINDS for path in sorted(POLICIES.glob(f"{kind}/*/policy.json"))
    ]
    for name in arguments.policies or folders:
        if name in rows and not arguments.again:
            continue
        rows[name] = measure(POLICIES / name)
        print(f"{name}: {rows[name]}", flush=True)
        rows = {key: rows[key] for key in folders if key in rows}
        file.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        file.with_suffix(".md").write_text(table(rows), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
