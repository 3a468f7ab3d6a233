"""Throughput of vectors of ThreeXReach-v0 against TwoXReach-v0, block by block in one run (median of CPU times); and
targets for which the dual-triangle's redundancy is resolved in a CPU second.

    python tests/envs/planar_arm_speed.py
"""

import time

import gymnasium as gym
import numpy as np

import tensegrity_envs
from tensegrity_envs.mechanics import DualTriangle

TARGETS = 10_000
COUNT, STEPS, BLOCKS = 1024, 31, 12  # a block has resets and synchronized time limits in it


def main():
    """Measure and print."""
    assert tensegrity_envs.ENV_IDS
    rng, rates = np.random.default_rng(0), {"tensegrity/TwoXReach-v0": [], "tensegrity/ThreeXReach-v0": []}
    vectors = {
        env_id: gym.make_vec(env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
        for env_id in rates
    }
    for envs in vectors.values():
        envs.reset(seed=0)
    for _ in range(BLOCKS):
        for env_id, envs in vectors.items():
            actions = rng.uniform(-1, 1, (STEPS, *envs.action_space.shape)).astype(np.float32)
            begun = time.process_time()
            for action in actions:
                envs.step(action)
            rates[env_id].append(STEPS * COUNT / (time.process_time() - begun))
    two, three = (float(np.median(measured)) for measured in rates.values())
    print(f"steps in a CPU second: TwoXReach {two:,.0f}, ThreeXReach {three:,.0f}, ratio {three / two:.2f}")
    arm = DualTriangle()
    limit = float(arm.design.joint_limit)
    x, y = arm.tip(tuple(rng.uniform(-limit, limit, (3, TARGETS))))
    for objective in ("sum", "max", "squares"):
        begun = time.process_time()
        arm.redundancy(x, y, (-0.1, 0.1, 0.1), objective)
        print(f'targets in a CPU second, "{objective}": {TARGETS / (time.process_time() - begun):,.0f}')


if __name__ == "__main__":
    main()
