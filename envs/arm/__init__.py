"""The flexible-joint arm SRLFJ of the paper (paper 002)."""
