#include "ambkit/multiple_model.h"
#include "ambkit/root.h"
#include "kalman_step.h"

static const amb_multiple_model *own_of(const amb_estimator *self)
{
  return (const amb_multiple_model *)self->own;
}

/* cov <- a cov + b other + c d d', on the upper triangle. */
AMB_INLINE void blend(amb_real a, amb_real cov[AMB_AXIAL_TRIANGLE], amb_real b,
                      const amb_real other[AMB_AXIAL_TRIANGLE], amb_real c,
                      const amb_real d[AMB_AXIAL_STATES])
{
  const amb_real c0 = c * d[0];
  const amb_real c1 = c * d[1];
  const amb_real c2 = c * d[2];
  const amb_real c3 = c * d[3];
  cov[0] = a * cov[0] + b * other[0] + c0 * d[0];
  cov[1] = a * cov[1] + b * other[1] + c0 * d[1];
  cov[2] = a * cov[2] + b * other[2] + c0 * d[2];
  cov[3] = a * cov[3] + b * other[3] + c0 * d[3];
  cov[4] = a * cov[4] + b * other[4] + c1 * d[1];
  cov[5] = a * cov[5] + b * other[5] + c1 * d[2];
  cov[6] = a * cov[6] + b * other[6] + c1 * d[3];
  cov[7] = a * cov[7] + b * other[7] + c2 * d[2];
  cov[8] = a * cov[8] + b * other[8] + c2 * d[3];
  cov[9] = a * cov[9] + b * other[9] + c3 * d[3];
}

/* Mean and covariance of all models together. */
static void combine(int n, amb_multiple_model_state *s)
{
  amb_real mean[AMB_AXIAL_STATES] = {0};
  amb_real cov[AMB_AXIAL_TRIANGLE] = {0};
  for (int j = 0; j < n; j++) {
    const amb_one_model *m = &s->model[j];
    for (int i = 0; i < AMB_AXIAL_STATES; i++) {
      mean[i] += m->weight * m->mean[i];
    }
  }
  for (int j = 0; j < n; j++) {
    const amb_one_model *m = &s->model[j];
    amb_real d[AMB_AXIAL_STATES];
    for (int i = 0; i < AMB_AXIAL_STATES; i++) {
      d[i] = m->mean[i] - mean[i];
    }
    blend(AMB_C(1.0), cov, m->weight, m->cov, m->weight, d);
  }
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    s->base.mean[i] = mean[i];
  }
  for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
    s->base.cov[i] = cov[i];
  }
}

/* All models take the mean and the covariance of the base, whatever their scales. */
static void agree(int n, amb_multiple_model_state *s)
{
  for (int j = 0; j < n; j++) {
    amb_one_model *m = &s->model[j];
    for (int i = 0; i < AMB_AXIAL_STATES; i++) {
      m->mean[i] = s->base.mean[i];
    }
    for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
      m->cov[i] = s->base.cov[i];
    }
  }
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    s->excitation.slope[i] = AMB_C(0.0);
  }
}

/* As amb_step_contain. */
static amb_status contain(const amb_kalman *kf, int n, amb_multiple_model_state *s)
{
  const amb_status status = amb_step_contain(kf, &s->base);
  if (status != AMB_OK) {
    agree(n, s);
  }
  return status;
}

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  const int n = own_of(self)->n;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    agree(n, s);
    for (int j = 0; j < n; j++) {
      s->model[j].weight = AMB_C(1.0) / (amb_real)n;
      s->trusted[j] = s->model[j].weight;
    }
    amb_excitation_reset(&s->excitation, s->base.mean[2]);
    s->excited = false;
  }
  return status;
}

static void mix(const amb_multiple_model *own, amb_multiple_model_state *s)
{
  const int others = own->n - 1;
  const amb_real enter = own->leave / (amb_real)others;
  const amb_real more = (AMB_C(1.0) - own->leave) - enter;
  for (int j = 0; j < own->n; j++) {
    amb_one_model *m = &s->model[j];
    const amb_real kept = more * m->weight;
    m->weight = enter + kept;
    const amb_real w = kept / m->weight;
    amb_real d[AMB_AXIAL_STATES];
    for (int i = 0; i < AMB_AXIAL_STATES; i++) {
      d[i] = m->mean[i] - s->base.mean[i];
      m->mean[i] = s->base.mean[i] + w * d[i];
    }
    blend(w, m->cov, AMB_C(1.0) - w, s->base.cov, w * (AMB_C(1.0) - w), d);
  }
}

static amb_real scale_of(const amb_multiple_model *own, const amb_multiple_model_state *s)
{
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < own->n; j++) {
    sum += s->model[j].weight * own->theta[j];
  }
  return sum;
}

/* The model that is closest to what all together say. */
static int nearest(const amb_multiple_model *own, const amb_multiple_model_state *s)
{
  const amb_real scale = scale_of(own, s);
  int best = 0;
  for (int j = 1; j < own->n; j++) {
    if (amb_magnitude(own->theta[j] - scale) < amb_magnitude(own->theta[best] - scale)) {
      best = j;
    }
  }
  return best;
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_kalman_settings *set = &kf->set;
  const amb_multiple_model *own = own_of(self);
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, &s->base, u, &status);
  if ((status & AMB_BAD_CONTROL) != 0U) {
    amb_excitation_miss(&s->excitation);
  }
  if (((status & AMB_SATURATED) != 0U) && amb_excitation_doubt(&s->excitation, &own->learn)) {
    for (int j = 0; j < own->n; j++) {
      s->model[j].weight = s->trusted[j];
    }
    combine(own->n, s);
  }
  amb_stiffness k;
  const amb_real at = amb_axial_displacement(&kf->model, s->base.mean);
  const amb_real now = amb_step_force(kf, self->magnet, iu, at, &k);
  const amb_real scale = scale_of(own, s);
  result->stiffness.k_i = scale * k.k_i;
  result->stiffness.k_s = scale * k.k_s;
  if (!amb_is_finite(now)) {
    status |= AMB_BAD_PARAMETER;
  } else {
    amb_excitation_predict(&s->excitation, &kf->model, result->stiffness.k_s, now + own->bias);
    if (s->excited) {
      mix(own, s);
    }
    for (int j = 0; j < own->n; j++) {
      amb_one_model *m = &s->model[j];
      const amb_real theta = own->theta[j];
      const amb_real own_at = amb_axial_displacement(&kf->model, m->mean);
      const amb_real f = amb_step_force(kf, self->magnet, iu, own_at, &k) + own->bias;
      amb_axial_predict_mean(&kf->model, theta * f + (set->f_0 - own->bias), m->mean);
      amb_axial_predict_covariance(&kf->model, theta * k.k_i, theta * k.k_s, set->k_ui, set->var_u,
                                   kf->growth, m->cov);
    }
    combine(own->n, s);
    status |= contain(kf, own->n, s);
  }
  result->status = status;
  return status;
}

/* Take y in by all models. Where they are to be told apart by it, weigh them by the likelihoods of
 * it, of which the largest exponent is made 0: what is least likely may vanish, not all. */
static amb_status weigh(const amb_multiple_model *own, amb_multiple_model_state *s, amb_real y,
                        amb_real var_y, amb_real x_max)
{
  amb_status status = AMB_OK;
  amb_real square[AMB_MODELS]; /* e^2 / S */
  amb_real S[AMB_MODELS];
  int best = 0;
  const int near = nearest(own, s);
  const amb_real *of_it = s->model[near].cov;
  const amb_real with_y[AMB_AXIAL_STATES] = {of_it[3], of_it[6], of_it[8], of_it[9]};
  for (int j = 0; j < own->n; j++) {
    amb_one_model *m = &s->model[j];
    amb_real *P = m->cov;
    const amb_real before[AMB_AXIAL_STATES] = {P[0], P[4], P[7], P[9]};
    amb_real e;
    amb_axial_update(y, var_y, m->mean, P, &e, &S[j]);
    square[j] = (e / S[j]) * e;
    if (square[j] < square[best]) {
      best = j;
    }
    if (!((P[0] > AMB_C(0.0)) && (P[4] > AMB_C(0.0)) && (P[7] > AMB_C(0.0)) &&
          (P[9] > AMB_C(0.0)))) {
      amb_step_drop_correlations(P, before);
      status = AMB_BAD_VARIANCE;
    }
  }
  s->excited = amb_excitation_update(&s->excitation, &own->learn, with_y, S[near],
                                     s->model[near].mean, x_max);
  if (!s->excited) {
    return status | AMB_UNEXCITED;
  }
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < own->n; j++) {
    const amb_real less = AMB_C(0.5) * (square[j] - square[best]);
    s->model[j].weight *= amb_exp_negative(less) * amb_root(S[best] / S[j]);
    sum += s->model[j].weight;
  }
  for (int j = 0; j < own->n; j++) {
    s->model[j].weight /= sum;
  }
  if (!(s->excitation.doubt > AMB_C(0.0))) {
    for (int j = 0; j < own->n; j++) {
      s->trusted[j] = s->model[j].weight;
    }
  }
  return status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_multiple_model_state *s = (amb_multiple_model_state *)state;
  amb_status status = AMB_OK;
  /* Half the digits of a variance must be left, as in amb_step_update. */
  const amb_real least = AMB_ROOT_EPSILON * s->base.cov[9];
  const amb_real var_y = (least > kf->set.var_y) ? least : kf->set.var_y;
  result->innovation = AMB_C(0.0);
  result->variance = s->base.cov[9] + var_y;
  if (!((y * y) <= kf->far_squared)) {
    status = AMB_MISSING;
  } else if (amb_step_frozen(kf, &s->base, y)) {
    status = AMB_FROZEN;
  } else {
    result->innovation = y - s->base.mean[3];
    status = amb_step_surprised(&s->base, result->innovation, result->variance);
    const amb_status outlier = amb_step_outlier(kf, &s->base, result->innovation, result->variance);
    status |= outlier;
    if (outlier == AMB_RESTARTED) {
      amb_envelope_restart(kf, &s->base, y);
      agree(own_of(self)->n, s);
    } else if (outlier == AMB_OK) {
      status |= weigh(own_of(self), s, y, var_y, kf->set.x_max);
      combine(own_of(self)->n, s);
      s->base.residual = y - s->base.mean[3];
    } else { /* left out */
    }
  }
  if ((status & AMB_UNTOLD) != 0U) {
    amb_excitation_miss(&s->excitation);
    s->excited = false;
  }
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
  const amb_multiple_model *own = own_of(self);
  const amb_multiple_model_state *s = (const amb_multiple_model_state *)state;
  const amb_real mean = scale_of(own, s);
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < own->n; j++) {
    const amb_real off = own->theta[j] - mean;
    sum += s->model[j].weight * off * off;
  }
  *value = mean;
  *variance = sum;
}

const amb_estimator_methods amb_multiple_model_methods = {
    sizeof(amb_multiple_model_state), reset, predict, update, advance, scale};
