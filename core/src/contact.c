#include "ambkit/contact.h"
#include "ambkit/root.h"
#include "kalman_step.h"

#define AMB_CONTACTS (2 * AMB_FORCES)

/* The contact of a ring, or after it its lateness, of which only `force` and what follows
 * `elastic` are set; w, u as in ambkit/contact.h. */
typedef struct touch_down {
  bool likely; /* more likely than not */
  int axes;    /* 1 or 2 */
  int axis[2];
  amb_real normal[2];          /* outward normal [1] ... */
  amb_real reaction[2];        /* ... and the negative reaction to N = 1, friction included [1] */
  amb_real depth;              /* penetration [m] ... */
  amb_real rate;               /* ... its rate ... */
  amb_real across;             /* ... and the velocity across the normal [m/s] */
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

/* Friction of a ring relative to N, against the slip [m/s]. */
AMB_INLINE amb_real friction(const amb_contact *own, int ring, amb_real force, amb_real slip)
{
  const amb_real most = own->friction[ring] * force;
  const amb_real stops = AMB_C(0.5) / own->mobility[ring] * slip; /* stops the slip in a sample */
  return amb_clamp(stops, -most, most) / force;
}

/* Normal, penetration and velocities of a ring at a mean of the states and under the other forces
 * F, if the displacement is beyond `least`; leaves w, u and spread unchanged. */
AMB_INLINE bool approach(const amb_model *model, const amb_contact *own, int ring,
                         const amb_real mean[AMB_STATES], const amb_real F[AMB_FORCES],
                         amb_real least, touch_down *at)
{
  const int n = amb_states(model);
  const bool two = (amb_forces(model) > 1) && (own->second[ring] != own->first[ring]);
  at->likely = true;
  at->axes = two ? 2 : 1;
  at->axis[0] = (int)own->first[ring];
  at->axis[1] = (int)own->second[ring];
  at->normal[0] = AMB_C(0.0);
  at->normal[1] = AMB_C(0.0);
  at->reaction[0] = AMB_C(0.0);
  at->reaction[1] = AMB_C(0.0);
  at->elastic = AMB_C(0.0);
  at->force = AMB_C(0.0);
  at->k = AMB_C(0.0);
  at->c = AMB_C(0.0);
  at->variance = AMB_C(0.0);
  at->extra = AMB_C(0.0);
  const amb_real F_a = F[at->axis[0]];
  const amb_real F_b = two ? F[at->axis[1]] : AMB_C(0.0);
  const amb_real compliance = own->compliance[ring];
  const amb_real a = times(n, own->displacement[at->axis[0]], mean) + compliance * F_a;
  const amb_real b =
      two ? (times(n, own->displacement[at->axis[1]], mean) + compliance * F_b) : AMB_C(0.0);
  const amb_real radius = two ? amb_root(a * a + b * b) : amb_magnitude(a);
  if (!(radius > least)) {
    return false;
  }
  at->depth = radius - own->clearance[ring];
  at->normal[0] = a / radius;
  at->normal[1] = two ? (b / radius) : AMB_C(0.0);
  const amb_real mobility = own->mobility[ring];
  const amb_real v = times(n, own->velocity[at->axis[0]], mean) + mobility * F_a;
  const amb_real w =
      two ? (times(n, own->velocity[at->axis[1]], mean) + mobility * F_b) : AMB_C(0.0);
  at->rate = at->normal[0] * v;
  at->across = AMB_C(0.0);
  if (two) {
    at->rate += at->normal[1] * w;
    at->across = at->normal[0] * w - at->normal[1] * v;
  }
  return true;
}

/* Reaction to N = 1: along the normal, and by friction across it. */
AMB_INLINE void react(const amb_contact *own, int ring, touch_down *at)
{
  at->reaction[0] = at->normal[0];
  at->reaction[1] = at->normal[1];
  if ((at->axes > 1) && (at->force > AMB_C(0.0))) {
    const amb_real share = friction(own, ring, at->force, own->surface[ring] + at->across);
    at->reaction[0] -= share * at->normal[1];
    at->reaction[1] += share * at->normal[0];
  }
}

/* Contact of a ring at a mean of the states and under the other forces F. Returns whether there is
 * any; leaves w, u and spread unchanged. */
AMB_INLINE bool touch(const amb_model *model, const amb_contact *own, int ring,
                      const amb_real mean[AMB_STATES], const amb_real F[AMB_FORCES], touch_down *at)
{
  if (!approach(model, own, ring, mean, F, own->clearance[ring], at)) {
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

/* Motion along the normal at the start of a sample. */
typedef struct start {
  amb_real depth; /* penetration [m] */
  amb_real rate;  /* and its rate [m per sample] */
  amb_real F;     /* forces along the normal, those of the stop excepted [N] */
  amb_real T;     /* sampling time [s] */
} start;

/* ... from its means over the sample, where they come near to the clearance. */
AMB_INLINE bool approach_from(const amb_model *model, const amb_contact *own, int ring,
                              const amb_real mean[AMB_STATES], const amb_real F[AMB_FORCES],
                              touch_down *at, start *from)
{
  if (!approach(model, own, ring, mean, F, AMB_C(0.5) * own->clearance[ring], at)) {
    return false;
  }
  const int load = amb_first(model, AMB_LOAD);
  from->F = AMB_C(0.0);
  for (int a = 0; a < at->axes; a++) {
    const int axis = at->axis[a];
    from->F += at->normal[a] * (F[axis] + ((load < 0) ? AMB_C(0.0) : mean[load + axis]));
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

AMB_INLINE void add_force(const touch_down *at, amb_real F[AMB_FORCES])
{
  for (int a = 0; a < at->axes; a++) {
    F[at->axis[a]] -= at->force * at->reaction[a];
  }
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

/* Magnet forces without current [N], relative to the bias forces, and their tangents. */
AMB_INLINE void forces_without_current(const amb_model *model, const amb_contact *own,
                                       amb_real F[AMB_FORCES], amb_stiffness k[AMB_FORCES])
{
  static const amb_stiffness none = {AMB_C(0.0), AMB_C(0.0)};
  for (int f = 0; f < amb_forces(model); f++) {
    F[f] = -own->bias[f];
    k[f] = none;
  }
}

/* The same as amb_contact_forces; `later`: what their lateness adds to the states. */
AMB_INLINE amb_status forces_at(const amb_estimator *self, const amb_real mean[AMB_STATES],
                                const amb_real iu[AMB_CONTROLS], amb_real scale, bool deenergised,
                                amb_real F[AMB_FORCES], amb_real N[AMB_FORCES],
                                amb_real later[AMB_STATES])
{
  const amb_kalman *kf = self->kf;
  const amb_contact *own = (const amb_contact *)self->own;
  amb_status status = AMB_OK;
  amb_stiffness unused[AMB_FORCES];
  amb_step_forces(kf, self->magnet, iu, mean, F, unused);
  if (deenergised) {
    forces_without_current(&kf->model, own, F, unused);
  }
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] = scale * F[f] + kf->set.f_0[f];
    N[f] = AMB_C(0.0);
  }
  amb_clear(amb_states(&kf->model), later);
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down at;
    if (own->parts > 1) {
      start from;
      if (approach_from(&kf->model, own, ring, mean, F, &at, &from)) {
        const impulse of = impulse_of(own, ring, &from, AMB_C(0.0), AMB_C(0.0));
        at.force = of.mean;
        react(own, ring, &at);
        add_force(&at, N);
        add_later(&kf->model, own, &at, -of.late, later);
      }
    } else if (touch(&kf->model, own, ring, mean, F, &at)) {
      add_force(&at, N);
    } else {
      at.force = AMB_C(0.0);
    }
    status |= (at.force > AMB_C(0.0)) ? AMB_CONTACT : AMB_OK;
  }
  return status;
}

amb_status amb_contact_forces(const amb_estimator *self, const amb_real mean[AMB_STATES],
                              const amb_real iu[AMB_CONTROLS], amb_real scale, bool deenergised,
                              amb_real F[AMB_FORCES], amb_real N[AMB_FORCES])
{
  amb_real unused[AMB_STATES];
  return forces_at(self, mean, iu, scale, deenergised, F, N, unused);
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

/* Mean and variance of N over the uncertainty of the penetration. */
AMB_INLINE void add_curvature(int n, const amb_contact *own, int ring, touch_down *at)
{
  /* A lower limit of E, so that the quotient is always finite. */
  const amb_real least = AMB_C(1e-9) * own->clearance[ring] / own->compliance[ring];
  const amb_real E = amb_at_least(at->elastic, least);
  at->variance = times(n, at->w, at->spread);
  const amb_real share = at->variance / (AMB_C(6.0) * E * E);
  const amb_real bend = amb_at_most(amb_at_least(share, AMB_C(0.0)), AMB_C(6.0));
  const amb_real relative = AMB_C(2.0) * bend * bend + own->scatter_squared;
  at->extra = relative * at->force * at->force;
  at->force += bend * at->force;
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
                       const amb_kalman_state *s, const amb_real F[AMB_FORCES], touch_down at[2])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  start from;
  if (!approach_from(model, own, ring, s->mean, F, &at[0], &from)) {
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

/* All resolved contacts, each with w, u and P w. Returns their number. */
AMB_INLINE int all_contacts(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                            const amb_real F[AMB_FORCES], touch_down at[AMB_FORCES])
{
  const int n = amb_states(&kf->model);
  int count = 0;
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down *now = &at[count];
    amb_clear(n, now->w); /* without contact too: the proof does not follow the count */
    amb_clear(n, now->u);
    amb_clear(n, now->spread);
    if (touch(&kf->model, own, ring, s->mean, F, now)) {
      count++;
      for (int a = 0; a < now->axes; a++) {
        const amb_real *row = own->displacement[now->axis[a]];
        const amb_real *rate = own->velocity[now->axis[a]];
        for (int i = 0; i < n; i++) {
          now->w[i] += now->normal[a] * (now->k * row[i] + now->c * rate[i]);
        }
        add_response(&kf->model, a, now);
      }
      add_spread(n, s->cov, now->w, now->spread);
      add_curvature(n, own, ring, now);
    }
  }
  return count;
}

/* All short contacts, two entries for each ring, 0 without contact. Returns whether there is any.
 */
AMB_INLINE bool all_bounces(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                            const amb_real F[AMB_FORCES], touch_down at[AMB_CONTACTS])
{
  const int n = amb_states(&kf->model);
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
    if (bounce(kf, own, ring, s, F, now)) {
      any = true;
    } else {
      now->likely = false;
      now->force = AMB_C(0.0);
    }
  }
  return any;
}

/* From A P A' of the free rotor to that of the rotor in contact, with the additional variances;
 * `in_pairs`: entries 2 j and 2 j + 1 are a force and its lateness. */
AMB_INLINE void add_contact_stiffness(const amb_kalman *kf, int count, bool in_pairs,
                                      touch_down at[], const amb_stiffness k[AMB_FORCES],
                                      amb_real P[AMB_TRIANGLE])
{
  static const amb_real no_current[AMB_CONTROLS] = {AMB_C(0.0)};
  const int n = amb_states(&kf->model);
  amb_real both[AMB_CONTACTS][AMB_CONTACTS]; /* covariances of the forces [N^2] */
  for (int r = 0; r < count; r++) {
    for (int s = 0; s < count; s++) {
      both[r][s] = (r == s) ? (at[r].variance + at[r].extra) : times(n, at[r].w, at[s].spread);
      if (in_pairs && (r != s) && ((r / 2) == (s / 2))) {
        both[r][s] += at[2 * (r / 2)].cross;
      }
    }
  }
  for (int r = 0; r < count; r++) {
    amb_step_carry(&kf->model, k, NULL, no_current, at[r].spread);
    for (int s = 0; s < count; s++) {
      for (int i = 0; i < n; i++) {
        at[r].spread[i] -= AMB_C(0.5) * both[r][s] * at[s].u[i];
      }
    }
  }
  for (int r = 0; r < count; r++) {
    int entry = 0;
    for (int i = 0; i < n; i++) {
      for (int j = i; j < n; j++) {
        P[entry] -= at[r].u[i] * at[r].spread[j] + at[r].spread[i] * at[r].u[j];
        entry++;
      }
    }
  }
}

/* Prediction with the other forces F, which become all forces, and resolved contacts. */
AMB_INLINE amb_status predict_contacts(const amb_kalman *kf, const amb_contact *own,
                                       amb_kalman_state *s, amb_real F[AMB_FORCES],
                                       const amb_stiffness k[AMB_FORCES],
                                       const amb_real iu[AMB_CONTROLS], amb_status *status)
{
  touch_down at[AMB_FORCES];
  const int count = all_contacts(kf, own, s, F, at);
  for (int ring = 0; ring < count; ring++) {
    *status |= AMB_CONTACT;
    add_force(&at[ring], F);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, k, iu);
  if ((predicted == AMB_OK) && (count > 0)) {
    add_contact_stiffness(kf, count, false, at, k, s->cov);
  }
  return predicted;
}

/* The same with short contacts. */
AMB_INLINE amb_status predict_bounces(const amb_kalman *kf, const amb_contact *own,
                                      amb_kalman_state *s, amb_real F[AMB_FORCES],
                                      const amb_stiffness k[AMB_FORCES],
                                      const amb_real iu[AMB_CONTROLS], amb_status *status)
{
  touch_down at[AMB_CONTACTS];
  const bool any = all_bounces(kf, own, s, F, at);
  for (int ring = 0; ring < own->rings; ring++) {
    *status |= at[2 * ring].likely ? AMB_CONTACT : AMB_OK;
    add_force(&at[2 * ring], F);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, k, iu);
  if ((predicted == AMB_OK) && any) {
    const int n = amb_states(&kf->model);
    for (int ring = 0; ring < own->rings; ring++) {
      for (int i = 0; i < n; i++) {
        s->mean[i] -= at[2 * ring + 1].force * at[2 * ring + 1].u[i];
      }
    }
    add_contact_stiffness(kf, 2 * amb_forces(&kf->model), true, at, k, s->cov);
  }
  return predicted;
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  amb_contact_state *s = (amb_contact_state *)state;
  s->deenergised = false;
  return amb_kalman_reset(self->kf, &s->base, mean, std);
}

void amb_contact_deenergise(void *state)
{
  amb_contact_state *s = (amb_contact_state *)state;
  s->deenergised = true;
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_contact *own = (const amb_contact *)self->own;
  amb_contact_state *contact_state = (amb_contact_state *)state;
  amb_kalman_state *s = &contact_state->base;
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->mean, F, result->stiffness);
  if (contact_state->deenergised) {
    contact_state->deenergised = false;
    forces_without_current(&kf->model, own, F, result->stiffness);
  }
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += kf->set.f_0[f];
  }
  const amb_status predicted =
      (own->parts > 1) ? predict_bounces(kf, own, s, F, result->stiffness, iu, &status)
                       : predict_contacts(kf, own, s, F, result->stiffness, iu, &status);
  status |= amb_step_contain(kf, s);
  return status | predicted;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  const amb_kalman *kf = self->kf;
  amb_real F[AMB_FORCES];
  amb_real N[AMB_FORCES];
  amb_real later[AMB_STATES];
  (void)forces_at(self, mean, iu, scale, false, F, N, later);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += N[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
  for (int i = 0; i < amb_states(&kf->model); i++) {
    mean[i] += later[i];
  }
}

const amb_estimator_methods amb_contact_methods = {sizeof(amb_contact_state), reset,   predict,
                                                   amb_plain_update,          advance, NULL,
                                                   amb_contact_deenergise};
