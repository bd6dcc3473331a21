#include "plant_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_rig_tune(&model->rig, value[VR_mass], value[VR_magnet_constant]);
  model->rig.off = value[VR_on] < 0.5;
  return AMB_OK;
}

static amb_real current(const amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_real u = value[VR_fault_u_gain] * (value[VR_u] + value[VR_noise_u]);
  return amb_rig_current(&model->rig, u, value[VR_fault_current]);
}

/* What the sensor shows now, frozen or not. */
static amb_real shown(const amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_plant_state now = amb_rig_now(&model->between, &model->state);
  if (value[VR_fault_frozen] >= 0.5)
    return model->frozen_y;
  return value[VR_fault_y_gain] * amb_parts_reading(plant.sensor, now.X[2], value[VR_noise_y]) +
         value[VR_fault_y_offset];
}

/* At rest, and the sensor has settled. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_real travel = model->rig.travel;
  model->demanded = current(model, value);
  const amb_real x = amb_clamp(value[VR_start_position], -travel, travel);
  amb_plant_settle(&plant, &model->state, &x, &model->demanded);
  model->between.share = 1;
  model->held = 0;
  model->frozen_y = amb_parts_reading(plant.sensor, model->state.X[2], 0);
  return status;
}

void amb_plant_demand(amb_unit *model, const double value[])
{
  model->rig.off = value[VR_on] < 0.5;
  model->demanded = current(model, value);
  if (!(value[VR_fault_frozen] >= 0.5))
    model->frozen_y = shown(model, value);
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_unit_part(model, 0, 1, value);
}

/* Without parts that count in samples, it goes on by whatever is asked. Dead time, amplifier and
 * turning go on from sample to sample: these are what its inputs hold for, and what lies between is
 * glimpsed. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  model->rig.off = value[VR_on] < 0.5;
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_real f_d = value[VR_f_d];
  const amb_acts acts = amb_rig_acts(&model->rig, &model->demanded, &f_d);
  if (!(value[VR_fault_frozen] >= 0.5))
    model->frozen_y = shown(model, value);
  if (!model->rig.with_parts) {
    const amb_real T = ((from > 0) || (to < 1)) ? (to - from) * model->rig.T : model->rig.T;
    model->demanded = current(model, value);
    (void)amb_plant_advance(&plant, &model->state, T, &acts);
    return;
  }
  if (!(from > 0)) {
    model->between.before = model->state;
    model->between.T = model->rig.T;
    model->demanded = current(model, value);
    (void)amb_plant_advance(&plant, &model->state, model->rig.T, &acts);
  }
  model->between.share = to;
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_plant_state now = amb_rig_now(&model->between, &model->state);
  value[VR_x] = now.X[0];
  value[VR_v] = now.X[1];
  value[VR_x_m] = now.X[2];
  value[VR_y] = shown(model, value);
  const amb_acting acting = amb_rig_acting(&model->rig, &now, model->demanded);
  value[VR_iu] = acting.iu;
  value[VR_f_mag] = acting.force;
  amb_plant_show_rates(model, value);
}
