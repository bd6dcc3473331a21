/* The bias of an estimate by the error of the filter's own force law.
 *
 * A filter whose law is not the machine's takes the difference of the laws for a disturbance force
 * and follows it: the force has a bias, and while the difference changes, position and velocity
 * have one too. With d, the filter's law less the machine's at the operating point, it goes on as
 * the error of the filter does:
 *
 *   b <- (I - K H) (A b - b_f d)
 *
 * and the mean square error is the covariance plus b b' (Schmidt 1966). At a constant d the bias is
 * -d in the disturbance force. d is a polynomial in current and displacement over (1 - c s^2)^2,
 * which the pull of ideal magnets is, with c of the air gap.
 */
#ifndef AMBKIT_LAW_ERROR_H
#define AMBKIT_LAW_ERROR_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

#define AMB_LAW_DEGREE 5
#define AMB_LAW_TERMS 22 /* of a polynomial in two variables of that degree, and the gap's */

/* Difference of the laws [N] at a current i [A] and a displacement s [m]; c: coefficients of
 * i^p s^q, the highest p first, of each the highest q first, and last 1 / gap^2. */
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
  const amb_real near = AMB_C(1.0) - (c[term] * s * s);
  return error / (near * near);
}

/* The error of force f's law [N] where the rotor is, with the control signals that acted last.
 * laws: of one force after another (forces * AMB_LAW_TERMS). */
AMB_INLINE amb_real amb_law_error_at(const amb_kalman *kf, const amb_real laws[],
                                     const amb_kalman_state *base, const amb_real iu[AMB_CONTROLS],
                                     int f)
{
  const amb_real s = amb_model_displacement(&kf->model, f, base->mean);
  const amb_real x_max = kf->set.x_max[f];
  return amb_law_error(&laws[f * AMB_LAW_TERMS], amb_model_current(&kf->model, f, base->mean, iu),
                       amb_clamp(s, -x_max, x_max));
}

/* Control currents [A] of the control signals that acted last. */
AMB_INLINE void amb_law_currents(const amb_kalman *kf, const amb_kalman_state *base,
                                 amb_real iu[AMB_CONTROLS])
{
  for (int c = 0; c < amb_controls(&kf->model); c++) {
    iu[c] = amb_clamp(kf->set.k_ui[c] * base->last_u[c], kf->set.iu_min[c], kf->set.iu_max[c]);
  }
}

/* The bias of the states where the error of the law has long been what it is now. */
AMB_INLINE void amb_law_rest(const amb_kalman *kf, const amb_real laws[],
                             const amb_kalman_state *base, amb_real bias[AMB_STATES])
{
  amb_real iu[AMB_CONTROLS];
  int f = 0; /* whose disturbance force it is */
  amb_law_currents(kf, base, iu);
  for (int i = 0; i < amb_states(&kf->model); i++) {
    bias[i] = AMB_C(0.0);
    if ((amb_model_role(&kf->model, i) == AMB_LOAD) && (f < amb_forces(&kf->model))) {
      bias[i] = -amb_law_error_at(kf, laws, base, iu, f);
      f++;
    }
  }
}

/* The bias one sample on, after a step. gain: of each innovation where it is constant, [sensors *
 * states]; NULL: that which belongs to the covariance. used: which measurements were. */
AMB_INLINE void amb_law_step(const amb_kalman *kf, const amb_magnet magnets[AMB_FORCES],
                             const amb_real laws[], const amb_real gain[],
                             const amb_kalman_state *base, const bool used[AMB_SENSORS],
                             amb_real bias[AMB_STATES])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  const amb_real none[AMB_CONTROLS] = {0};
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  amb_real predicted[AMB_STATES];
  amb_stiffness k[AMB_FORCES];
  amb_law_currents(kf, base, iu);
  amb_kalman_stiffness(kf, magnets, iu, base->mean, k);
  for (int f = 0; f < amb_forces(model); f++) {
    const amb_real of_bias = (k[f].k_i * amb_model_current(model, f, bias, none)) +
                             (k[f].k_s * amb_model_displacement(model, f, bias));
    F[f] = of_bias - amb_law_error_at(kf, laws, base, iu, f);
  }
  amb_model_predict_mean(model, F, none, bias);
  amb_copy(n, bias, predicted);
  for (int r = 0; r < amb_sensors(model); r++) {
    const amb_real shown = used[r] ? amb_model_shown(model, r, predicted) : AMB_C(0.0);
    amb_real K[AMB_STATES];
    if (gain != NULL) {
      amb_copy(n, &gain[r * n], K);
    } else {
      const amb_real share =
          amb_noise_share(kf->set.rise[r], amb_model_shown(model, r, base->mean));
      const amb_real noise = (kf->set.var_y[r] * share * share) + kf->rounding[r];
      /* No measurement leaves more than its own variance. */
      const amb_real var_y = amb_at_least(noise, amb_model_shown_variance(model, r, base->cov));
      amb_model_shown_with(model, r, base->cov, K);
      for (int i = 0; i < n; i++) {
        K[i] /= var_y;
      }
    }
    for (int i = 0; i < n; i++) {
      bias[i] -= K[i] * shown;
    }
  }
  /* Beyond its cap there is no bias, nor where a state is known by its cap only. */
  amb_real variance[AMB_STATES];
  amb_model_variances(model, base->cov, variance);
  for (int i = 0; i < n; i++) {
    const bool known = variance[i] < (AMB_C(0.99) * kf->widest[i]);
    bias[i] = (known && AMB_WITHIN(bias[i], kf->set.cap[i])) ? bias[i] : AMB_C(0.0);
  }
}

AMB_EXTERN_C_END

#endif
