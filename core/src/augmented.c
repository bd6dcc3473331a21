#include "ambkit/augmented.h"
#include "kalman_step.h"

static const amb_augmented *own_of(const amb_estimator *self)
{
  return (const amb_augmented *)self->own;
}

/* to = from + s var s'. */
static void widen(int n, const amb_real from[AMB_TRIANGLE], const amb_real s[AMB_STATES],
                  amb_real var, amb_real to[AMB_TRIANGLE])
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    const amb_real with_theta = s[i] * var;
    for (int j = i; j < n; j++) {
      to[entry] = from[entry] + with_theta * s[j];
      entry++;
    }
  }
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  const int n = amb_states(&self->kf->model);
  amb_augmented_state *s = (amb_augmented_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    amb_copy(amb_entry(n, n - 1, n), s->base.cov, s->cov);
    s->theta = AMB_C(1.0);
    s->trusted = AMB_C(1.0);
    s->var = own_of(self)->std * own_of(self)->std;
    amb_excitation_reset(&s->excitation, s->base.mean);
  }
  return status;
}

/* Decorrelates restarted states from theta; with several sensors only those that correlate with the
 * restarted one (with_y nonzero). */
static void decorrelate_theta(const amb_model *model, amb_augmented_state *s,
                              const amb_real with_y[AMB_STATES])
{
  (void)with_y;
  for (int i = 0; i < amb_states(model); i++) {
#if AMB_SENSORS > 1
    if ((amb_sensors(model) > 1) && !(amb_magnitude(with_y[i]) > AMB_C(0.0))) {
      continue;
    }
#endif
    s->excitation.slope[i] = AMB_C(0.0);
  }
}

/* As amb_step_contain. While a position is known, the other states keep their correlations, with
 * theta too. */
static amb_status contain(const amb_kalman *kf, amb_augmented_state *s)
{
  const int n = amb_states(&kf->model);
  bool held[AMB_STATES];
  if (!amb_step_is_lost(kf, &s->base)) {
    return AMB_OK;
  }
  const bool nowhere = !amb_envelope_lost(kf, s->base.cov, held);
  const amb_status status = amb_step_contain(kf, &s->base);
  int entry = 0;
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      if (nowhere || held[i] || held[j]) {
        s->cov[entry] = s->base.cov[entry];
      }
      entry++;
    }
    if (nowhere || held[i]) {
      s->excitation.slope[i] = AMB_C(0.0);
    }
  }
  return status;
}

/* Sets theta, and moves the states along their slopes. */
static void move(int n, amb_augmented_state *s, amb_real theta)
{
  const amb_real by = theta - s->theta;
  s->theta = theta;
  for (int i = 0; i < n; i++) {
    s->base.mean[i] += s->excitation.slope[i] * by;
  }
}

/* Random walk of theta by var_k; its covariance with the states, s p, is unchanged. */
static void add_random_walk(int n, const amb_augmented *own, amb_augmented_state *s)
{
  if (s->var < (own->std * own->std)) {
    const amb_real grown = s->var + own->var_k;
    const amb_real kept = amb_at_most(s->var / grown, AMB_C(1.0));
    widen(n, s->cov, s->excitation.slope, kept * own->var_k, s->cov);
    for (int i = 0; i < n; i++) {
      s->excitation.slope[i] *= kept;
    }
    s->var = grown;
  }
}

/* Repairs theta and its variance after a bit flip: the last trusted value, with the initial
 * variance. */
static void mend(const amb_augmented *own, amb_augmented_state *s)
{
  const amb_real most = own->std * own->std;
  if (!((s->trusted >= own->min) && (s->trusted <= own->max))) {
    s->trusted = AMB_C(1.0);
  }
  if (!((s->theta >= own->min) && (s->theta <= own->max))) {
    s->theta = s->trusted;
  }
  if (!((s->var >= AMB_C(0.0)) && (s->var <= (most + own->var_k)))) {
    s->var = most;
  }
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const int n = amb_states(&kf->model);
  const amb_augmented *own = own_of(self);
  amb_augmented_state *s = (amb_augmented_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_real known[AMB_FORCES];
  amb_real F[AMB_FORCES];
  amb_stiffness *k = result->stiffness;
  amb_status status = amb_step_currents(kf, &s->base, u, iu);
  mend(own, s);
  if (((status & AMB_SATURATED) != 0U) && amb_excitation_doubt(&s->excitation, &own->learn)) {
    move(n, s, s->trusted);
    s->var = own->std * own->std;
  }
  amb_step_forces(kf, self->magnet, iu, s->base.mean, known, k);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    known[f] += own->bias[f];
    k[f].k_i *= s->theta;
    k[f].k_s *= s->theta;
    F[f] = s->theta * known[f] + (kf->set.f_0[f] - own->bias[f]);
  }
  amb_copy(amb_entry(n, n - 1, n), s->cov, s->base.cov);
  const amb_status predicted = amb_step_predict_with(kf, &s->base, F, k, iu);
  if (predicted == AMB_OK) {
    amb_copy(amb_entry(n, n - 1, n), s->base.cov, s->cov);
    amb_excitation_predict(&s->excitation, &kf->model, k, known);
    add_random_walk(n, own, s);
  }
  if ((status & AMB_BAD_CONTROL) != 0U) {
    amb_excitation_miss(&s->excitation);
  }
  widen(n, s->cov, s->excitation.slope, s->var, s->base.cov);
  status |= contain(kf, s);
  return status | predicted;
}

/* One sample, with the innovations of all sensors for theta before the update. */
typedef struct sample_updates {
  amb_augmented_state *s;
  amb_real on_y[AMB_SENSORS]; /* slope of the reading */
  amb_real e[AMB_SENSORS];    /* innovation [m] */
  amb_real S[AMB_SENSORS];    /* its variance for known theta [m^2] */
} sample_updates;

static amb_status take_in(const amb_kalman *kf, const void *own, void *of, int r, amb_real y,
                          amb_real noise, amb_step_innovation *out)
{
  const int n = amb_states(&kf->model);
  sample_updates *h = (sample_updates *)of;
  amb_augmented_state *s = h->s;
  amb_real with_y[AMB_STATES];
  (void)own;
  amb_model_shown_with(&kf->model, r, s->cov, with_y);
  h->on_y[r] = amb_model_shown(&kf->model, r, s->excitation.slope);
  amb_copy(amb_entry(n, n - 1, n), s->cov, s->base.cov);
  const amb_status status = amb_step_update(kf, &s->base, r, y, noise, out);
  amb_copy(amb_entry(n, n - 1, n), s->base.cov, s->cov);
  h->e[r] = out->innovation;
  h->S[r] = amb_at_least(out->variance, noise); /* no change; shows the bound to the proof */
  out->variance += h->on_y[r] * s->var * h->on_y[r];
  if ((status & AMB_RESTARTED) != 0U) {
    decorrelate_theta(&kf->model, s, with_y);
  }
  if ((status & AMB_UNINFORMATIVE) == 0U) {
    amb_excitation_update(&s->excitation, &kf->model, r, with_y, h->S[r]);
  }
  return status;
}

/* Corrects theta by the sensors in sequence; each innovation is reduced by the change of theta so
 * far. */
static void learn(const amb_kalman *kf, const amb_augmented *own, const sample_updates *h,
                  amb_kalman_result *result)
{
  const amb_model *model = &kf->model;
  amb_augmented_state *s = h->s;
  amb_real theta = s->theta;
  for (int r = 0; r < amb_sensors(model); r++) {
    if ((result->health[r] & AMB_UNINFORMATIVE) == 0U) {
      const amb_real on_y = h->on_y[r];
      const amb_real known = on_y * (theta - s->theta);
      const amb_real e = h->e[r] - known;
      const amb_real total = h->S[r] + amb_at_least(on_y * s->var * on_y, AMB_C(0.0));
      const amb_real gain = (s->var * on_y) / total;
      theta = amb_clamp(theta + gain * e, own->min, own->max);
      s->var *= amb_at_most(h->S[r] / total, AMB_C(1.0));
      result->innovation[r] -= known;
      if (!amb_step_coarse(kf, r, AMB_COARSE)) {
        result->variance[r] = total;
      }
    }
  }
  move(amb_states(model), s, theta);
  if (!(s->excitation.doubt > AMB_C(0.0))) {
    s->trusted = s->theta;
  }
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_augmented *own = own_of(self);
  sample_updates h;
  h.s = (amb_augmented_state *)state;
  amb_augmented_state *s = h.s;
  amb_status status = amb_step_each(take_in, kf, own, &h, &s->base, true, y, result);
  if (!amb_step_informative(&kf->model, result)) {
    amb_excitation_miss(&s->excitation);
  } else if (amb_excitation_learns(&s->excitation, &own->learn, kf, s->base.mean)) {
    learn(kf, own, &h, result);
  } else {
    status |= AMB_UNEXCITED;
  }
  amb_excitation_hold(&s->excitation, kf);
  widen(amb_states(&kf->model), s->cov, s->excitation.slope, s->var, s->base.cov);
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  amb_scaled_advance(self, own_of(self)->bias, scale, iu, mean);
}

static void scale(const amb_estimator *self, const void *state, amb_real *value, amb_real *variance)
{
  const amb_augmented_state *s = (const amb_augmented_state *)state;
  (void)self;
  *value = s->theta;
  *variance = s->var;
}

const amb_estimator_methods amb_augmented_methods = {
    sizeof(amb_augmented_state), reset, predict, update, advance, scale, NULL};
