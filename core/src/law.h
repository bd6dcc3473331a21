/* The closed law (paper, eq. 1), stated once: magnet.c computes it with numbers; sim/lanes.h
 * includes this once more and computes it with vectors of them, so there is no branch here. */
#ifndef AMBKIT_LAW_H
#define AMBKIT_LAW_H

#include "ambkit/magnet.h"

/* F of two sides, as a product, a^2 - b^2 = (a + b)(a - b): no cancellation near the origin. */
AMB_INLINE amb_real amb_law_force(const amb_law *law, amb_real iu, amb_real x)
{
  const amb_real i0 = law->i0;
  const amb_real s0 = law->s0;
  const amb_real shift = i0 * x + iu * s0;
  const amb_real gaps = (s0 - x) * (s0 + x);
  return AMB_C(4.0) * law->k * (i0 * s0 + iu * x) * shift / (gaps * gaps);
}

/* `there` is 1, or 0 where there is no magnet on the other side. */
AMB_INLINE void amb_law_tangent(const amb_law *law, amb_real there, amb_real iu, amb_real x,
                                amb_real *k_i, amb_real *k_s)
{
  const amb_real own = AMB_C(1.0) / (law->s0 - x); /* of this magnet's gap */
  const amb_real other = AMB_C(1.0) / (law->s0 + x);
  const amb_real a = (law->i0 + iu) * own;
  const amb_real b = (law->i0 - iu) * other;
  *k_i = AMB_C(2.0) * law->k * (a * own + there * b * other);
  *k_s = AMB_C(2.0) * law->k * (a * a * own + there * b * b * other);
}

/* Square of the distance from the origin, p . p with p = (iu / ampere, x / metre). */
AMB_INLINE amb_real amb_law_square(const amb_law *law, amb_real iu, amb_real x)
{
  const amb_real p = iu / law->ampere;
  const amb_real q = x / law->metre;
  return p * p + q * q;
}

/* Tangents become the through-origin form: k . p = F and k . p' = grad F . p', where p' is p turned
 * by 90 degrees. It is the limit of the paper's least squares (eq. 28-31) for small steps: F itself
 * along the ray through the origin, the tangent across it. `square` is amb_law_square; below
 * AMB_REAL_MIN the tangent is this form to all digits, and the result is of no use. */
AMB_INLINE void amb_law_turn(const amb_law *law, amb_real force, amb_real square, amb_real iu,
                             amb_real x, amb_real *k_i, amb_real *k_s)
{
  const amb_real p = iu / law->ampere;
  const amb_real q = x / law->metre;
  const amb_real g_p = *k_i * law->ampere;
  const amb_real g_q = *k_s * law->metre;
  const amb_real along = force / square;
  const amb_real across = (g_q * p - g_p * q) / square;
  *k_i = (along * p - across * q) / law->ampere;
  *k_s = (along * q + across * p) / law->metre;
}

#endif
