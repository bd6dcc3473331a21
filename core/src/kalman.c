#include "ambkit/kalman.h"
#include <string.h>

static bool positive(amb_real a)
{
  return amb_is_finite(a) && (a > 0);
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

amb_real amb_kalman_current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
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

amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state, amb_stiffness k,
                              amb_real iu)
{
  const amb_kalman_settings *s = &kf->set;
  amb_real mean[AMB_AXIAL_STATES], cov[AMB_AXIAL_TRIANGLE];
  memcpy(mean, state->mean, sizeof mean);
  memcpy(cov, state->cov, sizeof cov);
  amb_axial_predict_mean(&kf->model, k.k_i * iu + k.k_s * mean[0] + s->f_0, mean);
  amb_axial_predict_covariance(&kf->model, k.k_i, k.k_s, s->k_ui, s->var_u, s->var_d, cov);
  /* The plant is unstable: without measurements mean and covariance grow until they overflow.
   * The stops bound the rotor, so beyond them nothing more is lost by standing still, and the
   * filter finds back at the first good sample. NaN fails the comparison too. */
  if (!(cov[0] <= s->x_max * s->x_max) || !amb_is_finite(mean[0] + mean[1] + mean[3]))
    return AMB_HELD;
  memcpy(state->mean, mean, sizeof mean);
  memcpy(state->cov, cov, sizeof cov);
  return AMB_OK;
}

/* Counts equal measurements; true once they are too many in a row. */
static bool frozen(const amb_kalman *kf, amb_kalman_state *state, amb_real y)
{
  const bool moved = (y < state->last_y) || (y > state->last_y);
  if (moved)
    state->unchanged = 0;
  else if (state->unchanged < kf->set.frozen_limit)
    state->unchanged++;
  state->last_y = y;
  return (kf->set.frozen_limit > 0) && (state->unchanged >= kf->set.frozen_limit);
}

amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                             amb_kalman_result *result)
{
  result->innovation = 0;
  result->variance = state->cov[AMB_AXIAL_TRIANGLE - 1] + kf->set.var_y;
  if (!amb_is_finite(y))
    return AMB_MISSING;
  if (frozen(kf, state, y))
    return AMB_FROZEN;
  if (!positive(result->variance))
    return AMB_BAD_VARIANCE;
  amb_axial_update(y, kf->set.var_y, state->mean, state->cov, &result->innovation,
                   &result->variance);
  return AMB_OK;
}

amb_status amb_kalman_step(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                           amb_real y, amb_real u, amb_kalman_result *result)
{
  result->status = AMB_OK;
  const amb_real iu = amb_kalman_current(kf, state, u, &result->status);
  result->stiffness = magnet->methods->through_origin(magnet->self, iu, state->mean[0]);
  result->status |= amb_kalman_predict(kf, state, result->stiffness, iu);
  result->status |= amb_kalman_update(kf, state, y, result);
  return result->status;
}

void amb_kalman_note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                     const amb_kalman_history *h)
{
  memcpy(h->mean + k * AMB_AXIAL_STATES, state->mean, sizeof state->mean);
  if (h->cov != NULL)
    memcpy(h->cov + k * AMB_AXIAL_TRIANGLE, state->cov, sizeof state->cov);
  if (h->innovation != NULL)
    h->innovation[k] = result->innovation;
  if (h->variance != NULL)
    h->variance[k] = result->variance;
  if (h->k_i != NULL)
    h->k_i[k] = result->stiffness.k_i;
  if (h->k_s != NULL)
    h->k_s[k] = result->stiffness.k_s;
  if (h->status != NULL)
    h->status[k] = (unsigned char)result->status;
}

static amb_status step_with_given(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                                  amb_real u, amb_kalman_result *result)
{
  result->status = AMB_OK;
  const amb_real iu = amb_kalman_current(kf, state, u, &result->status);
  result->status |= amb_kalman_predict(kf, state, result->stiffness, iu);
  result->status |= amb_kalman_update(kf, state, y, result);
  return result->status;
}

amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                          const amb_kalman_input *in, const amb_kalman_history *history)
{
  amb_status all = AMB_OK;
  const bool given = (in->k_i != NULL) && (in->k_s != NULL);
  amb_kalman_result result = {0, 0, {0, 0}, AMB_OK};
  for (size_t k = 0; k < in->n; k++) {
    if (given) {
      const size_t acted = k > 0 ? k - 1 : 0;
      result.stiffness.k_i = in->k_i[acted];
      result.stiffness.k_s = in->k_s[acted];
    }
    if (k == 0) {
      if (!given)
        result.stiffness = magnet->methods->through_origin(magnet->self, 0, state->mean[0]);
      result.status = amb_kalman_update(kf, state, in->y[0], &result);
    } else if (given) {
      (void)step_with_given(kf, state, in->y[k], in->u[k - 1], &result);
    } else {
      (void)amb_kalman_step(kf, magnet, state, in->y[k], in->u[k - 1], &result);
    }
    all |= result.status;
    amb_kalman_note(state, &result, k, history);
  }
  return all;
}
