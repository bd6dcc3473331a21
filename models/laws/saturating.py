"""Iron of finite permeability that saturates (Froehlich 1881), in closed form.

The iron asks for ``H = a B / (1 - B/Bs)`` with ``a = 1/(mu0 mu_r)``, and the magnetomotive force
goes round gaps and iron: ``N i = 2 s B/mu0 + l H``. With ``p = 2 s/mu0``, ``q = l a`` and
``n = N i`` the flux density is
``B = 2 n / ((p + q + n/Bs) + sqrt((p + q + n/Bs)^2 - 4 p n/Bs))``, and each side pulls with
``B^2 A cos(angle) / mu0``.

Divided by 2/mu0 that is ``k (i/h)^2`` with the magnet constant of ideal iron and an effective gap
``h = (g + e + c i + r)/2``, ``r^2 = (g + e - c i)^2 + 4 e c i``: e is the iron as so much more gap,
``l/(2 mu_r)``, and c i the gap at which ideal iron would just reach Bs, ``c = mu0 N/(2 Bs)``. The
tangents are short, because h solves ``h^2 - (g + e + c i) h + g c i = 0``.
"""

import sympy as sp

from models.laws.closed import I0, S0, K
from models.laws.law import Function, Law, Parameter, iu, k, relative, there, two_sides, x

gap, current = sp.symbols("gap current")
iron, knee = sp.symbols("iron knee")
"""e [m] and c [m/A]."""

mu0, N, A, length, mu_r, Bs = sp.symbols("mu0 N A length mu_r Bs", positive=True)
p, q, n = 2 * gap / mu0, length / (mu0 * mu_r), N * current
total = p + q + n / Bs
flux_density = 2 * n / (total + sp.sqrt(total**2 - 4 * p * n / Bs))
one_side = (flux_density**2 * A / mu0).subs(
    # What the core is given in their place; A holds the cosine of the pole angle.
    {length: 2 * mu_r * iron, Bs: mu0 * N / (2 * knee), A: 4 * k / (mu0 * N**2)}
)
reduced = {mu0: 1, N: 1, mu_r: 1}  # they cancel
whole = two_sides(one_side, gap, current).subs(reduced)
force = relative(whole)


def side(j: int, gap: str, current: str) -> tuple[tuple[str, str], ...]:
    """Return the steps to the effective gap h of a side."""
    return (
        (f"g{j}", gap),
        (f"i{j}", current),
        (f"w{j}", f"knee * i{j}"),
        (f"m{j}", f"g{j} + iron - w{j}"),
        (f"r{j}", f"sqrt(m{j} * m{j} + 4 * iron * w{j})"),
        (f"h{j}", f"(g{j} + iron + w{j} + r{j}) / 2"),
    )


saturating = Law(
    name="saturating",
    about="the force law of saturating iron",
    parameters=(
        K,
        S0,
        I0,
        Parameter(
            iron,
            "e, the iron as so much more gap, length / (2 mu_r) [m], > 0",
            "(m.iron_length or 0.0) / (2 * (m.relative_permeability or math.inf))",
        ),
        Parameter(
            knee,
            "c, mu0 N / (2 Bs): c i is the gap at which i saturates ideal iron [m/A]",
            "MU_0 * (m.turns or 0) / (2 * (m.saturation or math.inf))",
        ),
    ),
    holds_for="m.saturation is not None",
    reference="Froehlich, Investigations of dynamoelectric machines and electric power "
    "transmission, 1881.",
    functions=(
        Function(
            "force",
            "F - F(0, 0) as a product, a^2 - b^2 = (a + b)(a - b), from differences of gap and "
            "current, so that nothing cancels. `there` is 1, or 0 where b is of the origin.",
            (
                *side(1, "s0 - x", "i0 + iu"),
                *side(2, "s0 + there * x", "i0 - there * iu"),
                ("dg", "-(1 + there) * x"),
                ("di", "(1 + there) * iu"),
                ("dw", "knee * di"),
                ("dm", "(dg - dw) * (m1 + m2) + 4 * iron * dw"),
                ("dh", "(dg + dw + dm / (r1 + r2)) / 2"),
                ("a", "i1 / h1"),
                ("b", "i2 / h2"),
            ),
            {"return": ("k * (a + b) * (di * h2 - i2 * dh) / (h1 * h2)", force)},
            (there,),
        ),
        Function(
            "tangent",
            "dF/diu and dF/dx; `there` is 1, or 0 where there is no magnet on the other side.",
            (
                *side(1, "s0 - x", "i0 + iu"),
                *side(2, "s0 + x", "i0 - iu"),
                ("a", "i1 / h1"),
                ("b", "i2 / h2"),
                ("own", "a * (h1 - w1) / (h1 * r1)"),
                ("other", "b * (h2 - w2) / (h2 * r2)"),
            ),
            {
                "k_i": ("2 * k * (own + there * other)", sp.diff(force, iu)),
                "k_s": ("2 * k * (a * own + there * b * other)", sp.diff(force, x)),
            },
            (there,),
        ),
    ),
)
