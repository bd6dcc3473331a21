#include "ambkit/low_pass.h"
#include "kalman_step.h"

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  const amb_model *model = &self->kf->model;
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  if ((amb_first(model, AMB_POSITION) < 0) || (amb_first(model, AMB_VELOCITY) < 0) ||
      (amb_first(model, AMB_LOAD) < 0)) {
    return AMB_BAD_PARAMETER;
  }
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    amb_clear(AMB_TRIANGLE, s->base.cov);
    s->force = self->kf->set.f_0[0];
  }
  return status;
}

/* Advances the states that the controls determine by one sample; the others are unchanged. */
static void follow(const amb_model *model, const amb_real iu[AMB_CONTROLS],
                   amb_real mean[AMB_STATES])
{
  const amb_real none[AMB_FORCES] = {0};
  amb_real next[AMB_STATES];
  const int n = amb_states(model);
  amb_copy(n, mean, next);
  amb_model_predict_mean(model, none, iu, next);
  for (int i = 0; i < n; i++) {
    mean[i] = (amb_model_role(model, i) == AMB_KNOWN) ? next[i] : mean[i];
  }
}

/* Stores the force at the mean current of the sample, for the next measurement. */
static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  amb_status status = AMB_OK;
  const amb_model *model = &self->kf->model;
  const amb_real iu[AMB_CONTROLS] = {amb_step_current(self->kf, &s->base, 0, u[0], &status)};
  const amb_real x = s->base.mean[amb_first(model, AMB_POSITION)];
  const amb_real i = amb_model_current(model, 0, s->base.mean, iu);
  const amb_stiffness k = amb_step_stiffness(self->kf, self->magnet, 0, i, x);
  s->force = k.k_i * i + k.k_s * x + self->kf->set.f_0[0];
  follow(model, iu, s->base.mean);
  result->stiffness[0] = k;
  return status;
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_low_pass *own = (const amb_low_pass *)self->own;
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  amb_real *mean = s->base.mean;
  const amb_real seen = amb_step_seen(kf, 0, y[0]);
  (void)amb_step_rounded(kf, &s->base, 0, y[0], kf->set.var_y[0], false);
  const amb_status status = amb_step_useless(kf, &s->base, 0, y[0]);
  result->innovation[0] = AMB_C(0.0);
  result->variance[0] = AMB_C(0.0);
  if (status == AMB_OK) {
    const int x = amb_first(&kf->model, AMB_POSITION);
    const int v = amb_first(&kf->model, AMB_VELOCITY);
    const int load = amb_first(&kf->model, AMB_LOAD);
    const amb_real T = kf->set.T;
    const amb_real v_before = mean[v];
    result->innovation[0] = seen - amb_model_shown(&kf->model, 0, mean);
    const amb_real dx = own->position * (seen / kf->set.K_sen[0] - mean[x]);
    const amb_real dv = own->velocity * (dx / T - v_before);
    const amb_real f_d = own->m * (dv / T) - s->force;
    mean[x] += dx;
    mean[v] += dv;
    mean[load] += own->force * (f_d - mean[load]);
    amb_model_equilibrium(&kf->model, mean);
  }
  result->health[0] = status;
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  const amb_model *model = &self->kf->model;
  (void)scale;
  follow(model, iu, mean);
  mean[amb_first(model, AMB_POSITION)] += self->kf->set.T * mean[amb_first(model, AMB_VELOCITY)];
  amb_model_equilibrium(model, mean);
}

const amb_estimator_methods amb_low_pass_methods = {
    sizeof(amb_low_pass_state), reset, predict, update, advance, NULL, NULL};
