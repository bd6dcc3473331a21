#include "ambkit/estimator.h"
#include "kalman_step.h"

amb_status amb_estimator_step(const amb_estimator *estimator, void *state, amb_real y, amb_real u,
                              amb_kalman_result *result)
{
  const amb_status predicted = estimator->methods->predict(estimator, state, u, result);
  const amb_status updated = estimator->methods->update(estimator, state, y, result);
  result->status = predicted | updated;
  return result->status;
}

amb_status amb_estimator_start(const amb_estimator *estimator, void *state, amb_real y,
                               amb_kalman_result *result)
{
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  const amb_kalman *kf = estimator->kf;
  const amb_real s = amb_axial_displacement(&kf->model, base->mean);
  result->stiffness = amb_kalman_stiffness(kf, estimator->magnet, AMB_C(0.0), s);
  return estimator->methods->update(estimator, state, y, result);
}

/* ---- The paper's filter and the extended one: one update, two predictions. ---- */

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  return amb_kalman_reset(self->kf, (amb_kalman_state *)state, mean, std);
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(self->kf, s, u, &status);
  const amb_real at = amb_axial_displacement(&self->kf->model, s->mean);
  result->stiffness = amb_step_ask(self->kf, self->magnet, iu, at);
  status |= amb_step_predict(self->kf, s, result->stiffness, iu);
  status |= amb_step_contain(self->kf, s);
  result->status = status;
  return status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  result->status = amb_kalman_update(self->kf, (amb_kalman_state *)state, y, result);
  return result->status;
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu,
                    amb_real mean[AMB_AXIAL_STATES])
{
  amb_step_advance(self->kf, self->magnet, scale, iu, mean);
}

static amb_status predict_extended(const amb_estimator *self, void *state, amb_real u,
                                   amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, s, u, &status);
  const amb_real at = amb_axial_displacement(&kf->model, s->mean);
  const amb_real f = amb_step_force(kf, self->magnet, iu, at, &result->stiffness);
  status |= amb_step_predict_with(kf, s, f + kf->set.f_0, result->stiffness);
  status |= amb_step_contain(kf, s);
  result->status = status;
  return status;
}

static void advance_extended(const amb_estimator *self, amb_real scale, amb_real iu,
                             amb_real mean[AMB_AXIAL_STATES])
{
  amb_stiffness k;
  const amb_real s = amb_axial_displacement(&self->kf->model, mean);
  const amb_real f = scale * amb_step_force(self->kf, self->magnet, iu, s, &k);
  amb_axial_predict_mean(&self->kf->model, f + self->kf->set.f_0, mean);
}

const amb_estimator_methods amb_kalman_methods = {
    sizeof(amb_kalman_state), reset, predict, update, advance, NULL};

const amb_estimator_methods amb_extended_methods = {
    sizeof(amb_kalman_state), reset, predict_extended, update, advance_extended, NULL};
