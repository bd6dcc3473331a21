#include "loop_model.h"
#include "estimates.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  if (amb_filter_tune(&model->filter, value) != AMB_OK)
    return AMB_BAD_PARAMETER;
  amb_held_tune(model, value);
  amb_rig_tune(&model->rig, value[VR_mass], value[VR_magnet_constant]);
  return AMB_OK;
}

/* It points to the other three. */
static amb_loop loop_of(const amb_unit *model, const amb_estimator *estimator, amb_control *control,
                        amb_rig_room *room)
{
  const amb_rig *rig = &model->rig;
  amb_loop loop = {
      .plant = amb_rig_plant(rig, room),
      .T = rig->T,
      .k_ui = &rig->k_ui,
      .iu_min = &rig->iu_min,
      .iu_max = &rig->iu_max,
      .estimator = estimator,
  };
  amb_held_by(model, control, &loop);
  return loop;
}

/* At rest where the parameters say, and the estimator knows it. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_rig *rig = &model->rig;
  amb_loop_state *s = &model->state;
  memset(s, 0, sizeof *s);
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  amb_control control;
  amb_rig_room room;
  const amb_loop loop = loop_of(model, &estimator, &control, &room);
  const amb_plant plant = loop.plant;
  s->demanded[0] = amb_clamp(value[VR_start_current], rig->iu_min, rig->iu_max);
  const amb_real x = amb_clamp(value[VR_start_position], -rig->travel, rig->travel);
  amb_plant_settle(&plant, &s->plant, &x, s->demanded);
  /* Nobody tells it the runout. */
  amb_real mean[AMB_STATES];
  amb_filter_at(&x, s->demanded, mean);
  amb_filter_start(&model->filter, &model->estimate, &s->result, mean);
  amb_held_start(&loop, model, value);
  s->y[0] = amb_parts_reading(plant.sensor, s->plant.X[2], value[VR_noise_y]);
  const amb_acts acts = amb_rig_acts(rig, s->demanded, &x);
  s->acting[0] = amb_plant_acting(&plant, &s->plant, 0, &acts,
                                  amb_plant_from_now(&plant, &s->plant, 0, s->demanded[0]));
  s->u[0] = s->demanded[0] / rig->k_ui;
  model->between.share = 1;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  amb_control control;
  amb_rig_room room;
  const amb_loop loop = loop_of(model, &estimator, &control, &room);
  model->between.before = model->state.plant;
  model->between.T = model->rig.T;
  model->between.share = 1;
  const amb_real r = value[VR_r], f_d = value[VR_f_d];
  const amb_real noise_u = value[VR_noise_u], noise_y = value[VR_noise_y];
  const amb_loop_sample sample = {.r = &r,
                                  .load = &f_d,
                                  .noise_u = &noise_u,
                                  .noise_y = &noise_y,
                                  .scale = 1,
                                  .fly = amb_held_wanted(value)};
  (void)amb_loop_step(&loop, &model->state, &model->estimate, &sample);
}

/* The controller looks at its inputs when a sample begins; the rotor is glimpsed on its way. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  if (!(from > 0))
    amb_unit_sample(model, value);
  model->between.share = to;
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_loop_state *s = &model->state;
  const amb_plant_state now = amb_rig_now(&model->between, &s->plant);
  value[VR_x] = now.X[0];
  value[VR_v] = now.X[1];
  value[VR_x_m] = now.X[2];
  value[VR_y] = s->y[0];
  value[VR_u] = s->u[0];
  value[VR_iu] = s->acting[0].iu;
  value[VR_f_mag] = amb_rig_acting(&model->rig, &now, s->demanded[0]).force;
  amb_estimates_show(&model->estimate, &s->result, value);
  amb_held_show(model, value);
}
