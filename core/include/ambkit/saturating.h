/* A magnet whose iron has a finite permeability and saturates (Froehlich 1881).
 *
 * Each side pulls with k (i/h)^2, with the effective gap h = (g + e + c i + r)/2 of its air gap g
 * and its current i, r^2 = (g + e - c i)^2 + 4 e c i. With e = c = 0 it is the closed law. Derived
 * in models/laws/saturating.py; the square root is all of libm that it needs.
 */
#ifndef AMBKIT_SATURATING_H
#define AMBKIT_SATURATING_H

#include "ambkit/magnet.h"
#include "ambkit/root.h"

#ifdef __cplusplus
extern "C" {
#endif

/* `self` of amb_saturating_magnet. */
typedef struct amb_saturating_law {
  amb_real k;      /* magnet constant of ideal iron, mu0 A N^2 cos(angle) / 4 [N m^2/A^2] */
  amb_real s0;     /* nominal air gap [m] */
  amb_real i0;     /* bias current [A] */
  amb_real iron;   /* e, the iron as so much more gap, length / (2 mu_r) [m], > 0 */
  amb_real knee;   /* c, mu0 N / (2 Bs): c i is the gap at which i saturates ideal iron [m/A] */
  bool two_sided;  /* two magnets in differential mode; else one, against gravity */
  amb_real ampere; /* as in amb_law */
  amb_real metre;
} amb_saturating_law;

extern const amb_magnet_methods amb_saturating_magnet;

#ifdef __cplusplus
}
#endif

#endif
