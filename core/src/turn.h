/* From tangents to the through-origin form, for any magnet that knows both of its force: without a
 * branch, as sim/lanes.h includes this once more and computes it with vectors. */
#ifndef AMBKIT_TURN_H
#define AMBKIT_TURN_H

#include "ambkit/magnet.h"

#if defined(AMB_FLOAT)
#define AMB_TURN_LEAST 1e-24F
#else
#define AMB_TURN_LEAST 1e-60
#endif

/* Square of the distance from the origin, p . p with p = (iu / ampere, x / metre). */
AMB_INLINE amb_real amb_turn_square(amb_real ampere, amb_real metre, amb_real iu, amb_real x)
{
  const amb_real p = iu / ampere;
  const amb_real q = x / metre;
  return p * p + q * q;
}

/* Tangents become the through-origin form: k . p = F and k . p' = grad F . p', where p' is p turned
 * by 90 degrees. It is the limit of the paper's least squares (eq. 28-31) for small steps: F itself
 * along the ray through the origin, the tangent across it. `square` is amb_turn_square; below
 * AMB_TURN_LEAST the tangent is this form to all digits, and the result is of no use. */
AMB_INLINE void amb_turn(amb_real ampere, amb_real metre, amb_real force, amb_real square,
                         amb_real iu, amb_real x, amb_real *k_i, amb_real *k_s)
{
  const amb_real p = iu / ampere;
  const amb_real q = x / metre;
  const amb_real g_p = *k_i * ampere;
  const amb_real g_q = *k_s * metre;
  const amb_real along = force / square;
  const amb_real across = (g_q * p - g_p * q) / square;
  *k_i = (along * p - across * q) / ampere;
  *k_s = (along * q + across * p) / metre;
}

#if !defined(AMB_SIDE_BY_SIDE)
/* The through-origin form of a magnet with this force and these tangents at (iu, x). */
AMB_INLINE amb_stiffness amb_through_origin(amb_real ampere, amb_real metre, amb_real force,
                                            amb_stiffness tangent, amb_real iu, amb_real x)
{
  amb_stiffness k = tangent;
  const amb_real square = amb_turn_square(ampere, metre, iu, x);
  if (square >= AMB_TURN_LEAST) {
    amb_turn(ampere, metre, force, square, iu, x, &k.k_i, &k.k_s);
    k.k_i = amb_clamp(k.k_i, -AMB_STIFFEST, AMB_STIFFEST);
    k.k_s = amb_clamp(k.k_s, -AMB_STIFFEST, AMB_STIFFEST);
  }
  return k;
}
#endif

#endif
