"""How good linear models are: the table of docs/linear_models.md.

python tests/envs/linear_measurements.py [id ...]
"""

import sys

import numpy as np
from test_linear import IDS, Rest

STEPS = 5
ACTIONS = (0.1, 1.0)  # largest component of the first action; then the inputs stay
COUNT = 200  # of random directions


def derivative_error(rest, model):
    """Largest difference of the goal's derivative from finite differences of real steps, relative to the largest."""
    _, goals = rest.differences(STEPS)
    ours = model.C @ np.linalg.matrix_power(model.A, STEPS - 1) @ model.B
    return abs(ours - goals).max() / abs(goals).max()


def prediction_error(rest, model, size):
    """Median of |predicted - real| / |real displacement| of the achieved goal; episodes that fail do not count."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (rest.core.simulation.action_size, COUNT))
    actions *= size / abs(actions).max(axis=0)
    outcomes = rest.after(actions, STEPS)
    _, goals = rest.states(outcomes)
    failed = np.asarray(rest.core.outcomes.unpack(outcomes).state.failure) != 0
    real = (goals - model.output[:, None])[:, ~failed]
    ours = model.C @ np.linalg.matrix_power(model.A, STEPS - 1) @ model.B @ actions[:, ~failed]
    return float(np.median(np.linalg.norm(ours - real, axis=0) / np.linalg.norm(real, axis=0)))


def main(ids):
    print("| environment | derivative | " + " | ".join(f"action of {size:g}" for size in ACTIONS) + " |")
    print("| --- | ---: | " + " | ".join("---:" for _ in ACTIONS) + " |")
    for env_id in ids:
        rest = Rest(env_id)
        model = rest.linearized()
        errors = " | ".join(f"{100 * prediction_error(rest, model, size):.2g} %" for size in ACTIONS)
        print(f"| `{env_id.rpartition('/')[2]}` | {derivative_error(rest, model):.1e} | {errors} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or IDS)
