/* The expert system: a fuzzy basis function network for k_i and k_s (paper, eq. 32-33).
 *
 *   u_r = exp(-|p - c_r|^2 / (2 sigma_r^2)),  p = (iu * per_ampere, x * per_metre)
 *   k   = sum_r w_r u_r                       plain, eq. 33 as printed
 *   k   = sum_r w_r u_r / sum_r u_r           normalised (Wang and Mendel 1992)
 *
 * Far from every rule the nearest one decides: the normalised form never divides by nothing.
 * Outside its box the network answers as at the nearest point of the box.
 */
#ifndef AMBKIT_FUZZY_H
#define AMBKIT_FUZZY_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

#define AMB_FUZZY_MAX_RULES 64

/* One output of the network; arrays of `rules` elements, the caller's. */
typedef struct amb_fuzzy_output {
  const amb_real *sharpness; /* 1 / (2 sigma^2), in scaled units */
  const amb_real *weight;    /* [N/A] or [N/m] */
} amb_fuzzy_output;

typedef struct amb_fuzzy {
  int rules; /* 1 .. AMB_FUZZY_MAX_RULES */
  bool normalised;
  amb_real per_ampere; /* scale of the inputs [1/A] ... */
  amb_real per_metre;  /* ... and [1/m] */
  amb_real iu_min;     /* the box [A] ... */
  amb_real iu_max;
  amb_real x_min; /* ... and [m] */
  amb_real x_max;
  const amb_real *centre_iu; /* rule centres, scaled */
  const amb_real *centre_x;
  amb_fuzzy_output k_i;
  amb_fuzzy_output k_s;
} amb_fuzzy;

extern const amb_magnet_methods amb_fuzzy_magnet;

/* Fuzzy basis functions at (iu, x) [A, m]: out[rules]. The memberships of eq. 32, divided by their
 * sum where the network is normalised, so that k = sum_r w_r out_r. Inputs are held to the box. */
void amb_fuzzy_basis(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real iu, amb_real x,
                     amb_real *out);

AMB_EXTERN_C_END

#endif
