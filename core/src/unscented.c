#include "ambkit/unscented.h"
#include "ambkit/root.h"
#include "kalman_step.h"

static amb_status reset(const amb_estimator *self, void *state,
                        const amb_real mean[AMB_AXIAL_STATES], const amb_real std[AMB_AXIAL_STATES])
{
  return amb_extended_methods.reset(self, state, mean, std);
}

/* Of the mean displacement over the sample, x + v T/2 [m^2]. */
static amb_real displacement_variance(const amb_kalman *kf, const amb_real P[AMB_AXIAL_TRIANGLE])
{
  const amb_real t = kf->model.T_2;
  return P[0] + t * (P[1] + (P[1] + t * P[4]));
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_unscented *own = (const amb_unscented *)self->own;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, s, u, &status);
  const amb_real at = amb_axial_displacement(&kf->model, s->mean);
  amb_stiffness k;
  amb_stiffness unused;
  const amb_real f = amb_step_force(kf, self->magnet, iu, at, &k);
  const amb_real away = own->reach * amb_root(displacement_variance(kf, s->cov));
  amb_real d = AMB_C(0.0);
  if (away > (AMB_ROOT_EPSILON * kf->set.x_max)) { /* closer, the secant is the tangent */
    const amb_real more = amb_step_force(kf, self->magnet, iu, at + away, &unused);
    const amb_real less = amb_step_force(kf, self->magnet, iu, at - away, &unused);
    d = ((more - f) + (less - f)) / (AMB_C(2.0) * own->reach * own->reach);
    k.k_s = (more - less) / (AMB_C(2.0) * away);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, f + d + kf->set.f_0, k);
  if (predicted == AMB_OK) {
    const amb_real more_noise = own->curvature * d * d; /* [N^2] */
    const amb_real on_x = kf->model.T2_2m;
    const amb_real on_v = kf->model.T_m;
    const amb_real on_x_m = kf->model.d_sen;
    s->cov[0] += on_x * on_x * more_noise;
    s->cov[1] += on_x * on_v * more_noise;
    s->cov[3] += on_x * on_x_m * more_noise;
    s->cov[4] += on_v * on_v * more_noise;
    s->cov[6] += on_v * on_x_m * more_noise;
    s->cov[9] += on_x_m * on_x_m * more_noise;
  }
  status |= amb_step_contain(kf, s);
  result->stiffness = k;
  result->status = status | predicted;
  return result->status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  return amb_extended_methods.update(self, state, y, result);
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu,
                    amb_real mean[AMB_AXIAL_STATES])
{
  amb_extended_methods.advance(self, scale, iu, mean);
}

const amb_estimator_methods amb_unscented_methods = {
    sizeof(amb_kalman_state), reset, predict, update, advance, NULL};
