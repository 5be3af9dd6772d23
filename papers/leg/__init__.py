"""One leg of the quadruped SILO4 (paper 000): its experiments, and its printed figures beside ours."""
