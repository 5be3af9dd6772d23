"""The planar biped MABEL (paper 003): its experiments, and its printed figures beside ours."""
