"""What to measure next: the motion, out of a library, that best tells apart what the log leaves open."""

from .detection import DetectionLimit, blind_spots, detection_limits, experiment_for_still, unseen
from .excitations import EXCITATION_SECONDS, GOAL_RATE, Limits, default_limits, library
from .proposal import Along, Experiment, goal_table, propose, read_goals, write_experiment

__all__ = [
    "EXCITATION_SECONDS",
    "GOAL_RATE",
    "Along",
    "DetectionLimit",
    "Experiment",
    "Limits",
    "blind_spots",
    "default_limits",
    "detection_limits",
    "experiment_for_still",
    "goal_table",
    "library",
    "propose",
    "read_goals",
    "unseen",
    "write_experiment",
]
