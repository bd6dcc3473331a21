/* Forces on the rotor of the plant: magnets with their currents, and soft stops. */
#ifndef AMBKIT_PLANT_FORCES_H
#define AMBKIT_PLANT_FORCES_H

#include "ambkit/root.h"
#include "plant.h"

static inline amb_real amb_plant_velocity(const amb_plant *plant, int f, const amb_real X[])
{
  return amb_plant_along(plant, f, X + plant->positions);
}

static inline amb_real amb_plant_within(const amb_plant *plant, int f, amb_real s)
{
  return amb_clamp(s, -plant->farthest[f], plant->farthest[f]);
}

static inline amb_real amb_plant_current(const amb_plant *plant, int f, const amb_real X[],
                                         amb_real iu)
{
  const int first = plant->current[f], second = plant->second[f];
  if (first < 0)
    return iu;
  return second < 0 ? X[first] : (X[first] + X[second]) / 2;
}

/* Force of a magnet at the displacement s, relative to its bias force. */
static inline amb_real amb_plant_force(const amb_plant *plant, const amb_acts *acts, int f,
                                       const amb_real X[], amb_real iu, amb_real s)
{
  const amb_magnet *magnet = &plant->magnet[f], *coil = &plant->coil[f];
  if (acts->off)
    return -plant->bias[f];
  amb_real force;
  if ((plant->second[f] >= 0) && (coil->methods != NULL))
    force = coil->methods->force(coil->self, X[plant->current[f]], s) -
            coil->methods->force(coil->self, -X[plant->second[f]], -s);
  else
    force = magnet->methods->force(magnet->self, amb_plant_current(plant, f, X, iu), s);
  return acts->scale * force + (acts->scale - 1) * plant->bias[f];
}

/* Replaces the forces of axes with shared iron; iu: demanded currents. */
static inline void amb_plant_couple(const amb_plant *plant, const amb_acts *acts,
                                    const amb_real X[], const amb_real iu[], const amb_real s[],
                                    amb_real F[])
{
  for (int k = 0; (k < plant->couplings) && !acts->off; k++) {
    const amb_coupling *both = &plant->coupling[k];
    const int a = both->first, b = both->second;
    const amb_real i[2] = {amb_plant_current(plant, a, X, iu[a]),
                           amb_plant_current(plant, b, X, iu[b])};
    const amb_real at[2] = {amb_plant_within(plant, a, s[a]), amb_plant_within(plant, b, s[b])};
    amb_real force[2];
    amb_coupling_force(both, i, at, force);
    F[a] = acts->scale * force[0] - plant->bias[a];
    F[b] = acts->scale * force[1] - plant->bias[b];
  }
}

static inline bool amb_plant_as_built(const amb_acts *acts)
{
  return !acts->off && (acts->scale >= 1) && (acts->scale <= 1);
}

/* Penetration of the rotor into a ring [m], 0 if there is no contact, and its direction. */
static inline amb_real amb_ring_depth(const amb_ring *ring, const amb_real s[], amb_real way[2])
{
  const amb_real a = s[ring->first], b = ring->second < 0 ? 0 : s[ring->second];
  if (!(a * a + b * b > ring->travel * ring->travel))
    return 0;
  const amb_real far = ring->second < 0 ? amb_magnitude(a) : amb_root(a * a + b * b);
  way[0] = a / far;
  way[1] = b / far;
  return far - ring->travel;
}

/* Adds the forces of soft stops to those along the axes, for a speed of rotation [rad/s]. Returns
 * whether there are any. */
static inline bool amb_plant_contact(const amb_plant *plant, const amb_real s[], const amb_real X[],
                                     amb_real speed, amb_real F[])
{
  bool any = false;
  for (int k = 0; k < plant->rings; k++) {
    const amb_ring *ring = &plant->ring[k];
    const amb_parts *stop = ring->stop;
    amb_real way[2];
    const amb_real depth = amb_ring_depth(ring, s, way);
    if (depth > 0) {
      const bool two = ring->second >= 0;
      const amb_real v = amb_plant_velocity(plant, ring->first, X);
      const amb_real w = two ? amb_plant_velocity(plant, ring->second, X) : 0;
      const amb_real force = amb_parts_push(stop, depth, way[0] * v + way[1] * w);
      const amb_real slip = speed * stop->radius + way[0] * w - way[1] * v;
      const amb_real rub = stop->friction * force * amb_clamp(slip / AMB_STICKS, -1, 1);
      F[ring->first] -= force * way[0] - rub * way[1];
      if (two)
        F[ring->second] -= force * way[1] + rub * way[0];
      any = any || (stop->stiffness > 0);
    }
  }
  return any;
}

static inline bool amb_plant_in_contact(const amb_plant *plant, const amb_real X[])
{
  amb_real s[AMB_PLANT_AXES], F[AMB_PLANT_AXES] = {0};
  for (int f = 0; f < plant->axes; f++)
    s[f] = amb_plant_along(plant, f, X);
  return amb_plant_contact(plant, s, X, 0, F);
}

#endif
