#include "flight.h"
#include "model.h"

amb_control amb_flight_control(const amb_estimator *estimator)
{
  amb_control control = amb_data_control;
  control.estimator = estimator;
  return control;
}

void amb_flight_start(const amb_control *control, amb_control_state *state, void *filter,
                      amb_control_output *flown, amb_real x, amb_real current)
{
  if (amb_data_hovering) {
    const amb_real integral = amb_data_integral[0] +
                              amb_data_integral[1] * (current - amb_data_current) +
                              amb_data_integral[2] * x;
    amb_control_hover(control, state, &current, &integral);
  } else {
    amb_control_init(control, state, filter);
  }
  flown->mode = state->sequence.mode;
  flown->on = amb_data_hovering;
}

#ifdef AMB_DATA_SEQUENCED
bool amb_flight_wanted(const double value[])
{
  return value[VR_fly] >= 0.5;
}

void amb_flight_show(const amb_control_output *flown, double value[])
{
  value[VR_mode] = (double)flown->mode;
}
#else /* it flies, always */
bool amb_flight_wanted(const double value[])
{
  (void)value;
  return true;
}

void amb_flight_show(const amb_control_output *flown, double value[])
{
  (void)flown;
  (void)value;
}
#endif
