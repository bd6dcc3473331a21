"""The polynomial for exp(r) on |r| <= ln 2 / 2, by interpolation at Chebyshev nodes.

Evaluated by Estrin's scheme: half the waiting of Horner's, the same order everywhere.
"""

import mpmath as mp

PRECISIONS = {"AMB_FLOAT": (6, 9, "F"), "": (11, 17, "")}  # degree, digits, suffix


def coefficients(degree: int) -> list[mp.mpf]:
    """Coefficients c_0 .. c_degree; relative error 4.2e-18 for degree 11, 2.5e-9 for 6."""
    with mp.workdps(40):
        half = mp.log(2) / 2 * mp.mpf("1.0001")
        nodes = [half * mp.cos(mp.pi * (2 * k + 1) / (2 * (degree + 1))) for k in range(degree + 1)]
        powers = mp.matrix([[node**j for j in range(degree + 1)] for node in nodes])
        return list(mp.lu_solve(powers, mp.matrix([mp.exp(node) for node in nodes])))


def estrin(terms: list[str], power: int = 1) -> tuple[list[str], str]:
    """Lines that pair the terms up with r, r^2, r^4 ..., and the expression that is left."""
    if len(terms) == 1:
        return [], terms[0]
    pairs = [f"{a} + r{power} * {b}" for a, b in zip(terms[::2], terms[1::2], strict=False)]
    pairs += [terms[-1]] * (len(terms) % 2)
    if len(pairs) == 1:
        return [], pairs[0]
    names = [f"p{power}_{i}" for i in range(len(pairs))]
    lines = [f"const amb_real {n} = {e};" for n, e in zip(names, pairs, strict=True)]
    lines.append(f"const amb_real r{2 * power} = r{power} * r{power};")
    rest, last = estrin(names, 2 * power)
    return lines + rest, last


def body(degree: int, digits: int, suffix: str) -> str:
    """Return the statements of the function for one precision."""
    terms = [
        mp.nstr(c, digits, strip_zeros=False, min_fixed=0, max_fixed=0) + suffix
        for c in coefficients(degree)
    ]
    lines, last = estrin(terms)
    return "\n".join([*lines, f"return {last};"])


def exponential_header() -> str:
    """Return the text of ``core/generated/exponential.h``."""
    single, double = (body(*PRECISIONS[key]) for key in ("AMB_FLOAT", ""))
    return (
        "/* exp(r) for |r| <= ln 2 / 2. Written by `python -m models`; do not edit. */\n"
        "#ifndef AMBKIT_GENERATED_EXPONENTIAL_H\n#define AMBKIT_GENERATED_EXPONENTIAL_H\n\n"
        '#include "ambkit/real.h"\n\n'
        "static inline amb_real amb_exp_polynomial(amb_real r1)\n{\n"
        f"#if defined(AMB_FLOAT)\n{single}\n#else\n{double}\n#endif\n}}\n\n#endif\n"
    )
