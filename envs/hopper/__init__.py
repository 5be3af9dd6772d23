"""The series elastic hopper of the paper (paper 004)."""
