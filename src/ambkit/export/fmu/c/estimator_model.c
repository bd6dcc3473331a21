#include "estimator_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, (amb_real)value[VR_measurement_variance],
                         (amb_real)value[VR_control_variance],
                         (amb_real)value[VR_disturbance_growth]);
}

/* At rest at the measurement, or at the centre where that is beyond the stops. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_kalman_settings *set = &model->filter.set;
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_real reach = set->K_sen[0] * set->travel[0], y = (amb_real)value[VR_y];
  const amb_real first = ((y >= -reach) && (y <= reach)) ? y : AMB_C(0.0);
  const amb_real x = first / set->K_sen[0];
  amb_filter_start(&model->filter, &model->state, &model->result, x, first,
                   amb_data_hover[0] + amb_data_hover[1] * x);
  model->last_u = 0;
  model->sampled = false;
  return AMB_OK;
}

/* As the first sample of a record, the first one is taken in, and not predicted. */
void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_real y[AMB_SENSORS] = {(amb_real)value[VR_y]};
  if (model->sampled)
    (void)amb_estimator_step(&estimator, &model->state, y, &model->last_u, &model->result);
  else
    (void)amb_estimator_start(&estimator, &model->state, y, &model->result);
  model->last_u = (amb_real)value[VR_u];
  model->sampled = true;
}

/* It looks at its inputs when a sample begins, and not in between. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_real *mean = ((const amb_kalman_state *)&model->state)->mean;
  for (int i = 0; i < AMB_STATES; i++) /* they stand together, in their order */
    value[VR_x + i] = mean[i];
  amb_filter_show_std(&model->filter, &model->state, &value[VR_std_x]);
  value[VR_k_i] = model->result.stiffness[0].k_i;
  value[VR_k_s] = model->result.stiffness[0].k_s;
  value[VR_innovation] = model->result.innovation[0];
  value[VR_variance] = model->result.variance[0];
  value[VR_status] = (double)model->result.status;
}
