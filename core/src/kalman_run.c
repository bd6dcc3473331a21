#include "ambkit/kalman_run.h"
#include "kalman_step.h"
#include <string.h>

static void note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                 const amb_kalman_history *h)
{
  memcpy(h->mean + k * AMB_AXIAL_STATES, state->mean, sizeof state->mean);
  h->innovation[k] = result->innovation;
  h->variance[k] = result->variance;
  h->k_i[k] = result->stiffness.k_i;
  h->k_s[k] = result->stiffness.k_s;
  h->status[k] = (unsigned short)result->status;
  if (h->cov != NULL)
    memcpy(h->cov + k * AMB_AXIAL_TRIANGLE, state->cov, sizeof state->cov);
}

void amb_kalman_note(const amb_kalman_state *state, const amb_kalman_result *result, size_t k,
                     const amb_kalman_history *history)
{
  note(state, result, k, history);
}

amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                          const amb_kalman_input *in, const amb_kalman_history *history)
{
  const amb_kalman own = *kf; /* copies: nothing that is written can be part of them */
  const amb_kalman_history h = *history;
  amb_kalman_state s = *state;
  amb_kalman_result result = {0, 0, {0, 0}, AMB_OK};
  amb_status all = AMB_OK;
  const bool given = (in->k_i != NULL) && (in->k_s != NULL);
  for (size_t k = 0; k < in->n; k++) {
    const size_t acted = k > 0 ? k - 1 : 0;
    result.status = AMB_OK;
    const amb_real iu =
        k > 0 ? amb_step_current(&own, &s, in->u[acted], &result.status) : AMB_C(0.0);
    if (given) {
      result.stiffness.k_i = in->k_i[acted];
      result.stiffness.k_s = in->k_s[acted];
    } else {
      const amb_real at = amb_axial_displacement(&own.model, s.mean);
      result.stiffness = amb_step_ask(&own, magnet, iu, at);
    }
    if (k > 0) {
      result.status |= amb_step_predict(&own, &s, result.stiffness, iu);
      result.status |= amb_step_contain(&own, &s);
    }
    amb_step_surprise e;
    result.status |= amb_step_update(&own, &s, in->y[k], &e);
    result.innovation = e.innovation;
    result.variance = e.variance;
    all |= result.status;
    note(&s, &result, k, &h);
  }
  *state = s;
  return all;
}
