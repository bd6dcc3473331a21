#include "loop_pid.h"
#include "loop_model.h"
#include "model.h"

void amb_held_tune(amb_unit *model, const double value[])
{
  model->pid = amb_data_pid;
  model->pid.kp = value[VR_controller_kp];
  model->pid.ki = value[VR_controller_ki];
  model->pid.kd = value[VR_controller_kd];
  model->pid.weight = value[VR_controller_setpoint_weight];
}

void amb_held_by(const amb_unit *model, amb_control *control, amb_loop *loop)
{
  (void)control;
  loop->pid = model->pid;
  loop->feedback_estimate = amb_data_feedback_estimate;
}

void amb_held_start(const amb_loop *loop, amb_unit *model, const amb_real place[],
                    const double value[])
{
  (void)loop;
  (void)place;
  amb_pid_reset(&model->state.pid[0], value[VR_start_current]);
}

bool amb_held_wanted(const double value[])
{
  (void)value;
  return true;
}

void amb_held_show(const amb_unit *model, double value[])
{
  (void)model;
  (void)value;
}
