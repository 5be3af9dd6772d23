"""What to measure next: the motion, out of a library, that best tells apart what the log leaves open."""

from gap.experiment.excitations import DURATION, RATE, Limits, library
from gap.experiment.files import goal_table, read_goals, write_experiment
from gap.experiment.proposal import Experiment, propose, separate

__all__ = [
    "DURATION",
    "RATE",
    "Experiment",
    "Limits",
    "goal_table",
    "library",
    "propose",
    "read_goals",
    "separate",
    "write_experiment",
]
