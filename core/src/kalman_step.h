/* The pieces of a step, inline: a whole record becomes one loop whose state stays in registers, and
 * an exported filter one function. Elsewhere the functions of ambkit/kalman.h serve, which are
 * these.
 */
#ifndef AMBKIT_KALMAN_STEP_H
#define AMBKIT_KALMAN_STEP_H

#include "ambkit/envelope.h"

AMB_INLINE amb_real amb_step_current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                                     amb_status *status)
{
  amb_real iu = kf->set.k_ui * u;
  if ((iu >= kf->set.iu_min) && (iu <= kf->set.iu_max)) {
    state->last_u = u;
  } else { /* not finite, or more than there is */
    if (amb_is_finite(u)) {
      state->last_u = u;
    } else {
      *status |= AMB_BAD_CONTROL;
    }
    const amb_real asked = kf->set.k_ui * state->last_u;
    iu = amb_clamp(asked, kf->set.iu_min, kf->set.iu_max);
    if ((iu < asked) || (iu > asked)) {
      *status |= AMB_SATURATED;
    }
  }
  return iu;
}

/* Without measurements the estimate runs away, and most magnets have a pole in the air gap: they
 * are asked where the rotor can be, between the stops. `s`: mean displacement over the sample. */
AMB_INLINE amb_stiffness amb_step_ask(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                                      amb_real s)
{
  const amb_real x_max = kf->set.x_max;
  return magnet->methods->through_origin(magnet->self, iu, amb_clamp(s, -x_max, x_max));
}

/* Force of the magnet [N] and its tangents, asked between the stops and continued along the tangent
 * beyond them. */
AMB_INLINE amb_real amb_step_force(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                                   amb_real s, amb_stiffness *tangent)
{
  const amb_real near = amb_clamp(s, -kf->set.x_max, kf->set.x_max);
  *tangent = magnet->methods->tangent(magnet->self, iu, near);
  return magnet->methods->force(magnet->self, iu, near) + tangent->k_s * (s - near);
}

/* Prediction with the force f [N] that the magnet and what else is known exert; k carries the
 * covariance. The plant is unstable: without measurements mean and covariance grow, and what they
 * have become is contained afterwards. */
AMB_INLINE amb_status amb_step_predict_with(const amb_kalman *kf, amb_kalman_state *state,
                                            amb_real f, amb_stiffness k)
{
  const amb_kalman_settings *s = &kf->set;
  if (!((f * f) <= AMB_REAL_MAX)) { /* not finite, or as good as that */
    return AMB_BAD_PARAMETER;
  }
  amb_axial_predict_mean(&kf->model, f, state->mean);
  amb_axial_predict_covariance(&kf->model, k.k_i, k.k_s, s->k_ui, s->var_u, kf->growth, state->cov);
  return AMB_OK;
}

/* Force of the linear law (eq. 17) and what else is known [N], at the mean displacement s [m]. */
AMB_INLINE amb_real amb_step_linear(const amb_kalman *kf, amb_stiffness k, amb_real iu, amb_real s)
{
  return k.k_i * iu + k.k_s * s + kf->set.f_0;
}

/* The same with the force of the linear law. */
AMB_INLINE amb_status amb_step_predict(const amb_kalman *kf, amb_kalman_state *state,
                                       amb_stiffness k, amb_real iu)
{
  const amb_real s = amb_axial_displacement(&kf->model, state->mean);
  const amb_real f = amb_step_linear(kf, k, iu, s);
  return amb_step_predict_with(kf, state, f, k);
}

/* The mean alone one sample on, by the linear law and without noise. */
AMB_INLINE void amb_step_advance(const amb_kalman *kf, const amb_magnet *magnet, amb_real scale,
                                 amb_real iu, amb_real mean[AMB_AXIAL_STATES])
{
  const amb_real s = amb_axial_displacement(&kf->model, mean);
  const amb_stiffness k = amb_step_ask(kf, magnet, iu, s);
  const amb_real f = scale * (k.k_i * iu + k.k_s * s) + kf->set.f_0;
  amb_axial_predict_mean(&kf->model, f, mean);
}

/* Whether the position is known no better than the travel, or not at all. */
AMB_INLINE bool amb_step_is_lost(const amb_kalman *kf, const amb_kalman_state *state)
{
  return !(state->cov[0] <= kf->widest);
}

/* After each prediction. The call has a copy, so that the state itself stays in registers. */
AMB_INLINE amb_status amb_step_contain(const amb_kalman *kf, amb_kalman_state *state)
{
  if (!amb_step_is_lost(kf, state)) {
    return AMB_OK;
  }
  amb_kalman_state held;
  held = *state;
  const amb_status status = amb_envelope_hold(kf, &held);
  *state = held;
  return status;
}

/* Counts equal measurements; true once they are too many in a row. */
AMB_INLINE bool amb_step_frozen(const amb_kalman *kf, amb_kalman_state *state, amb_real y)
{
  if ((y < state->last_y) || (y > state->last_y)) {
    state->last_y = y;
    state->unchanged = 0U;
    return false;
  }
  if (state->unchanged < kf->set.frozen_limit) {
    state->unchanged++;
  }
  return (kf->set.frozen_limit > 0U) && (state->unchanged >= kf->set.frozen_limit);
}

/* Whether the measurement of innovation e goes on from the last one that was taken in. A load that
 * sets in drives the rotor off its prediction faster than a quiet filter follows, but step by step;
 * what is no rotor jumps. */
AMB_INLINE bool amb_step_goes_on(const amb_kalman *kf, const amb_kalman_state *state, amb_real e)
{
  const amb_real since = kf->set.T * ((amb_real)state->outliers + AMB_C(1.0));
  const amb_real pushed = AMB_SUDDEN * kf->set.K_sen * since * since;
  const amb_real jump = e - state->residual;
  return (jump * jump) <= (AMB_C(2.0) * kf->gate_squared * kf->set.var_y + pushed * pushed);
}

/* Whether an innovation e of variance S is AMB_OUTLIER. Only so many in a row are: the others say
 * that it is the estimate which is wrong, AMB_RESTARTED. */
AMB_INLINE amb_status amb_step_outlier(const amb_kalman *kf, amb_kalman_state *state, amb_real e,
                                       amb_real S)
{
  if (!((e * e) > (kf->gate_squared * S)) || amb_step_goes_on(kf, state, e)) {
    state->outliers = 0U;
    return AMB_OK;
  }
  if (state->outliers < kf->set.outlier_limit) {
    state->outliers++;
    return AMB_OUTLIER;
  }
  return (kf->set.outlier_limit > 0U) ? AMB_RESTARTED : AMB_OK;
}

/* Whether innovations have been larger than expected for a while. */
AMB_INLINE amb_status amb_step_surprised(amb_kalman_state *state, amb_real e, amb_real S)
{
  amb_real share = state->surprise * (AMB_C(1.0) - AMB_C(1.0) / AMB_MEMORY);
  if ((e * e) > (AMB_C(4.0) * S)) {
    share += AMB_C(1.0) / AMB_MEMORY;
  }
  state->surprise = share;
  return (share > AMB_SURPRISING) ? AMB_SURPRISED : AMB_OK;
}

/* What rounding makes of a nearly singular covariance may have no root. Its variances have: the
 * filter goes on from these, and learns the correlations anew. */
AMB_INLINE void amb_step_drop_correlations(amb_real P[AMB_AXIAL_TRIANGLE],
                                           const amb_real variances[AMB_AXIAL_STATES])
{
  P[0] = amb_magnitude(variances[0]);
  P[1] = AMB_C(0.0);
  P[2] = AMB_C(0.0);
  P[3] = AMB_C(0.0);
  P[4] = amb_magnitude(variances[1]);
  P[5] = AMB_C(0.0);
  P[6] = AMB_C(0.0);
  P[7] = amb_magnitude(variances[2]);
  P[8] = AMB_C(0.0);
  P[9] = amb_magnitude(variances[3]);
}

/* What an update leaves behind besides the state. */
typedef struct amb_step_surprise {
  amb_real innovation; /* [m]; 0 where the measurement was not used, but told of an outlier */
  amb_real variance;   /* of the innovation [m^2] */
} amb_step_surprise;

AMB_INLINE amb_status amb_step_update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                                      amb_step_surprise *e)
{
  amb_real *P = state->cov;
  const amb_real before[AMB_AXIAL_STATES] = {P[0], P[4], P[7], P[9]};
  e->innovation = AMB_C(0.0);
  e->variance = P[9] + kf->set.var_y;
  if (!((y * y) <= kf->far_squared)) {
    return AMB_MISSING;
  }
  if (amb_step_frozen(kf, state, y)) {
    return AMB_FROZEN;
  }
  /* Of a variance at least half the digits must be left: after an outage, a sensor much sharper
   * than the estimate is believed step by step. */
  const amb_real least = AMB_ROOT_EPSILON * P[9];
  const bool sharp = !(least <= kf->set.var_y);
  const amb_real var_y = sharp ? least : kf->set.var_y;
  e->variance = P[9] + var_y;
  if ((P[9] > AMB_C(0.0)) && (!sharp || amb_is_finite(e->variance))) {
    const amb_real innovation = y - state->mean[3];
    const amb_status surprised = amb_step_surprised(state, innovation, e->variance);
    const amb_status outlier = amb_step_outlier(kf, state, innovation, e->variance);
    if (outlier != AMB_OK) {
      e->innovation = innovation;
      if (outlier == AMB_RESTARTED) {
        amb_kalman_state fresh; /* a copy, as in amb_step_contain */
        fresh = *state;
        amb_envelope_restart(kf, &fresh, y);
        *state = fresh;
      }
      return surprised | outlier;
    }
    amb_axial_update(y, var_y, state->mean, P, &e->innovation, &e->variance);
    state->residual = y - state->mean[3];
    if ((P[0] > AMB_C(0.0)) && (P[4] > AMB_C(0.0)) && (P[7] > AMB_C(0.0))) {
      return surprised;
    }
  }
  amb_step_drop_correlations(P, before);
  return AMB_BAD_VARIANCE;
}

/* Prediction with the control current iu [A] that acted, then measurement y [m]; adds to `status`,
 * and returns it. The state's own copy stays in registers. Each way out writes for itself: so the
 * usual one moves nothing about for the others. */
AMB_INLINE amb_status amb_step_with(const amb_kalman *kf, amb_stiffness k, amb_real iu,
                                    amb_kalman_state *state, amb_real y, amb_status status,
                                    amb_kalman_result *result)
{
  amb_kalman_state s;
  s = *state;
  s.last_u = state->last_u; /* named, or compilers copy the whole through memory */
  const amb_status predicted = amb_step_predict(kf, &s, k, iu);
  if ((predicted != AMB_OK) || amb_step_is_lost(kf, &s)) {
    amb_kalman_result r;
    *state = s;
    const amb_status held = predicted | amb_step_contain(kf, state);
    const amb_status all = status | held | amb_kalman_update(kf, state, y, &r);
    result->innovation = r.innovation;
    result->variance = r.variance;
    result->stiffness = k;
    result->status = all;
    return all;
  }
  amb_step_surprise e;
  const amb_status all = status | amb_step_update(kf, &s, y, &e);
  *state = s;
  result->innovation = e.innovation;
  result->variance = e.variance;
  result->stiffness = k;
  result->status = all;
  return all;
}

/* A step whose input the caller vouches for: y is a measurement, u is finite and within the
 * amplifier's limits. Nothing is checked, and where the other step finds nothing to say this one
 * leaves the same mean and covariance, to the last bit. */
AMB_INLINE void amb_step_trusted(const amb_kalman *kf, amb_stiffness k, amb_kalman_state *state,
                                 amb_real y, amb_real iu)
{
  const amb_kalman_settings *set = &kf->set;
  amb_real innovation;
  amb_real variance;
  const amb_real s = amb_axial_displacement(&kf->model, state->mean);
  amb_axial_predict_mean(&kf->model, amb_step_linear(kf, k, iu, s), state->mean);
  amb_axial_predict_covariance(&kf->model, k.k_i, k.k_s, set->k_ui, set->var_u, kf->growth,
                               state->cov);
  amb_axial_update(y, set->var_y, state->mean, state->cov, &innovation, &variance);
}

#endif
