"""The series elastic hopper of the paper (seed 004)."""
