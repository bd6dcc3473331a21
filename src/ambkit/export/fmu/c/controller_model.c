#include "controller_model.h"
#include "model.h"

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  model->pid = amb_data_pid;
  model->pid.kp = value[VR_controller_kp];
  model->pid.ki = value[VR_controller_ki];
  model->pid.kd = value[VR_controller_kd];
  model->pid.weight = value[VR_controller_setpoint_weight];
  return AMB_OK;
}

amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  amb_pid_reset(&model->state, value[VR_start_current]);
  model->u =
      amb_clamp(value[VR_start_current], model->pid.iu_min, model->pid.iu_max) / amb_data_k_ui[0];
  return status;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_real iu;
  const amb_real v = value[VR_v];
  (void)amb_pid_step(&model->pid, &model->state, value[VR_r], value[VR_x] / amb_data_K_sen,
                     amb_data_feedback_estimate ? &v : NULL, &iu);
  model->u = iu / amb_data_k_ui[0];
}

/* The controller only reads its inputs at the start of a sample. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  value[VR_u] = model->u;
}
