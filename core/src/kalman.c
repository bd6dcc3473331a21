#include "ambkit/envelope.h"
#include "kalman_step.h"

static bool not_negative(amb_real a)
{
  return amb_is_finite(a) && (a >= AMB_C(0.0));
}

static bool not_zero(amb_real a)
{
  return amb_is_finite(a) && ((a > AMB_C(0.0)) || (a < AMB_C(0.0)));
}

amb_status amb_kalman_init(amb_kalman *kf, const amb_kalman_settings *s)
{
  const bool good = amb_is_positive(s->T) && amb_is_positive(s->m) && not_zero(s->K_sen) &&
                    amb_is_positive(s->T_sen) && not_zero(s->k_ui) && amb_is_finite(s->f_0) &&
                    amb_is_finite(s->iu_min) && amb_is_finite(s->iu_max) &&
                    (s->iu_min < s->iu_max) && amb_is_positive(s->x_max) &&
                    not_negative(s->var_u) && not_negative(s->var_d) && amb_is_positive(s->var_y) &&
                    amb_is_positive(s->gate);
  if (!good) {
    return AMB_BAD_PARAMETER;
  }
  const amb_real farthest = AMB_FAR * s->x_max * s->K_sen;
  kf->set = *s;
  kf->far_squared = farthest * farthest;
  kf->gate_squared = s->gate * s->gate;
  kf->widest = s->x_max * s->x_max;
  amb_envelope_caps(s, kf->cap);
  amb_axial_model_init(&kf->model, s->T, s->m, s->K_sen, s->T_sen);
  if (s->as_printed) {
    amb_axial_model_as_printed(&kf->model);
  }
  amb_axial_growth(&kf->model, s->var_d, kf->growth);
  return AMB_OK;
}

/* Not more than the rotor can do, and not less than there are digits for. */
static amb_real variance_at_start(amb_real std, amb_real cap)
{
  const amb_real least = (AMB_ROOT_EPSILON * AMB_ROOT_EPSILON) * cap;
  const amb_real taken = amb_clamp(std, least, cap);
  return taken * taken;
}

amb_status amb_kalman_reset(const amb_kalman *kf, amb_kalman_state *state,
                            const amb_real mean[AMB_AXIAL_STATES],
                            const amb_real std[AMB_AXIAL_STATES])
{
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    if (!amb_is_finite(mean[i]) || ((std != NULL) && !amb_is_positive(std[i]))) {
      return AMB_BAD_PARAMETER;
    }
  }
  const bool near = amb_envelope_within(kf, AMB_ASTRAY, mean);
  amb_envelope_open(kf, state->cov);
  int entry = 0;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    state->mean[i] = near ? mean[i] : AMB_C(0.0);
    for (int j = i; j < AMB_AXIAL_STATES; j++) {
      if (near && (std != NULL)) {
        state->cov[entry] = (i == j) ? variance_at_start(std[i], kf->cap[i]) : AMB_C(0.0);
      }
      entry++;
    }
  }
  state->last_u = AMB_C(0.0);
  state->last_y = AMB_C(0.0);
  state->residual = AMB_C(0.0);
  state->surprise = AMB_C(0.0);
  state->unchanged = 0U;
  state->outliers = 0U;
  return AMB_OK;
}

amb_real amb_kalman_current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                            amb_status *status)
{
  return amb_step_current(kf, state, u, status);
}

amb_stiffness amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                                   amb_real x)
{
  return amb_step_ask(kf, magnet, iu, x);
}

amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state, amb_stiffness k,
                              amb_real iu)
{
  const amb_status status = amb_step_predict(kf, state, k, iu);
  return status | amb_step_contain(kf, state);
}

amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                             amb_kalman_result *result)
{
  amb_step_surprise e;
  const amb_status status = amb_step_update(kf, state, y, &e);
  result->innovation = e.innovation;
  result->variance = e.variance;
  return status;
}

amb_status amb_kalman_step(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                           amb_real y, amb_real u, amb_kalman_result *result)
{
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, state, u, &status);
  const amb_real s = amb_axial_displacement(&kf->model, state->mean);
  const amb_stiffness k = amb_step_ask(kf, magnet, iu, s);
  return amb_step_with(kf, k, iu, state, y, status, result);
}

amb_status amb_kalman_step_given(const amb_kalman *kf, amb_stiffness k, amb_kalman_state *state,
                                 amb_real y, amb_real u, amb_kalman_result *result)
{
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, state, u, &status);
  return amb_step_with(kf, k, iu, state, y, status, result);
}
