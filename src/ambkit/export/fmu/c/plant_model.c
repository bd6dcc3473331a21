#include "plant_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_rig_tune(&model->rig, value);
  model->rig.off = value[VR_on] < 0.5;
  return AMB_OK;
}

static void currents(const double value[], int axes, amb_real demanded[])
{
  for (int f = 0; f < axes; f++) {
    const amb_real u =
        value[FIRST_fault_u_gain + f] * (value[FIRST_u + f] + value[FIRST_noise_u + f]);
    demanded[f] = amb_rig_current(f, u, value[FIRST_fault_current + f]);
  }
}

static bool frozen(const double value[], int r)
{
  return value[FIRST_fault_frozen + r] >= 0.5;
}

/* Output of a sensor, frozen or not. */
static amb_real displayed(const amb_unit *model, const amb_plant *plant, const amb_plant_state *now,
                          int r, const double value[])
{
  if (frozen(value, r))
    return model->frozen_y[r];
  const amb_real x_m = now->X[plant->shows[r]], noise = value[FIRST_noise_y + r];
  return value[FIRST_fault_y_gain + r] * amb_parts_reading(&plant->sensor[r], x_m, noise) +
         value[FIRST_fault_y_offset + r];
}

static void keep(amb_unit *model, const amb_plant *plant, const double value[])
{
  const amb_plant_state now = amb_rig_now(plant, &model->between, &model->state);
  for (int r = 0; r < plant->sensors; r++)
    if (!frozen(value, r))
      model->frozen_y[r] = displayed(model, plant, &now, r, value);
}

/* In equilibrium, with settled sensors. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  amb_real place[AMB_PLANT_AXES];
  currents(value, plant.axes, model->demanded);
  amb_rig_settle(&plant, &model->state, value, model->demanded, place);
  model->between.share = 1;
  model->held = 0;
  for (int r = 0; r < plant.sensors; r++)
    model->frozen_y[r] = amb_parts_reading(&plant.sensor[r], model->state.X[plant.shows[r]], 0);
  return status;
}

void amb_plant_demand(amb_unit *model, const amb_plant *plant, const double value[])
{
  model->rig.off = value[VR_on] < 0.5;
  currents(value, plant->axes, model->demanded);
  keep(model, plant, value);
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_unit_part(model, 0, 1, value);
}

/* Without discrete parts it advances by any step. Dead time, amplifiers and rotation advance from
 * sample to sample, with constant inputs; values in between are interpolated. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_outside outside = amb_rig_outside(&plant, value);
  model->rig.off = value[VR_on] < 0.5;
  const amb_acts acts = amb_rig_acts(&model->rig, model->demanded, &outside);
  const amb_real T = amb_data_rig.T;
  keep(model, &plant, value);
  if (!amb_data_rig.with_parts) {
    currents(value, plant.axes, model->demanded);
    (void)amb_plant_advance(&plant, &model->state, ((from > 0) || (to < 1)) ? (to - from) * T : T,
                            &acts);
    return;
  }
  if (!(from > 0)) {
    model->between.before = model->state;
    currents(value, plant.axes, model->demanded);
    (void)amb_plant_advance(&plant, &model->state, T, &acts);
  }
  model->between.share = to;
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_plant_state now = amb_rig_now(&plant, &model->between, &model->state);
  amb_rig_show(&model->rig, &plant, &now, model->demanded, value);
  for (int r = 0; r < plant.sensors; r++)
    value[FIRST_y + r] = displayed(model, &plant, &now, r, value);
  amb_plant_show_rates(model, value);
}
