"""The closed law of ideal iron (paper, eq. 1, first equality).

All of the magnetomotive force N i is spent in the two air gaps s of a pole pair, so that the flux
density is ``B = mu0 N i / (2 s)`` and each side pulls with ``B^2 A cos(angle) / mu0``, which is
``k (i/s)^2`` with ``k = mu0 A N^2 cos(angle) / 4``.
"""

import sympy as sp

from models.laws.law import Function, Law, Parameter, i0, iu, k, relative, s0, there, two_sides, x

gap, current = sp.symbols("gap current")
one_side = k * (current / gap) ** 2
whole = two_sides(one_side, gap, current)
force = relative(whole)

K = Parameter(
    k, "magnet constant of ideal iron, mu0 A N^2 cos(angle) / 4 [N m^2/A^2]", "m.magnet_constant"
)
S0 = Parameter(s0, "nominal air gap [m]", "m.air_gap")
I0 = Parameter(i0, "bias current [A]", "m.bias_current")

closed = Law(
    name="closed",
    about="the closed force law",
    reference="Paper, eq. 1, first equality: ideal iron.",
    shared=True,
    stem="amb_law",
    struct="amb_law",
    parameters=(K, S0, I0),
    functions=(
        Function(
            "force",
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
            "force_one_sided",
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
            "tangent",
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
        Function(
            "regressor",
            "What multiplies k in the force, bias force and all (paper, eq. 25).",
            (("own", "(i0 + iu) / (s0 - x)"), ("other", "(i0 - iu) / (s0 + x)")),
            {"return": ("own * own - there * (other * other)", whole / k)},
            (there,),
        ),
    ),
)
