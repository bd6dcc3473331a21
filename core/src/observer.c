#include "ambkit/observer.h"
#include "equilibrium.h"
#include "kalman_step.h"

/* Maximum distance of the rotor from the centre of a very coarse step [steps]: a constant gain
 * corrects too late at an edge, so the rotor is assumed to be within the step. */
#define MIDDLE AMB_C(0.3)

static const amb_observer *own(const amb_estimator *self)
{
  return (const amb_observer *)self->own;
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  amb_kalman_state *s = (amb_kalman_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, s, mean, std);
  if (status == AMB_OK) {
    const int n = amb_states(&self->kf->model);
    amb_copy(amb_entry(n, n - 1, n), own(self)->cov, s->cov);
  }
  return status;
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_real iu[AMB_CONTROLS];
  const amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_stiffnesses(kf, self->magnet, iu, s->mean, result->stiffness);
  amb_plain_advance(self, AMB_C(1.0), iu, s->mean);
  return status;
}

/* Moves the rotor into the very coarse step of sensor r. */
static void hold_to_step(const amb_kalman *kf, int r, amb_kalman_state *s)
{
  const amb_real half = MIDDLE * kf->set.step[r];
  const amb_real off = s->sensor[r].last_y - amb_model_shown(&kf->model, r, s->mean);
  const amb_real beyond = off - amb_clamp(off, -half, half);
  amb_real one[AMB_STATES];
  amb_rest_where_shown(&kf->model, r, one);
  for (int i = 0; i < amb_states(&kf->model); i++) {
    s->mean[i] += beyond * one[i];
  }
}

static amb_status take_in(const amb_kalman *kf, const void *constants, void *of, int r, amb_real y,
                          amb_real noise, amb_step_innovation *out)
{
  const amb_observer *observer = (const amb_observer *)constants;
  amb_kalman_state *s = (amb_kalman_state *)of;
  const amb_real S = observer->variance[r];
  const amb_real seen = amb_step_seen(kf, r, y);
  amb_status status = amb_step_useless(kf, s, r, y);
  (void)noise;
  out->innovation = AMB_C(0.0);
  out->variance = S;
  if (status == AMB_OK) {
    const amb_real e = seen - amb_model_shown(&kf->model, r, s->mean);
    out->innovation = e;
    status = amb_step_inconsistent(&s->sensor[r], e, S);
    /* After too many outliers the estimate is wrong, and the constant gain corrects it. */
    if (amb_step_outlier(kf, &s->sensor[r], r, e, S) == AMB_OUTLIER) {
      status |= AMB_OUTLIER;
    } else {
      for (int i = 0; i < amb_states(&kf->model); i++) {
        s->mean[i] += observer->gain[r][i] * e;
      }
      if (amb_step_coarse(kf, r, AMB_VERY_COARSE)) {
        hold_to_step(kf, r, s);
      }
      s->sensor[r].residual = seen - amb_model_shown(&kf->model, r, s->mean);
      if (!amb_all_within(amb_states(&kf->model), s->mean, AMB_C(1.0), observer->far)) {
        amb_envelope_place(kf, r, seen, s->mean);
        status |= AMB_RESTARTED;
      }
    }
  }
  if (((status & AMB_UNUSED) != 0U) && !amb_envelope_within(kf, AMB_ASTRAY, s->mean)) {
    amb_clear(amb_states(&kf->model), s->mean); /* invalid, and so is its disturbance force */
    status |= AMB_HELD | AMB_RESTARTED;
  } else if (((status & AMB_UNUSED) != 0U) && amb_envelope_clamp(kf, s->mean)) {
    status |= AMB_HELD;
  } else { /* within the envelope, or corrected by measurements */
  }
  return status;
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  amb_kalman_state *s = (amb_kalman_state *)state;
  return amb_step_each(take_in, self->kf, self->own, state, s, false, y, result);
}

const amb_estimator_methods amb_observer_methods = {
    sizeof(amb_kalman_state), reset, predict, update, amb_plain_advance, NULL, NULL};
