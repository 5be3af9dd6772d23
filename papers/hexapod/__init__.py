"""The hexapod AMRU5 (paper 001): its experiments, and its printed figures beside ours."""
