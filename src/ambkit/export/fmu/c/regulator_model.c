#include "regulator_model.h"
#include "model.h"

/* Its gains belong together: none can be tuned. */
amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  (void)model;
  (void)value;
  return AMB_OK;
}

amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_real current = value[VR_start_current];
  amb_pid_reset(&model->pid, value[VR_start_integral]);
  model->u = amb_clamp(current, amb_data_law.iu_min[0], amb_data_law.iu_max[0]) / amb_data_k_ui;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_real iu;
  const amb_real *states = &value[VR_x]; /* they stand together, in their order */
  (void)amb_controllers_step(&amb_data_law, &model->pid, &value[VR_r], states, 0, &iu);
  model->u = iu / amb_data_k_ui;
}
