"""The finder against benches drawn from a wide prior, with a fresh run of each plant, and a reliability diagram.

``python -m benchmarks.hidden_wide --cases 120`` draws motors, gears, loads, rates, lengths and noise
(:mod:`testbed.wide`), hides nothing, one effect, two, or what the catalogue lacks, and puts faults of recording on top.
It writes ``benchmarks/results/hidden_wide.{md,png}``; cases are kept in ``hidden_wide.jsonl`` beside them, so that it
can be stopped and goes on. Seeds below 900 are for development.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.markdown import page, table

from benchmarks.calibration import calibration_error, is_right, picture
from benchmarks.hidden import SURE, hides, limits_of, revision, row_of
from benchmarks.kept import RESULTS, Kept, command, study, write

FIRST = 1800
NAMED = 0.6
"""Confidence from which a cause counts as named; below it the diagnosis says itself that it may be another."""
VISIBLE = 2.0
"""Change of the position, in parts of the noise, from which a hidden effect is expected to be seen."""
FAULT_CODES = {
    "sign": ("position.sign",),
    "degrees": ("unit.degrees",),
    "held": ("column.held",),
    "late stamps": ("clock.late_stamps", "clock.irregular"),
    "velocity unit": ("unit.velocity",),
    "columns behind": ("column.behind",),
    "unsigned current": ("current.unsigned",),
}
"""Codes of findings that name a fault of recording."""


def run(seed: int) -> dict[str, Any]:
    """Record and diagnose one case, and judge the models on a fresh run of its plant."""
    from sealegs.gap.finder.diagnosis import diagnose

    from testbed import hidden_wide

    data, truth = hidden_wide(seed)
    began = time.perf_counter()
    (found,) = diagnose(data)
    seconds = time.perf_counter() - began
    return {
        "key": f"#{seed}",
        "revision": revision(),
        **{key: truth[key] for key in ("kind", "effects", "fault", "recorder", "noise_floor")},
        "seconds": seconds,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "model": found.model,
        "gap": {name: error.rmse for name, error in found.gap.items()},
        "fresh": _fresh(seed, found.values) if found.problem is not None else {},
        "causes": [row_of(cause) for cause in found.causes],
        "limits": limits_of(found),
        "structure": None if found.structure is None else found.structure.level,
        "open": [[cause.name, cause.standing] for cause in found.open_causes],
        "codes": sorted({finding.code for finding in found.findings}),
    }


def _fresh(seed: int, values: Mapping[str, float]) -> dict[str, float]:
    """Error of the nominal and the extended model on a run that was recorded after the diagnosis."""
    from sealegs.actuators.chain import load_chain
    from sealegs.gap.log.parts import cut
    from sealegs.gap.replay.driven import driven_problem
    from sealegs.gap.replay.free import free_problem
    from sealegs.gap.replay.joint_model import JointModel
    from sealegs.gap.replay.problem import converged

    from testbed import hidden_wide

    data, truth = hidden_wide(seed, fresh=True)
    run, joint = data.runs[0], "servo"
    models, units = [JointModel(load_chain(run.actuators[joint]))], cut(data.runs, joint)
    if run.robot == "bench":
        problem = converged(free_problem(data.runs, joint, models, units, {"position": 1.0 / truth["noise_floor"]}))
    else:
        problem = converged(driven_problem(data.runs, joint, models, units, truth["noise_floor"]))
    errors = [problem.position_error(channels) for channels in problem.simulate([{}, values])]
    nominal, extended = (float(np.sqrt(np.mean(error**2))) for error in errors)
    return {"nominal": nominal, "extended": extended, "noise": problem.noise}


# --- judging -----------------------------------------------------------------------------------------------------


def outcome(row: Mapping[str, Any]) -> str:
    """``right``, ``open``, ``missed``, ``wrong`` or ``confidently wrong``.

    Open is a diagnosis that leaves what is hidden to the next experiment: it names no false cause with a confidence of
    :data:`NAMED` or more, or it finds nothing and says that an effect of that size would not show. Missed is one that
    finds nothing to explain though the effect shows.
    """
    false = [cause for cause in row["causes"] if not is_right(cause, row)]
    doubted = [cause for cause in false if set(row["effects"]) & set(cause["rivals"])]
    if any(cause["confidence"] >= SURE for cause in false if cause not in doubted):
        return "confidently wrong"
    if any(cause["confidence"] >= NAMED for cause in false) and row["verdict"] != "not identifiable":
        return "wrong"
    known = [name for name in row["effects"] if not name.startswith("stranger")]
    visible = [name for name, effect in row["effects"].items() if effect["noise_floors"] > VISIBLE]
    if any(is_right(cause, row) for cause in row["causes"]):
        return "right"
    if row["verdict"] in ("nothing to explain", "explained") and not row["causes"]:
        if not visible:
            return "right"
        return "open" if all(_told(row, name) for name in visible) else "missed"
    return "open" if known or row["effects"] or row["verdict"] != "nothing to explain" else "right"


def _told(row: Mapping[str, Any], name: str) -> bool:
    """Whether a diagnosis that found nothing says that an effect of the size that is hidden would not show."""
    limits = row.get("limits", {})
    return name in limits and hides(limits, name, row["effects"][name]["actual"])


def worse_than_nominal(row: Mapping[str, Any]) -> bool:
    """Whether the model that is handed over does worse than the nominal one on a fresh run, by more than 2 %."""
    fresh = row["fresh"]
    return bool(fresh) and fresh["extended"] > 1.02 * fresh["nominal"]


# --- report ------------------------------------------------------------------------------------------------------


def told(rows: Sequence[Mapping[str, Any]]) -> str:
    """Figures and cases, as markdown."""
    rows = sorted(rows, key=lambda row: int(row["key"][1:]))
    count, results = len(rows), Counter(outcome(row) for row in rows)
    fresh = [row for row in rows if row["fresh"]]
    worse = sum(map(worse_than_nominal, fresh))
    faulty = [row for row in rows if row["fault"]]
    noticed = sum(bool(set(FAULT_CODES[row["fault"]]) & set(row["codes"])) for row in faulty)
    seconds = np.array([row["seconds"] for row in rows])
    named = sum(len(row["causes"]) for row in rows)
    good = results["right"] + results["open"]
    figures = (
        ("right or honestly open", "95 %", f"{good} of {count} ({good / count:.0%}); right {results['right']}, open "
         f"{results['open']}, missed {results['missed']}, wrong {results['wrong']}"),
        (f"a false cause named with confidence {SURE:g} or more", "at most 1 %",
         f"{results['confidently wrong']} of {count}"),
        ("model worse than the nominal one on a fresh run", "at most 1 %", f"{worse} of {len(fresh)}"),
        ("calibration error of confidences", "under 5 points",
         f"{100 * calibration_error(rows):.1f} points over {named} named causes"),
        ("faults of recording named", "", f"{noticed} of {len(faulty)}"),
        ("time per diagnosis", "at most 120 s", f"median {np.median(seconds):.0f} s, largest {seconds.max():.0f} s"),
    )  # fmt: skip
    cells = []
    for row in rows:
        hidden = ", ".join(f"{n} ({e['noise_floors']:.1f})" for n, e in row["effects"].items()) or "-"
        causes = ", ".join(f"{c['name']} ({c['confidence']:.2f})" for c in row["causes"]) or "-"
        recorder, after = row["recorder"], row["fresh"]
        runs = f"{recorder['runs']} x {recorder['duration']:g} s, {1 / recorder['period']:.0f} Hz"
        runs += "" if recorder["load_known"] else ", load unknown"
        errors = f"{after['nominal'] / after['noise']:.1f}, {after['extended'] / after['noise']:.1f}" if after else "-"
        cells.append((row["key"], outcome(row), hidden, row["fault"] or "-", runs, row["verdict"], causes, errors))
    heads = ("case", "outcome", "hidden (noise floors)", "fault", "runs", "verdict", "named (confidence)",
             "fresh run: nominal, extended / noise")  # fmt: skip
    return page(
        "Hidden effects, a wide prior",
        f"{count} benches with motors, gears, loads, rates, lengths and noise drawn anew for each "
        "(`testbed/wide.py`). Made by `python -m benchmarks.hidden_wide`, which can be stopped and goes on.",
        table(("", "wanted", "measured"), figures),
        f"Revisions of gap, actuators and testbed: {', '.join(sorted({row['revision'] for row in rows}))}. Right: a "
        f"hidden cause is named and no false one with {NAMED:g} or more, or nothing is hidden and nothing named. Open: "
        "left to the next experiment, or too small to show by the limit that the diagnosis gives. Missed: nothing to "
        f"explain, though the effect moves the position by more than {VISIBLE:g} noise floors and its limit.",
        "![reliability](hidden_wide.png)",
        table(heads, cells),
    )


def said(row: Mapping[str, Any]) -> str:
    """A case in a line."""
    causes = ", ".join(f"{c['name']} {c['confidence']:.2f}" for c in row["causes"]) or "-"
    hidden = ", ".join(f"{n} {e['noise_floors']:.1f}" for n, e in row["effects"].items()) or "-"
    return f"{outcome(row)}; {hidden} [{row['fault']}] -> {row['verdict']}: {causes}"


@study
def main() -> None:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("--cases", type=int, default=120, help="how many")
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first; below 900 for development")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    parser.add_argument("--out", type=Path, default=RESULTS / "hidden_wide.jsonl", help="kept cases")
    parser.add_argument("--report", action="store_true", help="only write the page of what is kept")
    options = parser.parse_args()
    kept = Kept(options.out)
    seeds = [] if options.report else range(options.first, options.first + options.cases)
    kept.run(run, [seed for seed in seeds if f"#{seed}" not in kept], said, options.jobs)
    write(kept.file.with_suffix(""), told(kept.rows))
    picture({"hidden_wide": kept.rows}, kept.file.with_suffix(".png"))
    print(told(kept.rows).partition("\n![")[0])


if __name__ == "__main__":
    sys.exit(main())
