#include "estimator_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, value[VR_measurement_variance], value[VR_control_variance],
                         value[VR_disturbance_growth]);
}

/* At rest at the measurement, or at the centre where that is beyond the stops. */
amb_status amb_unit_start(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  const amb_kalman_settings *set = &model->filter.set;
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_real reach = set->K_sen[0] * set->travel[0], y = value[VR_y];
  const amb_real first = ((y >= -reach) && (y <= reach)) ? y : AMB_C(0.0);
  const amb_real x = first / set->K_sen[0];
  amb_filter_start(&model->filter, &model->state, &model->result, x, first,
                   amb_data_hover[0] + amb_data_hover[1] * x);
  model->last_u = 0;
  model->sampled = false;
  return AMB_OK;
}

/* As the first sample of a record, the first one is taken in, and not predicted. */
void amb_unit_sample(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  if (model->sampled)
    (void)amb_estimator_step(&estimator, &model->state, &value[VR_y], &model->last_u,
                             &model->result);
  else
    (void)amb_estimator_start(&estimator, &model->state, &value[VR_y], &model->result);
  model->last_u = value[VR_u];
  model->sampled = true;
}

void amb_unit_show(const amb_unit *model, amb_real value[AMB_VARIABLES])
{
  const amb_real *mean = ((const amb_kalman_state *)&model->state)->mean;
  for (int i = 0; i < AMB_STATES; i++) /* they stand together, in their order */
    value[VR_x + i] = mean[i];
  value[VR_k_i] = model->result.stiffness[0].k_i;
  value[VR_k_s] = model->result.stiffness[0].k_s;
  value[VR_innovation] = model->result.innovation[0];
  value[VR_variance] = model->result.variance[0];
  value[VR_status] = (amb_real)model->result.status;
}
