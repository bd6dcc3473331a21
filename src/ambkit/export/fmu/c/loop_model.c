#include "loop_model.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  if (amb_filter_tune(&model->filter, value[VR_measurement_variance], value[VR_control_variance],
                      value[VR_disturbance_growth]) != AMB_OK)
    return AMB_BAD_PARAMETER;
  model->pid = amb_data_pid;
  model->pid.kp = value[VR_controller_kp];
  model->pid.ki = value[VR_controller_ki];
  model->pid.kd = value[VR_controller_kd];
  model->pid.weight = value[VR_controller_setpoint_weight];
  amb_rig_tune(&model->rig, value[VR_mass], value[VR_magnet_constant]);
  return AMB_OK;
}

static amb_loop loop_of(const amb_unit *model, const amb_estimator *estimator)
{
  const amb_rig *rig = &model->rig;
  const amb_loop loop = {
      .plant = amb_rig_plant(rig),
      .pid = model->pid,
      .T = rig->T,
      .k_ui = rig->k_ui,
      .iu_min = rig->iu_min,
      .iu_max = rig->iu_max,
      .estimator = estimator,
      .feedback_estimate = amb_data_feedback_estimate,
  };
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
  const amb_plant plant = amb_rig_plant(rig);
  s->demanded = amb_clamp(value[VR_start_current], rig->iu_min, rig->iu_max);
  amb_plant_settle(&plant, &s->plant,
                   amb_clamp(value[VR_start_position], -rig->travel, rig->travel), s->demanded);
  amb_pid_reset(&s->pid, value[VR_start_current]);
  /* Nobody tells it the runout. */
  const amb_real x = s->plant.x;
  amb_filter_start(&model->filter, &model->estimate, &s->result, x, rig->K_sen * x, s->demanded);
  s->y = amb_plant_measure(&plant, s->plant.x_m, value[VR_noise_y]);
  s->acting = amb_plant_from_now(&plant, &s->plant, s->demanded);
  s->u = s->demanded / rig->k_ui;
  model->between.share = 1;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_loop loop = loop_of(model, &estimator);
  model->between.before = model->state.plant;
  model->between.T = model->rig.T;
  model->between.share = 1;
  const amb_loop_sample sample = {value[VR_r], value[VR_f_d], value[VR_noise_u], value[VR_noise_y],
                                  true};
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
  value[VR_x] = now.x;
  value[VR_v] = now.v;
  value[VR_x_m] = now.x_m;
  value[VR_y] = s->y;
  value[VR_u] = s->u;
  value[VR_iu] = s->acting.iu;
  value[VR_f_mag] = amb_rig_force(&model->rig, &now, s->demanded);
  const amb_real *mean = ((const amb_kalman_state *)&model->estimate)->mean;
  for (int i = 0; i < AMB_STATES; i++) /* they stand together, in their order */
    value[VR_estimate_x + i] = mean[i];
  amb_filter_show_std(&model->filter, &model->estimate, &value[VR_estimate_std_x]);
  value[VR_estimate_k_i] = s->result.stiffness[0].k_i;
  value[VR_estimate_k_s] = s->result.stiffness[0].k_s;
  value[VR_estimate_innovation] = s->result.innovation[0];
  value[VR_estimate_variance] = s->result.variance[0];
  value[VR_estimate_status] = (double)s->result.status;
}
