#include "contact_bounce.h"

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
  if (!own->brief) {
    touch_in_turn(&kf->model, own, mean, F, N);
  }
  amb_clear(amb_states(&kf->model), later);
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down at;
    if (own->brief) {
      start from;
      if (approach_from(&kf->model, own, ring, mean, F, &at, &from)) {
        const impulse of = impulse_of(own, ring, &from, AMB_C(0.0), AMB_C(0.0));
        at.force = of.mean;
        react(own, ring, &at);
        add_force(&at, N);
        add_later(&kf->model, own, &at, -of.late, later);
      }
    } else if (touch_beside(&kf->model, own, ring, mean, F, N, &at)) {
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

/* Adds to a gradient those of displacement and velocity in a direction, with these factors. */
AMB_INLINE void add_gradient(int n, const amb_contact *own, const touch_down *at,
                             const amb_real direction[2], amb_real by_place, amb_real by_rate,
                             amb_real w[AMB_STATES])
{
  for (int a = 0; a < at->axes; a++) {
    const amb_real *row = own->displacement[at->axis[a]];
    const amb_real *rate = own->velocity[at->axis[a]];
    for (int i = 0; i < n; i++) {
      w[i] += direction[a] * (by_place * row[i] + by_rate * rate[i]);
    }
  }
}

/* Second entry of a ring, the force across the reaction: the reaction turns with the rotor, and the
 * friction of one that rolls follows its slip. `late`: lateness of both. */
AMB_INLINE void cross_contact(const amb_kalman *kf, const amb_contact *own, int ring,
                              const amb_kalman_state *s, touch_down *at, amb_real late[AMB_STATES])
{
  const int n = amb_states(&kf->model);
  const touch_down *of = &at[0];
  const amb_real across[2] = {-of->normal[1], of->normal[0]};
  const amb_real by_place = (of->force - of->sticks * of->rate) / of->radius;
  const amb_real rubs = (of->sticks > AMB_C(0.0)) ? own->friction[ring] : AMB_C(0.0);
  add_gradient(n, own, of, across, of->c * of->across / of->radius, AMB_C(0.0), at[0].w);
  add_turn(&kf->model, own, of, late);
  at[1].axes = 2;
  at[1].axis[0] = of->axis[0];
  at[1].axis[1] = of->axis[1];
  at[1].reaction[0] = -of->reaction[1];
  at[1].reaction[1] = of->reaction[0];
  at[1].force = AMB_C(0.0);
  amb_clear(n, at[1].w);
  amb_clear(n, at[1].u);
  amb_clear(n, at[1].spread);
  add_gradient(n, own, of, across, by_place, of->sticks, at[1].w);
  add_response(&kf->model, 0, &at[1]);
  add_response(&kf->model, 1, &at[1]);
  add_spread(n, s->cov, at[1].w, at[1].spread);
  at[1].variance = times(n, at[1].w, at[1].spread);
  at[1].extra = own->scatter_squared * (of->turn * of->turn + rubs * rubs) * of->force * of->force;
}

/* All resolved contacts, each with w, u and P w, and their lateness. Returns how many entries. */
AMB_INLINE int all_contacts(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                            const amb_real F[AMB_FORCES], touch_down at[AMB_RESOLVED],
                            amb_real late[AMB_STATES])
{
  const int n = amb_states(&kf->model);
  int count = 0;
  amb_real N[AMB_FORCES];
  if (amb_forces(&kf->model) > 1) {
    touch_in_turn(&kf->model, own, s->mean, F, N);
    amb_clear(n, late);
  }
  for (int ring = 0; ring < own->rings; ring++) {
    touch_down *now = &at[count];
    amb_clear(n, now->w); /* without contact too: the proof does not follow the count */
    amb_clear(n, now->u);
    amb_clear(n, now->spread);
    const bool touches = (amb_forces(&kf->model) > 1)
                             ? touch_beside(&kf->model, own, ring, s->mean, F, N, now)
                             : touch(&kf->model, own, ring, s->mean, F, now);
    if (touches) {
      count += (amb_forces(&kf->model) > 1) ? now->axes : 1;
      add_gradient(n, own, now, now->normal, now->k, now->c, now->w);
      for (int a = 0; a < now->axes; a++) {
        add_response(&kf->model, a, now);
      }
      if (amb_forces(&kf->model) > 1) {
        add_force(now, N);
        if (now->axes > 1) {
          cross_contact(kf, own, ring, s, now, late);
        }
      }
      add_spread(n, s->cov, now->w, now->spread);
      add_curvature(n, own, ring, now);
    }
  }
  return count;
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
  touch_down at[AMB_RESOLVED];
  amb_real late[AMB_STATES];
  const int count = all_contacts(kf, own, s, F, at, late);
  for (int e = 0; e < count; e++) {
    *status |= AMB_CONTACT;
    add_force(&at[e], F);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, k, iu);
  if ((predicted == AMB_OK) && (count > 0)) {
    for (int i = 0; (amb_forces(&kf->model) > 1) && (i < amb_states(&kf->model)); i++) {
      s->mean[i] += late[i];
    }
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
