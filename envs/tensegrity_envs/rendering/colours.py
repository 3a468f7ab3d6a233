"""The colours of pictures."""

import numpy as np

Colour = tuple[int, int, int]

PAPER, GRID, AXIS, INK, FAINT = (252, 253, 254), (234, 238, 243), (216, 222, 230), (52, 60, 72), (112, 121, 134)
BAR, SPRING, TIP, TARGET = (58, 68, 84), (18, 138, 132), (25, 113, 194), (208, 60, 12)
GOOD, BAD = (43, 158, 84), (214, 40, 40)
# The "plasma" colour map [van der Walt and Smith, 2015] without its ends, which are too dark and too bright on paper.
_TENSIONS = np.array(
    [(70, 3, 159), (114, 1, 168), (156, 23, 158), (189, 55, 134), (216, 87, 107), (237, 121, 83), (251, 159, 58)]
)


def tension_colour(tension: float, bounds: tuple[float, float]) -> Colour:
    """Colour of a cable: dark violet at the lower bound, orange at the upper one, evenly perceived between."""
    low, high = bounds
    position = np.clip((tension - low) / (high - low), 0, 1) * (len(_TENSIONS) - 1) if high > low else 0.0
    red, green, blue = (round(np.interp(position, range(len(_TENSIONS)), channel)) for channel in _TENSIONS.T)
    return red, green, blue


def mix(colour: Colour, share: float) -> Colour:
    """A colour thinned with paper."""
    red, green, blue = (round(share * c + (1 - share) * p) for c, p in zip(colour, PAPER))
    return red, green, blue
