#include "ambkit/adaptive_noise.h"
#include "kalman_step.h"

/* Minimum expected variance of the corrections, as a share of the smallest growth [1]; below it the
 * window carries no information. */
#define TELLING (AMB_ROOT_EPSILON * AMB_ROOT_EPSILON)

/* Square of the standard deviations beyond which an innovation is not attributed to noise [1]. */
#define BEYOND AMB_C(25.0)

static const amb_adaptive_noise *own(const amb_estimator *self)
{
  return (const amb_adaptive_noise *)self->own;
}

/* The inner estimator with this plant and noise. */
static amb_estimator inner_with(const amb_estimator *self, const amb_kalman *kf)
{
  const amb_estimator inner = {own(self)->inner.methods, kf, self->magnet, own(self)->inner.own};
  return inner;
}

static void open_window(amb_adaptive_noise_state *s)
{
  amb_clear(AMB_STATES, s->correction);
  amb_clear(AMB_STATES, s->expected);
  s->samples = 0U;
}

/* Reset to the nominal noise. */
static void reset_noise(const amb_estimator *self, amb_adaptive_noise_state *s)
{
  s->kf = *self->kf;
  s->share = own(self)->first_share;
  open_window(s);
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  amb_adaptive_noise_state *s = (amb_adaptive_noise_state *)state;
  const amb_estimator inner = inner_with(self, self->kf);
  const amb_status status = inner.methods->reset(&inner, &s->inner, mean, std);
  if (status == AMB_OK) {
    reset_noise(self, s);
    s->young = AMB_YOUNG;
    s->amiss = false;
  }
  return status;
}

/* The estimated noise within its limits, or the nominal one where it is not estimated. */
static amb_real estimated(amb_real noise, amb_real nominal, amb_real most)
{
  return ((noise >= (nominal / most)) && (noise <= (nominal * most))) ? noise : nominal;
}

/* Everything that is not estimated is rewritten at each sample: a bit in memory may flip. */
static void renew(const amb_estimator *self, amb_adaptive_noise_state *s)
{
  const amb_adaptive_noise *a = own(self);
  const amb_kalman_settings *nominal = &self->kf->set;
  const amb_model *model = &self->kf->model;
  amb_real var_y[AMB_SENSORS];
  amb_real var_d[AMB_NOISES];
  for (int r = 0; r < amb_sensors(model); r++) {
    var_y[r] = estimated(s->kf.set.var_y[r], nominal->var_y[r], a->most);
  }
  for (int k = 0; k < amb_noises(model); k++) {
    var_d[k] = estimated(s->kf.set.var_d[k], nominal->var_d[k], a->most);
  }
  s->kf = *self->kf;
  if (a->measurement) {
    amb_copy(amb_sensors(model), var_y, s->kf.set.var_y);
  }
  if (a->disturbance) {
    amb_copy(amb_noises(model), var_d, s->kf.set.var_d);
    amb_model_growth(&s->kf.model, s->kf.set.var_d, s->kf.growth);
  }
  s->share = ((s->share >= a->share) && (s->share < AMB_C(1.0))) ? s->share : a->share;
  s->young = (s->young <= AMB_YOUNG) ? s->young : 0U;
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  amb_adaptive_noise_state *s = (amb_adaptive_noise_state *)state;
  renew(self, s);
  const amb_estimator inner = inner_with(self, &s->kf);
  const amb_status status = inner.methods->predict(&inner, &s->inner, u, result);
  if ((status & (AMB_HELD | AMB_BAD_PARAMETER)) != AMB_OK) {
    open_window(s); /* the next corrections are not due to process noise */
  }
  return status;
}

/* One step of `noise` towards the value at which the observed `square` equals the expected
 * `variance`. The ratio is limited to that of five standard deviations, because a larger one is
 * caused by a wrong estimate. */
static amb_status adapt_variance(amb_real share, amb_real square, amb_real variance,
                                 amb_real nominal, amb_real most, amb_real *noise)
{
  const amb_real low = nominal / most;
  const amb_real high = nominal * most;
  const amb_real ratio = amb_at_most(square / variance, BEYOND);
  const amb_real next = *noise * (AMB_C(1.0) + share * (ratio - AMB_C(1.0)));
  *noise = amb_clamp(next, low, high);
  return ((next < low) || (next > high)) ? AMB_NOISE_LIMIT : AMB_OK;
}

/* Adapts the growth by each noise, from the corrections of the loads that it drives. */
static amb_status adapt_growth(const amb_adaptive_noise *a, const amb_kalman_settings *nominal,
                               amb_adaptive_noise_state *s)
{
  const amb_model *model = &s->kf.model;
  amb_status status = AMB_OK;
  /* One step per window, with the weight of all its samples. */
  const amb_real share = amb_clamp(s->share * (amb_real)a->window, AMB_C(0.0), AMB_C(0.5));
  for (int k = 0; k < amb_noises(model); k++) {
    amb_real square = AMB_C(0.0);
    amb_real expected = AMB_C(0.0);
    for (int i = 0; i < amb_states(model); i++) {
      if ((amb_model_role(model, i) == AMB_LOAD) && amb_model_drives(model, k, i)) {
        square += s->correction[i] * s->correction[i];
        expected += s->expected[i];
      }
    }
    if (expected > (TELLING * (nominal->var_d[k] / a->most))) {
      status |=
          adapt_variance(share, square, expected, nominal->var_d[k], a->most, &s->kf.set.var_d[k]);
    }
  }
  amb_model_growth(model, s->kf.set.var_d, s->kf.growth);
  return status;
}

/* Variance of an innovation of sensor r [m^2], at least the smallest variance of its noise
 * (amb_noise_share). */
static amb_real variance_of(const amb_adaptive_noise_state *s, int r, amb_real S)
{
  return amb_at_least(S, s->kf.set.var_y[r] / AMB_C(64.0));
}

static amb_status adapt(const amb_estimator *self, amb_adaptive_noise_state *s,
                        const amb_kalman_result *result)
{
  const amb_adaptive_noise *a = own(self);
  const amb_kalman_settings *nominal = &self->kf->set;
  amb_status status = AMB_OK;
  for (int r = 0; r < amb_sensors(&self->kf->model); r++) {
    const amb_real e = result->innovation[r];
    if (a->measurement && !amb_step_coarse(self->kf, r, AMB_COARSE) &&
        ((result->health[r] & AMB_UNINFORMATIVE) == AMB_OK)) {
      const amb_real S = variance_of(s, r, result->variance[r]);
      status |= adapt_variance(s->share, e * e, S, nominal->var_y[r], a->most, &s->kf.set.var_y[r]);
    }
  }
  s->samples++;
  if (s->samples >= a->window) {
    if (a->disturbance) {
      status |= adapt_growth(a, nominal, s);
    }
    open_window(s);
  }
  /* d = (1 - b) / (1 - b^n) with b = 1 - share, one sample later: 1/d <- 1 + b/d. */
  s->share = amb_at_least(s->share / (s->share + AMB_C(1.0) - a->share), a->share);
  return status;
}

/* Whether an innovation, or R, has become too large for a correct start. */
static bool is_bad_start(const amb_estimator *self, const amb_adaptive_noise_state *s,
                         const amb_kalman_result *result)
{
  bool amiss = false;
  for (int r = 0; r < amb_sensors(&self->kf->model); r++) {
    const amb_real e = result->innovation[r];
    amiss = amiss || ((e * e) > (BEYOND * result->variance[r])) ||
            (s->kf.set.var_y[r] > (AMB_C(4.0) * self->kf->set.var_y[r]));
  }
  return amiss;
}

/* Whether the measurements carry information on the noise, unaffected by the start or a fault. */
static bool is_informative(const amb_estimator *self, amb_adaptive_noise_state *s,
                           amb_status status, const amb_kalman_result *result)
{
  if (s->young > 0U) {
    s->amiss = s->amiss || ((status & (AMB_OUTLIER | AMB_RESTARTED)) != AMB_OK) ||
               is_bad_start(self, s, result);
    s->young--;
    if (s->amiss) {
      reset_noise(self, s);
      return false;
    }
  }
  return amb_step_informative(&self->kf->model, result);
}

/* Adds the corrections of each load by the sensors, and their expected variance K S K'; with
 * several sensors that is the total reduction of the load's variance. */
static void add_corrections(const amb_model *model, const amb_real before[AMB_STATES],
                            const amb_real variances[AMB_STATES], const amb_real with_y[AMB_STATES],
                            amb_real S, amb_adaptive_noise_state *s)
{
  const amb_kalman_state *base = &s->inner.base;
  (void)variances;
  for (int i = 0; i < amb_states(model); i++) {
    if (amb_model_role(model, i) == AMB_LOAD) {
      amb_real expected = with_y[i] * (with_y[i] / S);
#if AMB_SENSORS > 1
      if (amb_sensors(model) > 1) {
        expected = variances[i] - base->cov[amb_entry(amb_states(model), i, i)];
      }
#endif
      const amb_real most = AMB_BOUNDLESS * s->kf.set.cap[i];
      const amb_real correction = s->correction[i] + (base->mean[i] - before[i]);
      const amb_real sum = s->expected[i] + expected;
      if (AMB_WITHIN(correction, most) && AMB_WITHIN(sum, most * most)) {
        s->correction[i] = correction;
        s->expected[i] = sum;
      } else { /* impossible for a rotor */
        s->correction[i] = AMB_C(0.0);
        s->expected[i] = AMB_C(0.0);
      }
    }
  }
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  const amb_model *model = &self->kf->model;
  amb_adaptive_noise_state *s = (amb_adaptive_noise_state *)state;
  const amb_kalman_state *base = &s->inner.base;
  const amb_estimator inner = inner_with(self, &s->kf);
  amb_real before[AMB_STATES] = {0};
  amb_real variances[AMB_STATES] = {0};
  amb_real with_y[AMB_STATES] = {0};
  for (int r = 0; r < amb_sensors(model); r++) { /* no change, unless a bit in memory has flipped */
    const amb_real low = self->kf->set.var_y[r] / own(self)->most;
    s->kf.set.var_y[r] = amb_at_least(s->kf.set.var_y[r], low);
  }
  if (own(self)->disturbance) {
    amb_copy(amb_states(model), base->mean, before);
    amb_model_variances(model, base->cov, variances);
    amb_model_shown_with(model, 0, base->cov, with_y);
  }
  amb_status status = inner.methods->update(&inner, &s->inner, y, result);
  if (is_informative(self, s, status, result)) {
    if (own(self)->disturbance) {
      const amb_real S = variance_of(s, 0, result->variance[0]);
      add_corrections(model, before, variances, with_y, S, s);
    }
    status |= adapt(self, s, result);
  }
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  const amb_estimator inner = inner_with(self, self->kf);
  inner.methods->advance(&inner, scale, iu, mean);
}

static void scale(const amb_estimator *self, const void *state, amb_real *value, amb_real *variance)
{
  const amb_adaptive_noise_state *s = (const amb_adaptive_noise_state *)state;
  const amb_estimator inner = inner_with(self, self->kf);
  inner.methods->scale(&inner, &s->inner, value, variance);
}

const amb_estimator_methods amb_adaptive_noise_methods = {
    sizeof(amb_adaptive_noise_state), reset, predict, update, advance, NULL, NULL};

const amb_estimator_methods amb_adaptive_noise_scale_methods = {
    sizeof(amb_adaptive_noise_state), reset, predict, update, advance, scale, NULL};
