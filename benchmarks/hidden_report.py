"""The hidden bench's cases as a table, and what was named for what was hidden."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest
from sealegs.common.markdown import page, table

from benchmarks.hidden import SURE, all_names, bounded, coverage, outcome, within_tolerance
from benchmarks.kept import write

OUTCOMES = ("right", "rival", "not identifiable", "nothing", "unsure", "wrong")
AT_THE_NOISE = 1.2
"""Noise floors up to which the extended model is wanted on unseen data."""
SLOW = 120.0
"""Seconds up to which a diagnosis is wanted."""
MEANING = {
    "right": "right name first",
    "rival": "right name among rivals that are reported as inseparable",
    "not identifiable": "not identifiable",
    "nothing": "nothing to explain",
    "unsure": f"wrong name, confidence below {SURE:g}",
    "wrong": f"wrong name, confidence {SURE:g} or more",
}


def write_bench(rows: Sequence[dict[str, Any]], path: Path) -> str:
    """Write ``<path>.json`` and ``.md``.

    Returns:
        The summary as markdown.
    """
    rows = sorted(rows, key=lambda row: row["key"])
    cases = [{key: value for key, value in row.items() if key != "record"} for row in rows]
    text = page("The finder against the hidden bench", summary(rows), "## Cases", in_lines(rows))
    write(path, text, {"confusion": confusion(rows), "cases": cases})
    return summary(rows)


def kind(row: dict[str, Any]) -> str:
    """``null``, ``pair``, ``stranger``, or the magnitude of a single effect."""
    if not row["effects"]:
        return "null"
    if len(row["effects"]) > 1:
        return "pair"
    ((name, effect),) = row["effects"].items()
    return "stranger" if name.startswith("stranger") else str(effect["magnitude"])


def magnitude(row: dict[str, Any]) -> str:
    """``clear``, ``moderate`` or ``faint``, of the first effect."""
    return str(next(iter(row["effects"].values()))["magnitude"])


def flagged(row: dict[str, Any]) -> bool:
    """Whether the verdict says that something stays unexplained, and no known cause is named with confidence."""
    structure = row.get("structure") or {"noticed": False}
    silent = row["verdict"] in ("explained", "nothing to explain")
    return bool(structure["noticed"]) and not silent and not confident(row)


def confident(row: dict[str, Any]) -> bool:
    """Whether any physical cause is named with confidence."""
    return bool(sure(row))


def named(row: dict[str, Any]) -> list[str]:
    """Names of physical causes, errors of the log apart."""
    return [cause["name"] for cause in row["causes"] if cause["kind"] != "data"]


def sure(row: dict[str, Any]) -> list[str]:
    """Physical causes that are named with confidence, at whatever rank and with whatever verdict."""
    return [cause["name"] for cause in row["causes"] if cause["kind"] != "data" and cause["confidence"] >= SURE]


def unwanted(row: dict[str, Any]) -> list[str]:
    """Those of them that are not hidden."""
    return [name for name in sure(row) if name not in row["effects"]]


def share(count: int, of: int) -> str:
    """``56 of 60 (93 %; 84 to 97 %)``: with Wilson's interval of 95 % for so few cases."""
    inside = binomtest(count, of).proportion_ci(0.95, method="wilson")
    return f"{count} of {of} ({100 * count / of:.0f} %; {100 * inside.low:.0f} to {100 * inside.high:.0f} %)"


def counts(rows: Sequence[dict[str, Any]]) -> dict[str, tuple[int, int]]:
    """What the bars are set for, each as how many of how many; what has no case is left out.

    ``plain`` are clear and moderate effects, ``real`` those of them that are beyond the tolerance of a number.
    """
    alone = [row for row in rows if kind(row) in ("clear", "moderate", "faint")]
    plain = [row for row in alone if kind(row) != "faint"]
    faint = [row for row in alone if kind(row) == "faint"]
    real = [row for row in plain if not within_tolerance(row)]
    nulls, pairs, strangers = ([row for row in rows if kind(row) == name] for name in ("null", "pair", "stranger"))
    visible = [row for row in strangers if magnitude(row) != "faint"]
    both = [row for row in pairs if set(row["effects"]) <= set(named(row))]
    honest = sum(outcome(row) in ("right", "not identifiable") for row in faint)
    told = [bounded(row) for row in faint if outcome(row) == "nothing"]
    covered = [c[0] for row in plain if outcome(row) == "right" and (c := coverage(row))]
    over = [gap["extended"] / gap["noise_floor"] for row in rows if kind(row) == "clear" and (gap := row["gap"])]

    def first(of: Sequence[dict[str, Any]]) -> tuple[int, int]:
        return sum(bool(set(row["effects"]) & set(named(row)[:1])) for row in of), len(of)

    found = {
        "plain, first": first(plain),
        "real, first": first(real),
        "plain, trusted": (sum(outcome(row) == "right" for row in plain), len(plain)),
        "plain, false": (sum(bool(unwanted(row)) for row in plain), len(plain)),
        "faint, honest": (honest, len(faint)),
        "faint, bounded": (honest + told.count(True), len(faint)),
        "faint, false": (sum(bool(unwanted(row)) for row in faint), len(faint)),
        "nulls, false": (sum(bool(named(row)) for row in nulls), len(nulls)),
        "nulls, quiet": (sum(row["verdict"] == "nothing to explain" for row in nulls), len(nulls)),
        "pairs, named": (len(both), len(pairs)),
        "pairs, trusted": (sum(row["verdict"] in ("explained", "partly explained") for row in both), len(pairs)),
        "pairs, false": (sum(bool(unwanted(row)) for row in pairs), len(pairs)),
        "strangers, flagged": (sum(map(flagged, strangers)), len(strangers)),
        "visible strangers, flagged": (sum(map(flagged, visible)), len(visible)),
        "covered": (sum(covered), len(covered)),
        "clear, at the noise": (sum(value <= AT_THE_NOISE for value in over), len(over)),
        "slow": (sum(row["seconds"] > SLOW for row in rows), len(rows)),
    }
    return {name: value for name, value in found.items() if value[1]}


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """How often which outcome, as markdown."""
    by_size = {size: [row for row in rows if kind(row) == size] for size in ("clear", "moderate", "faint")}
    worth = {size: Counter(outcome(row) for row in mine) for size, mine in by_size.items() if mine}
    cells = ((size, count.total(), *(count[o] for o in OUTCOMES)) for size, count in worth.items())
    lines = [table(("hidden", "cases", *(MEANING[o] for o in OUTCOMES)), cells), ""]
    found = counts(rows)
    if hollow := [row for row in rows if kind(row) in ("clear", "moderate", "faint") and within_tolerance(row)]:
        keys = ", ".join(f"{row['key']} ({outcome(row)})" for row in hollow)
        lines.append(
            f"- {len(hollow)} of these hide only that numbers of the nominal model are wrong by no more than any may "
            f"be, as in a null. They count as missed all the same, where they are: {keys}"
        )
    alone = [row for row in rows if kind(row) in ("clear", "moderate", "faint")]
    if absorbed := [row for row in alone if outcome(row) == "nothing"]:
        lines.append(
            f"- where there was nothing to explain ({len(absorbed)}), the nominal model, its numbers tuned within "
            f"their tolerance, is at most {most_absorbed(rows):.2f} noise floors from data that nothing was fitted to"
        )
    if "plain, first" in found:
        lines.append(
            f"- clear and moderate, right name first, with or without a rival: {share(*found['plain, first'])}; "
            f"without those within the tolerance of a number {share(*found['real, first'])}; "
            f"with a verdict that trusts it {share(*found['plain, trusted'])}"
        )
    if faint := [row for row in alone if kind(row) == "faint"]:
        low = sum(bounded(row) is False for row in faint if outcome(row) == "nothing")
        lines.append(
            f"- faint, right or 'not identifiable': {share(*found['faint, honest'])}; with 'nothing to explain' where "
            f"the bound that is told holds: {share(*found['faint, bounded'])} (told, and too low: {low}); a cause that "
            f"is not hidden named with confidence {SURE:g} or more: {share(*found['faint, false'])}"
        )
    if false := [row for row in alone if kind(row) != "faint" and unwanted(row)]:
        keys = ", ".join(f"{row['key']} ({', '.join(unwanted(row))})" for row in false)
        lines.append(
            f"- clear and moderate, a cause that is not hidden named with confidence {SURE:g} or more, most of them "
            f"beside the right one: {share(*found['plain, false'])}: {keys}"
        )
    if "nulls, false" in found:
        lines.append(
            f"- nulls with a false cause: {share(*found['nulls, false'])}, verdict 'nothing to explain' "
            f"{found['nulls, quiet'][0]}"
        )
    if "pairs, named" in found:
        lines.append(
            f"- pairs, both named: {share(*found['pairs, named'])}, of them with a verdict that trusts both: "
            f"{found['pairs, trusted'][0]}"
        )
    if strangers := [row for row in rows if kind(row) == "stranger"]:
        inside, of = found.get("visible strangers, flagged", (0, 0))
        lines.append(
            f"- strangers flagged as unexplained: {share(*found['strangers, flagged'])}; of them {inside} of the {of} "
            f"clear and moderate ones; a known cause named with confidence {SURE:g} or more: "
            f"{sum(confident(row) for row in strangers)}"
        )
    if "covered" in found:
        covered = [c[1] for row in rows if kind(row) in ("clear", "moderate") and outcome(row) == "right"
                   and (c := coverage(row))]  # fmt: skip
        lines.append(
            f"- parameters of right causes, clear and moderate: interval covers the truth in "
            f"{share(*found['covered'])}, median error {100 * np.median(covered):.1f} %"
        )
    if single := [row for row in rows if kind(row) == "clear" and row["gap"]]:
        over = {row["key"]: row["gap"]["extended"] / row["gap"]["noise_floor"] for row in single}
        worst = max(over, key=lambda key: over[key])
        real = [row["gap"]["extended"] / row["true_noise"] for row in single if "true_noise" in row]
        true = (
            f"; over the noise that was put in: median {np.median(real):.2f}, largest {max(real):.2f}" if real else ""
        )
        lines.append(
            f"- extended model on unseen data over the noise floor, all clear effects: largest {over[worst]:.2f} "
            f"({worst}), median {np.median(list(over.values())):.2f}{true}"
        )
    seconds = np.array([row["seconds"] for row in rows])
    lines.append(
        f"- time per diagnosis of three 24 s runs on one core: median {np.median(seconds):.0f} s, largest "
        f"{seconds.max():.0f} s, above {SLOW:g} s {found['slow'][0]} of {len(seconds)}"
    )
    if revisions := sorted({row["revision"] for row in rows if "revision" in row}):
        lines.append(f"- revision of gap, actuators and the plant: {', '.join(revisions)}")
    return "\n".join(lines)


def most_absorbed(rows: Sequence[dict[str, Any]]) -> float:
    """Noise floors from unseen data, at most, of the nominal model where there was nothing to explain."""
    absorbed = [row for row in rows if kind(row) in ("clear", "moderate", "faint") and outcome(row) == "nothing"]
    return max(row["gap"]["extended"] / row["gap"]["noise_floor"] for row in absorbed)


def in_lines(rows: Sequence[dict[str, Any]]) -> str:
    """Every case in a line, as markdown."""
    heads = ("hidden", "outcome", "verdict", "named (confidence)", "error / noise: nominal, extended", "structure left")
    cells = []
    for row in rows:
        size = kind(row)
        result = outcome(row) if size in ("clear", "moderate", "faint") else "-"
        causes = ", ".join(f"{c['name']} ({c['confidence']:.2f})" for c in row["causes"]) or "-"
        gap = row["gap"]
        errors = (
            f"{gap['nominal'] / gap['noise_floor']:.1f}, {gap['extended'] / gap['noise_floor']:.2f}" if gap else "-"
        )
        rest: dict[str, Any] = row.get("structure") or {"noticed": False}
        said = "-" if not rest["noticed"] else f"{rest['level']:.2f}: {', '.join(rest['depends_on']) or 'no signal'}"
        cells.append((row["key"], result, row["verdict"], causes, errors, said))
    return table(heads, cells)


def confusion(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """How often which name came first, by what was hidden."""
    counts = {name: Counter[str]() for name in (*all_names(), "null")}
    for row in rows:
        if len(row["effects"]) <= 1:
            undecided = "nothing" if row["verdict"] == "nothing to explain" else "not identifiable"
            first = named(row)[:1] if row["verdict"] != "not identifiable" else []
            counts[next(iter(row["effects"]), "null")][first[0] if first else undecided] += 1
    return {hidden: dict(found) for hidden, found in counts.items() if found}
