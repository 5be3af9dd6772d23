"""A diagnosis over time: all runs one behind the other, with the pieces that were only for the test marked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from ...log.parts import TEST
from ...measure.named import NamedCause
from ...measure.signatures import SIGNATURE_LIMITS, Signature
from ...verdict.verdict import JointDiagnosis
from ..numbers import LAYOUT
from .evidence import Evidence
from .style import BOTH, EXTENDED, MEASURED, NOMINAL, figure, legend_above, styled

MODELS = ("nominal", "refitted", "extended")


@dataclass(frozen=True, eq=False)
class Timeline:
    """Signals over time (n,), with NaN where one piece ends and the next begins.

    Attributes:
        x: time [s], runs one behind the other.
        goal: command, None in a log without.
        measured: what was logged.
        models: simulated signal by model name, as far as there is one.
        tested: spans of the test part in ``x``.
        quantity, unit: of the signal.
    """

    x: np.ndarray
    goal: np.ndarray | None
    measured: np.ndarray
    models: dict[str, np.ndarray]
    tested: list[tuple[float, float]]
    quantity: str
    unit: str

    def thinned(self, most: int) -> Timeline:
        """About ``most`` samples that keep every peak of the measured signal and of the nominal error."""
        n = len(self.x)
        if n <= most:
            return self
        size = int(np.ceil(5 * n / most))
        error = np.abs(self.models.get("nominal", self.measured) - self.measured)
        keep = []
        for a in range(0, n, size):
            part, wrong = self.measured[a : a + size], error[a : a + size]
            good = np.flatnonzero(np.isfinite(part))
            keep += [a, *(a + np.flatnonzero(~np.isfinite(part))[:1])]
            if len(good):
                keep += [a + good[k] for k in (part[good].argmin(), part[good].argmax(), wrong[good].argmax(), -1)]
        at = np.unique(keep)
        goal = None if self.goal is None else self.goal[at]
        models = {name: values[at] for name, values in self.models.items()}
        return replace(self, x=self.x[at], goal=goal, measured=self.measured[at], models=models)


def timeline(diagnosis: JointDiagnosis) -> Timeline | None:
    """Signals of a diagnosis over time; None where nothing was replayed."""
    problem, simulated = diagnosis.problem, diagnosis.simulated
    if problem is None:
        return None
    rows, x, tested = [], [], []
    offset, end, last = 0.0, 0.0, -1
    for k, unit in enumerate(problem.units):
        at = np.arange(problem.starts[k], problem.starts[k + 1])
        at = at[problem.judged[at]]
        if not len(at):
            continue
        if unit.run != last:
            offset = end + (LAYOUT.pause if last >= 0 else 0.0) - problem.time[at[0]]
            last = unit.run
        time = offset + problem.time[at]
        end = float(time[-1])
        if unit.part == TEST:
            tested.append((float(time[0]), end))
        rows += [at, [-1]]
        x += [time, [end]]
    index = np.concatenate(rows).astype(int) if rows else np.zeros(0, int)

    def cut(values: np.ndarray) -> np.ndarray:
        return np.append(values, np.nan)[index]

    models = {name: cut(simulated[name][:, 0]) for name in MODELS if name in simulated}
    measured = cut(problem.measured[:, 0])
    joint = problem.joint if problem.signal[0] == "position" else None
    goal = None if joint is None or joint.models[0].command != "goal" else cut(joint.goal)  # no position
    quantity = diagnosis.signal.rpartition(".")[2]
    return Timeline(np.concatenate(x), goal, measured, models, tested, quantity, diagnosis.unit)


def worst_window(line: Timeline, width: float) -> tuple[float, float]:
    """Span of the test part, at most ``width`` seconds long, where the nominal model is most wrong."""
    error = line.models.get("nominal", line.measured) - line.measured
    total = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(error), error**2, 0.0))])
    best, window = -1.0, (float(line.x[0]), float(line.x[0]) + width)
    for start, stop in line.tested or [(float(line.x[0]), float(line.x[-1]))]:
        first = np.flatnonzero((line.x >= start) & (line.x <= max(start, stop - width)))
        last = np.searchsorted(line.x, np.minimum(line.x[first] + width, stop), side="right")
        sums = total[last] - total[first]
        if len(first) and sums.max() > best:
            best, begin = float(sums.max()), float(line.x[first[sums.argmax()]])
            window = (begin, min(begin + width, stop))
    return window


# --- pictures of errors: of a walk, as measured and as simulated, and of the features that a cause must mend ---------

WORDS = {
    "x": "way of the base along x",
    "y": "way of the base along y",
    "z": "height of the base",
    "roll": "roll of the base",
    "pitch": "pitch of the base",
    "yaw": "yaw of the base",
}
ANGLES = ("roll", "pitch", "yaw")
FACTOR, UNITS = 1e3, {"m": "mm", "rad": "mrad"}


@styled
def stance(evidence: Evidence, cause: NamedCause) -> Figure:
    """The piece of the test part where the nominal model is most wrong, and the errors of all pieces of it."""
    diagnosis, problem = evidence.diagnosis, evidence.diagnosis.problem
    if problem is None:
        raise ValueError("a diagnosis without a replay has no stance to draw")
    names, told = list(problem.channels), problem.signal[0]
    shown = cause.against if cause.against in names else told
    if not np.isfinite(problem.measured[:, names.index(shown)]).any():
        shown = told
    column, factor = names.index(shown), FACTOR
    unit = UNITS["rad" if shown.endswith(ANGLES) else "m"]
    errors = {model: problem.errors(diagnosis.simulated[model])[:, column] for model in ("nominal", "extended")}
    units = [k for k, one in enumerate(problem.units) if one.part == TEST] or list(range(len(problem.units)))
    rows = [np.arange(problem.starts[k], problem.starts[k + 1]) for k in units]
    rows = [row[problem.judged[row]] for row in rows]
    worst = max(rows, key=lambda row: float(np.nanmean(errors["nominal"][row] ** 2)))
    chart = figure(5.8, 5.8)
    one, all_ = chart.subplots(2, 1)
    zero = problem.measured[worst[0], column] if shown.rpartition(".")[2] in ("x", "y", "yaw") else 0.0
    time = 1e3 * (problem.time[worst] - problem.time[worst[0]])
    for model, colour in BOTH:
        path = problem.measured[worst, column] + errors[model][worst] - zero
        one.plot(time, factor * path, color=colour, label=f"{model} model")
    one.plot(time, factor * (problem.measured[worst, column] - zero), ".", color=MEASURED, ms=4, label="measured")
    one.set_ylabel(f"{WORDS.get(shown.rpartition('.')[2], shown)} [{unit}]")
    legend_above(one)
    for model, colour in BOTH:
        for k, row in enumerate(rows):
            at = 1e3 * (problem.time[row] - problem.time[row[0]])
            label = f"{model} model, every piece" if k == 0 else None
            all_.plot(at, -factor * errors[model][row], color=colour, lw=0.7, alpha=0.6, label=label)
    all_.axhline(0.0, color=MEASURED, lw=0.9)
    all_.set_ylabel(f"measured minus model [{unit}]")
    all_.set_xlabel("time in the piece [ms]")
    legend_above(all_, 2)
    return chart


def signature_pictures(diagnosis: JointDiagnosis) -> Iterator[tuple[str, Figure]]:
    """One picture per cause that has features, by the cause's name and ``.signature``."""
    for cause in diagnosis.causes:
        if cause.signatures:
            yield f"{cause.name}.signature", features(cause)


@styled
def features(cause: NamedCause) -> Figure:
    """How far each feature of the models is from what was measured; a cause that is right brings it to zero."""
    seen = cause.signatures
    chart = figure(6.4, 1.1 + 0.75 * len(seen))
    for axes, signature in zip(np.atleast_1d(chart.subplots(len(seen), 1)), seen, strict=True):
        rows = ((1.0, signature.nominal, signature.nominal_error, NOMINAL, "nominal model, tuned"),
                (0.0, signature.extended, signature.extended_error, EXTENDED, f"with {cause.name}"))  # fmt: skip
        for height, value, error, colour, label in rows:
            axes.errorbar(
                1e3 * value,
                height,
                xerr=1e3 * SIGNATURE_LIMITS.sure * error,
                fmt="o",
                color=colour,
                label=label,
                capsize=3,
                lw=1.4,
            )
        axes.axvline(0.0, color="0.4", lw=0.8)
        axes.set_ylim(-0.6, 1.6)
        axes.set_yticks([])
        axes.set_title(f"{signature.name}: {signature.verdict}", fontsize=9, loc="left")
        axes.set_xlabel(f"measured minus model [m{signature.unit}]", fontsize=8)
    chart.axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8, frameon=False)
    return chart


def told(seen: Signature) -> str:
    """A feature in words."""
    unit = f"m{seen.unit}"
    return f"{seen.name}: {1e3 * seen.nominal:+.2g} to {1e3 * seen.extended:+.2g} {unit} off ({seen.verdict})"
