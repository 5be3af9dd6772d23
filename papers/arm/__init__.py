"""The flexible-joint arm SRLFJ (paper 002): its experiments, and its printed figures beside ours."""
