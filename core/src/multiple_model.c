#include "ambkit/multiple_model.h"
#include "kalman_step.h"
#include "mixture.h"

static const amb_multiple_model *own_of(const amb_estimator *self)
{
  return (const amb_multiple_model *)self->own;
}

/* All models know only that the rotor is within the envelope. */
static void begin_anew(const amb_kalman *kf, int models, amb_multiple_model_state *s)
{
  const int n = amb_states(&kf->model);
  amb_clear(n, s->base.mean);
  amb_envelope_open(kf, s->base.cov);
  amb_mixture_restart(n, models, s);
}

/* Restart all models if one of them has left the envelope. */
static amb_status hold_each(const amb_kalman *kf, int models, amb_multiple_model_state *s)
{
  for (int j = 0; j < models; j++) {
    if (!amb_envelope_bounds(kf, AMB_BOUNDLESS, s->model[j].mean, s->model[j].cov)) {
      begin_anew(kf, models, s);
      return AMB_RESTARTED;
    }
  }
  amb_excitation_hold(&s->excitation, kf);
  return AMB_OK;
}

/* As amb_step_contain. */
static amb_status contain(const amb_kalman *kf, int models, amb_multiple_model_state *s)
{
  const amb_status status = amb_step_contain(kf, &s->base);
  if (status != AMB_OK) {
    amb_mixture_restart(amb_states(&kf->model), models, s);
  }
  return status;
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  const amb_model *model = &self->kf->model;
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  const int n = own_of(self)->n;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    amb_mixture_restart(amb_states(model), n, s);
    for (int j = 0; j < n; j++) {
      s->model[j].weight = AMB_C(1.0) / (amb_real)n;
      s->trusted[j] = s->model[j].weight;
    }
    amb_excitation_reset(&s->excitation, s->base.mean);
    s->beyond = AMB_C(0.0);
    s->excited = false;
  }
  return status;
}

/* Predict model j over a sample, with the control currents iu [A]. */
static void predict_one(const amb_estimator *self, amb_multiple_model_state *s, int j,
                        const amb_real iu[AMB_CONTROLS])
{
  const amb_kalman *kf = self->kf;
  const amb_multiple_model *own = own_of(self);
  const amb_real theta = own->theta[j];
  amb_one_model *m = &s->model[j];
  amb_real F[AMB_FORCES];
  amb_stiffness k[AMB_FORCES];
  amb_step_forces(kf, self->magnet, iu, m->mean, F, k);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] = theta * (F[f] + own->bias[f]) + (kf->set.f_0[f] - own->bias[f]);
    k[f].k_i *= theta;
    k[f].k_s *= theta;
  }
  amb_model_predict_mean(&kf->model, F, iu, m->mean);
  amb_model_predict_covariance(&kf->model, k, kf->set.k_ui, kf->set.var_u, kf->growth, m->cov,
                               AMB_ROOM(&s->base));
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const int n = amb_states(&kf->model);
  const amb_multiple_model *own = own_of(self);
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_status status = amb_step_currents(kf, &s->base, u, iu);
  amb_mixture_repair(own->n, s);
  if ((status & AMB_BAD_CONTROL) != 0U) {
    amb_excitation_miss(&s->excitation);
  }
  if (((status & AMB_SATURATED) != 0U) && amb_excitation_doubt(&s->excitation, &own->learn)) {
    for (int j = 0; j < own->n; j++) {
      s->model[j].weight = s->trusted[j];
    }
    amb_mixture_combine(n, own->n, s);
    if (!amb_envelope_bounds(kf, AMB_BOUNDLESS, s->base.mean, s->base.cov)) { /* nor are models */
      begin_anew(kf, own->n, s);
      status |= AMB_RESTARTED;
    }
  }
  amb_real now[AMB_FORCES];
  bool finite = true;
  const amb_real scale = amb_mixture_scale(own, s);
  amb_step_forces(kf, self->magnet, iu, s->base.mean, now, result->stiffness);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    result->stiffness[f].k_i *= scale;
    result->stiffness[f].k_s *= scale;
    finite = finite && amb_is_finite(now[f]);
    now[f] += own->bias[f];
  }
  if (!finite) {
    status |= AMB_BAD_PARAMETER;
  } else {
    amb_excitation_predict(&s->excitation, &kf->model, result->stiffness, now);
    if (s->excited) {
      amb_mixture_mix(n, own, s);
    }
    for (int j = 0; j < own->n; j++) {
      predict_one(self, s, j, iu);
    }
    amb_mixture_combine(n, own->n, s);
    status |= contain(kf, own->n, s);
  }
  return status;
}

/* Update all models with y of sensor r. */
static amb_status update_all(const amb_kalman *kf, const amb_multiple_model *own,
                             amb_likelihoods *h, int r, amb_real y, amb_real var_y)
{
  const amb_model *model = &kf->model;
  amb_multiple_model_state *s = h->s;
  amb_status status = AMB_OK;
  amb_real with_y[AMB_STATES];
  const int near = amb_mixture_nearest(own, s);
  amb_model_shown_with(model, r, s->model[near].cov, with_y);
  for (int j = 0; j < own->n; j++) {
    amb_one_model *m = &s->model[j];
    amb_real before[AMB_STATES];
    amb_real e;
    const amb_real S = amb_magnitude(amb_model_shown_variance(model, r, m->cov)) + var_y;
    amb_model_variances(model, m->cov, before);
    amb_model_update(model, r, y, S, m->mean, m->cov, &e);
    h->S[r][j] = S;
    h->square[j] += (e / S) * e;
    if (!amb_model_sound(model, m->cov)) {
      amb_model_uncorrelated(model, before, m->cov);
      status = AMB_BAD_VARIANCE;
    }
  }
  amb_excitation_update(&s->excitation, model, r, with_y, h->S[r][near]);
  h->taken[r] = true;
  return status;
}

static amb_status take_in(const amb_kalman *kf, const void *own, void *of, int r, amb_real y,
                          amb_real noise, amb_step_innovation *out)
{
  const amb_model *model = &kf->model;
  const amb_multiple_model *models = (const amb_multiple_model *)own;
  amb_likelihoods *h = (amb_likelihoods *)of;
  amb_multiple_model_state *s = h->s;
  amb_sensor_state *sensor = &s->base.sensor[r];
  /* Half the digits of a variance must be left, as in amb_step_update. */
  const amb_real shown = amb_model_shown_variance(model, r, s->base.cov);
  const amb_real var_y = amb_at_least(AMB_ROOT_EPSILON * shown, noise);
  const amb_real S = shown + var_y;
  const amb_real seen = amb_step_seen(kf, r, y);
  const amb_real e = seen - amb_model_shown(model, r, s->base.mean);
  out->innovation = AMB_C(0.0);
  out->variance = AMB_C(0.0);
  h->taken[r] = false;
  if (!AMB_WITHIN(e, AMB_REAL_MAX) || !AMB_WITHIN(S, AMB_REAL_MAX)) { /* nor are the models */
    begin_anew(kf, models->n, s);
    return AMB_RESTARTED;
  }
  out->variance = S;
  amb_status status = amb_step_useless(kf, &s->base, r, y);
  if (status == AMB_OK) {
    out->innovation = e;
    status = amb_step_inconsistent(sensor, out->innovation, out->variance);
    const amb_status outlier = amb_step_outlier(kf, sensor, r, out->innovation, out->variance);
    status |= outlier;
    if (outlier == AMB_RESTARTED) {
      amb_envelope_restart(kf, &s->base, r, seen);
      amb_mixture_restart(amb_states(model), models->n, s);
    } else if (outlier == AMB_OK) {
      status |= update_all(kf, models, h, r, seen, var_y);
      if ((r + 1) < amb_sensors(model)) { /* for the next sensor, before any is weighed */
        amb_mixture_combine(amb_states(model), models->n, s);
      }
    } else { /* left out */
    }
  }
  return status;
}

/* AMB_OUTSIDE if the disturbance force has long followed the magnets as if theta were beyond all
 * models. */
static amb_status outside(const amb_multiple_model *own, amb_multiple_model_state *s)
{
  const amb_excitation *e = &s->excitation;
  const amb_real near = own->theta[amb_mixture_nearest(own, s)];
  const amb_real theta = near + e->offset;
  amb_real least = own->theta[0];
  amb_real most = own->theta[0];
  for (int j = 1; j < own->n; j++) {
    least = amb_at_most(own->theta[j], least);
    most = amb_at_least(own->theta[j], most);
  }
  const bool above = theta > (AMB_OUTSIDE_FACTOR * most);
  const bool below =
      ((near * e->balanced) > AMB_OUTSIDE_BALANCE) && ((AMB_OUTSIDE_FACTOR * theta) < least);
  const amb_real before =
      AMB_WITHIN(s->beyond, AMB_C(2.0) * AMB_OUTSIDE_WINDOWS) ? s->beyond : AMB_C(0.0);
  s->beyond = before;
  if (e->informative) {
    const amb_real next =
        (above || below) ? (before + own->learn.fresh) : (before - own->learn.fresh);
    s->beyond = amb_at_least(amb_at_most(next, AMB_C(2.0) * AMB_OUTSIDE_WINDOWS), AMB_C(0.0));
  }
  return (s->beyond >= AMB_OUTSIDE_WINDOWS) ? AMB_OUTSIDE : AMB_OK;
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_model *model = &kf->model;
  const amb_multiple_model *own = own_of(self);
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  amb_likelihoods h;
  h.s = s;
  for (int j = 0; j < own->n; j++) {
    h.square[j] = AMB_C(0.0);
    for (int r = 0; r < amb_sensors(model); r++) {
      h.S[r][j] = AMB_C(1.0);
    }
  }
  amb_status status = amb_step_each(take_in, kf, own, &h, &s->base, true, y, result);
  const amb_status held = hold_each(kf, own->n, s);
  bool taken = false;
  for (int r = 0; r < amb_sensors(model); r++) {
    taken = taken || h.taken[r];
  }
  status |= held;
  if (taken && (held == AMB_OK)) {
    s->excited = amb_excitation_learns(&s->excitation, &own->learn, kf,
                                       s->model[amb_mixture_nearest(own, s)].mean);
    if (s->excited) {
      amb_mixture_weigh(model, own, &h);
    } else {
      status |= AMB_UNEXCITED;
    }
    status |= outside(own, s);
    amb_mixture_combine(amb_states(model), own->n, s);
    for (int r = 0; r < amb_sensors(model); r++) {
      if (h.taken[r]) {
        s->base.sensor[r].residual = y[r] - amb_model_shown(model, r, s->base.mean);
      }
    }
  }
  if (!amb_step_informative(model, result) || (held != AMB_OK)) {
    amb_excitation_miss(&s->excitation);
    s->excited = false;
  }
  if ((status & AMB_BAD_VARIANCE) != 0U) { /* it has corrected the slopes, too */
    amb_excitation_reset(&s->excitation, s->base.mean);
  }
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  amb_scaled_advance(self, own_of(self)->bias, scale, iu, mean);
}

static void scale(const amb_estimator *self, const void *state, amb_real *value, amb_real *variance)
{
  const amb_multiple_model *own = own_of(self);
  const amb_multiple_model_state *s = (const amb_multiple_model_state *)state;
  const amb_real mean = amb_mixture_scale(own, s);
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < own->n; j++) {
    const amb_real off = own->theta[j] - mean;
    sum += s->model[j].weight * off * off;
  }
  *value = mean;
  *variance = sum;
}

const amb_estimator_methods amb_multiple_model_methods = {
    sizeof(amb_multiple_model_state), reset, predict, update, advance, scale, NULL};
