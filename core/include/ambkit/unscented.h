/* Unscented Kalman filter (Julier & Uhlmann 1997, scaled as by van der Merwe 2004): `own` is an
 * amb_unscented.
 *
 * Its 2 n + 1 points are the mean and the mean +- c times the columns of the triangular root of the
 * covariance. Order the states such that the displacement of a magnet is the first: then only the
 * first of the columns moves it, and of what is not known only the displacement enters the magnet's
 * force, the one thing here that is not linear (a current that is a state is as good as known, and
 * enters by its tangent). Of all points three forces are therefore enough, F at x and F+, F- at
 * x +- c sigma_x, and what the transform sums up comes out in closed form:
 *
 *   mean of the force      F + d,  d = (F+ - 2 F + F-) / (2 c^2)
 *   covariance with state  k_s P_x,  k_s = (F+ - F-) / (2 c sigma_x), the secant
 *   variance of the force  k_s^2 P_xx + (c^2 + beta - alpha^2) d^2
 *
 * with c^2 = alpha^2 (n + kappa). The rest is the linear filter's. With c^2 = 3 the mean is that of
 * Gauss and Hermite, exact for a force of fifth order in x.
 */
#ifndef AMBKIT_UNSCENTED_H
#define AMBKIT_UNSCENTED_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_unscented {
  amb_real reach;     /* c: how many standard deviations away the points lie [1], > 0 */
  amb_real curvature; /* c^2 + beta - alpha^2: weight of d^2 [1], >= 0 */
} amb_unscented;

extern const amb_estimator_methods amb_unscented_methods;

AMB_EXTERN_C_END

#endif
