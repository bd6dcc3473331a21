#include "flight.h"
#include "model.h"

amb_control amb_flight_control(const amb_estimator *estimator)
{
  amb_control control = amb_data_control;
  control.estimator = estimator;
  return control;
}

void amb_flight_start(const amb_control *control, amb_control_state *state, void *filter,
                      amb_control_output *output, const amb_real place[], const amb_real current[])
{
  if (amb_data_levitated) {
    amb_real integral[AMB_DATA_PIDS];
    for (int q = 0; q < AMB_DATA_PIDS; q++) {
      integral[q] = amb_data_integral[q];
      for (int c = 0; c < AMB_CONTROLS; c++) {
        const amb_real more = current[c] - amb_data_current[c];
        integral[q] += amb_data_integral_by_current[q * AMB_CONTROLS + c] * more;
        integral[q] += amb_data_integral_by_place[q * AMB_CONTROLS + c] * place[c];
      }
    }
    amb_control_levitate(control, state, current, integral);
  } else {
    amb_control_init(control, state, filter);
  }
  output->mode = state->sequence.mode;
  output->on = amb_data_levitated;
}

#ifdef AMB_DATA_SEQUENCED
bool amb_flight_wanted(const double value[])
{
  return value[VR_fly] >= 0.5;
}

void amb_flight_show(const amb_control_output *output, double value[])
{
  value[VR_mode] = (double)output->mode;
}
#else /* always levitated */
bool amb_flight_wanted(const double value[])
{
  (void)value;
  return true;
}

void amb_flight_show(const amb_control_output *output, double value[])
{
  (void)output;
  (void)value;
}
#endif

#ifdef AMB_DATA_TURNING
amb_real amb_flight_speed(const double value[])
{
  return (amb_real)value[VR_speed];
}
#else
amb_real amb_flight_speed(const double value[])
{
  (void)value;
  return 0;
}
#endif
