"""The thresholds of the search in one place, each with what it means.

Losses are per judged value and in parts of that of the noise (:mod:`sealegs.gap.replay.robust`): a right model has
about one. ``python -m benchmarks.sensitivity`` shows what each threshold does when it is halved or doubled.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

EFFORT, COLUMNS, ROBOT, TORQUE, TOLD = (
    "What bounds the effort",
    "Which columns count",
    "What joints of a robot share",
    "Logs of torque alone",
    "What is told beside a cause",
)
"""What a setting is about that a record does not decide again."""


def threshold(value: float, meaning: str, *, decides: bool = False, neutral: float = 0.0, about: str = EFFORT) -> Any:
    """A setting.

    Args:
        value: its default.
        meaning: of it, with its unit.
        decides: whether it decides what is named, given what was fitted.
        neutral: from where its distance counts: one for a share that must be near one, and for a factor.
        about: what it is about, where it does not decide.
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
    finalist_cost: float = threshold(
        2.0, "Rough cost, in parts of the least one, up to which a further cause is a finalist."
    )
    hopeless_cost: float = threshold(
        1.5, "Cost after one iteration, in parts of the least one, from which the rough fit of an effect is given up."
    )
    outrun_cost: float = threshold(
        1.15, "Rough cost, in parts of its cause's best variant, from which a variant is not fitted to convergence."
    )
    far: float = threshold(
        1000.0, "Excess loss from which the screen foresees nothing: every cause gets an iteration of a rough fit."
    )
    rough_iterations: int = threshold(3, "Iterations of a rough fit.")
    shape_edge: float = threshold(
        0.98, "Share of the upper bound of a shape parameter from which the simpler law of its cause is tried."
    )
    speed_quantile: float = threshold(
        0.99,
        "Quantile of the simulated speeds that counts as the highest: a characteristic speed above it is at its edge.",
    )
    screen_outlier: float = threshold(
        5.0, "Rms errors beyond which an error says nothing about small changes, and is clipped by the screen."
    )
    screen_far: float = threshold(
        20.0, "Clipped errors beyond which a change is no small one: a replay that runs elsewhere."
    )
    screen_tuned_reach: float = threshold(15.0, "Most that a tuned number moves in the screen, in units of its scale.")
    screen_least_size: float = threshold(-2.0, "Least size of a variant in the screen, in parts of the one tried.")
    screen_most_size: float = threshold(4.0, "Largest size of a variant in the screen, in parts of the one tried.")
    window_error: float = threshold(
        20.0, "Noise floors of rms error that refitting leaves, from which a free replay begins anew every second."
    )
    refitted_by: float = threshold(
        4.0, "How far refitting alone may turn each number that the model has: to five times, down to a fifth."
    )
    iterations: int = threshold(25, "Iterations of a fit to convergence, at most.")
    coarse_step: float = threshold(
        2.0, "Factor on the largest step of play and of switching firmware while causes are sought."
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
        "Loss below which an excess, or what a cause removes of it, is weak: a weak excess needs a promise, and a "
        "weak cause further evidence.",
        decides=True,
    )
    least_promise: float = threshold(
        0.015, "Loss that the screen must promise to remove where the excess is weak.", decides=True
    )

    # --- whether the best candidate pays
    least_gain: float = threshold(0.08, "Share of the excess loss that a cause must remove.", decides=True)
    least_removed: float = threshold(
        0.04, "Loss that a cause must remove: ripple of ticks and of steps can do less.", decides=True
    )
    least_certainty: float = threshold(
        0.975, "Share of bootstrap draws in which a cause must lower the loss at all.", decides=True, neutral=1.0
    )
    least_certainty_agreeing: float = threshold(
        0.9, "The same, for a cause that is strong in every other respect.", decides=True, neutral=1.0
    )
    strong_win_rate: float = threshold(0.95, "Bootstrap win rate of such a cause.", decides=True, neutral=1.0)
    strong_gain: float = threshold(0.5, "Share of the excess loss that such a cause removes.", decides=True)
    close_agreement: float = threshold(
        0.75, "Ratio of the distances from doing nothing of such a cause in the two parts.", decides=True, neutral=1.0
    )
    near_certainty: float = threshold(
        0.8, "Share of the draws in which a near miss must lower the loss: it is told beside the verdict, not named."
    )
    least_agreement: float = threshold(
        0.4,
        "Ratio, lesser to greater, of a parameter's distances from doing nothing in the two parts of the data.",
        decides=True,
    )
    least_change: float = threshold(
        0.01, "Relative change of a number below which it is no finding: none is known better.", decides=True
    )
    most_contradicted: float = threshold(
        2e-3, "Share of samples that may contradict a cause, as duties above a fitted limit do.", decides=True
    )
    least_win_rate: float = threshold(
        0.5,
        "Minimum bootstrap win rate for a weak or an additional cause; below it the cause is ambiguous.",
        decides=True,
    )
    least_sampled: float = threshold(
        0.01, "Loss that a weak cause must remove from what is judged sample by sample.", decides=True
    )
    least_removed_by_columns: float = threshold(
        0.12, "Or else the loss that a weak cause must remove in all, duty and current included.", decides=True
    )

    # --- which candidate is the best
    draws: int = threshold(2000, "Draws of the block bootstrap.")
    rival_win_rate: float = threshold(
        0.05, "Bootstrap win rate from which another candidate is a rival of the winner.", decides=True
    )
    shared_error: float = threshold(
        0.02,
        "Relative error of a candidate's loss that all data share, such as ripple of steps and ticks: no resampling "
        "shows it, so candidates closer than this are not told apart.",
        decides=True,
    )
    parameter_charge: float = threshold(
        0.02,
        "Share of the loss that each further parameter of a variant must remove; a missing effect is charged once "
        "against a wrong number.",
        decides=True,
    )
    form_charge: float = threshold(
        1.4,
        "Factor by which another form of a cause must lower the loss against its usual form.",
        decides=True,
        neutral=1.0,
    )

    # --- which columns count beside the position
    column_logged: float = threshold(0.5, "Share of its samples from which a column is looked at.", about=COLUMNS)
    column_agreement: float = threshold(
        0.8, "Least correlation of a column with what the tuned model predicts.", about=COLUMNS
    )
    column_least_slope: float = threshold(
        0.5, "Least ratio of measured to predicted size: below it the column has another unit.", about=COLUMNS
    )
    column_most_slope: float = threshold(2.0, "Largest ratio of measured to predicted size.", about=COLUMNS)
    column_groups: int = threshold(50, "Groups of samples from which a column can be judged.", about=COLUMNS)
    column_calibration: float = threshold(
        0.02, "Calibration error of a column, as a share of its rms: the least noise that it has.", about=COLUMNS
    )
    column_lag: float = threshold(
        2.5e-4,
        "Time [s] by which a column may be later than the stamp of its row: a period of a drive's loop, assumed.",
        about=COLUMNS,
    )
    column_trim: float = threshold(
        0.98, "Quantile of a column's second differences beyond which they are no noise.", about=COLUMNS
    )
    column_fast: float = threshold(
        0.75, "Quantile of a column's changes from which its timing error is read off.", about=COLUMNS
    )

    # --- what joints of a robot share
    shared_joints: int = threshold(2, "Joints that a cause of the whole robot must act on, and help.", about=ROBOT)
    shared_gain: float = threshold(
        0.1, "Share of a joint's own loss that a cause must remove which the joint shares.", about=ROBOT
    )
    light_body: float = threshold(
        0.02,
        "Share of the robot's moving mass below which a body's own mass and centre of mass are not sought.",
        about=ROBOT,
    )

    # --- logs of torque alone
    most_torque_causes: int = threshold(4, "Causes after which the search in a torque log ends.", about=TORQUE)
    shift_certainty: float = threshold(
        0.9, "Share of bootstrap draws in which a torque column must be out of step to the same side.", about=TORQUE
    )
    shift_error: float = threshold(
        0.995, "Error with the shift, in parts of that without, below which it is sought at all.", about=TORQUE
    )
    least_shift: float = threshold(
        2e-3,
        "Shift [s] from which a column is out of step: two steps of the grid that logs are brought to.",
        about=TORQUE,
    )

    # --- what is told beside a cause
    verdict_draws: int = threshold(
        1000, "Draws of the bootstrap over the test part, and over a torque log.", about=TOLD
    )
    place_error: float = threshold(
        0.5, "Share of the squared error that a place, or few moments, must hold to be told.", about=TOLD
    )
    place_lift: float = threshold(2.0, "The same in parts of the place's share of the time.", about=TOLD)
    few_moments: float = threshold(
        0.05, "Share of the windows of a log that are few: what holds most of the error there are events.", about=TOLD
    )
    at_duty_limit: float = threshold(0.98, "Share of the largest duty from which it is at its limit.", about=TOLD)
    at_rest_speed: float = threshold(
        0.02, "Share of the highest speeds (99 % quantile) below which a joint is at rest.", about=TOLD
    )
    goal_knots: float = threshold(
        0.35,
        "Relative difference of what was added to a delay and half of the time between two goals, below which the log "
        "may have been interpolated.",
        about=TOLD,
    )
    further: float = threshold(
        0.02, "Share of the fitted range by which the test part goes further; less is chance.", about=TOLD
    )
    worse_there: float = threshold(
        2.0, "Times the error of all other pieces that it has there; less is scatter.", about=TOLD
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
"""What was measured on the hidden benches (docs/results/diagnosis.md) was measured with these."""
