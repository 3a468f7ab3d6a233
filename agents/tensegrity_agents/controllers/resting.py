"""When a plan has come to its end, and the mean of what was measured since."""

import numpy as np

LATEST = 16  # positions that are remembered


def ends_of_plans(plans: np.ndarray, still: float) -> np.ndarray:
    """The steps from which on plans (n, steps, inputs) change by no more than `still`, (n,)."""
    moves = np.abs(np.diff(plans, axis=1)).max(axis=2) > still
    return np.where(moves.any(axis=1), moves.shape[1] - moves[:, ::-1].argmax(axis=1), 0)


def first_tips(tip: np.ndarray) -> np.ndarray:
    """The latest tips (n, 16, 2) of episodes that begin with these, (n, 2)."""
    return np.repeat(np.asarray(tip, float)[:, None], LATEST, axis=1)


def with_latest(tips: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """The latest tips with one more, the newest first."""
    return np.concatenate([np.asarray(tip, float)[:, None], tips[:, :-1]], axis=1)


def planned_at(plan: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Inputs (n, inputs) of plans (n, steps, inputs) after steps (n,) that count from 0; beyond the end, the last."""
    return np.asarray(plan[np.arange(len(step)), np.minimum(step, plan.shape[1] - 1)])
