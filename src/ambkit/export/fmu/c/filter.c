#include "filter.h"

amb_status amb_filter_tune(amb_kalman *filter, amb_real measurement, amb_real control,
                           amb_real growth)
{
  amb_kalman_settings set = amb_data_settings;
  set.var_y = measurement;
  set.var_u = control;
  set.var_d = set.T * growth;
  return amb_kalman_init(filter, &set);
}

amb_estimator amb_filter_estimator(const amb_kalman *filter)
{
  const amb_estimator estimator = {&AMB_DATA_METHODS, filter, &amb_data_magnet, amb_data_own};
  return estimator;
}

void amb_filter_start(const amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      amb_real x, amb_real x_m)
{
  const amb_real mean[AMB_AXIAL_STATES] = {x, 0, 0, x_m};
  const amb_estimator estimator = amb_filter_estimator(filter);
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  (void)estimator.methods->reset(&estimator, state, mean, amb_data_std);
  result->innovation = 0;
  result->variance = base->cov[AMB_AXIAL_TRIANGLE - 1] + filter->set.var_y;
  result->stiffness = amb_kalman_stiffness(filter, &amb_data_magnet, 0, x);
  result->status = AMB_OK;
}
