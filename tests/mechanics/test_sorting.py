"""Sorting within groups, against NumPy's own."""

import numpy as np
import pytest

from tensegrity_envs.mechanics.sorting import order_within


@pytest.mark.parametrize("count", [0, 1, 2, 7, 500])
def test_order_is_that_of_lexsort_ties_included(count):
    rng = np.random.default_rng(count)
    for _ in range(10):
        owner = rng.integers(0, count // 4 + 1, count)
        first, second = rng.integers(-1, 2, (2, count)).astype(float)
        np.testing.assert_array_equal(order_within(owner, first, second), np.lexsort((second, first, owner)))
