#include "filter.h"
#include "ambkit/root.h"

amb_status amb_filter_tune(amb_kalman *filter, amb_real measurement, amb_real control,
                           amb_real growth)
{
  amb_kalman_settings set = amb_data_settings;
  set.var_y[0] = measurement;
  set.var_u[0] = control;
  set.var_d[0] = set.T * growth; /* the load is the first that grows */
  return amb_kalman_init(filter, &amb_data_model, &set);
}

amb_estimator amb_filter_estimator(const amb_kalman *filter)
{
  const amb_estimator estimator = {&AMB_DATA_METHODS, filter, &amb_data_magnet, amb_data_own};
  return estimator;
}

void amb_filter_start(const amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      amb_real x, amb_real x_m, amb_real current)
{
  const amb_real none[AMB_CONTROLS] = {0};
  amb_real mean[AMB_STATES];
  for (int i = 0; i < amb_states(&filter->model); i++) {
    const amb_role role = amb_model_role(&filter->model, i);
    const amb_real other = (role == AMB_KNOWN) ? current : AMB_C(0.0);
    mean[i] = (role == AMB_POSITION) ? x : ((role == AMB_SHOWN) ? x_m : other);
  }
  const amb_estimator estimator = amb_filter_estimator(filter);
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  (void)estimator.methods->reset(&estimator, state, mean, amb_data_std);
  result->innovation[0] = 0;
  result->variance[0] = amb_model_shown_variance(&filter->model, 0, base->cov) +
                        (filter->set.var_y[0] + filter->rounding[0]);
  result->health[0] = AMB_OK;
  amb_kalman_stiffness(filter, &amb_data_magnet, none, base->mean, result->stiffness);
  result->status = AMB_OK;
}

void amb_filter_show_std(const amb_kalman *filter, const amb_data_state *state, double *std)
{
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  amb_real variances[AMB_STATES];
  amb_model_variances(&filter->model, base->cov, variances);
  for (int i = 0; i < amb_states(&filter->model); i++)
    std[i] = (variances[i] > AMB_C(0.0)) ? amb_root(variances[i]) : AMB_C(0.0);
}
