#include "ambkit/estimator_run.h"
#include <string.h>

void amb_estimator_note(const amb_estimator *estimator, const void *state,
                        const amb_kalman_result *result, size_t k,
                        const amb_kalman_history *history)
{
  amb_kalman_note((const amb_kalman_state *)state, result, k, history);
  if ((estimator->methods->scale != NULL) && (history->scale != NULL))
    estimator->methods->scale(estimator, state, &history->scale[k], &history->scale_variance[k]);
}

amb_status amb_estimator_run(const amb_estimator *estimator, void *state,
                             const amb_kalman_input *in, const amb_kalman_history *history)
{
  const amb_estimator_methods *methods = estimator->methods;
  if (methods == &amb_kalman_methods) /* the same numbers, with the state in registers */
    return amb_kalman_run(estimator->kf, estimator->magnet, (amb_kalman_state *)state, in, history);
  amb_kalman_result result = {0, 0, {0, 0}, AMB_OK};
  amb_status all = AMB_OK;
  for (size_t k = 0; k < in->n; k++) {
    if (k > 0)
      (void)amb_estimator_step(estimator, state, in->y[k], in->u[k - 1], &result);
    else
      (void)amb_estimator_start(estimator, state, in->y[0], &result);
    all |= result.status;
    amb_estimator_note(estimator, state, &result, k, history);
  }
  return all;
}

amb_real amb_estimator_forecast(const amb_estimator *estimator, amb_real scale,
                                const amb_real mean[AMB_AXIAL_STATES], const amb_real *u,
                                size_t ahead)
{
  const amb_kalman_settings *s = &estimator->kf->set;
  amb_real m[AMB_AXIAL_STATES];
  memcpy(m, mean, sizeof m);
  for (size_t j = 0; j < ahead; j++) {
    const amb_real iu = amb_clamp(s->k_ui * u[j], s->iu_min, s->iu_max);
    estimator->methods->advance(estimator, scale, iu, m);
  }
  return m[AMB_AXIAL_STATES - 1];
}
