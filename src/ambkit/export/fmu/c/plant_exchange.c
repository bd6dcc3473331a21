#include "exchange.h"

#define TURN 6.283185307179586 /* [rad] */

/* The angle of rotation since the start. */
static void turn(amb_unit *model, double time)
{
  amb_plant_state *s = &model->state;
  const double turns = amb_data_rig.plant->sensor->speed * time / TURN;
  const double rest = turns - (double)(int64_t)turns;
  const double within = (rest > 0.5) ? rest - 1 : ((rest < -0.5) ? rest + 1 : rest);
  amb_parts_turn(within * TURN, &s->cosine, &s->sine);
}

void amb_unit_follow(amb_unit *model, double time, const double value[AMB_VARIABLES])
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  amb_plant_demand(model, &plant, value);
  if (amb_data_rig.with_parts)
    turn(model, time);
  for (int n = 0; n < AMB_DELAY_MOST + 2; n++)
    model->state.demanded[n][0] = model->demanded[0];
}

/* Index of an importer's state in the plant's: currents come first, if they lag. */
static int place(int i)
{
  const int between = amb_data_rig.plant->amplifier->behind;
  const int first = AMB_CONTINUOUS_STATES - between;
  return (i < first) ? i : (5 + i - first);
}

void amb_unit_states(const amb_unit *model, double states[])
{
  for (int i = 0; i < AMB_CONTINUOUS_STATES; i++)
    states[i] = model->state.X[place(i)];
}

void amb_unit_set_states(amb_unit *model, const double states[])
{
  for (int i = 0; i < AMB_CONTINUOUS_STATES; i++)
    model->state.X[place(i)] = states[i];
}

/* Rates without a hard stop. */
static void rates(const amb_unit *model, const double value[AMB_VARIABLES],
                  amb_real rate[AMB_PLANT_STATES])
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(&model->rig, &room);
  const amb_outside outside = amb_rig_outside(&plant, value);
  const amb_acts acts = amb_rig_acts(&model->rig, model->demanded, &outside);
  amb_plant_rates(&plant, &model->state, &acts, rate);
}

/* Acceleration against the stop on this side [m/s^2]. */
static amb_real pressed(const amb_unit *model, const double value[AMB_VARIABLES], int side)
{
  amb_real rate[AMB_PLANT_STATES];
  rates(model, value, rate);
  return side * rate[1];
}

void amb_unit_slopes(const amb_unit *model, const double value[AMB_VARIABLES], double slopes[])
{
  amb_real rate[AMB_PLANT_STATES];
  rates(model, value, rate);
  for (int i = 0; i < AMB_CONTINUOUS_STATES; i++)
    slopes[i] = (i < 2) && (model->held != 0) ? 0 : rate[place(i)];
}

void amb_plant_show_rates(const amb_unit *model, double value[])
{
  amb_unit_slopes(model, value, &value[VR_der_x_]); /* consecutive, in their order */
  for (int i = 3; i < AMB_CONTINUOUS_STATES; i++)   /* followed by the other states, in theirs */
    value[VR_der_x_ - AMB_CONTINUOUS_STATES + i] = model->state.X[place(i)];
  amb_unit_indicators(model, value, &value[VR_event_0]);
}

/* End of the rotor's clearance: at a hard stop, or where a soft stop is fully compressed. */
static amb_real end_of(void)
{
  return amb_data_rig.plant->farthest[0];
}

/* Remaining clearance on both sides [m]; at a stop, the acceleration against it [m/s^2]. */
void amb_unit_indicators(const amb_unit *model, const double value[AMB_VARIABLES],
                         double indicators[AMB_EVENT_INDICATORS])
{
  const amb_real end = end_of();
  if (model->held != 0) {
    indicators[0] = pressed(model, value, model->held);
    indicators[1] = 1;
  } else {
    indicators[0] = end - model->state.X[0];
    indicators[1] = end + model->state.X[0];
  }
}

bool amb_unit_event(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_real end = end_of(), near = 1e-9 * end;
  amb_plant_state *s = &model->state;
  if (model->held != 0) {
    if (!(pressed(model, value, model->held) > 0))
      model->held = 0;
    return false;
  }
  const int side = (s->X[0] >= end - near) - (s->X[0] <= near - end);
  if ((side == 0) || (side * s->X[1] < 0))
    return false;
  s->X[0] = side * end;
  s->X[1] = 0;
  model->held = (pressed(model, value, side) > 0) ? side : 0;
  return true;
}
