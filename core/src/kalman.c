#include "ambkit/kalman.h"
#include <string.h>

static bool positive(amb_real a)
{
  return (a > 0) && (a <= AMB_REAL_MAX);
}

static bool not_negative(amb_real a)
{
  return amb_is_finite(a) && (a >= 0);
}

static bool not_zero(amb_real a)
{
  return amb_is_finite(a) && ((a > 0) || (a < 0));
}

amb_status amb_kalman_init(amb_kalman *kf, const amb_kalman_settings *s)
{
  const bool good = positive(s->T) && positive(s->m) && not_zero(s->K_sen) && positive(s->T_sen) &&
                    not_zero(s->k_ui) && amb_is_finite(s->f_0) && amb_is_finite(s->iu_min) &&
                    amb_is_finite(s->iu_max) && (s->iu_min < s->iu_max) && positive(s->x_max) &&
                    not_negative(s->var_u) && not_negative(s->var_d) && positive(s->var_y);
  if (!good)
    return AMB_BAD_PARAMETER;
  kf->set = *s;
  amb_axial_model_init(&kf->model, s->T, s->m, s->K_sen, s->T_sen);
  return AMB_OK;
}

amb_status amb_kalman_reset(amb_kalman_state *state, const amb_real mean[AMB_AXIAL_STATES],
                            const amb_real std[AMB_AXIAL_STATES])
{
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    if (!amb_is_finite(mean[i]) || !positive(std[i]))
      return AMB_BAD_PARAMETER;
  }
  int entry = 0;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    state->mean[i] = mean[i];
    for (int j = i; j < AMB_AXIAL_STATES; j++)
      state->cov[entry++] = i == j ? std[i] * std[i] : AMB_C(0.0);
  }
  state->last_u = 0;
  state->last_y = 0;
  state->unchanged = 0;
  return AMB_OK;
}

/* A control signal that is not finite, or asks for more than there is. */
static amb_real beyond(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                       amb_status *status)
{
  if (amb_is_finite(u))
    state->last_u = u;
  else
    *status |= AMB_BAD_CONTROL;
  const amb_real iu = kf->set.k_ui * state->last_u;
  const amb_real held = amb_clamp(iu, kf->set.iu_min, kf->set.iu_max);
  if ((held < iu) || (held > iu))
    *status |= AMB_SATURATED;
  return held;
}

AMB_INLINE amb_real current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                            amb_status *status)
{
  const amb_real iu = kf->set.k_ui * u;
  if (!((iu >= kf->set.iu_min) && (iu <= kf->set.iu_max)))
    return beyond(kf, state, u, status);
  state->last_u = u;
  return iu;
}

/* The pieces of a step are static, so that amb_kalman_run becomes one loop whose state stays in
 * registers; the public functions below are these pieces. */

/* Without measurements the estimate runs away, and most magnets have a pole in the air gap: they
 * are asked where the rotor can be, between the stops. */
AMB_INLINE amb_stiffness ask(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                             amb_real x)
{
  const amb_real x_max = kf->set.x_max;
  return magnet->methods->through_origin(magnet->self, iu, amb_clamp(x, -x_max, x_max));
}

AMB_INLINE amb_status predict(const amb_kalman *kf, amb_kalman_state *state, amb_stiffness k,
                              amb_real iu)
{
  const amb_kalman_settings *s = &kf->set;
  /* The plant is unstable: without measurements mean and covariance grow until they overflow.
   * The stops bound the rotor, so once nothing is known but that it is between them, nothing more
   * is lost by standing still, and the filter finds back at the first good sample. */
  if (!(state->cov[0] <= s->x_max * s->x_max))
    return AMB_HELD;
  const amb_real f = k.k_i * iu + k.k_s * state->mean[0] + s->f_0;
  if (!amb_is_finite(f))
    return AMB_BAD_PARAMETER;
  amb_axial_predict_mean(&kf->model, f, state->mean);
  amb_axial_predict_covariance(&kf->model, k.k_i, k.k_s, s->k_ui, s->var_u, s->var_d, state->cov);
  return AMB_OK;
}

/* Counts equal measurements; true once they are too many in a row. */
AMB_INLINE bool frozen(const amb_kalman *kf, amb_kalman_state *state, amb_real y)
{
  const bool moved = (y < state->last_y) || (y > state->last_y);
  state->last_y = y;
  if (moved)
    state->unchanged = 0;
  else if (state->unchanged < kf->set.frozen_limit)
    state->unchanged++;
  return (kf->set.frozen_limit > 0) && (state->unchanged >= kf->set.frozen_limit);
}

static amb_real magnitude(amb_real a)
{
  return a < 0 ? -a : a;
}

/* What rounding makes of a nearly singular covariance may have no root. Its variances have: the
 * filter goes on from these, and learns the correlations anew. */
AMB_INLINE void drop_correlations(amb_real P[AMB_AXIAL_TRIANGLE],
                                  const amb_real variances[AMB_AXIAL_STATES])
{
  P[0] = magnitude(variances[0]);
  P[1] = P[2] = P[3] = 0;
  P[4] = magnitude(variances[1]);
  P[5] = P[6] = 0;
  P[7] = magnitude(variances[2]);
  P[8] = 0;
  P[9] = magnitude(variances[3]);
}

AMB_INLINE amb_status update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                             amb_kalman_result *result)
{
  const amb_real far = AMB_FAR * kf->set.x_max * kf->set.K_sen;
  amb_real *P = state->cov;
  result->innovation = 0;
  result->variance = P[9] + kf->set.var_y;
  if (!(y * y <= far * far))
    return AMB_MISSING;
  if (frozen(kf, state, y))
    return AMB_FROZEN;
  /* Of a variance at least half the digits must be left: after an outage, a sensor much sharper
   * than the estimate is believed step by step. */
  const amb_real least = AMB_ROOT_EPSILON * P[9];
  const amb_real var_y = kf->set.var_y > least ? kf->set.var_y : least;
  result->variance = P[9] + var_y;
  const amb_real before[AMB_AXIAL_STATES] = {P[0], P[4], P[7], P[9]};
  if (positive(result->variance)) {
    amb_axial_update(y, var_y, state->mean, P, &result->innovation, &result->variance);
    if ((P[0] > 0) && (P[4] > 0) && (P[7] > 0) && (P[9] > 0))
      return AMB_OK;
  }
  drop_correlations(P, before);
  return AMB_BAD_VARIANCE;
}

amb_real amb_kalman_current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                            amb_status *status)
{
  return current(kf, state, u, status);
}

amb_stiffness amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                                   amb_real x)
{
  return ask(kf, magnet, iu, x);
}

amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state, amb_stiffness k,
                              amb_real iu)
{
  return predict(kf, state, k, iu);
}

amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                             amb_kalman_result *result)
{
  return update(kf, state, y, result);
}

/* The state's own copy stays in registers. Each way out writes it for itself: so the usual one
 * moves nothing about for the others, which saves a Cortex-M4 one instruction in ten. */
amb_status amb_kalman_step(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                           amb_real y, amb_real u, amb_kalman_result *result)
{
  amb_kalman_result r;
  r.status = AMB_OK;
  const amb_real iu = current(kf, state, u, &r.status);
  r.stiffness = ask(kf, magnet, iu, state->mean[0]);
  amb_kalman_state s = *state;
  s.last_u = state->last_u; /* named, or compilers copy the whole through memory */
  const amb_status predicted = predict(kf, &s, r.stiffness, iu);
  if (predicted != AMB_OK) {
    *result = r;
    result->status |= predicted | amb_kalman_update(kf, state, y, result);
    return result->status;
  }
  const amb_status updated = update(kf, &s, y, &r);
  *state = s;
  *result = r;
  result->status |= updated;
  return result->status;
}

amb_real amb_kalman_forecast(const amb_kalman *kf, const amb_magnet *magnet,
                             const amb_real mean[AMB_AXIAL_STATES], const amb_real *u, size_t ahead)
{
  const amb_kalman_settings *s = &kf->set;
  amb_real m[AMB_AXIAL_STATES];
  memcpy(m, mean, sizeof m);
  for (size_t j = 0; j < ahead; j++) {
    const amb_real iu = amb_clamp(s->k_ui * u[j], s->iu_min, s->iu_max);
    const amb_stiffness k = ask(kf, magnet, iu, m[0]);
    amb_axial_predict_mean(&kf->model, k.k_i * iu + k.k_s * m[0] + s->f_0, m);
  }
  return m[AMB_AXIAL_STATES - 1];
}

static void note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                 const amb_kalman_history *h)
{
  memcpy(h->mean + k * AMB_AXIAL_STATES, state->mean, sizeof state->mean);
  h->innovation[k] = result->innovation;
  h->variance[k] = result->variance;
  h->k_i[k] = result->stiffness.k_i;
  h->k_s[k] = result->stiffness.k_s;
  h->status[k] = (unsigned char)result->status;
  if (h->cov != NULL)
    memcpy(h->cov + k * AMB_AXIAL_TRIANGLE, state->cov, sizeof state->cov);
}

void amb_kalman_note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                     const amb_kalman_history *history)
{
  note(state, result, k, history);
}

amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                          const amb_kalman_input *in, const amb_kalman_history *history)
{
  const amb_kalman own = *kf; /* copies: nothing that is written can be part of them */
  const amb_kalman_history h = *history;
  amb_kalman_state s = *state;
  amb_kalman_result result = {0, 0, {0, 0}, AMB_OK};
  amb_status all = AMB_OK;
  const bool given = (in->k_i != NULL) && (in->k_s != NULL);
  for (size_t k = 0; k < in->n; k++) {
    const size_t acted = k > 0 ? k - 1 : 0;
    result.status = AMB_OK;
    const amb_real iu = k > 0 ? current(&own, &s, in->u[acted], &result.status) : AMB_C(0.0);
    if (given) {
      result.stiffness.k_i = in->k_i[acted];
      result.stiffness.k_s = in->k_s[acted];
    } else {
      result.stiffness = ask(&own, magnet, iu, s.mean[0]);
    }
    if (k > 0)
      result.status |= predict(&own, &s, result.stiffness, iu);
    result.status |= update(&own, &s, in->y[k], &result);
    all |= result.status;
    note(&s, &result, k, &h);
  }
  *state = s;
  return all;
}
