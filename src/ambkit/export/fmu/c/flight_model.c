#include "flight_model.h"
#include "estimates.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, (amb_real)value[VR_measurement_variance],
                         (amb_real)value[VR_control_variance],
                         (amb_real)value[VR_disturbance_growth]);
}

/* In flight where the parameters say, or at power-on. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  const amb_kalman_settings *set = &model->filter.set;
  const amb_real x = (amb_real)value[VR_start_position];
  const amb_real current =
      amb_clamp((amb_real)value[VR_start_current], set->iu_min[0], set->iu_max[0]);
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_control control = amb_flight_control(&estimator);
  memset(&model->state, 0, sizeof model->state);
  memset(&model->flown, 0, sizeof model->flown);
  amb_filter_start(&model->filter, &model->estimate, &model->flown.estimator, x, set->K_sen[0] * x,
                   current);
  amb_flight_start(&control, &model->state, &model->estimate, &model->flown, x, current);
  model->flown.iu[0] = amb_data_hovering ? current : AMB_C(0.0);
  model->status = AMB_OK;
  return AMB_OK;
}

void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator estimator = amb_filter_estimator(&model->filter);
  const amb_control control = amb_flight_control(&estimator);
  const amb_real y[AMB_SENSORS] = {(amb_real)value[VR_y]}, r = (amb_real)value[VR_r];
  model->status = amb_control_step(&control, &model->state, &model->estimate, y, &r, AMB_C(0.0),
                                   amb_flight_wanted(value), &model->flown);
}

/* It looks at its inputs when a sample begins, and not in between. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  const amb_real iu = model->flown.iu[0];
  const amb_real coil[] = {amb_data_bias + iu, amb_data_bias - iu};
  for (int k = 0; k < AMB_DATA_COILS; k++)
    value[VR_coil_0 + k] = model->flown.on ? coil[k] : 0;
  value[VR_u] = model->state.u[0];
  value[VR_iu] = iu;
  value[VR_on] = model->flown.on ? 1 : 0;
  value[VR_status] = (double)model->status;
  amb_flight_show(&model->flown, value);
  amb_estimates_show(&model->filter, &model->estimate, &model->flown.estimator, value);
}
