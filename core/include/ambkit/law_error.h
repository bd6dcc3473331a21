/* The error of an estimated disturbance force by the filter's own force law.
 *
 * A filter whose law is not the machine's takes the difference for a disturbance force and follows
 * it: position and velocity stay right, the force has a bias. Its mean square error is its variance
 * plus the square of that bias (Schmidt 1966), which depends on the operating point: a polynomial
 * in current and displacement.
 */
#ifndef AMBKIT_LAW_ERROR_H
#define AMBKIT_LAW_ERROR_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

#define AMB_LAW_DEGREE 5
#define AMB_LAW_TERMS 21 /* of a polynomial in two variables of that degree */

/* Difference of the laws [N] at a current i [A] and a displacement s [m]; c: coefficients of
 * i^p s^q, the highest p first, of each the highest q first. */
AMB_INLINE amb_real amb_law_error(const amb_real c[AMB_LAW_TERMS], amb_real i, amb_real s)
{
  amb_real error = AMB_C(0.0);
  int term = 0;
  for (int p = AMB_LAW_DEGREE; p >= 0; p--) {
    amb_real of_power = AMB_C(0.0);
    for (int q = p; q <= AMB_LAW_DEGREE; q++) {
      of_power = (of_power * s) + c[term];
      term++;
    }
    error = (error * i) + of_power;
  }
  return error;
}

/* What the laws' difference adds to the variance of state j: of a disturbance force its square
 * [N^2], of others 0. laws: of one force after another (forces * AMB_LAW_TERMS); u [V]: the control
 * signals that acted last. */
AMB_INLINE amb_real amb_law_variance(const amb_model *model, const amb_kalman_settings *set,
                                     const amb_real laws[], const amb_real mean[AMB_STATES],
                                     const amb_real u[AMB_CONTROLS], int j)
{
  int f = 0; /* whose disturbance force it is */
  for (int i = 0; i < j; i++) {
    f += (amb_model_role(model, i) == AMB_LOAD) ? 1 : 0;
  }
  if ((amb_model_role(model, j) != AMB_LOAD) || (f >= amb_forces(model))) {
    return AMB_C(0.0);
  }
  amb_real iu[AMB_CONTROLS];
  for (int c = 0; c < amb_controls(model); c++) {
    iu[c] = amb_clamp(set->k_ui[c] * u[c], set->iu_min[c], set->iu_max[c]);
  }
  const amb_real s = amb_model_displacement(model, f, mean);
  const amb_real x_max = set->x_max[f];
  const amb_real error = amb_law_error(
      &laws[f * AMB_LAW_TERMS], amb_model_current(model, f, mean, iu), amb_clamp(s, -x_max, x_max));
  return error * error;
}

AMB_EXTERN_C_END

#endif
