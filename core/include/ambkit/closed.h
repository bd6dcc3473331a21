/* The closed force law (models/laws/closed.py). Written by `python -m models`; do not edit. */
#ifndef AMBKIT_CLOSED_H
#define AMBKIT_CLOSED_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

/* `self` of amb_law_magnet. */
typedef struct amb_law {
  amb_real k;      /* magnet constant of ideal iron, mu0 A N^2 cos(angle) / 4 [N m^2/A^2] */
  amb_real s0;     /* nominal air gap [m] */
  amb_real i0;     /* bias current [A] */
  bool two_sided;  /* two magnets in differential mode; else one, against gravity */
  amb_real ampere; /* what the through-origin form takes for equally far: [A] ... */
  amb_real metre;  /* ... and [m]; the paper's least squares steps 0.01 A and 0.01 mm */
} amb_law;

extern const amb_magnet_methods amb_law_magnet;

AMB_EXTERN_C_END

#endif
