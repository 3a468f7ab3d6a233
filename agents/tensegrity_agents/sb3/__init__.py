"""Stable-Baselines3: the vector environment adapter, training, and policy files without pickle."""
