#include "ambkit/estimator.h"
#include "kalman_step.h"

amb_status amb_estimator_step(const amb_estimator *estimator, void *state,
                              const amb_real y[AMB_SENSORS],
                              const amb_real u_previous[AMB_CONTROLS], amb_kalman_result *result)
{
  static const amb_real none[AMB_CONTROLS] = {0};
  const amb_estimator_methods *methods = estimator->methods;
  const amb_kalman_state *base = (const amb_kalman_state *)state;
  amb_status status = AMB_OK;
  if (u_previous != NULL) {
    status = methods->predict(estimator, state, u_previous, result);
  } else {
    amb_kalman_stiffness(estimator->kf, estimator->magnet, none, base->mean, result->stiffness);
  }
  status |= methods->update(estimator, state, y, result);
  result->status = status;
  return status;
}

void amb_deenergise(const amb_estimator *self, void *state)
{
  if (self->methods->deenergise != NULL) {
    self->methods->deenergise(state);
  }
}

/* ---- The paper's filter and the extended one: one update, two predictions. ---- */

amb_status amb_plain_reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                           const amb_real std[AMB_STATES])
{
  return amb_kalman_reset(self->kf, (amb_kalman_state *)state, mean, std);
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_status status = amb_step_currents(self->kf, s, u, iu);
  amb_step_stiffnesses(self->kf, self->magnet, iu, s->mean, result->stiffness);
  status |= amb_step_predict(self->kf, s, result->stiffness, iu);
  status |= amb_step_contain(self->kf, s);
  return status;
}

amb_status amb_plain_update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                            amb_kalman_result *result)
{
  return amb_kalman_update(self->kf, (amb_kalman_state *)state, y, result);
}

void amb_plain_advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                       amb_real mean[AMB_STATES])
{
  amb_step_advance(self->kf, self->magnet, scale, iu, mean);
}

static amb_status predict_extended(const amb_estimator *self, void *state,
                                   const amb_real u[AMB_CONTROLS], amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->mean, F, result->stiffness);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += kf->set.f_0[f];
  }
  status |= amb_step_predict_with(kf, s, F, result->stiffness, iu);
  status |= amb_step_contain(kf, s);
  return status;
}

void amb_scaled_advance(const amb_estimator *self, const amb_real bias[AMB_FORCES], amb_real scale,
                        const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES])
{
  const amb_kalman *kf = self->kf;
  amb_real F[AMB_FORCES];
  amb_stiffness k[AMB_FORCES];
  amb_step_forces(kf, self->magnet, iu, mean, F, k);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] = scale * (F[f] + bias[f]) + (kf->set.f_0[f] - bias[f]);
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

void amb_extended_advance(const amb_estimator *self, amb_real scale,
                          const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES])
{
  const amb_real none[AMB_FORCES] = {0};
  amb_scaled_advance(self, none, scale, iu, mean);
}

const amb_estimator_methods amb_kalman_methods = {sizeof(amb_kalman_state),
                                                  amb_plain_reset,
                                                  predict,
                                                  amb_plain_update,
                                                  amb_plain_advance,
                                                  NULL,
                                                  NULL};

const amb_estimator_methods amb_extended_methods = {sizeof(amb_kalman_state),
                                                    amb_plain_reset,
                                                    predict_extended,
                                                    amb_plain_update,
                                                    amb_extended_advance,
                                                    NULL,
                                                    NULL};
