"""One leg of the quadruped SILO4 (paper 000)."""
