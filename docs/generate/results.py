"""Writes the other pages of docs/results: ``python -m docs.generate.results``, from what ``benchmarks/results`` keeps.

The text of a page lies in ``benchmarks/pages``, with fields for its figures (:mod:`docs.generate.templates`). What is
worked out here is what no page of ``benchmarks/results`` has as it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from sealegs.common.markdown import table

from benchmarks import hidden, hidden_arm, hidden_hopper, hidden_report, hidden_wide, next_experiment, policy_matrix
from benchmarks.hidden_report import share
from benchmarks.kept import CHECKOUT, RESULTS, Kept, read
from benchmarks.walking import cell

from .papers import robots
from .papers import tables as paper_tables
from .templates import NUMBER, Measured, as_number, fill, summarised, write

TEXTS = CHECKOUT / "benchmarks" / "pages"
LEARNED = {
    "hexapod": "hexapod, walking",
    "leg": "leg, a path of the foot",
    "biped": "biped, walking",
    "biped_hopping": "biped, hopping",
    "arm": "arm, a path of the tool",
}
"""What the pages ``learning_<name>`` are of."""
BENCHES = {"drawn": "hidden_drawn", "table": "hidden", "faint": "hidden_faint"}
LEAST = {"plain, first": 0.95, "faint, honest": 0.9, "covered": 0.85, "pairs, named": 0.8, "strangers, flagged": 0.9,
         "good": 0.95}  # fmt: skip
MOST = {"faint, false": 0.03, "nulls, false": 1.0 / 40.0, "worse": 0.01, "false": 0.01}
"""Shares that are wanted at least, and at most; both were set before the benches were run."""
WRITTEN = "\n*Written by `python -m docs.generate.results` from `benchmarks/results`; do not edit.*\n"


def pages() -> list[str]:
    """Names of the pages that are written here."""
    return sorted(path.stem for path in TEXTS.glob("*.md"))


def page(name: str) -> str:
    """The text of docs/results/<name>.md."""
    own = FIGURES.get(name)
    return fill(TEXTS / f"{name}.md", own() if own else {}) + WRITTEN


def cases(name: str) -> list[dict[str, Any]]:
    """Kept cases of a hidden bench."""
    whole = read(name)
    return Kept(RESULTS / f"{name}.jsonl").rows if whole is None else whole["cases"]


def wanted(name: str) -> str:
    """A bar as pages have it."""
    return f"{100 * LEAST[name]:g} %" if name in LEAST else f"at most {100 * MOST[name]:g} %"


def marked(name: str, text: str) -> str:
    """A share as a text, ``33 of 36 ...``, with a word where it misses its bar."""
    good, of = (int(number.replace(",", "")) for number in NUMBER.findall(text)[:2])
    missed = good / of < LEAST.get(name, 0.0) or good / of > MOST.get(name, 1.0)
    return f"{text}: missed" if missed else text


def bench(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Shares of a hidden bench with their intervals, and what its time and its models come to."""
    counted = hidden_report.counts([dict(row) for row in rows])
    found = {name: marked(name, share(*value)) for name, value in counted.items()}
    seconds = np.array([row["seconds"] for row in rows])
    return found | {"median": f"{np.median(seconds):.0f} s", "longest": f"{seconds.max():.0f} s"}


def benches() -> dict[str, dict[str, str]]:
    """All hidden benches of one joint."""
    return {name: bench(cases(file)) for name, file in BENCHES.items()}


def sizes() -> dict[str, str]:
    """Error of the nominal model over the noise floor by what is hidden, as medians of all benches."""
    found: dict[str, list[float]] = {}
    for row in (row for file in BENCHES.values() for row in cases(file)):
        if row["gap"]:
            found.setdefault(hidden_report.kind(row), []).append(row["gap"]["nominal"] / row["gap"]["noise_floor"])
    return {name: f"{np.median(values):.1f}" for name, values in found.items()}


def named(causes: Sequence[Mapping[str, Any]]) -> str:
    """Names with their confidence."""
    return ", ".join(f"{cause['name']} ({cause['confidence']:.2f})" for cause in causes) or "nothing"


def not_right() -> str:
    """Every single effect whose name did not come first under a verdict that trusts it, and strangers not flagged."""
    rows = []
    for label, file in BENCHES.items():
        for row in cases(file):
            kind = hidden_report.kind(row)
            missed = not hidden_report.flagged(row) if kind == "stranger" else (
                kind in ("clear", "moderate", "faint") and hidden.outcome(row) != "right"
            )  # fmt: skip
            if missed:
                ((_, effect),) = row["effects"].items()
                size = f"{effect['parameter']} {effect['value']:.3g}"
                rows.append((label, row["key"].replace(" drawn", ""), size, row["verdict"], named(row["causes"])))
    return table(("bench", "hidden", "its size", "verdict", "named (confidence)"), rows)


def diagnosis() -> dict[str, Any]:
    """Figures of the page on finding causes."""
    arms, wide, measured = cases("hidden_arm"), cases("hidden_wide"), Measured()["hidden_wide"]
    good = sum(hidden_wide.outcome(row) in ("right", "open") for row in wide)
    return {
        **benches(),
        "sizes": sizes(),
        "revisions": {name: ", ".join(sorted({row["revision"] for row in cases(file)}))
                      for name, file in (*BENCHES.items(), ("wide", "hidden_wide"), ("arms", "hidden_arm"))},
        "not_right": not_right(),
        "absorbed": {name: f"{hidden_report.most_absorbed(cases(file)):.2f}" for name, file in BENCHES.items()},
        "over": over_the_noise(),
        "wanted": {name: wanted(name) for name in (*LEAST, *MOST)},
        "wide": {
            "good": marked("good", share(good, len(wide))),
            "worse": marked("worse", measured["model worse than the nominal one on a fresh run"]["measured"]),
            "by": worse_models(wide),
            "false": marked("false", measured["a false cause named with confidence 0.9 or more"]["measured"]),
            "others": wide_misses(),
        },
        "arms": {
            **arm_shares(),
            "nulls": sum(not row["hidden"] for row in arms),
            "loud": sum(bool(hidden_arm.false_names(row)) for row in arms if not row["hidden"]),
            "missed": table(
                ("arm", "what was named"),
                ((row["key"], "; ".join(f"{joint}: {named(item['causes'])}" for joint, item in row["joints"].items()
                                        if item["causes"]) or "nothing")
                 for row in arms if row["hidden"] and hidden_arm.outcome(row) in ("missed", "doubtful", "wrong")),
            ),
        },
        "ground": ground(),
        "experiments": experiments(),
        "long": long_logs(),
    }  # fmt: skip


def arm_shares() -> dict[str, str]:
    """Shares of whole arms, each beside its bar."""
    found = Measured()["hidden_arm"]
    return {
        "right": marked("good", found["right cause at the right joint first"]),
        "covered": marked("covered", found["the interval covers the truth, joint by joint"]),
        "false": marked("false", found["another joint named with 0.9 or more"]),
        "strangers": marked("strangers, flagged", found["strangers flagged"]),
    }


def over_the_noise() -> dict[str, str]:
    """Of the extended model on unseen data, single clear effects: median, and the cases over the bar."""
    found = {}
    for name in ("drawn", "table"):
        over = {
            row["key"].replace(" drawn", ""): row["gap"]["extended"] / row["gap"]["noise_floor"]
            for row in cases(BENCHES[name])
            if hidden_report.kind(row) == "clear" and row["gap"]
        }
        beyond = [f"{key}: {value:.2g}" for key, value in over.items() if value > hidden_report.AT_THE_NOISE]
        within = len(over) - len(beyond)
        found[name] = (
            f"median {np.median(list(over.values())):.2f}, {within} of {len(over)} at most "
            f"{hidden_report.AT_THE_NOISE:g}; {', '.join(beyond)}: missed"
        )
    return found


def worse_models(rows: Sequence[Mapping[str, Any]]) -> str:
    """By how much models are worse than the nominal one on a fresh run, where they are."""
    worse = [row["fresh"]["extended"] / row["fresh"]["nominal"] - 1.0 for row in rows
             if hidden_wide.worse_than_nominal(row)]  # fmt: skip
    return " and ".join(f"{value:.1%}" for value in sorted(worse))


def wide_misses() -> str:
    """Cases of the wide prior that are neither right nor open."""
    listed = next(item for item in Measured()["hidden_wide"].tables if item.heads[0] == "case")
    keep = ("case", "outcome", "hidden (noise floors)", "verdict", "named (confidence)")
    found = listed.where("outcome", ("missed", "wrong", "confidently wrong"))
    return table(keep, ([row[head] for head in keep] for row in found))


def ground() -> dict[str, str]:
    """Shares of the hidden hopper, by size of what is hidden."""
    rows = cases("hidden_hopper")
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        by_kind.setdefault(hidden_report.kind(row), []).append(row)
    plain = [*by_kind["clear"], *by_kind["moderate"]]
    covered = [found[0] for row in rows if (found := hidden_hopper.coverage(row)) is not None]

    def right(of: Sequence[dict[str, Any]]) -> str:
        others = [f"{row['key'].partition(' ')[0]}: {hidden_hopper.worth(row)}" for row in of
                  if hidden_hopper.worth(row) != "right"]  # fmt: skip
        return "; ".join((share(sum(hidden_hopper.worth(row) == "right" for row in of), len(of)), *others))

    nulls, drags = by_kind["null"], by_kind["stranger"]
    return {
        "plain": right(plain),
        "faint": right(by_kind["faint"]),
        "nulls": share(sum(bool(hidden_report.named(row)) for row in nulls), len(nulls)),
        "drags": share(sum(hidden_hopper.worth(row) == "not identifiable" for row in drags), len(drags)),
        "covered": marked("covered", share(sum(covered), len(covered))),
    }


def experiments() -> dict[str, Any]:
    """How many poor sets are right, open or wrong, before and after the proposed experiments."""
    rows = cases("next_experiment")
    ends = {
        label: [next_experiment.outcome(row["effect"], row["steps"][place]) for row in rows]
        for label, place in (("before", 0), ("after", -1))
    }
    return {
        "sets": len(rows),
        **{label: {name: found.count(name) for name in ("right", "open", "wrong")} for label, found in ends.items()},
        "left": ", ".join(row["key"] for row, end in zip(rows, ends["after"], strict=True) if end != "right"),
    }


def long_logs() -> dict[str, str]:
    """Memory, time and result of diagnoses of long logs."""
    rows = read("large_log")
    longest = max(rows, key=lambda row: row["rows"])
    name, number, truth = "friction.load_dependent", "friction.load", 0.15
    off = max(abs(row[number][0] / truth - 1.0) for row in rows)
    return {
        "reading": f"{max(row['reading_mib'] for row in rows):.0f}",
        "peak": f"{max(row['peak_mib'] for row in rows):.0f}",
        "minutes": f"{longest['total_s'] / 60.0:.0f}",
        "rows": f"{longest['rows'] / 1e6:g} million rows ({longest['file_mib']:.0f} MiB)",
        "confidence": f"{min(row['causes'][name][1] for row in rows):.2f}",
        "off": f"{off:.1%}",
    }


def how_fast() -> dict[str, Any]:
    """Figures of the page on speed."""
    chains, training = Measured()["speed"].tables[0], read("training")
    ratios = [float(cell) for cell in chains.column("ratio")]
    errors = read("numerics")
    step = next(row["ours"] for row in errors["stiff"] if (row["integrator"], row["step"]) == ("RK4", 1e-3))
    fits = read("published_fit")
    trials = [[row["trials"] for row in fits[name]] for name in ("cma_es", "least_squares")]
    return {
        "table": bench(cases("hidden")),
        "chains": {"least": f"{min(ratios):.2f}", "costs": f"{100 * (1.0 - min(ratios)):.0f} %"},
        "training": f"{training['ratio']:.1f}",
        "subprocesses": training["simulations"]["subproc"],
        "step": f"{step:.2f} mrad, {step / errors['noise_floor']:.0%} of an encoder's noise",
        "fit": f"{np.median(trials[1]):.0f} trials in the median in place of {np.median(trials[0]):.0f}",
        "long": long_logs(),
    }


def policies() -> dict[str, Any]:
    """Figures of the page on policies."""
    bars = [
        (f"[{label}](../../benchmarks/results/learning_{name}.md)", bar["wanted"], bar["found"],
         "yes" if bar["holds"] else "**no**")
        for name, label in LEARNED.items() for bar in read(f"learning_{name}")["bars"]
    ]  # fmt: skip
    on_the_bus = read("policies_on_the_bus")
    leg = [row["share"] for row in on_the_bus if row["policy"].startswith("leg/")]
    others = [row["share"] for row in on_the_bus if not row["policy"].startswith("leg/")]
    starts = next(item for item in Measured()["many_starts"].tables if "hidden" in item.heads)
    ended, quiet = (summarised(starts.column(head), "sum") or "" for head in ("ended well", "no gap"))
    return {
        "bars": table(("robot and task", "bar", "reached", "holds"), bars),
        "tasks": len(LEARNED),
        "shares": f"{min(others):.2f} to {max(others):.2f}",
        "percent": f"{100 * min(others):.0f} to {100 * max(others):.0f} %",
        "leg": f"{max(leg):.2f}",
        "starts": {
            "policies": len(starts.rows),
            "each": starts.column("ended well")[0].split(" of ")[1],
            "ended": ended,
            "quiet": quiet,
            "told": f"{len(starts.column('told'))} of {len(starts.column('hidden'))}",
        },
        "effects": effects(),
        **on_other_models(),
        "cluster": cluster(),
        "feet": feet(),
        "legs": on_legs(),
    }


def on_other_models() -> dict[str, str]:
    """The committed policies on the actuator models of their robots: counts, and where they do worse than untrained."""
    cells = policy_matrix.cells(policy_matrix.read())
    tried = [policy_matrix.tried(name) for name in policy_matrix.TASKS]
    return {
        "matrix": table(policy_matrix.HEADS, policy_matrix.counted(cells, LEARNED)),
        "matrix_rule": policy_matrix.RULE,
        "tried": f"{min(tried)} to {max(tried)}",
        "collapsed": "Surely worse than what learned nothing: " + "; ".join(policy_matrix.worse(cells)) + ".",
        "falls": "Falls: " + "; ".join(policy_matrix.falls(cells)) + ".",
    }


def feet() -> dict[str, str]:
    """How many learned gaits of the hexapod lift their feet and slide little, and what a higher lift costs."""
    rows = {row[0]: row for row in Measured()["hexapod_feet"].tables[0].rows if row[0] != "reference"}
    higher = {name: row for name, row in rows.items() if name.endswith("held")}
    own = {name: rows[name.partition(",")[0]] for name in higher}
    costs = [float(higher[name][3]) / float(own[name][3]) - 1.0 for name in higher]
    counts = {key: str(sum(row[-place] == "yes" for row in of.values()))
              for key, of, place in (("lift", own, 2), ("slide", own, 1), ("held_lift", higher, 2),
                                     ("held_slide", higher, 1))}  # fmt: skip
    return {**counts, "cost": f"{100.0 * min(costs):.0f} to {100.0 * max(costs):.0f} %"}


def cluster() -> dict[str, str]:
    """What became of the trials of a sweep, a node of whose cluster was killed."""
    row = read("sweep_on_cluster")
    return {
        "trials": str(row["trials"]),
        "nodes": str(row["nodes"]),
        "lost": str(len(row["finished trials that changed"])),
        "ended": str(row["finished in the end"]),
    }


def on_legs() -> str:
    """Public robots that learned to walk, each beside its reference gait."""
    rows = [
        (name, str(row["joints"]), f"{row['mass']:.1f}", f"{row['steps']:,}", cell(row["gait"]), cell(row["policy"]))
        for name, row in read("walking")["robots"].items()
    ]
    return table(("robot", "joints", "mass [kg]", "steps learned", "its gait alone", "policy"), rows)


def safety() -> dict[str, Any]:
    """Figures of the page on safety."""
    rows = [
        (str(row["servos"]), f"{row['ratio']:.2f}", f"{row['bar']:g}",
         "reached" if row["ratio"] >= row["bar"] else "**missed**")
        for row in read("bus")["rows"]
    ]  # fmt: skip
    return {**policies(), "cycles": table(("servos", "of the SDK", "bar", ""), rows)}


def effects() -> str:
    """Effects that surely cost a policy of a robot more than a twentieth of its reward, dearest first."""
    found = Measured()["effects_on_policies"].tables[0]
    lines = []
    for row in found.rows:
        cells = dict(zip(found.heads[2:], row[2:], strict=True))
        sure = {head: cell.strip("*").partition(" (")[0] for head, cell in cells.items() if cell.startswith("**")}
        dearest = sorted(sure.items(), key=lambda item: -float(item[1].removesuffix(" %")))
        lines.append((row[0], ", ".join(f"{head}: {cell}" for head, cell in dearest) or "none"))
    return table(("policy", "effects that surely cost more than 5 % of the reward"), lines)


def front() -> dict[str, Any]:
    """Figures of the front page of the results."""
    servo = next(item for item in Measured()["real_data"].tables if item.heads[0] == "held out")
    better = [as_number(row[servo.heads.index("**extended**")].strip("*")) < as_number(best)
              for row, best in zip(servo.rows, servo.column("best of M1 to M6"), strict=True)]  # fmt: skip
    logs = Measured()["robot_logs"].tables[0]
    joints = [row[2] for row in logs.rows if row[1] != "robot"]
    told = ", ".join(f"{joints.count(verdict)} {verdict}" for verdict in sorted(set(joints), key=joints.index))
    return {**how_fast(), **policies(), **benches(), "servo": f"{sum(better)} of {len(better)}", "joints": told}


def papers() -> dict[str, Any]:
    """What decides in each paper, and how many rows are judged."""
    results = {robot: read(f"paper_{robot}") for robot in robots()}
    counted, deciding = [], []
    for robot, result in results.items():
        judged = [row for row in result["rows"] if row["holds"] is not None]
        of = [[row["holds"] for row in judged if (row["mark"] == "predicted") is real] for real in (True, False)]
        counted.append((
            f"[{robot}]({robot}.md)", result["paper"].removeprefix("paper "), str(len(result["rows"])),
            *(f"{sum(holds)} of {len(holds)}" for holds in of), str(sum(row["decides"] for row in judged)),
            str(len(result["not_built"])),
        ))  # fmt: skip
        deciding += [(robot, *cells) for cells in rows_of(paper_tables(result)["decided"])]
    return {
        "counted": table(
            ("robot", "paper", "rows", "predictions that agree", "others that agree", "that another model misses",
             "not built"), counted,
        ),
        "deciding": table(("robot", "prediction", "printed", "here", "other model", "its figure"), deciding),
    }  # fmt: skip


def rows_of(text: str) -> list[tuple[str, ...]]:
    """Rows of a table of Markdown."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [tuple(cell.strip() for cell in line.strip("| ").split(" | ")) for line in lines[1:]]


def confidence() -> dict[str, Any]:
    """Figures of the page on confidence."""
    return {**benches(), "ground": ground(), "arms": arm_shares(), "wanted": wanted("covered")}


TRANSFER = ("extended", "extended, drawn", "fine-tuned")
"""Of the treatments of the transfer study, what a diagnosis gives."""


def transfer() -> dict[str, Any]:
    """Figures of the page on transfer, beside the bars of the product; of a part of the machines that they are for."""
    document = read("transfer")
    figures = {row["treatment"]: row for row in document["figures"]}
    rows = []
    for name in TRANSFER:
        own = figures[name]
        of, worse = own["machines"], len(own["worse"])
        told = [
            ("share of the limit's accuracy, median machine", "at least 0.9", f"{own['median']:.2f}",
             own["median"] >= 0.9),
            ("way from nominal to limit closed, median machine", "at least 80 %", f"{own['closed']:.0%}",
             own["closed"] >= 0.8),
            ("better than both randomisations", "16 of 20", f"{own['better']} of {of}", own["better"] >= 0.8 * of),
            ("worse than nominal by more than noise", "none", f"{worse} of {of}", worse == 0),
        ]  # fmt: skip
        rows += [(name, what, bar, reached, "yes" if holds else "**no**") for what, bar, reached, holds in told]
    first = Measured()["transfer"].tables[0]
    machine = "pan_tilt-5900"
    play = next(row for row in document["hidden"][machine]["effects"] if row["name"] == "play")
    errors = document["errors"][machine]
    learnt = [1e3 * np.mean(row) for name, row in errors.items() if name != "limit" and "reference" not in name]
    eight = read("transfer_eight")
    (extended,) = (row for row in eight["figures"] if row["treatment"] == "extended")
    hide = {name for name, own in eight["hidden"].items() if any(one["name"] == "play" for one in own["effects"])}
    behind = [f"`{name}`" for name, own in eight["errors"].items() if _closed(own, "extended") < 0.8 and name in hide]
    ways = [_closed(own, "extended") for own in eight["errors"].values()]
    return {
        "table": table(first.heads, first.rows),
        "eight": table(*_eight(eight["errors"])),
        "eight_median": f"{extended['median']:.2f}",
        "eight_closed": f"{extended['closed']:.0%}",
        "eight_most": f"{sum(way >= 0.8 for way in ways)} of {len(ways)}",
        "eight_better": f"{extended['better']} of {extended['machines']}",
        "eight_behind": " and ".join(behind),
        "eight_worse": f"{len(extended['worse'])} of {extended['machines']}",
        "found": table(("trained on", "figure", "bar", "reached", "holds"), rows),
        "play": f"{1e3 * max(play['moves'].values()):.1f}",
        "size": f"{1e3 * play['size']:.0f}",
        "causes": ", ".join(f"`{name}`" for name in document["hidden"]["bench-5903"]["joints"]["servo"]["causes"]),
        "way": f"{_closed(document['errors']['leg-5901'], 'extended'):.0%}",
        "others": f"{min(learnt):.1f} to {max(learnt):.1f}",
    }


def _eight(errors: Mapping[str, Mapping[str, list[float]]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and rows of a table of errors on the machine by treatment [mrad]."""
    names = ("nominal", "hand-made randomisation", "extended", "limit")
    rows = [(machine, *(f"{1e3 * np.mean(own[name]):.1f}" for name in names)) for machine, own in errors.items()]
    return ("machine", *names), rows


def _closed(errors: Mapping[str, list[float]], treatment: str) -> float:
    """Share of the way from nominal to limit that a treatment goes on a machine."""
    nominal, limit, own = (float(np.mean(errors[name])) for name in ("nominal", "limit", treatment))
    return (nominal - own) / (nominal - limit)


FIGURES: Mapping[str, Callable[[], Mapping[str, Any]]] = {
    "confidence": confidence,
    "diagnosis": diagnosis,
    "how-fast": how_fast,
    "index": front,
    "papers": papers,
    "policies": policies,
    "safety": safety,
    "transfer": transfer,
}
"""What each page works out itself."""


def main() -> None:
    """Write all of them."""
    for name in pages():
        write(name, page(name))


if __name__ == "__main__":
    main()
