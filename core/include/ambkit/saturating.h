/* The force law of saturating iron (models/laws/saturating.py). Written by `python -m models`; do
 * not edit. */
#ifndef AMBKIT_SATURATING_H
#define AMBKIT_SATURATING_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

/* `self` of amb_saturating_magnet. */
typedef struct amb_saturating_law {
  amb_real k;      /* magnet constant of ideal iron, mu0 A N^2 cos(angle) / 4 [N m^2/A^2] */
  amb_real s0;     /* nominal air gap [m] */
  amb_real i0;     /* bias current [A] */
  amb_real iron;   /* e, the iron as so much more gap, length / (2 mu_r) [m], > 0 */
  amb_real knee;   /* c, mu0 N / (2 Bs): c i is the gap at which i saturates ideal iron [m/A] */
  bool two_sided;  /* two magnets in differential mode; else one, against gravity */
  amb_real ampere; /* what the through-origin form takes for equally far: [A] ... */
  amb_real metre;  /* ... and [m]; the paper's least squares steps 0.01 A and 0.01 mm */
} amb_saturating_law;

extern const amb_magnet_methods amb_saturating_magnet;

AMB_EXTERN_C_END

#endif
