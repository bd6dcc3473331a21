#include "flight.h"
#include "loop_model.h"
#include "model.h"

/* Its gains depend on each other: none is tunable. */
void amb_held_tune(amb_unit *model, const double value[])
{
  (void)model;
  (void)value;
}

void amb_held_by(const amb_unit *model, amb_control *control, amb_loop *loop)
{
  (void)model;
  *control = amb_flight_control(loop->estimator);
  loop->control = control;
}

void amb_held_start(const amb_loop *loop, amb_unit *model, const amb_real place[],
                    const double value[])
{
  amb_loop_state *s = &model->state;
  (void)value;
  amb_flight_start(loop->control, &s->control, &model->estimate, &s->control_output, place,
                   s->demanded);
}

bool amb_held_wanted(const double value[])
{
  return amb_flight_wanted(value);
}

void amb_held_show(const amb_unit *model, double value[])
{
  const amb_control_output *output = &model->state.control_output;
  for (int f = 0; !output->on && (f < amb_data_rig.axes); f++)
    value[FIRST_f_mag + f] = 0; /* no current, not even the bias */
  amb_flight_show(output, value);
}
