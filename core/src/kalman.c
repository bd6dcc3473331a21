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

static bool good_settings(const amb_model *model, const amb_kalman_settings *s)
{
  bool good = amb_is_positive(s->T) && amb_is_positive(s->gate);
  for (int r = 0; r < amb_sensors(model); r++) {
    good = good && not_zero(s->K_sen[r]) && not_negative(s->lag[r]) &&
           amb_is_positive(s->travel[r]) && amb_is_positive(s->var_y[r]) &&
           amb_is_finite(s->rise[r]);
  }
  for (int c = 0; c < amb_controls(model); c++) {
    good = good && not_zero(s->k_ui[c]) && amb_is_finite(s->iu_min[c]) &&
           amb_is_finite(s->iu_max[c]) && (s->iu_min[c] < s->iu_max[c]) &&
           not_negative(s->var_u[c]);
  }
  for (int f = 0; f < amb_forces(model); f++) {
    good = good && amb_is_finite(s->f_0[f]) && amb_is_positive(s->x_max[f]);
  }
  for (int k = 0; k < amb_noises(model); k++) {
    good = good && not_negative(s->var_d[k]);
  }
  for (int i = 0; i < amb_states(model); i++) {
    good = good && amb_is_positive(s->cap[i]);
  }
  return good;
}

amb_status amb_kalman_init(amb_kalman *kf, const amb_model *model, const amb_kalman_settings *s)
{
  if (!good_settings(model, s)) {
    return AMB_BAD_PARAMETER;
  }
  kf->set = *s;
  kf->model = *model;
  for (int r = 0; r < amb_sensors(model); r++) {
    kf->far[r] = amb_magnitude(AMB_FAR * s->travel[r] * s->K_sen[r]);
  }
  kf->gate_squared = s->gate * s->gate;
  for (int i = 0; i < amb_states(model); i++) {
    kf->widest[i] = s->cap[i] * s->cap[i];
  }
  int entry = 0;
  for (int i = 0; i < amb_states(model); i++) {
    for (int j = i; j < amb_states(model); j++) {
      kf->most[entry] = (AMB_BOUNDLESS * s->cap[i]) * (AMB_BOUNDLESS * s->cap[j]);
      entry++;
    }
  }
  amb_model_growth(model, s->var_d, kf->growth);
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
                            const amb_real mean[AMB_STATES], const amb_real std[AMB_STATES])
{
  const int n = amb_states(&kf->model);
  for (int i = 0; i < n; i++) {
    if (!amb_is_finite(mean[i]) || ((std != NULL) && !amb_is_positive(std[i]))) {
      return AMB_BAD_PARAMETER;
    }
  }
  const bool near = amb_envelope_within(kf, AMB_ASTRAY, mean);
  amb_envelope_open(kf, state->cov);
  int entry = 0;
  for (int i = 0; i < n; i++) {
    state->mean[i] = near ? mean[i] : AMB_C(0.0);
    for (int j = i; j < n; j++) {
      if (near && (std != NULL)) {
        state->cov[entry] = (i == j) ? variance_at_start(std[i], kf->set.cap[i]) : AMB_C(0.0);
      }
      entry++;
    }
  }
  for (int c = 0; c < amb_controls(&kf->model); c++) {
    state->last_u[c] = AMB_C(0.0);
  }
  for (int r = 0; r < amb_sensors(&kf->model); r++) {
    const amb_sensor_state well = {AMB_C(0.0), AMB_C(0.0), AMB_C(0.0), 0U, 0U};
    state->sensor[r] = well;
  }
  return AMB_OK;
}

amb_status amb_kalman_currents(const amb_kalman *kf, amb_kalman_state *state,
                               const amb_real u[AMB_CONTROLS], amb_real iu[AMB_CONTROLS])
{
  return amb_step_currents(kf, state, u, iu);
}

void amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                          amb_stiffness k[AMB_FORCES])
{
  amb_step_ask_all(kf, magnet, iu, mean, k);
}

amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state,
                              const amb_stiffness k[AMB_FORCES], const amb_real iu[AMB_CONTROLS])
{
  const amb_status status = amb_step_predict(kf, state, k, iu);
  return status | amb_step_contain(kf, state);
}

amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state,
                             const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  return amb_step_update_all(kf, state, y, result);
}

amb_status amb_kalman_step(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                           amb_kalman_state *state, const amb_real y[AMB_SENSORS],
                           const amb_real u_previous[AMB_CONTROLS], amb_kalman_result *result)
{
  amb_real iu[AMB_CONTROLS];
  amb_stiffness k[AMB_FORCES];
  const amb_status status = amb_step_currents(kf, state, u_previous, iu);
  amb_step_ask_all(kf, magnet, iu, state->mean, k);
  return amb_step_with(kf, k, iu, state, y, status, result);
}

amb_status amb_kalman_step_given(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES],
                                 amb_kalman_state *state, const amb_real y[AMB_SENSORS],
                                 const amb_real u_previous[AMB_CONTROLS], amb_kalman_result *result)
{
  amb_real iu[AMB_CONTROLS];
  const amb_status status = amb_step_currents(kf, state, u_previous, iu);
  return amb_step_with(kf, k, iu, state, y, status, result);
}
