/* Extended Kalman filter with the magnet constant as a fifth state: `own` is an amb_extended_k.
 *
 * The fifth state is the scale theta = k / known k. The whole force of the magnet goes with it,
 * bias force and all: F = theta (F(iu, x) + bias).
 *
 * The filter of five states is kept in two stages (Friedland 1969; with a wandering theta as by
 * Ignagni 1990), which is the same filter written otherwise: the four states as if theta were
 * known, with their covariance P; the slope s of their estimate with theta; theta and its variance
 * p. The five states' covariance is P + s p s', s p, p. So P stays as well-conditioned as that of
 * four states, p stays positive, and with theta held the filter is the plain extended one, to the
 * last bit.
 *
 * Held it is where k and a load cannot be told apart (ambkit/excitation.h), and the step says
 * AMB_UNEXCITED.
 */
#ifndef AMBKIT_EXTENDED_K_H
#define AMBKIT_EXTENDED_K_H

#include "ambkit/estimator.h"
#include "ambkit/excitation.h"

typedef struct amb_extended_k {
  amb_real bias;  /* bias force of the known magnet, part of the settings' f_0 [N] */
  amb_real std;   /* standard deviation of theta at the start, and the most it grows to [1], > 0 */
  amb_real var_k; /* growth of its variance in a sample [1], >= 0 */
  amb_real min;   /* limits of theta [1], 0 < min < 1 < max */
  amb_real max;
  amb_excitation_settings learn;
} amb_extended_k;

typedef struct amb_extended_k_state {
  amb_kalman_state base;            /* its covariance is that of the first four of five states */
  amb_real cov[AMB_AXIAL_TRIANGLE]; /* P, with theta known */
  amb_excitation excitation;        /* its slope is s */
  amb_real theta;
  amb_real var;     /* p */
  amb_real trusted; /* theta before control signals were beyond their limit */
} amb_extended_k_state;

extern const amb_estimator_methods amb_extended_k_methods;

#endif
