"""The thresholds of the search in one place, each with its meaning.

Losses are per judged value and relative to that of the noise (:mod:`sealegs.gap.replay.comparison`): a right model has
about one. ``python -m benchmarks.sensitivity`` shows what each threshold does when it is halved or doubled.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..checks.recording import DRIVE_LOOP_PERIOD
from ..checks.signal import AT_LIMIT

EFFORT, COLUMNS, ROBOT, TOLD = (
    "What bounds the effort",
    "Which columns count",
    "What joints of a robot share",
    "What is reported beside a cause",
)
"""Headings of the settings that cannot be varied on a recorded search."""


def threshold(value: float, meaning: str, *, decides: bool = False, neutral: float = 0.0, about: str = EFFORT) -> Any:
    """A setting.

    Args:
        value: default.
        meaning: one sentence, with the unit.
        decides: whether it decides what is named, given what was fitted.
        neutral: value from which halving and doubling count: one for a share that must be near one, and for a factor.
        about: heading under which it is listed, if it does not decide.
    """
    return field(default=value, metadata={"meaning": meaning, "decides": decides, "neutral": neutral, "about": about})


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Thresholds of screen, fits and forward selection."""

    # --- effort: what is fitted, and how well
    screened: int = threshold(10, "Causes that the screen keeps for a rough fit.")
    screened_variants: int = threshold(3, "Variants of one cause that the screen keeps.")
    finalists: int = threshold(5, "Causes that are fitted to convergence, the lowest rough cost first.")
    sure_finalists: int = threshold(2, "Of the finalists, those that are fitted whatever their rough cost.")
    foreseen: int = threshold(
        1, "Variants that the screen puts first and that are fitted to convergence, whatever their rough cost."
    )
    finalist_cost: float = threshold(
        2.0, "Rough cost, relative to the least one, up to which a further cause is a finalist."
    )
    hopeless_cost: float = threshold(
        1.5, "Cost after one iteration, relative to the least one, from which the rough fit of an effect is abandoned."
    )
    hopeless_gain: float = threshold(
        0.5,
        "Share of the best finalist's gain, by the fit to the sketch, below which one is not fitted to the parts, "
        "if that gain is above `weak`. There all rivals of the recorded searches reached 0.97. Above `open_excess` the "
        "same share of `least_gain`, or of `least_open_gain`, is asked for.",
    )
    outrun_cost: float = threshold(
        1.15, "Rough cost, relative to its cause's best variant, from which a variant is not fitted to convergence."
    )
    far: float = threshold(
        1000.0,
        "Excess loss from which the screen predicts nothing, so that every cause gets an iteration of a rough fit.",
    )
    sketched: float = threshold(
        30.0,
        "Length [s] of the data that screen and rough fits see of logs of twice that or more: two thirds of it spread "
        "evenly, the rest where the model is most wrong; finalists are fitted to all.",
    )
    rough_iterations: int = threshold(3, "Iterations of a rough fit.")
    shape_edge: float = threshold(
        0.98, "Share of the upper bound of a shape parameter from which the simpler law of its cause is tried."
    )
    speed_quantile: float = threshold(
        0.99,
        "Quantile of the simulated speeds that counts as the highest: a characteristic speed above it is at its edge.",
    )
    least_periods: float = threshold(
        0.5, "Periods of what repeats over the angle that a joint must visit; with less the simpler law is meant."
    )
    screen_outlier: float = threshold(
        5.0, "Rms errors at which the screen clips an error: larger ones say nothing about small changes."
    )
    screen_far: float = threshold(
        20.0, "Clip levels at which the screen clips a change: larger ones are those of a replay that diverges."
    )
    screen_tuned_reach: float = threshold(15.0, "Largest move of a tuned number in the screen, in units of its scale.")
    screen_least_size: float = threshold(-2.0, "Least size of a variant in the screen, relative to the one simulated.")
    screen_most_size: float = threshold(4.0, "Largest size of a variant in the screen, relative to the one simulated.")
    window_error: float = threshold(
        20.0, "Rms error of the refitted model, in noise floors, from which a free replay restarts every second."
    )
    refitted_by: float = threshold(
        4.0, "Relative change that refitting alone may make to a number: up to five times, down to a fifth."
    )
    iterations: int = threshold(25, "Iterations of a fit to convergence, at most.")
    sketched_iterations: int = threshold(
        6, "The same to data of a log that is sketched, where the fit starts near the optimum."
    )
    coarse_step: float = threshold(
        4.0,
        "Largest factor on the steps of play and switching firmware during the search. It is halved as long as a "
        "replay with play changes by more than a tenth of the noise as its steps are halved.",
    )
    most_causes: int = threshold(6, "Causes after which the search ends.")
    least_temperature_range: float = threshold(
        1.0, "Change of the temperature [K] from which a thermal cause can show."
    )

    # --- when to look for another cause
    least_excess: float = threshold(
        0.04, "Excess loss over the noise from which another cause is looked for.", decides=True
    )
    weak: float = threshold(
        0.3,
        "Loss below which an excess, or what a cause removes of it, is weak. A weak excess must meet `least_promise`, "
        "a weak cause needs further evidence.",
        decides=True,
    )
    least_promise: float = threshold(
        0.015, "Loss that the screen must predict to be removed for a weak excess to be searched.", decides=True
    )

    # --- whether the best candidate pays
    least_gain: float = threshold(0.08, "Share of the excess loss that a cause must remove.", decides=True)
    least_open_gain: float = threshold(
        0.3,
        "The same for a further cause that leaves more than `open_excess`: with less it is a guess. Causes that the "
        "fastest run named are held against `least_gain`.",
        decides=True,
    )
    least_removed: float = threshold(
        0.04, "Loss that a cause must remove; encoder ticks and time steps can imitate smaller gains.", decides=True
    )
    least_certainty: float = threshold(
        0.975, "Share of bootstrap draws in which a cause must lower the loss.", decides=True, neutral=1.0
    )
    least_certainty_agreeing: float = threshold(
        0.9, "The same for a strong cause, which is above all three of the next values.", decides=True, neutral=1.0
    )
    strong_win_rate: float = threshold(0.95, "Bootstrap win rate of a strong cause.", decides=True, neutral=1.0)
    strong_gain: float = threshold(0.5, "Share of the excess loss that a strong cause removes.", decides=True)
    close_agreement: float = threshold(
        0.75,
        "Agreement of a strong cause between the two parts of the data, as for `least_agreement`.",
        decides=True,
        neutral=1.0,
    )
    near_certainty: float = threshold(
        0.8,
        "Share of the draws in which a near miss must lower the loss. It is reported beside the verdict, not named.",
    )
    least_agreement: float = threshold(
        0.4,
        "Least ratio, smaller to larger, of the two distances of a parameter from the value without effect, one fitted "
        "on each part of the data.",
        decides=True,
    )
    open_excess: float = threshold(
        3.0,
        "Excess loss at the end of a search from which causes are sought beside refitted numbers whatever these do. In "
        "a round it is that from which finalists that cannot pay are passed over.",
    )
    clearly_less: float = threshold(
        0.9, "Loss of refitted numbers beside causes, relative to that of the causes, below which they are sought so."
    )
    least_change: float = threshold(
        0.01,
        "Relative change of a number below which it is no finding: no number is known better. Of what is nothing in "
        "the nominal model, in parts of a typical change.",
        decides=True,
    )
    most_contradicted: float = threshold(
        2e-3, "Share of samples that may contradict a cause, as duties above a fitted limit do.", decides=True
    )
    least_win_rate: float = threshold(
        0.5,
        "Minimum bootstrap win rate for a weak or an additional cause; below it the cause is ambiguous.",
        decides=True,
    )
    shared_win_gain: float = threshold(
        1.0,
        "Share of what is left that an additional cause must remove to be named, with its rivals, where none of them "
        "wins most draws alone, and together they do. 1: never; a search that ends on such a tie goes on with 0.2, or "
        "with `least_open_gain` where that holds.",
        decides=True,
    )
    least_sampled: float = threshold(
        0.01, "Loss that a weak cause must remove from what is judged sample by sample.", decides=True
    )
    least_removed_by_columns: float = threshold(
        0.12,
        "Alternative to `least_sampled`: loss that a weak cause must remove in all, duty and current included.",
        decides=True,
    )
    least_fall: float = threshold(
        0.4,
        "Share of what a weak cause removes by which the excess must fall: errors that neighbours do not share are no "
        "effect. Causes that are there reached 0.66 and more, a spring that followed encoder ticks 0.2.",
        decides=True,
    )

    # --- which candidate is the best
    draws: int = threshold(2000, "Draws of the block bootstrap.")
    rival_win_rate: float = threshold(
        0.05, "Bootstrap win rate from which another candidate is a rival of the winner.", decides=True
    )
    shared_error: float = threshold(
        0.02,
        "Relative error of a candidate's loss, or of that of the noise if it is larger, that all data share, as from "
        "time steps and encoder ticks. No resampling shows it, so candidates closer than this are not told apart.",
        decides=True,
    )
    parameter_charge: float = threshold(
        0.02,
        "Share of the loss that each further parameter of a candidate must remove. Compared with a wrong number, a "
        "missing effect counts as one parameter more.",
        decides=True,
    )
    form_charge: float = threshold(
        1.4,
        "Factor by which a cause's other form must lower the loss below that of its usual form.",
        decides=True,
        neutral=1.0,
    )

    # --- which columns count beside the position
    column_logged: float = threshold(
        0.5, "Least share of samples that a column must have to be considered.", about=COLUMNS
    )
    column_agreement: float = threshold(
        0.8, "Least correlation of a column with what the tuned model predicts.", about=COLUMNS
    )
    column_least_slope: float = threshold(
        0.5, "Least ratio of measured to predicted size: below it the column has another unit.", about=COLUMNS
    )
    column_most_slope: float = threshold(2.0, "Largest ratio of measured to predicted size.", about=COLUMNS)
    column_groups: int = threshold(
        50, "Least number of groups of samples for which a column can be judged.", about=COLUMNS
    )
    column_calibration: float = threshold(
        0.02, "Calibration error of a column, as a share of its rms; its noise is never taken as less.", about=COLUMNS
    )
    column_lag: float = threshold(
        DRIVE_LOOP_PERIOD,
        "Time [s] by which a column may be later than the stamp of its row: a period of a drive's loop, assumed.",
        about=COLUMNS,
    )
    column_trim: float = threshold(
        0.98, "Quantile of a column's second differences beyond which they do not count as noise.", about=COLUMNS
    )
    column_fast: float = threshold(
        0.75, "Quantile of a column's changes from which its timing error is estimated.", about=COLUMNS
    )

    # --- what joints of a robot share
    shared_joints: int = threshold(2, "Least number of joints that share a cause of the whole robot.", about=ROBOT)
    shared_gain: float = threshold(
        0.1, "Share of its own loss that a joint must lose by a cause to share it.", about=ROBOT
    )
    light_body: float = threshold(
        0.02,
        "Share of the robot's moving mass below which a body's own mass and centre of mass are not considered.",
        about=ROBOT,
    )

    # --- what is told beside a cause
    verdict_draws: int = threshold(1000, "Draws of the bootstrap over the test part.", about=TOLD)
    place_error: float = threshold(
        0.5, "Share of the squared error that a place, or a few moments, must hold to be reported.", about=TOLD
    )
    place_lift: float = threshold(2.0, "The same share, relative to the place's share of the time.", about=TOLD)
    few_moments: float = threshold(0.05, "Largest share of a log's windows that counts as a few moments.", about=TOLD)
    at_duty_limit: float = threshold(
        AT_LIMIT, "Share of the largest duty from which a duty is at its limit.", about=TOLD
    )
    at_rest_speed: float = threshold(
        0.02, "Share of the highest speeds (99 % quantile) below which a joint is at rest.", about=TOLD
    )
    goal_knots: float = threshold(
        0.35,
        "Relative difference, between the delay that was added and half the time between two goals, below which the "
        "goals may have been interpolated.",
        about=TOLD,
    )
    further: float = threshold(
        0.02,
        "Share of the fitted range by which the test part must exceed it to be reported; less is chance.",
        about=TOLD,
    )
    worse_there: float = threshold(
        2.0,
        "Error there, relative to that of all other pieces, from which it is reported; less is scatter.",
        about=TOLD,
    )

    @classmethod
    def meanings(cls) -> dict[str, str]:
        """Meaning of each setting, by its name."""
        return {item.name: item.metadata["meaning"] for item in fields(cls)}

    @classmethod
    def from_one(cls) -> tuple[str, ...]:
        """Names of the settings whose distance from one counts."""
        return tuple(item.name for item in fields(cls) if item.metadata["neutral"] == 1.0)

    def scaled(self, name: str, factor: float) -> SearchSettings:
        """With the distance of one setting from what is neutral multiplied."""
        neutral = next(item.metadata["neutral"] for item in fields(self) if item.name == name)
        return replace(self, **{name: neutral + (getattr(self, name) - neutral) * factor})

    @classmethod
    def deciding(cls) -> tuple[str, ...]:
        """Names of the settings that decide what is named, given what was fitted."""
        return tuple(item.name for item in fields(cls) if item.metadata["decides"])


DEFAULT = SearchSettings()
"""The settings with which the hidden benches were measured (docs/results/diagnosis.md)."""
