#include "flight_model.h"
#include "estimates.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, value);
}

/* Levitated, or at power-on, as the parameters state. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_kalman_settings *set = &model->filter.set;
  amb_real place[AMB_CONTROLS], current[AMB_CONTROLS], mean[AMB_STATES];
  for (int c = 0; c < AMB_CONTROLS; c++) {
    place[c] = (amb_real)value[FIRST_start_position + c];
    current[c] =
        amb_clamp((amb_real)value[FIRST_start_current + c], set->iu_min[c], set->iu_max[c]);
  }
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_control control = amb_flight_control(&estimator);
  memset(&model->state, 0, sizeof model->state);
  memset(&model->output, 0, sizeof model->output);
  amb_filter_at(place, current, mean);
  amb_filter_start(&model->filter, &model->estimate, &model->output.estimator, mean);
  amb_flight_start(&control, &model->state, &model->estimate, &model->output, place, current);
  for (int c = 0; c < AMB_CONTROLS; c++)
    model->output.iu[c] = amb_data_levitated ? current[c] : AMB_C(0.0);
  model->status = AMB_OK;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_control control = amb_flight_control(&estimator);
  amb_real y[AMB_SENSORS], r[AMB_CONTROLS];
  for (int k = 0; k < AMB_SENSORS; k++)
    y[k] = (amb_real)value[FIRST_y + k];
  for (int c = 0; c < AMB_CONTROLS; c++)
    r[c] = (amb_real)value[FIRST_r + c];
  model->status =
      amb_control_step(&control, &model->state, &model->estimate, y, r, amb_flight_speed(value),
                       amb_flight_wanted(value), &model->output);
  if (value[VR_power_failure] >= 0.5)
    amb_control_deenergise(&control, &model->state, &model->estimate);
}

/* It reads its inputs at the start of a sample only. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_control_output *output = &model->output;
  int at = FIRST_coil_0;
  for (int c = 0; c < AMB_CONTROLS; c++) {
    const amb_real iu = output->iu[c], bias = amb_data_bias[c];
    value[at++] = output->on ? bias + iu : 0;
    if (amb_data_coils[c] > 1)
      value[at++] = output->on ? bias - iu : 0;
    value[FIRST_u + c] = model->state.u[c];
    value[FIRST_iu + c] = iu;
  }
  value[VR_on] = output->on ? 1 : 0;
  value[VR_status] = (double)model->status;
  amb_flight_show(output, value);
  amb_estimates_show(&model->estimate, &output->estimator, NULL, value);
}
