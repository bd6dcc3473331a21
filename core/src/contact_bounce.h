/* Contacts as short as a few samples: integrated in parts of a sample, at three points. */
#ifndef AMBKIT_CONTACT_BOUNCE_H
#define AMBKIT_CONTACT_BOUNCE_H

#include "contact_ring.h"

#define AMB_CONTACTS (2 * AMB_FORCES) /* entries: the force of each ring, and its lateness */

/* Motion along the normal at the start of a sample. */
typedef struct start {
  amb_real depth; /* penetration [m] */
  amb_real rate;  /* and its rate [m per sample] */
  amb_real F;     /* forces along the normal, those of the stop excepted [N] */
  amb_real T;     /* sampling time [s] */
} start;

/* ... from its means over the sample, where they come near to the clearance. */
AMB_INLINE bool approach_from(const amb_model *model, const amb_contact *own, int ring,
                              const amb_real mean[AMB_STATES], const motion *free,
                              const amb_real F[AMB_FORCES], touch_down *at, start *from)
{
  if (!approach(model, own, ring, free, F, AMB_C(0.5) * own->clearance[ring], at)) {
    return false;
  }
  const int load = amb_first(model, AMB_LOAD);
  from->F = AMB_C(0.0);
  for (int a = 0; a < at->axes; a++) {
    const int axis = at->axis[a];
    from->F += at->normal[a] * (along(model, own, axis, F) +
                                ((load < 0) ? AMB_C(0.0) : along(model, own, axis, &mean[load])));
  }
  const amb_real moved = own->compliance[ring] * from->F; /* by F within a sample, times 1/6 */
  from->T = AMB_C(3.0) * own->compliance[ring] / own->mobility[ring];
  from->rate = at->rate * from->T - AMB_C(3.0) * moved;
  from->depth = at->depth - AMB_C(0.5) * at->rate * from->T + AMB_C(0.5) * moved;
  return true;
}

/* Normal force of a stop over a sample [N]. */
typedef struct impulse {
  amb_real mean;
  amb_real late; /* lateness */
} impulse;

/* ... by integration from a start, deeper by `depth` [m] and faster by `rate` [m per sample]. */
AMB_INLINE impulse impulse_of(const amb_contact *own, int ring, const start *from, amb_real depth,
                              amb_real rate)
{
  const amb_real h = AMB_C(1.0) / (amb_real)AMB_CONTACT_PARTS;
  const amb_real moved = AMB_C(6.0) * own->compliance[ring]; /* T^2 / mass */
  const amb_real compliance = own->compliance[ring] * h * h;
  const amb_real mobility = own->mobility[ring] * h;
  const amb_real F = from->F;
  amb_real d = from->depth + depth;
  amb_real v = from->rate + rate;
  impulse sum = {AMB_C(0.0), AMB_C(0.0)};
  for (int part = 0; part < AMB_CONTACT_PARTS; part++) {
    const amb_real there = d + AMB_C(0.5) * h * v + compliance * F;
    amb_real N = AMB_C(0.0);
    if (there > AMB_C(0.0)) {
      amb_real E;
      amb_real k;
      elastic_force(own->stiffness[ring], compliance, there, &E, &k);
      const amb_real c = amb_at_most(AMB_C(1.5) * own->damping[ring] * E, AMB_C(0.5) / mobility);
      const amb_real force = E + c * (v / from->T + mobility * F);
      N = amb_at_least(force, AMB_C(0.0)) / (AMB_C(1.0) + compliance * k + mobility * c);
    }
    const amb_real faster = h * moved * (F - N);
    d += h * (v + AMB_C(0.5) * faster);
    v += faster;
    sum.mean += h * N;
    sum.late += h * N * (AMB_C(4.0) * h * ((amb_real)part + AMB_C(0.5)) - AMB_C(2.0));
  }
  return sum;
}

/* Response of the states to a lateness along the reaction. */
AMB_INLINE void add_later(const amb_model *model, const amb_contact *own, const touch_down *at,
                          amb_real late, amb_real moved[AMB_STATES])
{
  for (int a = 0; a < at->axes; a++) {
    for (int i = 0; i < amb_states(model); i++) {
      moved[i] += late * at->reaction[a] * own->later[at->axis[a]][i];
    }
  }
}

/* Gradient of a number with these derivatives by displacement and velocity, and P times it, from
 * those of both. */
AMB_INLINE void combine(int n, amb_real by_depth, amb_real by_rate,
                        const amb_real depth[AMB_STATES], const amb_real rate[AMB_STATES],
                        amb_real sum[AMB_STATES])
{
  for (int i = 0; i < n; i++) {
    sum[i] = by_depth * depth[i] + by_rate * rate[i];
  }
}

/* Contact that is as short as a few samples, at most: N, and its lateness as a second entry. */
AMB_INLINE bool bounce(const amb_kalman *kf, const amb_contact *own, int ring,
                       const amb_kalman_state *s, const motion *free, const amb_real F[AMB_FORCES],
                       touch_down at[2])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  start from;
  if (!approach_from(model, own, ring, s->mean, free, F, &at[0], &from)) {
    return false;
  }
  /* Standard deviations (Cholesky) of penetration and rate. */
  amb_real depth[AMB_STATES];
  amb_real rate[AMB_STATES];
  amb_real P_depth[AMB_STATES];
  amb_real P_rate[AMB_STATES];
  amb_clear(n, depth);
  amb_clear(n, rate);
  amb_clear(n, P_depth);
  amb_clear(n, P_rate);
  for (int a = 0; a < at[0].axes; a++) {
    const int axis = at[0].axis[a];
    for (int i = 0; i < n; i++) {
      const amb_real moved = from.T * own->velocity[axis][i];
      rate[i] += at[0].normal[a] * moved;
      depth[i] += at[0].normal[a] * (own->displacement[axis][i] - AMB_C(0.5) * moved);
    }
  }
  for (int i = 0; i < n; i++) { /* f_d does not act before the start */
    if (amb_model_role(model, i) == AMB_LOAD) {
      depth[i] = AMB_C(0.0);
      rate[i] = AMB_C(0.0);
    }
  }
  add_spread(n, s->cov, depth, P_depth);
  add_spread(n, s->cov, rate, P_rate);
  const amb_real least = AMB_C(1e-12) * own->clearance[ring] * own->clearance[ring];
  const amb_real deep = amb_root(amb_at_least(times(n, depth, P_depth), least));
  const amb_real both = times(n, rate, P_depth) / deep;
  const amb_real fast = amb_root(amb_at_least(times(n, rate, P_rate) - both * both, least));
  /* The three points. */
  const amb_real inwards = AMB_C(-1.4142135623730951);
  const amb_real outwards = AMB_C(0.7071067811865476);
  const amb_real side = AMB_C(1.224744871391589);
  const impulse far = impulse_of(own, ring, &from, inwards * deep, inwards * both);
  const impulse slow = impulse_of(own, ring, &from, outwards * deep, outwards * both - side * fast);
  const impulse quick =
      impulse_of(own, ring, &from, outwards * deep, outwards * both + side * fast);
  const amb_real third = AMB_C(0.3333333333333333);
  at[0].force = third * (far.mean + slow.mean + quick.mean);
  if (!(at[0].force > AMB_C(0.0))) {
    return false;
  }
  const bool touches[3] = {far.mean > AMB_C(0.0), slow.mean > AMB_C(0.0), quick.mean > AMB_C(0.0)};
  at[0].likely = (touches[1] && touches[2]) || (touches[0] && (touches[1] || touches[2]));
  react(own, ring, &at[0]);
  for (int a = 0; a < at[0].axes; a++) {
    add_response(model, a, &at[0]);
  }
  add_later(model, own, &at[0], AMB_C(1.0), at[1].u);
  at[1].force = third * (far.late + slow.late + quick.late);
  const amb_real slopes[2][2] = {
      {third * (inwards * far.mean + outwards * (slow.mean + quick.mean)) / deep,
       third * side * (quick.mean - slow.mean) / fast},
      {third * (inwards * far.late + outwards * (slow.late + quick.late)) / deep,
       third * side * (quick.late - slow.late) / fast}};
  for (int e = 0; e < 2; e++) {
    const amb_real by_rate = slopes[e][1];
    const amb_real by_depth = slopes[e][0] - by_rate * both / deep;
    combine(n, by_depth, by_rate, depth, rate, at[e].w);
    combine(n, by_depth, by_rate, P_depth, P_rate, at[e].spread);
    at[e].variance = times(n, at[e].w, at[e].spread);
    at[e].extra = own->scatter_squared * at[e].force * at[e].force;
  }
  at[0].cross = own->scatter_squared * at[0].force * at[1].force;
  return true;
}

/* All short contacts, two entries for each ring, 0 without contact. Returns whether there is any.
 */
AMB_INLINE bool all_bounces(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                            const amb_real F[AMB_FORCES], touch_down at[AMB_CONTACTS])
{
  const int n = amb_states(&kf->model);
  const motion free = free_motion(&kf->model, own, s->mean);
  bool any = false;
  for (int e = 0; e < 2 * amb_forces(&kf->model); e++) {
    at[e].likely = false;
    at[e].axes = 0;
    at[e].force = AMB_C(0.0);
    at[e].variance = AMB_C(0.0);
    at[e].extra = AMB_C(0.0);
    at[e].cross = AMB_C(0.0);
    amb_clear(n, at[e].w);
    amb_clear(n, at[e].u);
    amb_clear(n, at[e].spread);
  }
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down *now = &at[2 * ring];
    if (bounce(kf, own, ring, s, &free, F, now)) {
      any = true;
    } else {
      now->likely = false;
      now->force = AMB_C(0.0);
    }
  }
  return any;
}

#endif
