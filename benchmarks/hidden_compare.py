"""Whether the finder still says what it said: cases of an earlier run again, name by name and value by value.

``python -m benchmarks.hidden_compare`` takes the quickest of the committed cases, one in seven of them a null, runs
those that this revision of the code has not run, and writes ``benchmarks/results/hidden_compare.md``. A case is the
same where its verdict, its causes, their order, rivals and parameters are, and where each value lies within the other's
interval. Can be stopped and goes on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sealegs.common.markdown import page, table

from benchmarks.hidden import Case, all_names, revision, run
from benchmarks.kept import RESULTS, Kept, command, side_by_side, study, write


def case_of(row: dict[str, Any]) -> Case:
    """The case that a recorded row is of."""
    effects = tuple((name, effect["magnitude"]) for name, effect in row["effects"].items())
    return Case(effects, int(row["key"].rpartition("#")[2]), " drawn #" in row["key"])


def sample(
    rows: Sequence[dict[str, Any]],
    count: int,
    nulls: int | None = None,
    magnitudes: Sequence[str] = (),
    least: int = 0,
) -> list[dict[str, Any]]:
    """The ``count`` quickest of the rows, one in seven a null; effects that the testbed lost are left out.

    Args:
        rows: of the earlier run.
        count: how many, nulls included.
        nulls: how many of them are nulls, where not one in seven.
        magnitudes: of the effects; default: all.
        least: how many effects a case hides at least.
    """
    rows = [row for row in rows if len(row["effects"]) >= least]
    known, nulls = set(all_names()), count // 7 if nulls is None else nulls
    rows = sorted((row for row in rows if set(row["effects"]) <= known), key=lambda row: row["seconds"])
    if magnitudes:
        rows = [row for row in rows if {effect["magnitude"] for effect in row["effects"].values()} <= set(magnitudes)]
    return [row for row in rows if row["effects"]][: count - nulls] + [row for row in rows if not row["effects"]][
        :nulls
    ]


def differences(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """What is not the same in two rows of one case."""
    found = []
    if before["verdict"] != after["verdict"]:
        found.append(f"verdict: {before['verdict']} → {after['verdict']}")
    old, new = ([c for c in row["causes"] if c["kind"] != "data"] for row in (before, after))
    names = [[c["name"] for c in causes] for causes in (old, new)]
    if names[0] != names[1]:
        found.append(f"causes: {', '.join(names[0]) or '-'} → {', '.join(names[1]) or '-'}")
        return found
    for a, b in zip(old, new, strict=True):
        if added := set(b["parameters"]) - set(a["parameters"]):
            found.append(f"{b['name']} has gained {', '.join(sorted(added))}")
        if a.get("rivals", []) != b.get("rivals", []):
            found.append(f"rivals of {a['name']}: {a.get('rivals') or '-'} → {b.get('rivals') or '-'}")
        for path, (value, low, high, *_) in a["parameters"].items():
            other, other_low, other_high, *_ = b["parameters"].get(path, (float("nan"),) * 3)
            if not (low <= other <= high and other_low <= value <= other_high):
                found.append(
                    f"{path}: {value:.4g} [{low:.4g}, {high:.4g}] → {other:.4g} [{other_low:.4g}, {other_high:.4g}]"
                )
    return found


@study
def main() -> int:
    """Command line; the status is 1 where a case differs."""
    parser = command(__doc__)
    parser.add_argument("--like", type=Path, default=RESULTS / "hidden_drawn.json", help="the earlier run")
    parser.add_argument("--sample", type=int, default=42, help="how many of its cases")
    parser.add_argument("--nulls", type=int, help="how many of them are nulls; default: one in seven")
    parser.add_argument("--magnitudes", nargs="+", default=(), help="of the effects; default: all")
    parser.add_argument("--pairs", action="store_true", help="only cases that hide several effects")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    parser.add_argument(
        "--out", type=Path, default=RESULTS / "hidden_compare.jsonl", help="kept cases, the page beside it"
    )
    options = parser.parse_args()
    cases = json.loads(options.like.read_text())["cases"]
    rows = sample(cases, options.sample, options.nulls, options.magnitudes, 2 * options.pairs)
    by_key = {row["key"]: row for row in rows}
    kept = Kept(options.out)
    ran = {row["key"]: row for row in kept.rows if row["key"] in by_key}  # of each case the last
    have = {key for key, row in ran.items() if row["revision"] == revision()}
    todo = [case_of(row) for row in sorted(rows, key=lambda row: row["seconds"]) if row["key"] not in have]
    for row in side_by_side(run, todo, options.jobs):
        kept.add(row)
        ran[row["key"]] = row
        said = "; ".join(differences(by_key[row["key"]], row)) or "same"
        print(f"{len(ran)}/{len(rows)} {row['key']}: {said} ({row['seconds']:.0f} s)", flush=True)
        write(options.out.with_suffix(""), told(list(ran.values()), by_key))
    return 0 if all(not differences(by_key[key], row) for key, row in ran.items()) else 1


def told(kept: Sequence[dict[str, Any]], by_key: dict[str, dict[str, Any]]) -> str:
    """The page about the cases that were run so far."""
    rows = [(row["key"], differences(by_key[row["key"]], row)) for row in sorted(kept, key=lambda row: row["key"])]
    same = sum(not found for _, found in rows)
    earlier, now = (", ".join(sorted({row["revision"] for row in rows})) for rows in (by_key.values(), kept))
    return page(
        "The finder before and after a change of the code",
        f"{same} of {len(rows)} cases of revision {earlier} are the same in {now}: verdict, causes in order, "
        f"their rivals and parameters, each value within the other's interval. {len(by_key)} are the sample: the "
        "quickest of their kind.",
        "Made by `python -m benchmarks.hidden_compare`, which can be stopped and goes on.",
        table(("case", "difference"), ((key, "; ".join(found) or "none") for key, found in rows)),
    )


if __name__ == "__main__":
    sys.exit(main())
