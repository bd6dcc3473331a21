#include "ambkit/observer.h"
#include "kalman_step.h"

static const amb_observer *own(const amb_estimator *self)
{
  return (const amb_observer *)self->own;
}

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  amb_kalman_state *s = (amb_kalman_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, s, mean, std);
  if (status == AMB_OK) {
    for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
      s->cov[i] = own(self)->cov[i];
    }
  }
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu,
                    amb_real mean[AMB_AXIAL_STATES])
{
  amb_step_advance(self->kf, self->magnet, scale, iu, mean);
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, s, u, &status);
  const amb_real at = amb_axial_displacement(&kf->model, s->mean);
  result->stiffness = amb_step_ask(kf, self->magnet, iu, at);
  advance(self, AMB_C(1.0), iu, s->mean);
  result->status = status;
  return status;
}

static bool is_far(const amb_observer *observer, const amb_real mean[AMB_AXIAL_STATES])
{
  bool within = true;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    within = within && (amb_magnitude(mean[i]) <= observer->far[i]);
  }
  return !within; /* or not a number */
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_kalman_state *s = (amb_kalman_state *)state;
  result->innovation = AMB_C(0.0);
  result->variance = own(self)->variance;
  amb_status status = AMB_OK;
  if (!((y * y) <= kf->far_squared)) {
    status = AMB_MISSING;
  } else if (amb_step_frozen(kf, s, y)) {
    status = AMB_FROZEN;
  } else {
    const amb_real e = y - s->mean[3];
    result->innovation = e;
    status = amb_step_surprised(s, e, result->variance);
    /* After too many outliers it is the estimate that is wrong: a constant gain leads it back. */
    if (amb_step_outlier(kf, s, e, result->variance) == AMB_OUTLIER) {
      status |= AMB_OUTLIER;
    } else {
      for (int i = 0; i < AMB_AXIAL_STATES; i++) {
        s->mean[i] += own(self)->gain[i] * e;
      }
      s->residual = y - s->mean[3];
      if (is_far(own(self), s->mean)) {
        amb_envelope_place(kf, y, s->mean);
        status |= AMB_RESTARTED;
      }
    }
  }
  if (((status & AMB_UNUSED) != 0U) && amb_envelope_clamp(kf, s->mean)) {
    status |= AMB_HELD;
  }
  result->status = status;
  return status;
}

const amb_estimator_methods amb_observer_methods = {
    sizeof(amb_kalman_state), reset, predict, update, advance, NULL};
