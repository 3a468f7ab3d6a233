"""Local optima among the configurations with the tip at a target, of any arm with a tip and its Jacobian.

An arm of n joints has surfaces of n - 2 dimensions of such configurations, with edges and corners where joints are at
their limits, and objectives have kinks on them. `objectives` says what is to be small, `projection` puts the tip onto
the target, `descent` leads downhill, `faces` has places where searches begin, `pieces` has the programmes that go on
from there, `optimality` decides what a local optimum is, and `search` brings them together. `n_x` and `dual_triangle`
add what is particular to them.
"""
