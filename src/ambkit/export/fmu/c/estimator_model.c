#include "estimator_model.h"
#include "model.h"

amb_status amb_model_tune(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, value[VR_measurement_variance], value[VR_control_variance],
                         value[VR_disturbance_growth]);
}

/* At rest at the measurement, or at the centre where that is beyond the stops. */
amb_status amb_model_start(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  const amb_kalman_settings *set = &model->filter.set;
  const amb_status status = amb_model_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_real reach = set->K_sen * set->x_max, y = value[VR_y];
  const amb_real first = ((y >= -reach) && (y <= reach)) ? y : AMB_C(0.0);
  amb_filter_start(&model->filter, &model->state, &model->result, first / set->K_sen, first);
  model->last_u = 0;
  model->sampled = false;
  return AMB_OK;
}

/* As the first sample of a record, the first one is taken in, and not predicted. */
void amb_model_sample(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  if (model->sampled)
    (void)amb_estimator_step(&estimator, &model->state, value[VR_y], model->last_u, &model->result);
  else
    (void)amb_estimator_start(&estimator, &model->state, value[VR_y], &model->result);
  model->last_u = value[VR_u];
  model->sampled = true;
}

void amb_model_show(const amb_model *model, amb_real value[AMB_VARIABLES])
{
  const amb_real *mean = ((const amb_kalman_state *)&model->state)->mean;
  value[VR_x] = mean[0];
  value[VR_v] = mean[1];
  value[VR_f_d] = mean[2];
  value[VR_x_m] = mean[3];
  value[VR_k_i] = model->result.stiffness.k_i;
  value[VR_k_s] = model->result.stiffness.k_s;
  value[VR_innovation] = model->result.innovation;
  value[VR_variance] = model->result.variance;
  value[VR_status] = (amb_real)model->result.status;
}
