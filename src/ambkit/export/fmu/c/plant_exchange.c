#include "exchange.h"
#include "sim/parts_step.h"

#define TURN 6.283185307179586 /* [rad] */

/* The angle of rotation counts from the start. */
static void turn(amb_unit *model, double time)
{
  const amb_parts *parts = &model->rig.parts;
  amb_plant_state *s = &model->state;
  const double turns = parts->speed * time / TURN;
  const double rest = turns - (double)(int64_t)turns;
  const double within = (rest > 0.5) ? rest - 1 : ((rest < -0.5) ? rest + 1 : rest);
  amb_parts_turn(within * TURN, &s->cosine, &s->sine);
}

void amb_unit_follow(amb_unit *model, double time, const double value[AMB_VARIABLES])
{
  amb_plant_demand(model, value);
  if (model->rig.with_parts)
    turn(model, time);
  for (int n = 0; n < AMB_DELAY_MOST + 2; n++)
    model->state.demanded[n] = model->demanded;
}

void amb_unit_states(const amb_unit *model, double states[])
{
  const amb_plant_state *s = &model->state;
  const double all[] = {s->x, s->v, s->x_m, s->i[0], s->i[1]};
  for (int i = 0; i < AMB_CONTINUOUS_STATES; i++)
    states[i] = all[i];
}

void amb_unit_set_states(amb_unit *model, const double states[])
{
  amb_plant_state *s = &model->state;
  s->x = states[0];
  s->v = states[1];
  s->x_m = states[2];
#if AMB_CONTINUOUS_STATES > 3
  s->i[0] = states[3];
  s->i[1] = states[AMB_CONTINUOUS_STATES - 1];
#endif
}

/* Rates of a rotor that no hard stop holds. */
static amb_plant_state rates(const amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_plant plant = amb_rig_plant(&model->rig);
  amb_plant_state found;
  amb_plant_rates(&plant, &model->state, model->demanded, value[VR_f_d], &found);
  return found;
}

void amb_unit_slopes(const amb_unit *model, const double value[AMB_VARIABLES], double slopes[])
{
  const amb_plant_state d = rates(model, value);
  const bool free = model->held == 0;
  const double all[] = {free ? d.x : 0, free ? d.v : 0, d.x_m, d.i[0], d.i[1]};
  for (int i = 0; i < AMB_CONTINUOUS_STATES; i++)
    slopes[i] = all[i];
}

void amb_plant_show_rates(const amb_unit *model, double value[])
{
  amb_unit_slopes(model, value, &value[VR_der_x_]); /* they stand together, in their order */
#if AMB_CONTINUOUS_STATES > 3
  const double i[] = {model->state.i[0], model->state.i[1]};
  for (int k = 0; k < AMB_CONTINUOUS_STATES - 3; k++)
    value[VR_i_0 + k] = i[k];
#endif
  amb_unit_indicators(model, value, &value[VR_event_0]);
}

/* Where the rotor's way ends: at a hard stop, or where a soft one gives way no more. */
static amb_real end_of(const amb_rig *rig)
{
  return (rig->parts.stiffness > 0) ? rig->parts.farthest : rig->travel;
}

/* What is left of the way on both sides [m]; at a stop, how hard it is pressed there [m/s^2]. */
void amb_unit_indicators(const amb_unit *model, const double value[AMB_VARIABLES],
                         double indicators[AMB_EVENT_INDICATORS])
{
  const amb_real end = end_of(&model->rig);
  if (model->held != 0) {
    indicators[0] = model->held * rates(model, value).v;
    indicators[1] = 1;
  } else {
    indicators[0] = end - model->state.x;
    indicators[1] = end + model->state.x;
  }
}

bool amb_unit_event(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_real end = end_of(&model->rig), near = 1e-9 * end;
  amb_plant_state *s = &model->state;
  if (model->held != 0) {
    if (!(model->held * rates(model, value).v > 0))
      model->held = 0;
    return false;
  }
  const int side = (s->x >= end - near) - (s->x <= near - end);
  if ((side == 0) || (side * s->v < 0))
    return false;
  s->x = side * end;
  s->v = 0;
  model->held = (side * rates(model, value).v > 0) ? side : 0;
  return true;
}
