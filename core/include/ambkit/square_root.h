/* Extended Kalman filter on a factor of its covariance, P = U D U', for float: it cannot lose its
 * definiteness.
 *
 * U is unit upper triangular and D diagonal. The prediction orthogonalises [A U, G] under its
 * weights (modified weighted Gram-Schmidt, Thornton 1976), each entry of D a sum of squares; the
 * update is Bierman's (1977). Neither asks for a root, so there is none of libm. The measured
 * state is the last one, and the last row of U that of the unit matrix: an update scales one entry
 * of D, and that is all. No variance is a difference here, so a sensor may be as sharp as it likes.
 *
 * With the constant magnet it is the linear filter: force and tangents are then the linear law's.
 */
#ifndef AMBKIT_SQUARE_ROOT_H
#define AMBKIT_SQUARE_ROOT_H

#include "ambkit/estimator.h"

typedef struct amb_square_root_state {
  amb_kalman_state base; /* its cov is U D U', multiplied out */
  amb_real U[AMB_AXIAL_STATES][AMB_AXIAL_STATES];
  amb_real D[AMB_AXIAL_STATES];
} amb_square_root_state;

extern const amb_estimator_methods amb_square_root_methods;

#endif
