#include "plant_model.h"
#include "model.h"

amb_status amb_model_tune(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  amb_rig_tune(&model->rig, value[VR_mass], value[VR_magnet_constant]);
  return AMB_OK;
}

static amb_real current(const amb_model *model, const amb_real value[AMB_VARIABLES])
{
  return amb_rig_current(&model->rig, value[VR_u] + value[VR_noise_u]);
}

/* At rest, and the sensor has settled. */
amb_status amb_model_start(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  const amb_status status = amb_model_tune(model, value);
  const amb_real travel = model->rig.travel;
  model->state.x = amb_clamp(value[VR_start_position], -travel, travel);
  model->state.v = 0;
  model->state.x_m = model->rig.K_sen * model->state.x;
  model->iu = current(model, value);
  return status;
}

void amb_model_sample(amb_model *model, const amb_real value[AMB_VARIABLES])
{
  const amb_plant plant = amb_rig_plant(&model->rig);
  model->iu = current(model, value);
  (void)amb_plant_advance(&plant, &model->state, model->rig.T, model->iu, value[VR_f_d]);
}

void amb_model_show(const amb_model *model, amb_real value[AMB_VARIABLES])
{
  const amb_real x = model->state.x;
  value[VR_x] = x;
  value[VR_v] = model->state.v;
  value[VR_x_m] = model->state.x_m;
  value[VR_y] = model->state.x_m + value[VR_noise_y];
  value[VR_iu] = model->iu;
  value[VR_f_mag] = amb_rig_force(&model->rig, model->iu, x);
}
