#include "ambkit/extended_k.h"
#include "kalman_step.h"

static const amb_extended_k *own_of(const amb_estimator *self)
{
  return (const amb_extended_k *)self->own;
}

static void copy(const amb_real from[AMB_AXIAL_TRIANGLE], amb_real to[AMB_AXIAL_TRIANGLE])
{
  for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
    to[i] = from[i];
  }
}

/* Write from + s var s' into `to`. */
static void widen(const amb_real from[AMB_AXIAL_TRIANGLE], const amb_real s[AMB_AXIAL_STATES],
                  amb_real var, amb_real to[AMB_AXIAL_TRIANGLE])
{
  int entry = 0;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    const amb_real with_theta = s[i] * var;
    for (int j = i; j < AMB_AXIAL_STATES; j++) {
      to[entry] = from[entry] + with_theta * s[j];
      entry++;
    }
  }
}

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  amb_extended_k_state *s = (amb_extended_k_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    copy(s->base.cov, s->cov);
    s->theta = AMB_C(1.0);
    s->trusted = AMB_C(1.0);
    s->var = own_of(self)->std * own_of(self)->std;
    amb_excitation_reset(&s->excitation, s->base.mean[2]);
  }
  return status;
}

/* The four states start afresh, whatever theta is. */
static void part_from_theta(amb_extended_k_state *s)
{
  copy(s->base.cov, s->cov);
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    s->excitation.slope[i] = AMB_C(0.0);
  }
}

/* As amb_step_contain. */
static amb_status contain(const amb_kalman *kf, amb_extended_k_state *s)
{
  const amb_status status = amb_step_contain(kf, &s->base);
  if (status != AMB_OK) {
    part_from_theta(s);
  }
  return status;
}

/* Set theta, and the states to what they would be had it been that. */
static void move(amb_extended_k_state *s, amb_real theta)
{
  const amb_real by = theta - s->theta;
  s->theta = theta;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    s->base.mean[i] += s->excitation.slope[i] * by;
  }
}

/* Theta wanders by var_k: its covariance with the states, s p, stays what it was. */
static void wander(const amb_extended_k *own, amb_extended_k_state *s)
{
  if (s->var < (own->std * own->std)) {
    const amb_real grown = s->var + own->var_k;
    const amb_real kept = s->var / grown;
    widen(s->cov, s->excitation.slope, kept * own->var_k, s->cov);
    for (int i = 0; i < AMB_AXIAL_STATES; i++) {
      s->excitation.slope[i] *= kept;
    }
    s->var = grown;
  }
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_extended_k *own = own_of(self);
  amb_extended_k_state *s = (amb_extended_k_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, &s->base, u, &status);
  if (((status & AMB_SATURATED) != 0U) && amb_excitation_doubt(&s->excitation, &own->learn)) {
    move(s, s->trusted);
    s->var = own->std * own->std;
  }
  amb_stiffness k;
  const amb_real at = amb_axial_displacement(&kf->model, s->base.mean);
  const amb_real known = amb_step_force(kf, self->magnet, iu, at, &k) + own->bias;
  k.k_i *= s->theta;
  k.k_s *= s->theta;
  const amb_real f = s->theta * known + (kf->set.f_0 - own->bias);
  copy(s->cov, s->base.cov);
  const amb_status predicted = amb_step_predict_with(kf, &s->base, f, k);
  if (predicted == AMB_OK) {
    copy(s->base.cov, s->cov);
    amb_excitation_predict(&s->excitation, &kf->model, k.k_s, known);
    wander(own, s);
  }
  if ((status & AMB_BAD_CONTROL) != 0U) {
    amb_excitation_miss(&s->excitation);
  }
  widen(s->cov, s->excitation.slope, s->var, s->base.cov);
  status |= contain(kf, s);
  result->stiffness = k;
  result->status = status | predicted;
  return result->status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  const amb_extended_k *own = own_of(self);
  amb_extended_k_state *s = (amb_extended_k_state *)state;
  const amb_real with_y[AMB_AXIAL_STATES] = {s->cov[3], s->cov[6], s->cov[8], s->cov[9]};
  const amb_real on_y = s->excitation.slope[3];
  copy(s->cov, s->base.cov);
  amb_status status = amb_kalman_update(self->kf, &s->base, y, result);
  copy(s->base.cov, s->cov);
  const amb_real S = result->variance;
  const amb_real total = S + on_y * s->var * on_y;
  if ((status & AMB_RESTARTED) != 0U) {
    part_from_theta(s);
  }
  if ((status & AMB_UNTOLD) == 0U) {
    if (amb_excitation_update(&s->excitation, &own->learn, with_y, S, s->base.mean,
                              self->kf->set.x_max)) {
      const amb_real gain = (s->var * on_y) / total;
      move(s, amb_clamp(s->theta + gain * result->innovation, own->min, own->max));
      s->var *= S / total;
      if (!(s->excitation.doubt > AMB_C(0.0))) {
        s->trusted = s->theta;
      }
    } else {
      status |= AMB_UNEXCITED;
    }
  } else {
    amb_excitation_miss(&s->excitation);
  }
  widen(s->cov, s->excitation.slope, s->var, s->base.cov);
  result->variance = total;
  result->status = status;
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu,
                    amb_real mean[AMB_AXIAL_STATES])
{
  const amb_real bias = own_of(self)->bias;
  amb_stiffness unused;
  const amb_real s = amb_axial_displacement(&self->kf->model, mean);
  const amb_real known = amb_step_force(self->kf, self->magnet, iu, s, &unused) + bias;
  amb_axial_predict_mean(&self->kf->model, scale * known + (self->kf->set.f_0 - bias), mean);
}

static void scale(const amb_estimator *self, const void *state, amb_real *value, amb_real *variance)
{
  const amb_extended_k_state *s = (const amb_extended_k_state *)state;
  (void)self;
  *value = s->theta;
  *variance = s->var;
}

const amb_estimator_methods amb_extended_k_methods = {
    sizeof(amb_extended_k_state), reset, predict, update, advance, scale};
