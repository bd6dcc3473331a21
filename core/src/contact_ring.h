/* A ring in contact: where the rotor touches it, and with which force. */
#ifndef AMBKIT_CONTACT_RING_H
#define AMBKIT_CONTACT_RING_H

#include "ambkit/contact.h"
#include "ambkit/root.h"
#include "kalman_step.h"

/* The contact of a ring, or after it its lateness, of which only `force` and what follows
 * `elastic` are set; w, u as in ambkit/contact.h. */
typedef struct touch_down {
  bool likely; /* more likely than not */
  int axes;    /* 1 or 2 */
  int axis[2];
  amb_real normal[2];          /* outward normal [1] ... */
  amb_real reaction[2];        /* ... and the negative reaction to N = 1, friction included [1] */
  amb_real radius;             /* mean displacement without N [m] ... */
  amb_real depth;              /* ... penetration [m] ... */
  amb_real rate;               /* ... its rate ... */
  amb_real across;             /* ... and the velocity across the normal [m/s] */
  amb_real turn;               /* rotation of the normal over the sample, at most 1 [rad] */
  amb_real sticks;             /* tangent of the friction by the slip [N s/m]; 0: sliding */
  amb_real elastic;            /* E [N] */
  amb_real force;              /* N [N]; 0: free */
  amb_real k;                  /* tangents of N: by the depth [N/m] ... */
  amb_real c;                  /* ... and by its rate [N s/m] */
  amb_real variance;           /* variance of N [N^2]: by that of the states ... */
  amb_real extra;              /* ... and in addition, by curvature and scatter */
  amb_real cross;              /* covariance of the extra parts of N and its lateness [N^2] */
  amb_real w[AMB_STATES];      /* gradient of N by the states */
  amb_real u[AMB_STATES];      /* response of the states to N */
  amb_real spread[AMB_STATES]; /* P w, then A P w */
} touch_down;

AMB_INLINE amb_real times(int n, const amb_real row[AMB_STATES], const amb_real states[AMB_STATES])
{
  amb_real sum = row[0] * states[0];
  for (int i = 1; i < n; i++) {
    sum += row[i] * states[i];
  }
  return sum;
}

/* Elastic force E [N] at a penetration and its tangent k, at most that of half an inverse
 * compliance. */
AMB_INLINE void elastic_force(amb_real stiffness, amb_real compliance, amb_real depth, amb_real *E,
                              amb_real *k)
{
  const amb_real slope = AMB_C(1.5) * stiffness; /* of the tangent by the root of d */
  const amb_real stiffest = AMB_C(0.5) / compliance;
  const amb_real last = stiffest / slope; /* root of the depth of the stiffest tangent */
  const amb_real edge = last * last;
  const amb_real curved = amb_at_most(depth, edge);
  const amb_real root = amb_root(curved);
  *k = slope * root;
  *E = stiffness * curved * root;
  if (depth > edge) {
    *E += stiffest * (depth - edge);
  }
}

/* Mean displacement [m] and velocity [m/s] along each axis over a sample without forces. */
typedef struct motion {
  amb_real displacement[AMB_FORCES];
  amb_real velocity[AMB_FORCES];
} motion;

/* Number of states that contacts may depend on, the first ones. */
AMB_INLINE int seen_states(const amb_model *model, const amb_contact *own)
{
  return (amb_forces(model) > 1) ? own->seen : amb_states(model);
}

AMB_INLINE motion free_motion(const amb_model *model, const amb_contact *own,
                              const amb_real mean[AMB_STATES])
{
  motion free;
  for (int axis = 0; axis < amb_forces(model); axis++) {
    free.displacement[axis] = own->displacement[axis][0] * mean[0];
    free.velocity[axis] = own->velocity[axis][0] * mean[0];
  }
  for (int i = 1; i < seen_states(model, own); i++) {
    for (int axis = 0; axis < amb_forces(model); axis++) {
      free.displacement[axis] += own->displacement[axis][i] * mean[i];
      free.velocity[axis] += own->velocity[axis][i] * mean[i];
    }
  }
  return free;
}

/* Force that has the effect of all forces F on the mean motion along an axis. */
AMB_INLINE amb_real along(const amb_model *model, const amb_contact *own, int axis,
                          const amb_real F[AMB_FORCES])
{
  if (amb_forces(model) == 1) {
    return F[0];
  }
  amb_real sum = own->coupling[axis][0] * F[0];
  for (int f = 1; f < amb_forces(model); f++) {
    sum += own->coupling[axis][f] * F[f];
  }
  return sum;
}

/* Normal, penetration and velocities of a ring in a motion that other forces F change, if the
 * displacement is beyond `least`; leaves w, u and spread unchanged. */
AMB_INLINE bool approach(const amb_model *model, const amb_contact *own, int ring,
                         const motion *free, const amb_real F[AMB_FORCES], amb_real least,
                         touch_down *at)
{
  const bool two = (amb_forces(model) > 1) && (own->second[ring] != own->first[ring]);
  at->likely = true;
  at->axes = two ? 2 : 1;
  at->axis[0] = (int)own->first[ring];
  at->axis[1] = (int)own->second[ring];
  at->normal[0] = AMB_C(0.0);
  at->normal[1] = AMB_C(0.0);
  at->reaction[0] = AMB_C(0.0);
  at->reaction[1] = AMB_C(0.0);
  at->radius = AMB_C(0.0);
  at->across = AMB_C(0.0);
  at->turn = AMB_C(0.0);
  at->sticks = AMB_C(0.0);
  at->elastic = AMB_C(0.0);
  at->force = AMB_C(0.0);
  at->k = AMB_C(0.0);
  at->c = AMB_C(0.0);
  at->variance = AMB_C(0.0);
  at->extra = AMB_C(0.0);
  const amb_real F_a = along(model, own, at->axis[0], F);
  const amb_real F_b = two ? along(model, own, at->axis[1], F) : AMB_C(0.0);
  const amb_real compliance = own->compliance[ring];
  const amb_real a = free->displacement[at->axis[0]] + compliance * F_a;
  const amb_real b = two ? (free->displacement[at->axis[1]] + compliance * F_b) : AMB_C(0.0);
  const amb_real radius = two ? amb_root(a * a + b * b) : amb_magnitude(a);
  if (!(radius > least)) {
    return false;
  }
  at->depth = radius - own->clearance[ring];
  at->normal[0] = a / radius;
  at->normal[1] = two ? (b / radius) : AMB_C(0.0);
  const amb_real mobility = own->mobility[ring];
  const amb_real v = free->velocity[at->axis[0]] + mobility * F_a;
  const amb_real w = two ? (free->velocity[at->axis[1]] + mobility * F_b) : AMB_C(0.0);
  at->rate = at->normal[0] * v;
  if (two) {
    at->rate += at->normal[1] * w;
    at->across = at->normal[0] * w - at->normal[1] * v;
    at->radius = radius;
    at->turn = amb_clamp(AMB_C(3.0) * compliance / mobility * at->across / radius, AMB_C(-1.0),
                         AMB_C(1.0));
    at->depth += radius * at->turn * at->turn / AMB_C(24.0);
  }
  return true;
}

/* Reaction to N = 1: along the normal, and by friction across it. */
AMB_INLINE void react(const amb_contact *own, int ring, touch_down *at)
{
  at->reaction[0] = at->normal[0];
  at->reaction[1] = at->normal[1];
  if ((at->axes > 1) && (at->force > AMB_C(0.0))) {
    const amb_real mobility = own->mobility[ring];
    const amb_real slip =
        own->surface[ring] + at->across + AMB_C(0.25) * mobility * at->turn * at->force;
    const amb_real sticks = AMB_C(0.5) / mobility; /* stops the slip in a sample */
    const amb_real most = own->friction[ring] * at->force;
    const amb_real stops = sticks * slip;
    const amb_real share = amb_clamp(stops, -most, most) / at->force;
    at->sticks = (amb_magnitude(stops) < most) ? sticks : AMB_C(0.0);
    const amb_real mean = AMB_C(1.0) - at->turn * at->turn / AMB_C(24.0);
    at->reaction[0] = mean * (at->normal[0] - share * at->normal[1]);
    at->reaction[1] = mean * (at->normal[1] + share * at->normal[0]);
  }
}

/* Adds the response of the states to the lateness across the reaction, which turns with the rotor
 * within the sample. */
AMB_INLINE void add_turn(const amb_model *model, const amb_contact *own, const touch_down *at,
                         amb_real moved[AMB_STATES])
{
  if (at->axes > 1) {
    const amb_real late = at->force * at->turn / AMB_C(3.0);
    for (int i = 0; i < amb_states(model); i++) {
      moved[i] += late * (at->reaction[1] * own->later[at->axis[0]][i] -
                          at->reaction[0] * own->later[at->axis[1]][i]);
    }
  }
}

/* Contact of a ring in a motion that other forces F change. Returns whether there is any; leaves w,
 * u and spread unchanged. */
AMB_INLINE bool touch(const amb_model *model, const amb_contact *own, int ring, const motion *free,
                      const amb_real F[AMB_FORCES], touch_down *at)
{
  if (!approach(model, own, ring, free, F, own->clearance[ring], at)) {
    return false;
  }
  const amb_real compliance = own->compliance[ring];
  const amb_real mobility = own->mobility[ring];
  elastic_force(own->stiffness[ring], compliance, at->depth, &at->elastic, &at->k);
  at->c = amb_at_most(AMB_C(1.5) * own->damping[ring] * at->elastic, AMB_C(0.5) / mobility);
  const amb_real force = at->elastic + at->c * at->rate;
  if (!(force > AMB_C(0.0))) {
    return false;
  }
  const amb_real implicit = AMB_C(1.0) / (AMB_C(1.0) + compliance * at->k + mobility * at->c);
  at->force = implicit * force;
  at->k *= implicit;
  at->c *= implicit;
  react(own, ring, at);
  return true;
}

AMB_INLINE void add_force(const touch_down *at, amb_real F[AMB_FORCES])
{
  for (int a = 0; a < at->axes; a++) {
    F[at->axis[a]] -= at->force * at->reaction[a];
  }
}

/* The contact of a ring under the other forces F and those of the other contacts, of all of which
 * N [N] are those along the axes so far, and then without its own. Returns whether there is any. */
AMB_INLINE bool touch_beside(const amb_model *model, const amb_contact *own, int ring,
                             const motion *free, const amb_real F[AMB_FORCES],
                             amb_real N[AMB_FORCES], touch_down *at)
{
  amb_real beside[AMB_FORCES];
  N[own->first[ring]] = AMB_C(0.0);
  N[own->second[ring]] = AMB_C(0.0);
  beside[0] = F[0] + N[0];
  for (int f = 1; f < amb_forces(model); f++) {
    beside[f] = F[f] + N[f];
  }
  return touch(model, own, ring, free, (amb_forces(model) > 1) ? beside : F, at);
}

/* N of all contacts but the first, from last to first: each knows those after it. */
AMB_INLINE void touch_in_turn(const amb_model *model, const amb_contact *own, const motion *free,
                              const amb_real F[AMB_FORCES], amb_real N[AMB_FORCES])
{
  touch_down at;
  amb_clear(amb_forces(model), N);
  if ((amb_forces(model) > 1) && (own->rings > 1)) {
    for (int ring = own->rings - 1; ring > 0; ring--) {
      if (touch_beside(model, own, ring, free, F, N, &at)) {
        add_force(&at, N);
      }
    }
  }
}

/* Adds P w, of the upper triangle of P. */
AMB_INLINE void add_spread(int n, const amb_real P[AMB_TRIANGLE], const amb_real w[AMB_STATES],
                           amb_real spread[AMB_STATES])
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    spread[i] += P[entry] * w[i];
    entry++;
    for (int j = i + 1; j < n; j++) {
      spread[i] += P[entry] * w[j];
      spread[j] += P[entry] * w[i];
      entry++;
    }
  }
}

/* Response of the states to N along an axis. */
AMB_INLINE void add_response(const amb_model *model, int a, touch_down *at)
{
  amb_real by_force[AMB_STATES];
  amb_model_pushed(model, at->axis[a], by_force);
  for (int i = 0; i < amb_states(model); i++) {
    at->u[i] += at->reaction[a] * by_force[i];
  }
}

#endif
