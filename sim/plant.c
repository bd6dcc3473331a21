#include "plant.h"
#include "parts_step.h"

amb_real amb_plant_force(const amb_plant *plant, amb_real iu, amb_real x)
{
  return plant->magnet.methods->force(plant->magnet.self, iu, x) + plant->f_0;
}

/* A stage of Runge-Kutta may look beyond a stop; magnet and sensor do not find the rotor there. */
static amb_real reachable(const amb_plant *plant, amb_real x)
{
  return amb_clamp(x, -plant->travel, plant->travel);
}

/* Force of the magnet alone. */
static amb_real pull(const amb_plant *plant, amb_real iu, amb_real x)
{
  return plant->magnet.methods->force(plant->magnet.self, iu, x);
}

/* One step of length h with control current iu and the constant acceleration g [m/s^2].
 *
 * x'' = F(x)/m + g does not ask for the velocity. So the classical method's stages of v are
 * eliminated (Nystroem 1925), and g's part is the parabola that it is: the same method with a
 * shorter chain of operations that wait for one another, and that is what its time goes into. */
static void runge_kutta(const amb_plant *plant, amb_plant_state *s, amb_real h, amb_real iu,
                        amb_real g)
{
  const amb_real half = h / 2, sixth = h / 6;
  const amb_real per_mass = 1 / plant->m, per_lag = 1 / plant->T_sen, K = plant->K_sen;
  const amb_real x = s->x, v = s->v, x_m = s->x_m;

  const amb_real coasting = x + h * v + h * half * g; /* where it gets without the magnet */
  const amb_real halfway = x + half * v, x2 = reachable(plant, halfway);
  const amb_real F1 = pull(plant, iu, x), F2 = pull(plant, iu, x2);
  const amb_real x3 = reachable(plant, halfway + half * half * g + half * half * per_mass * F1);
  const amb_real x4 = reachable(plant, coasting + h * half * per_mass * F2);
  const amb_real F3 = pull(plant, iu, x3), F4 = pull(plant, iu, x4);
  s->x = coasting + h * sixth * per_mass * (F1 + F2 + F3);
  s->v = v + h * g + sixth * per_mass * (F1 + 2 * (F2 + F3) + F4);

  const amb_real d1 = (K * x - x_m) * per_lag;
  const amb_real d2 = (K * x2 - (x_m + half * d1)) * per_lag;
  const amb_real d3 = (K * x3 - (x_m + half * d2)) * per_lag;
  const amb_real d4 = (K * x4 - (x_m + h * d3)) * per_lag;
  s->x_m = x_m + sixth * (d1 + 2 * (d2 + d3) + d4);
}

/* At a stop the rotor stays until the force pulls it off. Returns true where one is touched. */
static bool stop(const amb_plant *plant, amb_plant_state *s)
{
  const amb_real travel = plant->travel;
  if (!((s->x >= travel) || (s->x <= -travel)))
    return false;
  s->x = amb_clamp(s->x, -travel, travel);
  const bool outward = s->x > 0 ? s->v > 0 : s->v < 0;
  if (outward)
    s->v = 0;
  return true;
}

/* Without parts. The delay line in the state is left alone, not copied: that would cost a tenth. */
static bool advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                    amb_real f_d)
{
  const amb_real h = T / (amb_real)plant->substeps, g = (plant->f_0 + f_d) / plant->m;
  bool touched = false;
  amb_plant_state s = {.x = reachable(plant, state->x), .v = state->v, .x_m = state->x_m};
  for (int i = 0; i < plant->substeps; i++) {
    runge_kutta(plant, &s, h, iu, g);
    touched |= stop(plant, &s);
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
  return advance(plant, state, T, iu, f_d);
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
