/* Extended Kalman filter with a factored covariance, P = U D U', for float: it cannot lose
 * definiteness.
 *
 * U is unit upper triangular and D diagonal. The prediction orthogonalises [A U, G] with weights
 * (modified weighted Gram-Schmidt, Thornton 1976), each entry of D a sum of squares; the update is
 * Bierman's (1977). Neither needs a square root, so none of libm. No variance is a difference, so a
 * sensor may be arbitrarily accurate.
 *
 * With constant magnets it is the linear filter: forces and tangents are then those of the linear
 * law.
 */
#ifndef AMBKIT_UD_H
#define AMBKIT_UD_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

/* Columns to be orthogonalised: of A U, of each control's noise, and of the process noise. */
#define AMB_UD_COLUMNS (2 * AMB_STATES + AMB_CONTROLS)

typedef struct amb_ud_state {
  amb_kalman_state base; /* its cov is the product U D U' */
  amb_real U[AMB_STATES][AMB_STATES];
  amb_real D[AMB_STATES];
  amb_real W[AMB_STATES][AMB_UD_COLUMNS]; /* workspace of a prediction */
} amb_ud_state;

extern const amb_estimator_methods amb_ud_methods;

AMB_EXTERN_C_END

#endif
