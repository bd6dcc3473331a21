"""The closed law of ideal iron (paper, eq. 1, first equality).

All of the magnetomotive force N i is spent in the two air gaps s of a pole pair, so that the flux
density is ``B = mu0 N i / (2 s)`` and each side pulls with ``B^2 A cos(angle) / mu0``, which is
``k (i/s)^2`` with ``k = mu0 A N^2 cos(angle) / 4``.
"""

import sympy as sp

from models.laws.law import Function, Law, i0, iu, k, relative, s0, there, two_sides, x

gap, current = sp.symbols("gap current")
one_side = k * (current / gap) ** 2
whole = two_sides(one_side, gap, current)
force = relative(whole)

closed = Law(
    name="closed_law",
    about="The closed force law (paper, eq. 1), without a branch: sim/lanes.h compiles it once "
    "more, with vectors",
    struct="amb_law",
    include="ambkit/magnet.h",
    parameters=(k, s0, i0),
    functions=(
        Function(
            "amb_law_force",
            "F of two sides, as a product, a^2 - b^2 = (a + b)(a - b): no cancellation near the "
            "origin.",
            (("shift", "i0 * x + iu * s0"), ("gaps", "(s0 - x) * (s0 + x)")),
            {
                "return": (
                    "4 * k * (i0 * s0 + iu * x) * shift / (gaps * gaps)",
                    force.subs(there, 1),
                )
            },
        ),
        Function(
            "amb_law_force_one_sided",
            "F - F(0, 0) of one side, as a product as well.",
            (("own", "(i0 + iu) / (s0 - x)"),),
            {
                "return": (
                    "k * (own + i0 / s0) * (i0 * x + iu * s0) / ((s0 - x) * s0)",
                    force.subs(there, 0),
                )
            },
        ),
        Function(
            "amb_law_tangent",
            "dF/diu and dF/dx; `there` is 1, or 0 where there is no magnet on the other side.",
            (
                ("own", "1 / (s0 - x)"),
                ("other", "1 / (s0 + x)"),
                ("a", "(i0 + iu) * own"),
                ("b", "(i0 - iu) * other"),
            ),
            {
                "k_i": ("2 * k * (a * own + there * b * other)", sp.diff(force, iu)),
                "k_s": ("2 * k * (a * a * own + there * b * b * other)", sp.diff(force, x)),
            },
            (there,),
        ),
    ),
)
