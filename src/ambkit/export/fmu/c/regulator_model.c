#include "regulator_model.h"
#include "model.h"

/* Their gains depend on each other: none is tunable. */
amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  (void)model;
  (void)value;
  return AMB_OK;
}

amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_controllers *law = &amb_data_law;
  for (int q = 0; q < AMB_DATA_PIDS; q++)
    amb_pid_reset(&model->pid[q], value[FIRST_start_integral + q]);
  for (int f = 0; f < AMB_DATA_AXES; f++)
    model->u[f] = amb_clamp(value[FIRST_start_current + f], law->iu_min[f], law->iu_max[f]) /
                  amb_data_k_ui[f];
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  amb_real iu[AMB_DATA_AXES];
  const amb_real speed = amb_data_speed < 0 ? 0 : value[amb_data_speed];
  (void)amb_controllers_step(&amb_data_law, model->pid, &value[FIRST_r], &value[FIRST_fed], speed,
                             iu);
  for (int f = 0; f < AMB_DATA_AXES; f++)
    model->u[f] = iu[f] / amb_data_k_ui[f];
}

/* They only read their inputs at the start of a sample. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  for (int f = 0; f < AMB_DATA_AXES; f++)
    value[FIRST_u + f] = model->u[f];
}
