#include "plant.h"
#include "generated/closed_law.h"
#include "parts_step.h"

amb_real amb_plant_force(const amb_plant *plant, amb_real iu, amb_real x)
{
  return plant->magnet.methods->force(plant->magnet.self, iu, x) + plant->f_0;
}

/* Where the force of the magnet comes from: the closed law of two sides is known here, and not
 * asked through a pointer. */
typedef struct amb_puller {
  const amb_magnet *magnet;
  bool closed;
} amb_puller;

AMB_INLINE amb_real amb_pull(const amb_puller *of, amb_real iu, amb_real x)
{
  return of->closed ? amb_law_force((const amb_law *)of->magnet->self, iu, x)
                    : of->magnet->methods->force(of->magnet->self, iu, x);
}

#include "plant_step.h"

/* At a stop the rotor stays until the force pulls it off. Returns true where one is touched. */
AMB_INLINE bool stop(amb_real travel, amb_motion *s)
{
  if (!((s->x >= travel) || (s->x <= -travel)))
    return false;
  s->x = amb_clamp(s->x, -travel, travel);
  const bool outward = s->x > 0 ? s->v > 0 : s->v < 0;
  if (outward)
    s->v = 0;
  return true;
}

/* Without parts. The delay line in the state is left alone, not copied: that would cost a tenth. */
AMB_INLINE bool advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                        amb_real f_d, bool closed)
{
  const amb_real h = T / (amb_real)plant->substeps, g = (plant->f_0 + f_d) / plant->m;
  const amb_stride of = {
      h, h / 2, h / 6, 1 / plant->m, 1 / plant->T_sen, plant->K_sen, plant->travel};
  const amb_puller magnet = {&plant->magnet, closed};
  bool touched = false;
  amb_motion s = {amb_reachable(&of, state->x), state->v, state->x_m};
  for (int i = 0; i < plant->substeps; i++) {
    amb_runge_kutta(&of, &magnet, &s, iu, g);
    touched |= stop(of.travel, &s);
  }
  state->x = s.x;
  state->v = s.v;
  state->x_m = s.x_m;
  return touched;
}

bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real f_d)
{
  if (plant->parts != NULL)
    return amb_parts_advance(plant, state, T, iu, (plant->f_0 + f_d) / plant->m);
  const bool closed = (plant->magnet.methods == &amb_law_magnet) &&
                      ((const amb_law *)plant->magnet.self)->two_sided;
  return closed ? advance(plant, state, T, iu, f_d, true)
                : advance(plant, state, T, iu, f_d, false);
}

void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, amb_real iu,
                     amb_real f_d, amb_plant_state *rates)
{
  if (plant->parts != NULL) {
    amb_parts_rates(plant, state, iu, (plant->f_0 + f_d) / plant->m, rates);
    return;
  }
  const amb_real x = amb_clamp(state->x, -plant->travel, plant->travel);
  const amb_plant_state found = {
      .x = state->v,
      .v = (amb_plant_force(plant, iu, x) + f_d) / plant->m,
      .x_m = (plant->K_sen * x - state->x_m) / plant->T_sen,
  };
  *rates = found;
}

void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, amb_real x, amb_real iu)
{
  const amb_plant_state settled = {.x = x, .x_m = plant->K_sen * x};
  *state = settled;
  if (plant->parts != NULL)
    amb_parts_settle(plant, state, iu);
}

amb_acting amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, amb_real iu)
{
  if (plant->parts != NULL)
    return amb_parts_acting(plant, state, amb_parts_next(plant->parts, state, iu));
  const amb_acting acting = {.iu = iu, .force = amb_plant_force(plant, iu, state->x)};
  return acting;
}

amb_acting amb_plant_until_now(const amb_plant *plant, const amb_plant_state *state, amb_real iu)
{
  if (plant->parts != NULL)
    return amb_parts_acting(plant, state, state->demanded[plant->parts->delay]);
  return amb_plant_from_now(plant, state, iu);
}
