#include "plant_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  amb_rig_tune(&model->rig, value[VR_mass], value[VR_magnet_constant]);
  return AMB_OK;
}

static amb_real current(const amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  return amb_rig_current(&model->rig, value[VR_u] + value[VR_noise_u]);
}

/* At rest, and the sensor has settled. */
amb_status amb_unit_start(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  const amb_plant plant = amb_rig_plant(&model->rig);
  const amb_real travel = model->rig.travel;
  model->demanded = current(model, value);
  amb_plant_settle(&plant, &model->state, amb_clamp(value[VR_start_position], -travel, travel),
                   model->demanded);
  return status;
}

void amb_unit_sample(amb_unit *model, const amb_real value[AMB_VARIABLES])
{
  const amb_plant plant = amb_rig_plant(&model->rig);
  model->demanded = current(model, value);
  (void)amb_plant_advance(&plant, &model->state, model->rig.T, model->demanded, value[VR_f_d]);
}

void amb_unit_show(const amb_unit *model, amb_real value[AMB_VARIABLES])
{
  const amb_plant plant = amb_rig_plant(&model->rig);
  value[VR_x] = model->state.x;
  value[VR_v] = model->state.v;
  value[VR_x_m] = model->state.x_m;
  value[VR_y] = amb_plant_measure(&plant, model->state.x_m, value[VR_noise_y]);
  value[VR_iu] = amb_plant_until_now(&plant, &model->state, model->demanded).iu;
  value[VR_f_mag] = amb_rig_force(&model->rig, &model->state, model->demanded);
}
