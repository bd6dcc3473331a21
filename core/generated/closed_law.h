/* The closed force law (models/laws/closed.py). Written by `python -m models`; do not edit. */
#ifndef AMBKIT_GENERATED_CLOSED_LAW_H
#define AMBKIT_GENERATED_CLOSED_LAW_H

#include "ambkit/closed.h"

/* F of two sides, as a product, a^2 - b^2 = (a + b)(a - b): no cancellation near the origin. */
AMB_INLINE amb_real amb_law_force(const amb_law *law, amb_real iu, amb_real x)
{
  const amb_real shift = law->i0 * x + iu * law->s0;
  const amb_real gaps = (law->s0 - x) * (law->s0 + x);
  return AMB_C(4.0) * law->k * (law->i0 * law->s0 + iu * x) * shift / (gaps * gaps);
}

/* F - F(0, 0) of one side, as a product as well. */
AMB_INLINE amb_real amb_law_force_one_sided(const amb_law *law, amb_real iu, amb_real x)
{
  const amb_real own = (law->i0 + iu) / (law->s0 - x);
  return law->k * (own + law->i0 / law->s0) * (law->i0 * x + iu * law->s0) /
         ((law->s0 - x) * law->s0);
}

/* dF/diu and dF/dx; `there` is 1, or 0 where there is no magnet on the other side. */
AMB_INLINE void amb_law_tangent(const amb_law *law, amb_real there, amb_real iu, amb_real x,
                                amb_real *k_i, amb_real *k_s)
{
  const amb_real own = AMB_C(1.0) / (law->s0 - x);
  const amb_real other = AMB_C(1.0) / (law->s0 + x);
  const amb_real a = (law->i0 + iu) * own;
  const amb_real b = (law->i0 - iu) * other;
  *k_i = AMB_C(2.0) * law->k * (a * own + there * b * other);
  *k_s = AMB_C(2.0) * law->k * (a * a * own + there * b * b * other);
}

/* What multiplies k in the force, bias force and all (paper, eq. 25). */
AMB_INLINE amb_real amb_law_regressor(const amb_law *law, amb_real there, amb_real iu, amb_real x)
{
  const amb_real own = (law->i0 + iu) / (law->s0 - x);
  const amb_real other = (law->i0 - iu) / (law->s0 + x);
  return own * own - there * (other * other);
}

#endif
