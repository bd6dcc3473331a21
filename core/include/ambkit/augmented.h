/* Extended Kalman filter with its state augmented by the magnet constant: `own` is an
 * amb_augmented.
 *
 * The state more is the scale theta = k / known k, the same for all magnets. The whole force of a
 * magnet goes with it, bias force and all: F = theta (F(iu, x) + bias).
 *
 * The augmented filter is kept in two stages (Friedland 1969; with a wandering theta as by Ignagni
 * 1990), which is the same filter written otherwise: the plant's states as if theta were known,
 * with their covariance P; the slope s of their estimate with theta; theta and its variance p. The
 * augmented covariance is P + s p s', s p, p. So P stays as well-conditioned as without theta, p
 * stays positive, and with theta held the filter is the plain extended one, to the last bit.
 *
 * While k and a disturbance force cannot be distinguished (ambkit/excitation.h), theta is held, and
 * the step returns AMB_UNEXCITED.
 */
#ifndef AMBKIT_AUGMENTED_H
#define AMBKIT_AUGMENTED_H

#include "ambkit/estimator.h"
#include "ambkit/excitation.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_augmented {
  amb_real bias[AMB_FORCES]; /* bias force of the known magnet, part of the settings' f_0 [N] */
  amb_real std;   /* standard deviation of theta at the start, and the most it grows to [1], > 0 */
  amb_real var_k; /* growth of its variance in a sample [1], >= 0 */
  amb_real min;   /* limits of theta [1], 0 < min < 1 < max */
  amb_real max;
  amb_excitation_settings learn;
} amb_augmented;

typedef struct amb_augmented_state {
  amb_kalman_state base;      /* its covariance is that of the plant's states */
  amb_real cov[AMB_TRIANGLE]; /* P, with theta known */
  amb_excitation excitation;  /* its slope is s */
  amb_real theta;
  amb_real var;     /* p */
  amb_real trusted; /* theta before control signals were beyond their limit */
} amb_augmented_state;

extern const amb_estimator_methods amb_augmented_methods;

AMB_EXTERN_C_END

#endif
