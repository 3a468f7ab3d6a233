"""One self-contained HTML page per mechanism, to play with: drag the tip, see all inverse solutions and their margins.

The page's arithmetic is the component code of `tensegrity_envs.mechanics`, written as JavaScript by
`compiler.javascript`. Only searches (`solver.js`), what a mechanism puts together from them (`two_x.js`, ...) and the
drawing (`view.js`) are JavaScript of their own.
"""

from tensegrity_agents.playground.page import Playground, write_playground
from tensegrity_agents.playground.planar import DUAL_TRIANGLE, N_X, PLANAR_FOUR_BAR, TWO_X
from tensegrity_agents.playground.spatial import SPATIAL_PRISM

PLAYGROUNDS: dict[str, Playground] = {
    "two-x": TWO_X,
    "n-x": N_X,
    "dual-triangle": DUAL_TRIANGLE,
    "planar-four-bar": PLANAR_FOUR_BAR,
    "spatial-prism": SPATIAL_PRISM,
}

__all__ = ["PLAYGROUNDS", "Playground", "write_playground"]
