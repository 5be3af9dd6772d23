"""The batch engine: tasks, many simulations at once, and the shells of Gymnasium and Stable-Baselines3 around it."""
