"""A servo with a pendulum load."""
