"""What learns: Stable-Baselines3 on the vectorised robots, with runs that survive being stopped."""
