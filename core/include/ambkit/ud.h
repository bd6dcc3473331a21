/* Extended Kalman filter on a factor of its covariance, P = U D U', for float: it cannot lose its
 * definiteness.
 *
 * U is unit upper triangular and D diagonal. The prediction orthogonalises [A U, G] under its
 * weights (modified weighted Gram-Schmidt, Thornton 1976), each entry of D a sum of squares; the
 * update is Bierman's (1977). Neither asks for a root, so there is none of libm. No variance is a
 * difference here, so a sensor may be as sharp as it likes.
 *
 * With constant magnets it is the linear filter: forces and tangents are then the linear law's.
 */
#ifndef AMBKIT_UD_H
#define AMBKIT_UD_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

/* Columns of what is made orthogonal: of A U, of each control's noise, and of the growth. */
#define AMB_UD_COLUMNS (2 * AMB_STATES + AMB_CONTROLS)

typedef struct amb_ud_state {
  amb_kalman_state base; /* its cov is U D U', multiplied out */
  amb_real U[AMB_STATES][AMB_STATES];
  amb_real D[AMB_STATES];
  amb_real W[AMB_STATES][AMB_UD_COLUMNS]; /* room for a prediction */
} amb_ud_state;

extern const amb_estimator_methods amb_ud_methods;

AMB_EXTERN_C_END

#endif
