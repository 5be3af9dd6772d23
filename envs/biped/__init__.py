"""The planar biped MABEL (seed 003)."""
