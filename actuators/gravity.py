"""Gravity, as MuJoCo's models have it."""

GRAVITY = 9.81
"""[m/s2], the default of MuJoCo's ``option/gravity``."""
