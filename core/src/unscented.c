#include "ambkit/unscented.h"
#include "ambkit/root.h"
#include "kalman_step.h"

/* Variance of the mean displacement of magnet f over the sample [m^2]: the displacement is a linear
 * form of each column of the covariance, and of these forms in turn. */
static amb_real displacement_variance(const amb_model *model, int f, const amb_real P[AMB_TRIANGLE])
{
  const int n = amb_states(model);
  amb_real with[AMB_STATES];
  for (int j = 0; j < n; j++) {
    amb_real column[AMB_STATES];
    for (int i = 0; i < n; i++) {
      column[i] = P[amb_place(n, i, j)];
    }
    with[j] = amb_model_displacement(model, f, column);
  }
  return amb_model_displacement(model, f, with);
}

/* Force of magnet f at its points: their mean minus the force at the mean, d [N]; k_s becomes the
 * secant. */
static amb_real spread(const amb_estimator *self, int f, const amb_kalman_state *s,
                       const amb_real iu[AMB_CONTROLS], amb_real force, amb_stiffness *k)
{
  const amb_kalman *kf = self->kf;
  const amb_unscented *own = (const amb_unscented *)self->own;
  const amb_real at = amb_model_displacement(&kf->model, f, s->mean);
  const amb_real i = amb_model_current(&kf->model, f, s->mean, iu);
  const amb_real variance = displacement_variance(&kf->model, f, s->cov);
  const amb_real away = own->reach * amb_root(amb_at_least(variance, AMB_C(0.0)));
  amb_real d = AMB_C(0.0);
  if (away > (AMB_ROOT_EPSILON * kf->set.x_max[f])) { /* closer, the secant is the tangent */
    amb_stiffness unused;
    const amb_real more = amb_step_force(kf, self->magnet, f, i, at + away, &unused);
    const amb_real less = amb_step_force(kf, self->magnet, f, i, at - away, &unused);
    d = ((more - force) + (less - force)) / (AMB_C(2.0) * own->reach * own->reach);
    k->k_s = amb_clamp((more - less) / (AMB_C(2.0) * away), -AMB_STIFFEST, AMB_STIFFEST);
  }
  return d;
}

/* Adds the variance of the states from a force of this variance [N^2] at magnet f. */
static void add_force_noise(const amb_model *model, int f, amb_real variance,
                            amb_real P[AMB_TRIANGLE])
{
  const int n = amb_states(model);
  amb_real moved[AMB_STATES];
  amb_model_pushed(model, f, moved);
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      P[amb_entry(n, i, j)] += moved[i] * moved[j] * variance;
    }
  }
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_unscented *own = (const amb_unscented *)self->own;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  amb_real d[AMB_FORCES];
  d[0] = AMB_C(0.0); /* compilers do not know that there is at least one */
  amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->mean, F, result->stiffness);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    d[f] = spread(self, f, s, iu, F[f], &result->stiffness[f]);
    F[f] = F[f] + d[f] + kf->set.f_0[f];
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, result->stiffness, iu);
  if (predicted == AMB_OK) {
    for (int f = 0; f < amb_forces(&kf->model); f++) {
      add_force_noise(&kf->model, f, own->curvature * d[f] * d[f], s->cov);
    }
  }
  status |= amb_step_contain(kf, s);
  return status | predicted;
}

const amb_estimator_methods amb_unscented_methods = {sizeof(amb_kalman_state),
                                                     amb_plain_reset,
                                                     predict,
                                                     amb_plain_update,
                                                     amb_extended_advance,
                                                     NULL,
                                                     NULL};
