"""Sine and cosine in plain arithmetic. `kernel` turns this into machine code, for several numbers at a time.

The C library's take one number at a time, and were half of an environment's step.
"""

# pi / 2 in three parts. The first two have 33 bits: their products with whole numbers below 2**20 are exact.
HALF_PI_1 = float.fromhex("0x1.921fb544p+0")
HALF_PI_2 = float.fromhex("0x1.0b4611a6p-34")
HALF_PI_3 = float.fromhex("0x1.3198a2e037073p-69")
TWO_OVER_PI = 0.6366197723675814
ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to a whole number
# Taylor's series; what follows in them is below 2**-53 for |r| <= pi / 4.
S3, S5, S7, S9 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880
S11, S13, S15 = -1 / 39916800, 1 / 6227020800, -1 / 1307674368000
C4, C6, C8, C10 = 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800
C12, C14, C16 = 1 / 479001600, -1 / 87178291200, 1 / 20922789888000


def sine_and_cosine(x: float) -> tuple[float, float]:
    """Of an angle [rad], to within a unit in the last place below a million."""
    quarters = (x * TWO_OVER_PI + ROUND) - ROUND
    # The distance to the nearest quarter turn is r + rest, as exactly as two numbers can tell.
    near, by = x - quarters * HALF_PI_1, quarters * HALF_PI_2
    rough = near - by
    small = ((near - rough) - by) - quarters * HALF_PI_3
    r = rough + small
    rest = small - (r - rough)
    z = r * r
    s = r + (r * z * (S3 + z * (S5 + z * (S7 + z * (S9 + z * (S11 + z * (S13 + z * S15)))))) + rest)
    tail = z * z * (C4 + z * (C6 + z * (C8 + z * (C10 + z * (C12 + z * (C14 + z * C16))))))
    most = 1 - 0.5 * z
    c = most + (((1 - most) - 0.5 * z) + (tail - r * rest))
    half = quarters * 0.5
    is_odd = (half + ROUND) - ROUND != half
    quarter = (half - 0.5 if is_odd else half) * 0.5
    is_upper = (quarter + ROUND) - ROUND == quarter
    sine = c if is_odd else (s if x != 0.0 else x)  # which keeps the sign of zero
    cosine = s if is_odd else c
    return sine if is_upper else -sine, cosine if is_upper != is_odd else -cosine
