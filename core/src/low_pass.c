#include "ambkit/low_pass.h"
#include "kalman_step.h"

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
      s->base.cov[i] = AMB_C(0.0);
    }
    s->force = self->kf->set.f_0;
  }
  return status;
}

/* Nothing is predicted; the force that acts is kept for the next measurement. */
static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(self->kf, &s->base, u, &status);
  const amb_real x = s->base.mean[0];
  result->stiffness = amb_step_ask(self->kf, self->magnet, iu, x);
  s->force = result->stiffness.k_i * iu + result->stiffness.k_s * x + self->kf->set.f_0;
  result->status = status;
  return status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_low_pass *own = (const amb_low_pass *)self->own;
  amb_low_pass_state *s = (amb_low_pass_state *)state;
  amb_real *mean = s->base.mean;
  result->innovation = AMB_C(0.0);
  result->variance = AMB_C(0.0);
  amb_status status = AMB_OK;
  if (!((y * y) <= kf->far_squared)) {
    status = AMB_MISSING;
  } else if (amb_step_frozen(kf, &s->base, y)) {
    status = AMB_FROZEN;
  } else {
    const amb_real T = kf->set.T;
    const amb_real v_before = mean[1];
    result->innovation = y - mean[3];
    const amb_real dx = own->position * (y / kf->set.K_sen - mean[0]);
    const amb_real dv = own->velocity * (dx / T - v_before);
    const amb_real f_d = kf->set.m * (dv / T) - s->force;
    mean[0] += dx;
    mean[1] += dv;
    mean[2] += own->force * (f_d - mean[2]);
    mean[3] = kf->set.K_sen * mean[0];
  }
  result->status = status;
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu,
                    amb_real mean[AMB_AXIAL_STATES])
{
  (void)scale;
  (void)iu;
  mean[0] += self->kf->set.T * mean[1];
  mean[3] = self->kf->set.K_sen * mean[0];
}

const amb_estimator_methods amb_low_pass_methods = {
    sizeof(amb_low_pass_state), reset, predict, update, advance, NULL};
