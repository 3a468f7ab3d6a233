"""Controllers, Stable-Baselines3 agents, evaluation and reports for `tensegrity_envs`."""
