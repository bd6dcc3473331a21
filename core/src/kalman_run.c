#include "ambkit/kalman_run.h"
#include "kalman_step.h"

/* Entry by entry: what is copied as a block of memory cannot stay in registers. */
AMB_INLINE void note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                     const amb_kalman_history *h)
{
  for (size_t i = 0; i < AMB_AXIAL_STATES; i++)
    h->mean[k * AMB_AXIAL_STATES + i] = state->mean[i];
  h->innovation[k] = result->innovation;
  h->variance[k] = result->variance;
  h->k_i[k] = result->stiffness.k_i;
  h->k_s[k] = result->stiffness.k_s;
  h->status[k] = (unsigned short)result->status;
  if (h->cov != NULL)
    for (size_t i = 0; i < AMB_AXIAL_TRIANGLE; i++)
      h->cov[k * AMB_AXIAL_TRIANGLE + i] = state->cov[i];
}

void amb_kalman_note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                     const amb_kalman_history *history)
{
  note(state, result, k, history);
}

/* Prediction with the control current iu [A] that acted and the result's stiffness, then
 * measurement y [m]. What is not usual has a copy, so that the state itself stays in registers. */
AMB_INLINE void step(const amb_kalman *kf, amb_kalman_state *s, amb_real iu, amb_real y,
                     amb_kalman_result *result)
{
  const amb_status predicted = amb_step_predict(kf, s, result->stiffness, iu);
  if ((predicted != AMB_OK) || amb_step_is_lost(kf, s)) {
    amb_kalman_state held;
    amb_kalman_result r;
    held = *s;
    result->status |= predicted | amb_step_contain(kf, &held);
    result->status |= amb_kalman_update(kf, &held, y, &r);
    result->innovation = r.innovation;
    result->variance = r.variance;
    *s = held;
  } else {
    amb_step_surprise e;
    result->status |= amb_step_update(kf, s, y, &e);
    result->innovation = e.innovation;
    result->variance = e.variance;
  }
}

amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                          const amb_kalman_input *input, const amb_kalman_history *history)
{
  const amb_kalman own = *kf; /* copies: nothing that is written can be part of them */
  const amb_kalman_history h = *history;
  const amb_kalman_input in = *input;
  const bool given = (in.k_i != NULL) && (in.k_s != NULL);
  const bool constant = !given && (magnet->methods == &amb_constant_magnet);
  if (in.n == 0) {
    return AMB_OK;
  }
  /* The first sample, which is only taken in, with the stiffness that comes first. */
  amb_kalman_result result;
  amb_stiffness k;
  if (given) {
    k.k_i = in.k_i[0];
    k.k_s = in.k_s[0];
  } else {
    const amb_real at = amb_axial_displacement(&own.model, state->mean);
    k = amb_step_ask(&own, magnet, AMB_C(0.0), at);
  }
  result.status = amb_kalman_update(&own, state, in.y[0], &result);
  result.stiffness = k;
  amb_kalman_note(state, &result, 0, &h);
  amb_status all = result.status;
  amb_kalman_state s = *state;
  for (size_t i = 1; i < in.n; i++) {
    result.status = AMB_OK;
    const amb_real iu = amb_step_current(&own, &s, in.u[i - 1], &result.status);
    if (given) {
      result.stiffness.k_i = in.k_i[i - 1];
      result.stiffness.k_s = in.k_s[i - 1];
    } else if (!constant) { /* not for nothing: a call empties the registers */
      const amb_real at = amb_axial_displacement(&own.model, s.mean);
      result.stiffness = amb_step_ask(&own, magnet, iu, at);
    } else { /* as before */
    }
    step(&own, &s, iu, in.y[i], &result);
    all |= result.status;
    note(&s, &result, i, &h);
  }
  *state = s;
  return all;
}
