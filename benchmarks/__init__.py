"""Measurements of speed and of numerical accuracy; their results are committed in ``benchmarks/results``."""
