#include "mixture.h"
#include "ambkit/root.h"

/* Exponent beyond which a likelihood is 0. */
#define UNLIKELY AMB_C(1e4)

/* cov <- a cov + b other + c d d', on the upper triangle. */
AMB_INLINE void blend(int n, amb_real a, amb_real cov[AMB_TRIANGLE], amb_real b,
                      const amb_real other[AMB_TRIANGLE], amb_real c, const amb_real d[AMB_STATES])
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    const amb_real scaled = c * d[i];
    for (int j = i; j < n; j++) {
      cov[entry] = a * cov[entry] + b * other[entry] + scaled * d[j];
      entry++;
    }
  }
}

void amb_mixture_combine(int n, int models, amb_multiple_model_state *s)
{
  amb_real *mean = s->base.mean;
  amb_real *cov = s->base.cov;
  for (int i = 0; i < n; i++) {
    mean[i] = AMB_C(0.0);
    for (int j = 0; j < models; j++) {
      mean[i] += s->model[j].weight * s->model[j].mean[i];
    }
  }
  amb_clear(amb_entry(n, n - 1, n), cov);
  for (int j = 0; j < models; j++) {
    const amb_one_model *m = &s->model[j];
    amb_real d[AMB_STATES];
    for (int i = 0; i < n; i++) {
      d[i] = m->mean[i] - mean[i];
    }
    blend(n, AMB_C(1.0), cov, m->weight, m->cov, m->weight, d);
  }
}

void amb_mixture_restart(int n, int models, amb_multiple_model_state *s)
{
  for (int j = 0; j < models; j++) {
    amb_copy(n, s->base.mean, s->model[j].mean);
    amb_copy(amb_entry(n, n - 1, n), s->base.cov, s->model[j].cov);
  }
  amb_clear(n, s->excitation.slope);
}

/* Whether weights are from 0 to 1 and add to 1, to half of the digits. */
static bool are_weights(int n, const amb_real w[AMB_MODELS])
{
  bool positive = true;
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < n; j++) {
    positive = positive && (w[j] >= AMB_C(0.0));
    sum += w[j];
  }
  return positive && AMB_WITHIN(sum - AMB_C(1.0), AMB_ROOT_EPSILON);
}

void amb_mixture_repair(int n, amb_multiple_model_state *s)
{
  amb_real w[AMB_MODELS] = {0};
  for (int j = 0; j < n; j++) {
    w[j] = s->model[j].weight;
  }
  const bool good = are_weights(n, w);
  const bool trusted = are_weights(n, s->trusted);
  if (!good || !trusted) {
    for (int j = 0; j < n; j++) {
      const amb_real instead = trusted ? s->trusted[j] : (AMB_C(1.0) / (amb_real)n);
      s->model[j].weight = good ? w[j] : instead;
      s->trusted[j] = s->model[j].weight;
    }
  }
}

void amb_mixture_mix(int n, const amb_multiple_model *own, amb_multiple_model_state *s)
{
  const int others = own->n - 1;
  const amb_real enter = own->leave / (amb_real)others;
  const amb_real more = (AMB_C(1.0) - own->leave) - enter;
  for (int j = 0; j < own->n; j++) {
    amb_one_model *m = &s->model[j];
    const amb_real kept = more * m->weight;
    m->weight = enter + kept;
    const amb_real w = amb_at_most(kept / m->weight, AMB_C(1.0));
    amb_real d[AMB_STATES];
    for (int i = 0; i < n; i++) {
      d[i] = m->mean[i] - s->base.mean[i];
      m->mean[i] = s->base.mean[i] + w * d[i];
    }
    blend(n, w, m->cov, AMB_C(1.0) - w, s->base.cov, w * (AMB_C(1.0) - w), d);
  }
}

amb_real amb_mixture_scale(const amb_multiple_model *own, const amb_multiple_model_state *s)
{
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < own->n; j++) {
    sum += s->model[j].weight * own->theta[j];
  }
  return sum;
}

int amb_mixture_nearest(const amb_multiple_model *own, const amb_multiple_model_state *s)
{
  const amb_real scale = amb_mixture_scale(own, s);
  int best = 0;
  for (int j = 1; j < own->n; j++) {
    if (amb_magnitude(own->theta[j] - scale) < amb_magnitude(own->theta[best] - scale)) {
      best = j;
    }
  }
  return best;
}

/* Likelihoods are relative to that of the best model, so that not all of them underflow. */
void amb_mixture_weigh(const amb_model *model, const amb_multiple_model *own,
                       const amb_likelihoods *h)
{
  amb_multiple_model_state *s = h->s;
  int best = 0;
  amb_real sum = AMB_C(0.0);
  for (int j = 1; j < own->n; j++) {
    best = (h->square[j] < h->square[best]) ? j : best;
  }
  for (int j = 0; j < own->n; j++) {
    amb_real ratio = AMB_C(1.0);
    for (int r = 0; r < amb_sensors(model); r++) {
      if (h->taken[r]) {
        ratio *= h->S[r][best] / h->S[r][j];
      }
    }
    const amb_real less = AMB_C(0.5) * (h->square[j] - h->square[best]);
    const amb_real held = AMB_WITHIN(less, UNLIKELY) ? amb_at_least(less, AMB_C(0.0)) : UNLIKELY;
    const amb_real near = AMB_WITHIN(ratio, AMB_REAL_ROOT) ? ratio : AMB_REAL_ROOT;
    s->model[j].weight *= amb_exp_negative(held) * amb_root(near);
    sum += s->model[j].weight;
  }
  if (sum >= (AMB_C(1.0) / AMB_REAL_ROOT)) {
    for (int j = 0; j < own->n; j++) {
      s->model[j].weight = amb_at_most(s->model[j].weight / sum, AMB_C(1.0));
    }
  } else { /* no model is likely */
    for (int j = 0; j < own->n; j++) {
      s->model[j].weight = AMB_C(1.0) / (amb_real)own->n;
    }
  }
  if (!(s->excitation.doubt > AMB_C(0.0))) {
    for (int j = 0; j < own->n; j++) {
      s->trusted[j] = s->model[j].weight;
    }
  }
}
