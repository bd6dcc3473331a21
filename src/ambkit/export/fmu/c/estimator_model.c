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
  amb_kalman_result *result = &model->result;
  if (model->sampled)
    (void)amb_kalman_step(&model->filter, &amb_data_magnet, &model->state, value[VR_y],
                          model->last_u, result);
  else
    result->status = amb_kalman_update(&model->filter, &model->state, value[VR_y], result);
  model->last_u = value[VR_u];
  model->sampled = true;
}

void amb_model_show(const amb_model *model, amb_real value[AMB_VARIABLES])
{
  value[VR_x] = model->state.mean[0];
  value[VR_v] = model->state.mean[1];
  value[VR_f_d] = model->state.mean[2];
  value[VR_x_m] = model->state.mean[3];
  value[VR_k_i] = model->result.stiffness.k_i;
  value[VR_k_s] = model->result.stiffness.k_s;
  value[VR_innovation] = model->result.innovation;
  value[VR_variance] = model->result.variance;
  value[VR_status] = (amb_real)model->result.status;
}
