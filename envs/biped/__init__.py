"""The planar biped MABEL (paper 003)."""
