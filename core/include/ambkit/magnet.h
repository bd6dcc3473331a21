/* What an estimator asks of its magnet: force and stiffnesses at (iu, x), and nothing else.
 *
 * All in SI: iu control current [A], x displacement towards the pulling magnet [m], force [N],
 * k_i [N/A], k_s [N/m]. Forces are relative to the bias force F(0, 0), which is zero for a
 * two-sided magnet and carries the rotor for a one-sided one; the bias force belongs to the known
 * forces of the filter.
 *
 * Two forms of the stiffnesses:
 *   through origin   F(iu, x) = k_i iu + k_s x exactly, no affine term (paper, eq. 26)
 *   tangent          k_i = dF/diu, k_s = dF/dx
 * They agree at the origin.
 */
#ifndef AMBKIT_MAGNET_H
#define AMBKIT_MAGNET_H

#include "ambkit/real.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_stiffness {
  amb_real k_i; /* [N/A] */
  amb_real k_s; /* [N/m] */
} amb_stiffness;

/* Upper limits of magnet stiffnesses [N/A], [N/m]: bounds for the proof, where a quotient has none.
 * */
#define AMB_STIFFEST AMB_C(1e9)

/* The interface. Each implementation provides one constant of this type. */
typedef struct amb_magnet_methods {
  amb_real (*force)(const void *self, amb_real iu, amb_real x);
  amb_stiffness (*through_origin)(const void *self, amb_real iu, amb_real x);
  amb_stiffness (*tangent)(const void *self, amb_real iu, amb_real x);
} amb_magnet_methods;

/* A magnet consists of methods and their data `self`, which is the caller's and outlives it. */
typedef struct amb_magnet {
  const amb_magnet_methods *methods;
  const void *self;
} amb_magnet;

/* ---- Constant stiffness (paper, eq. 14): `self` is an amb_stiffness. ---- */
extern const amb_magnet_methods amb_constant_magnet;

AMB_EXTERN_C_END

#endif
