#include "plant_forces.h"

amb_real amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, int f,
                            amb_real iu)
{
  if (plant->delay_rest > 0)
    return state->demanded[plant->delay][f];
  return plant->delay > 0 ? state->demanded[plant->delay - 1][f] : iu;
}

amb_acting amb_plant_acting(const amb_plant *plant, const amb_plant_state *state, int f,
                            const amb_acts *acts, amb_real iu)
{
  const amb_real *X = state->X;
  if (plant->plain && plant->own && amb_plant_as_built(acts)) {
    const amb_magnet *magnet = &plant->magnet[f];
    const amb_acting held = {.iu = iu, .force = magnet->methods->force(magnet->self, iu, X[f])};
    return held;
  }
  const amb_real s = amb_plant_within(plant, f, amb_plant_along(plant, f, X));
  const amb_parts *parts = &plant->amplifier[f];
  amb_real force = amb_plant_force(plant, acts, f, X, iu, s);
  if (plant->couplings > 0) {
    amb_real all[AMB_PLANT_AXES], demanded[AMB_PLANT_AXES], F[AMB_PLANT_AXES];
    for (int k = 0; k < plant->axes; k++) {
      all[k] = amb_plant_along(plant, k, X);
      demanded[k] = amb_plant_from_now(plant, state, k, acts->demanded[k]);
    }
    F[f] = force;
    amb_plant_couple(plant, acts, X, demanded, all, F);
    force = F[f];
  }
  amb_acting acting = {.iu = amb_plant_current(plant, f, X, iu),
                       .force = amb_parts_behind(parts, X, force)};
  if (parts->voltage > 0) {
    const amb_real v = amb_plant_velocity(plant, f, X), scale = acts->scale;
    const amb_real i = X[plant->current[f]];
    acting.voltage[0] =
        amb_parts_voltage(parts, scale, i, amb_parts_rate(parts, scale, i, iu, s, v), s, v);
    if (plant->second[f] >= 0) {
      const amb_real other = -X[plant->second[f]];
      const amb_real rate = amb_parts_rate(parts, scale, other, -iu, -s, -v);
      acting.voltage[1] = amb_parts_voltage(parts, scale, other, rate, -s, -v);
    }
  }
  return acting;
}

void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, const amb_real q[],
                      const amb_real iu[])
{
  const amb_plant_state settled = {.cosine = 1};
  *state = settled;
  amb_copy(plant->positions, q, state->X);
  for (int r = 0; r < plant->sensors; r++) {
    const amb_real x = plant->own ? q[r] : amb_sparse_times(&plant->C, plant->C.value, r, q);
    state->X[plant->shows[r]] = amb_parts_shown(&plant->sensor[r], plant->gain[r], x, 1, 0);
  }
  for (int f = 0; f < plant->axes; f++) {
    if (plant->current[f] >= 0)
      state->X[plant->current[f]] = iu[f];
    if (plant->second[f] >= 0)
      state->X[plant->second[f]] = iu[f];
    const amb_parts *parts = &plant->amplifier[f];
    const amb_real s = amb_plant_along(plant, f, q);
    for (int k = 0; k < parts->behind; k++)
      state->X[parts->behind_at[k]] =
          parts->behind_rest[k] * plant->magnet[f].methods->force(plant->magnet[f].self, iu[f], s);
    for (int n = 0; n < AMB_DELAY_MOST + 2; n++)
      state->demanded[n][f] = iu[f];
  }
}
