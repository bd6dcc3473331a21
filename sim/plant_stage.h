/* Forces and rates of the plant at one stage of a substep, as plant_text.h needs them. Included by
 * plant.c only. */
#ifndef AMBKIT_SIM_PLANT_STAGE_H
#define AMBKIT_SIM_PLANT_STAGE_H

#include "generated/closed_law.h"
#include "plant_forces.h"

/* Rotation at an instant. */
typedef struct amb_rotor_angle {
  amb_real speed, cosine, sine;
} amb_rotor_angle;

/* Constants over an interval with constant demand. */
typedef struct amb_substep_constants {
  const amb_plant *plant;
  const amb_acts *acts;
  const amb_real *demanded;
  amb_real h, half, sixth;
  amb_real g[AMB_PLANT_STATES];
  amb_real per_mass[AMB_PLANT_STATES], per_lag[AMB_SENSORS];
  bool as_built;                        /* whether magnets have currents and their nominal force */
  amb_real growth;                      /* angular acceleration [rad/s^2] */
  bool turning;                         /* whether the angle is needed */
  amb_rotor_angle at_sample, turned[3]; /* and at the stages of a substep */
  bool *met;                            /* set if a stage is in a soft stop */
} amb_substep_constants;

/* ---- Amplifiers ---- */

/* Rates of the currents of axis f. */
static void flow(const amb_substep_constants *of, int f, const amb_real X[], amb_real s,
                 amb_real d[])
{
  const amb_plant *plant = of->plant;
  const amb_parts *parts = &plant->amplifier[f];
  const int first = plant->current[f], second = plant->second[f];
  const amb_real iu = of->demanded[f], scale = of->acts->scale;
  const amb_real v = parts->voltage > 0 ? amb_plant_velocity(plant, f, X) : 0;
  if (first >= 0)
    d[first] = amb_parts_rate(parts, scale, X[first], iu, s, v);
  if (second >= 0)
    d[second] = -amb_parts_rate(parts, scale, -X[second], -iu, -s, -v);
}

/* Sizes and flags of a plant. Constant patterns let the compiler unroll the substep. */
typedef struct amb_pattern {
  int positions, axes, sensors, states;
  bool own, plain; /* as in amb_plant */
  bool closed;     /* the closed law of two sides, evaluated without a pointer */
} amb_pattern;

static const amb_pattern closed_axis = {1, 1, 1, 3, true, true, true};
static const amb_pattern plain_axis = {1, 1, 1, 3, true, true, false};
static const amb_pattern axis_with_parts = {1, 1, 1, 5, true, false, false};

/* A stage may be beyond a stop; magnet and sensor of an isolated axis are evaluated within it. */
AMB_INLINE amb_real amb_reachable(const amb_pattern *p, const amb_substep_constants *of, amb_real x,
                                  int k)
{
  return p->own ? amb_plant_within(of->plant, k, x) : x;
}

/* `start` plus `by` times the acceleration of position k by the forces. */
AMB_INLINE amb_real amb_driven(const amb_pattern *p, const amb_substep_constants *of,
                               amb_real start, amb_real by, const amb_real F[], int k)
{
  return p->own ? start + by * of->per_mass[k] * F[k]
                : start + by * amb_sparse_times(&of->plant->B, of->plant->B.value, k, F);
}

/* Acceleration of position k by motion and unbalance. */
static amb_real moved(const amb_substep_constants *of, const amb_real X[],
                      const amb_rotor_angle *now, int k)
{
  const amb_plant *plant = of->plant;
  amb_real sum = 0;
  for (int j = plant->A.start[k]; j < plant->A.start[k + 1]; j++)
    sum += (plant->A.value[j] + now->speed * plant->spin[j]) * X[plant->A.column[j]];
  if (plant->cosine != NULL) {
    const amb_real square = now->speed * now->speed;
    sum += (square * now->cosine + of->growth * now->sine) * plant->cosine[k] +
           (square * now->sine - of->growth * now->cosine) * plant->sine[k];
  }
  return sum;
}

/* Forces F and rates d: accelerations in addition to g (not for a plain plant), and rates of the
 * first-order states. */
AMB_INLINE void amb_stage(const amb_pattern *p, const amb_substep_constants *of, const amb_real X[],
                          int stage, amb_real F[], amb_real d[])
{
  const amb_plant *plant = of->plant;
  const amb_rotor_angle *now = &of->turned[stage];
  const int q = p->positions;
  amb_real s[AMB_PLANT_AXES];
  for (int j = 2 * q + p->sensors; j < p->states; j++)
    d[j] = 0;
  for (int f = 0; f < p->axes; f++) {
    s[f] = p->own ? X[f] : amb_sparse_times(&plant->H, plant->H.value, f, X);
    const amb_real at = p->own ? s[f] : amb_plant_within(plant, f, s[f]), iu = of->demanded[f];
    if (p->closed)
      F[f] = amb_law_force((const amb_law *)plant->magnet[f].self, iu, at);
    else if (p->plain && of->as_built)
      F[f] = plant->magnet[f].methods->force(plant->magnet[f].self, iu, at);
    else
      F[f] = amb_plant_force(plant, of->acts, f, X, iu, at);
  }
  if (!p->own)
    amb_plant_couple(plant, of->acts, X, of->demanded, s, F);
  if (!p->plain) {
    for (int f = 0; f < p->axes; f++) {
      const amb_real force = F[f];
      flow(of, f, X, p->own ? s[f] : amb_plant_within(plant, f, s[f]), d);
      amb_parts_follow(&plant->amplifier[f], X, force, d);
      F[f] = amb_parts_behind(&plant->amplifier[f], X, force);
    }
    if (amb_plant_contact(plant, s, X, now->speed, F))
      *of->met = true;
    for (int k = 0; k < q; k++)
      d[q + k] = p->own ? 0 : moved(of, X, now, k);
  }
  for (int r = 0; r < p->sensors; r++) {
    const amb_real x = p->own ? X[r] : amb_sparse_times(&plant->C, plant->C.value, r, X),
                   K = plant->gain[r];
    const int j = p->own ? 2 * q + r : plant->shows[r];
    const amb_real seen =
        p->plain ? K * x : amb_parts_shown(&plant->sensor[r], K, x, now->cosine, now->sine);
    d[j] = (seen - X[j]) * of->per_lag[r];
  }
}

#include "plant_text.h"

#endif
