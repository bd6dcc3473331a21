#include "filter.h"
#include "ambkit/root.h"
#include "model.h"

amb_status amb_filter_tune(amb_kalman *filter, const double value[])
{
  amb_kalman_settings set = amb_data_settings;
  for (int r = 0; r < AMB_SENSORS; r++)
    set.var_y[r] = (amb_real)value[FIRST_measurement_variance + r];
  for (int c = 0; c < AMB_CONTROLS; c++) { /* the first noises drive the loads */
    set.var_u[c] = (amb_real)value[FIRST_control_variance + c];
    set.var_d[c] = set.T * (amb_real)value[FIRST_disturbance_growth + c];
  }
  return amb_kalman_init(filter, &amb_data_model, &set);
}

amb_estimator amb_filter_estimator(amb_kalman *filter)
{
  filter->model = amb_data_model;
  const amb_estimator estimator = {&AMB_DATA_METHODS, filter, amb_data_magnet, amb_data_own};
  return estimator;
}

void amb_filter_at(const amb_real place[], const amb_real current[], amb_real mean[AMB_STATES])
{
  for (int i = 0; i < AMB_STATES; i++) {
    mean[i] = amb_data_rest[i];
    for (int c = 0; c < AMB_CONTROLS; c++)
      mean[i] += amb_data_by_place[i * AMB_CONTROLS + c] * place[c] +
                 amb_data_by_current[i * AMB_CONTROLS + c] * current[c];
  }
}

void amb_filter_shown(const amb_kalman *filter, const amb_real y[], amb_real mean[AMB_STATES])
{
  const amb_kalman_settings *set = &filter->set;
  amb_real first[AMB_SENSORS] = {0};
  bool within = true;
  for (int r = 0; r < AMB_SENSORS; r++) {
    const amb_real gain = set->K_sen[r], limit = (gain < 0 ? -gain : gain) * set->travel[r];
    within = within && (y[r] >= -limit) && (y[r] <= limit);
  }
  for (int r = 0; within && (r < AMB_SENSORS); r++)
    first[r] = y[r];
  if (amb_data_start_by == NULL) {
    const amb_real x = first[0] / set->K_sen[0];
    const amb_real current = amb_data_levitation[0] + amb_data_levitation[1] * x;
    amb_filter_at(&x, &current, mean);
    for (int i = 0; i < AMB_STATES; i++)
      mean[i] = (amb_model_role(&filter->model, i) == AMB_SHOWN) ? first[0] : mean[i];
    return;
  }
  for (int i = 0; i < AMB_STATES; i++) {
    mean[i] = amb_data_start[i];
    for (int r = 0; r < AMB_SENSORS; r++)
      mean[i] += amb_data_start_by[i * AMB_SENSORS + r] * first[r];
  }
}

void amb_filter_start(amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      const amb_real mean[AMB_STATES])
{
  const amb_real none[AMB_CONTROLS] = {0};
  const amb_estimator estimator = amb_filter_estimator(filter);
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  (void)estimator.methods->reset(&estimator, state, mean, amb_data_std);
  for (int r = 0; r < AMB_SENSORS; r++) {
    result->innovation[r] = 0;
    result->variance[r] = amb_model_shown_variance(&filter->model, r, base->cov) +
                          (filter->set.var_y[r] + filter->rounding[r]);
    result->health[r] = AMB_OK;
  }
  amb_kalman_stiffness(filter, amb_data_magnet, none, base->mean, result->stiffness);
  result->status = AMB_OK;
}

void amb_filter_carry(const amb_kalman *filter, const amb_data_state *state,
                      const amb_kalman_result *result, bool first, amb_real bias[AMB_STATES])
{
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  bool used[AMB_SENSORS];
  if (amb_data_law_error == NULL)
    return;
  if (first) {
    amb_law_rest(filter, amb_data_law_error, base, bias);
    return;
  }
  for (int r = 0; r < AMB_SENSORS; r++)
    used[r] = (result->health[r] & AMB_UNUSED) == AMB_OK;
  amb_law_step(filter, amb_data_magnet, amb_data_law_error, amb_data_gain, base, used, bias);
}

void amb_filter_show_std(const amb_data_state *state, const amb_real carried[], double *std)
{
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  amb_real variances[AMB_STATES];
  amb_real rest[AMB_STATES] = {0};
  const amb_real *bias = (carried != NULL) ? carried : rest;
  amb_model_variances(&amb_data_model, base->cov, variances);
  if ((amb_data_law_error != NULL) && (carried == NULL)) {
    const amb_kalman filter = {.set = amb_data_settings, .model = amb_data_model};
    amb_law_rest(&filter, amb_data_law_error, base, rest);
  }
  for (int i = 0; i < AMB_STATES; i++) {
    const amb_real variance = variances[i] + bias[i] * bias[i];
    std[i] = (variance > AMB_C(0.0)) ? amb_root(variance) : AMB_C(0.0);
  }
}
