#include "ambkit/contact.h"
#include "ambkit/root.h"
#include "kalman_step.h"

/* The contact of a ring; w, u as in ambkit/contact.h. */
typedef struct touch_down {
  int axes; /* 1 or 2 */
  int axis[2];
  amb_real normal[2];          /* outward normal [1] ... */
  amb_real reaction[2];        /* ... and the negative reaction to N = 1, friction included [1] */
  amb_real depth;              /* penetration [m] */
  amb_real elastic;            /* E [N] */
  amb_real force;              /* N [N]; 0: free */
  amb_real k;                  /* tangents of N: by the depth [N/m] ... */
  amb_real c;                  /* ... and by its rate [N s/m] */
  amb_real variance;           /* variance of N [N^2]: by that of the states ... */
  amb_real extra;              /* ... and in addition, by curvature and scatter */
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

/* Elastic force at the penetration and its tangent, which is at most 3 mass / T^2. */
AMB_INLINE void elastic_force(const amb_contact *own, int ring, touch_down *at)
{
  const amb_real slope = AMB_C(1.5) * own->stiffness[ring]; /* of the tangent by the root of d */
  const amb_real stiffest = AMB_C(0.5) / own->compliance[ring];
  const amb_real last = stiffest / slope; /* root of the depth of the stiffest tangent */
  const amb_real edge = last * last;
  const amb_real curved = amb_at_most(at->depth, edge);
  const amb_real root = amb_root(curved);
  at->k = slope * root;
  at->elastic = own->stiffness[ring] * curved * root;
  if (at->depth > edge) {
    at->elastic += stiffest * (at->depth - edge);
  }
}

/* Friction of a ring relative to N, against the slip [m/s]. */
AMB_INLINE amb_real friction(const amb_contact *own, int ring, amb_real force, amb_real slip)
{
  const amb_real most = own->friction[ring] * force;
  const amb_real stops = AMB_C(0.5) / own->mobility[ring] * slip; /* stops the slip in a sample */
  return amb_clamp(stops, -most, most) / force;
}

/* Contact of a ring at a mean of the states and under the other forces F. Returns whether there is
 * any; leaves w, u and spread unchanged. */
AMB_INLINE bool touch(const amb_model *model, const amb_contact *own, int ring,
                      const amb_real mean[AMB_STATES], const amb_real F[AMB_FORCES], touch_down *at)
{
  const int n = amb_states(model);
  const bool two = (amb_forces(model) > 1) && (own->second[ring] != own->first[ring]);
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
  if (!(radius > own->clearance[ring])) {
    return false;
  }
  at->depth = radius - own->clearance[ring];
  at->normal[0] = a / radius;
  at->normal[1] = b / radius;
  const amb_real mobility = own->mobility[ring];
  const amb_real v = times(n, own->velocity[at->axis[0]], mean) + mobility * F_a;
  const amb_real w =
      two ? (times(n, own->velocity[at->axis[1]], mean) + mobility * F_b) : AMB_C(0.0);
  elastic_force(own, ring, at);
  at->c = amb_at_most(AMB_C(1.5) * own->damping[ring] * at->elastic, AMB_C(0.5) / mobility);
  const amb_real depth_rate = at->normal[0] * v + at->normal[1] * w;
  const amb_real force = at->elastic + at->c * depth_rate;
  if (!(force > AMB_C(0.0))) {
    return false;
  }
  const amb_real implicit = AMB_C(1.0) / (AMB_C(1.0) + compliance * at->k + mobility * at->c);
  at->force = implicit * force;
  at->k *= implicit;
  at->c *= implicit;
  at->reaction[0] = at->normal[0];
  at->reaction[1] = at->normal[1];
  if (two) {
    const amb_real slip = own->surface[ring] + at->normal[0] * w - at->normal[1] * v;
    const amb_real share = friction(own, ring, at->force, slip);
    at->reaction[0] -= share * at->normal[1];
    at->reaction[1] += share * at->normal[0];
  }
  return true;
}

AMB_INLINE void add_force(const touch_down *at, amb_real F[AMB_FORCES])
{
  for (int a = 0; a < at->axes; a++) {
    F[at->axis[a]] -= at->force * at->reaction[a];
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

amb_status amb_contact_forces(const amb_estimator *self, const amb_real mean[AMB_STATES],
                              const amb_real iu[AMB_CONTROLS], amb_real scale, bool deenergised,
                              amb_real F[AMB_FORCES], amb_real N[AMB_FORCES])
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
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down at;
    if (touch(&kf->model, own, ring, mean, F, &at)) {
      status = AMB_CONTACT;
      add_force(&at, N);
    }
  }
  return status;
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

/* All contacts, each with w, u and P w. Returns their number. */
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
        amb_real by_force[AMB_STATES];
        amb_model_pushed(&kf->model, now->axis[a], by_force);
        for (int i = 0; i < n; i++) {
          now->w[i] += now->normal[a] * (now->k * row[i] + now->c * rate[i]);
          now->u[i] += now->reaction[a] * by_force[i];
        }
      }
      add_spread(n, s->cov, now->w, now->spread);
      add_curvature(n, own, ring, now);
    }
  }
  return count;
}

/* From A P A' of the free rotor to that of the rotor in contact, with the additional variances. */
AMB_INLINE void add_contact_stiffness(const amb_kalman *kf, int count, touch_down at[AMB_FORCES],
                                      const amb_stiffness k[AMB_FORCES], amb_real P[AMB_TRIANGLE])
{
  static const amb_real no_current[AMB_CONTROLS] = {AMB_C(0.0)};
  const int n = amb_states(&kf->model);
  amb_real both[AMB_FORCES][AMB_FORCES]; /* w' P w of two rings [N^2] */
  for (int r = 0; r < count; r++) {
    for (int s = 0; s < count; s++) {
      both[r][s] = (r == s) ? (at[r].variance + at[r].extra) : times(n, at[r].w, at[s].spread);
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
  touch_down at[AMB_FORCES];
  amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->mean, F, result->stiffness);
  if (contact_state->deenergised) {
    contact_state->deenergised = false;
    forces_without_current(&kf->model, own, F, result->stiffness);
  }
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += kf->set.f_0[f];
  }
  const int count = all_contacts(kf, own, s, F, at);
  for (int ring = 0; ring < count; ring++) {
    status |= AMB_CONTACT;
    add_force(&at[ring], F);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, result->stiffness, iu);
  if ((predicted == AMB_OK) && (count > 0)) {
    add_contact_stiffness(kf, count, at, result->stiffness, s->cov);
  }
  status |= amb_step_contain(kf, s);
  return status | predicted;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  const amb_kalman *kf = self->kf;
  amb_real F[AMB_FORCES];
  amb_real N[AMB_FORCES];
  (void)amb_contact_forces(self, mean, iu, scale, false, F, N);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += N[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

const amb_estimator_methods amb_contact_methods = {sizeof(amb_contact_state), reset,   predict,
                                                   amb_plain_update,          advance, NULL,
                                                   amb_contact_deenergise};
