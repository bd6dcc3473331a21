#include "contact_bounce.h"
#include "linear_forces.h"

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
  const motion free = free_motion(&kf->model, own, mean);
  if (!own->brief) {
    touch_in_turn(&kf->model, own, &free, F, N);
  }
  amb_clear(amb_states(&kf->model), later);
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down at;
    if (own->brief) {
      start from;
      if (approach_from(&kf->model, own, ring, mean, &free, F, &at, &from)) {
        const impulse of = impulse_of(own, ring, &from, AMB_C(0.0), AMB_C(0.0));
        at.force = of.mean;
        react(own, ring, &at);
        add_force(&at, N);
        add_later(&kf->model, own, &at, -of.late, later);
      }
    } else if (touch_beside(&kf->model, own, ring, &free, F, N, &at)) {
      add_force(&at, N);
      add_turn(&kf->model, own, &at, later);
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

/* Mean and variance of N over the uncertainty of the penetration, by the variance of N. */
AMB_INLINE void add_curvature(const amb_contact *own, int ring, touch_down *at)
{
  /* A lower limit of E, so that the quotient is always finite. */
  const amb_real least = AMB_C(1e-9) * own->clearance[ring] / own->compliance[ring];
  const amb_real E = amb_at_least(at->elastic, least);
  const amb_real share = at->variance / (AMB_C(6.0) * E * E);
  const amb_real bend = amb_at_most(amb_at_least(share, AMB_C(0.0)), AMB_C(6.0));
  const amb_real relative = AMB_C(2.0) * bend * bend + own->scatter_squared;
  at->extra = relative * at->force * at->force;
  at->force += bend * at->force;
}

/* The resolved contact of one axis, with w, u and P w. Returns whether there is any. */
AMB_INLINE bool one_contact(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                            const amb_real F[AMB_FORCES], touch_down *at)
{
  const int n = amb_states(&kf->model);
  const motion free = free_motion(&kf->model, own, s->mean);
  if ((own->rings == 0) || !touch(&kf->model, own, 0, &free, F, at)) {
    return false;
  }
  amb_clear(n, at->u);
  amb_clear(n, at->spread);
  for (int i = 0; i < n; i++) {
    at->w[i] = at->normal[0] * (at->k * own->displacement[0][i] + at->c * own->velocity[0][i]);
  }
  add_response(&kf->model, 0, at);
  add_spread(n, s->cov, at->w, at->spread);
  at->variance = times(n, at->w, at->spread);
  add_curvature(own, 0, at);
  return true;
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

#if AMB_FORCES > 1
/* w' P w, of a w with `seen` entries. */
AMB_INLINE amb_real variance_of(int n, int seen, const amb_real P[AMB_TRIANGLE],
                                const amb_real w[AMB_STATES])
{
  amb_real half = AMB_C(0.0);
  for (int i = 0; (i + 1) < seen; i += 2) { /* two rows, which share the entries of w */
    const amb_real *row = &P[amb_entry(n, i, 0)];
    const amb_real *next = &P[amb_entry(n, i + 1, 0)];
    amb_real sum = AMB_C(0.5) * row[i] * w[i] + row[i + 1] * w[i + 1];
    amb_real below = AMB_C(0.5) * next[i + 1] * w[i + 1];
    for (int j = i + 2; j < seen; j++) {
      sum += row[j] * w[j];
      below += next[j] * w[j];
    }
    half += w[i] * sum + w[i + 1] * below;
  }
  if ((seen % 2) != 0) {
    const int last = seen - 1;
    half += AMB_C(0.5) * P[amb_entry(n, last, last)] * w[last] * w[last];
  }
  return AMB_C(2.0) * half;
}

/* Adds the gradients of a ring's forces along its axes by the states, and their variances besides:
 * those of N with the reaction, and those of the force across it. The reaction turns with the
 * rotor, and the friction of one that rolls follows its slip. */
AMB_INLINE void add_ring(const amb_model *model, const amb_contact *own, int ring,
                         const amb_real P[AMB_TRIANGLE], touch_down *at, linear_forces *forces)
{
  const int n = amb_states(model);
  const int p = amb_forces(model);
  const int axis[2] = {at->axis[0], at->axis[1]};
  const bool two = at->axes > 1;
  const amb_real across[2] = {-at->normal[1], at->normal[0]};
  const amb_real turned[2] = {-at->reaction[1], at->reaction[0]};
  amb_real slope = AMB_C(0.0); /* of N by the displacement across the normal ... */
  amb_real turns = AMB_C(0.0); /* ... and of the force across the reaction */
  amb_real extra = AMB_C(0.0);
  if (two) {
    const amb_real rubs = (at->sticks > AMB_C(0.0)) ? own->friction[ring] : AMB_C(0.0);
    slope = at->c * at->across / at->radius;
    turns = (at->force - at->sticks * at->rate) / at->radius;
    extra = own->scatter_squared * (at->turn * at->turn + rubs * rubs) * at->force * at->force;
  }
  const amb_real by_place[2] = {at->k * at->normal[0] + slope * across[0],
                                at->k * at->normal[1] + slope * across[1]};
  const amb_real by_rate[2] = {at->c * at->normal[0], at->c * at->normal[1]};
  const amb_real turns_by[2] = {turns * across[0], turns * across[1]};
  const amb_real rolls_by[2] = {at->sticks * across[0], at->sticks * across[1]};
  amb_real *first = &forces->row[axis[0] * n];
  amb_real *second = &forces->row[axis[1] * n];
  for (int j = 0; j < own->seen; j++) {
    const amb_real place[2] = {own->displacement[axis[0]][j], own->displacement[axis[1]][j]};
    const amb_real rate[2] = {own->velocity[axis[0]][j], own->velocity[axis[1]][j]};
    const amb_real w = by_place[0] * place[0] + by_place[1] * place[1] + by_rate[0] * rate[0] +
                       by_rate[1] * rate[1];
    const amb_real beside = turns_by[0] * place[0] + turns_by[1] * place[1] +
                            rolls_by[0] * rate[0] + rolls_by[1] * rate[1];
    at->w[j] = w;
    first[j] = at->reaction[1] * beside - at->reaction[0] * w;
    if (two) {
      second[j] = -at->reaction[1] * w - at->reaction[0] * beside;
    }
  }
  at->variance = variance_of(n, own->seen, P, at->w);
  add_curvature(own, ring, at);
  for (int a = 0; a < at->axes; a++) {
    for (int b = 0; b < at->axes; b++) {
      forces->variance[axis[a] * p + axis[b]] =
          at->extra * (at->reaction[a] * at->reaction[b]) + extra * (turned[a] * turned[b]);
    }
  }
}

/* All resolved contacts of several axes under the other forces F, which become all forces, with the
 * lateness of the contacts. */
AMB_INLINE bool all_contacts(const amb_kalman *kf, const amb_contact *own,
                             const amb_kalman_state *s, amb_real F[AMB_FORCES],
                             linear_forces *forces, amb_real late[AMB_STATES])
{
  const int n = amb_states(&kf->model);
  const int p = amb_forces(&kf->model);
  const motion free = free_motion(&kf->model, own, s->mean);
  amb_real N[AMB_FORCES];
  amb_real sum[AMB_FORCES];
  bool any = false;
  touch_in_turn(&kf->model, own, &free, F, N);
  amb_clear(n, late);
  amb_clear(p, sum);
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down at;
    if (touch_beside(&kf->model, own, ring, &free, F, N, &at)) {
      if (!any) {
        amb_clear(p * n, forces->row);
        amb_clear(p * p, forces->variance);
      }
      any = true;
      add_force(&at, N);
      add_turn(&kf->model, own, &at, late);
      add_ring(&kf->model, own, ring, s->cov, &at, forces);
      add_force(&at, sum);
    }
  }
  for (int f = 0; f < p; f++) {
    F[f] += sum[f];
  }
  return any;
}

/* Prediction of several axes with resolved contacts. */
AMB_INLINE amb_status predict_rings(const amb_kalman *kf, const amb_contact *own,
                                    amb_kalman_state *s, amb_real F[AMB_FORCES],
                                    const amb_stiffness k[AMB_FORCES],
                                    const amb_real iu[AMB_CONTROLS], amb_status *status)
{
  linear_forces forces;
  amb_real late[AMB_STATES];
  const bool any = all_contacts(kf, own, s, F, &forces, late);
  const amb_status predicted = amb_linear_forces_predict(kf, s, F, k, iu, any ? &forces : NULL);
  if ((predicted == AMB_OK) && any) {
    *status |= AMB_CONTACT;
    for (int i = 0; i < amb_states(&kf->model); i++) {
      s->mean[i] += late[i];
    }
  }
  return predicted;
}
#endif

/* Prediction with the other forces F, which become all forces, and resolved contacts. */
AMB_INLINE amb_status predict_contacts(const amb_kalman *kf, const amb_contact *own,
                                       amb_kalman_state *s, amb_real F[AMB_FORCES],
                                       const amb_stiffness k[AMB_FORCES],
                                       const amb_real iu[AMB_CONTROLS], amb_status *status)
{
#if AMB_FORCES > 1
  if (amb_forces(&kf->model) > 1) {
    return predict_rings(kf, own, s, F, k, iu, status);
  }
#endif
  touch_down at[1];
  const bool any = one_contact(kf, own, s, F, at);
  if (any) {
    *status |= AMB_CONTACT;
    add_force(at, F);
  }
  const amb_status predicted = amb_linear_forces_predict(kf, s, F, k, iu, NULL);
  if ((predicted == AMB_OK) && any) {
    add_contact_stiffness(kf, 1, false, at, k, s->cov);
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
  const amb_status predicted = amb_linear_forces_predict(kf, s, F, k, iu, NULL);
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
      own->brief ? predict_bounces(kf, own, s, F, result->stiffness, iu, &status)
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
