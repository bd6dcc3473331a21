#include "loop_model.h"
#include "estimates.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  if (amb_filter_tune(&model->filter, value) != AMB_OK)
    return AMB_BAD_PARAMETER;
  amb_held_tune(model, value);
  amb_rig_tune(&model->rig, value);
  return AMB_OK;
}

/* It points to the other three. */
static amb_loop loop_of(const amb_unit *model, const amb_estimator *estimator, amb_control *control,
                        amb_rig_room *room)
{
  amb_loop loop = {
      .plant = amb_rig_plant(&model->rig, room),
      .T = amb_data_rig.T,
      .k_ui = amb_data_rig.k_ui,
      .iu_min = amb_data_rig.iu_min,
      .iu_max = amb_data_rig.iu_max,
      .estimator = estimator,
  };
  amb_held_by(model, control, &loop);
  return loop;
}

/* In equilibrium as the parameters state, known to the estimator. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  amb_loop_state *s = &model->state;
  memset(s, 0, sizeof *s);
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  amb_control control;
  amb_rig_room room;
  const amb_loop loop = loop_of(model, &estimator, &control, &room);
  const amb_plant *plant = &loop.plant;
  amb_real place[AMB_CONTROLS], mean[AMB_STATES];
  for (int f = 0; f < plant->axes; f++)
    s->demanded[f] = amb_clamp(value[FIRST_start_current + f], loop.iu_min[f], loop.iu_max[f]);
  amb_rig_settle(plant, &s->plant, value, s->demanded, place);
  /* The runout is unknown to it. */
  amb_filter_at(place, s->demanded, mean);
  amb_filter_start(&model->filter, &model->estimate, &s->result, mean);
  amb_held_start(&loop, model, place, value);
  for (int r = 0; r < plant->sensors; r++)
    s->y[r] =
        amb_parts_reading(&plant->sensor[r], s->plant.X[plant->shows[r]], value[FIRST_noise_y + r]);
  const amb_outside outside = amb_rig_outside(plant, value);
  const amb_acts acts = amb_rig_acts(&model->rig, s->demanded, &outside);
  for (int f = 0; f < plant->axes; f++) {
    s->acting[f] = amb_plant_acting(plant, &s->plant, f, &acts,
                                    amb_plant_from_now(plant, &s->plant, f, s->demanded[f]));
    s->u[f] = s->demanded[f] / loop.k_ui[f];
  }
  model->between.share = 1;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  amb_control control;
  amb_rig_room room;
  const amb_loop loop = loop_of(model, &estimator, &control, &room);
  const amb_outside outside = amb_rig_outside(&loop.plant, value);
  model->between.before = model->state.plant;
  model->between.share = 1;
  const amb_loop_sample sample = {.r = &value[FIRST_r],
                                  .load = outside.load,
                                  .noise_u = &value[FIRST_noise_u],
                                  .noise_y = &value[FIRST_noise_y],
                                  .base = outside.base,
                                  .speed = amb_data_rig.speed < 0 ? NULL : outside.speed,
                                  .scale = 1,
                                  .fly = amb_held_wanted(value)};
  (void)amb_loop_step(&loop, &model->state, &model->estimate, &sample);
}

/* The controller reads its inputs at the start of a sample; outputs in between are interpolated. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  if (!(from > 0))
    amb_unit_sample(model, value);
  model->between.share = to;
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_loop_state *s = &model->state;
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_plant_state now = amb_rig_now(&plant, &model->between, &s->plant);
  amb_rig_show(&model->rig, &plant, &now, s->demanded, value);
  for (int r = 0; r < plant.sensors; r++)
    value[FIRST_y + r] = s->y[r];
  for (int f = 0; f < plant.axes; f++) {
    value[FIRST_u + f] = s->u[f];
    value[FIRST_iu + f] = s->acting[f].iu;
  }
  amb_estimates_show(&model->estimate, &s->result, NULL, value);
  amb_held_show(model, value);
}
