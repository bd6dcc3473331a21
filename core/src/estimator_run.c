#include "ambkit/estimator_run.h"
#include <string.h>

void amb_estimator_note(const amb_estimator *estimator, const void *state,
                        const amb_kalman_result *result, size_t k,
                        const amb_kalman_history *history)
{
  amb_kalman_note(estimator->kf, (const amb_kalman_state *)state, result, k, history);
  if ((estimator->methods->scale != NULL) && (history->scale != NULL))
    estimator->methods->scale(estimator, state, &history->scale[k], &history->scale_variance[k]);
}

amb_status amb_estimator_run(const amb_estimator *estimator, void *state,
                             const amb_kalman_input *in, const amb_kalman_history *history)
{
  const amb_estimator_methods *methods = estimator->methods;
  if (methods == &amb_kalman_methods) /* the same bits, with the state in registers */
    return amb_kalman_run(estimator->kf, estimator->magnet, (amb_kalman_state *)state, in, history);
  const size_t m = (size_t)amb_sensors(&estimator->kf->model);
  const size_t controls = (size_t)amb_controls(&estimator->kf->model);
  amb_kalman_result result;
  amb_status all = AMB_OK;
  memset(&result, 0, sizeof result);
  for (size_t k = 0; k < in->n; k++) {
    const amb_real *u = (k > 0) ? in->u + (k - 1) * controls : NULL;
    if ((k > 0) && (in->on != NULL) && !(in->on[k - 1] > 0))
      amb_deenergise(estimator, state);
    all |= amb_estimator_step(estimator, state, in->y + k * m, u, &result);
    amb_estimator_note(estimator, state, &result, k, history);
  }
  return all;
}

void amb_estimator_forecast(const amb_estimator *estimator, amb_real scale,
                            const amb_real mean[AMB_STATES], const amb_real *u, size_t ahead,
                            amb_real y[AMB_SENSORS])
{
  const amb_kalman_settings *s = &estimator->kf->set;
  const amb_model *model = &estimator->kf->model;
  const int controls = amb_controls(model);
  amb_real m[AMB_STATES], iu[AMB_CONTROLS];
  memcpy(m, mean, (size_t)amb_states(model) * sizeof *m);
  for (size_t j = 0; j < ahead; j++) {
    for (int c = 0; c < controls; c++)
      iu[c] =
          amb_clamp(s->k_ui[c] * u[j * (size_t)controls + (size_t)c], s->iu_min[c], s->iu_max[c]);
    estimator->methods->advance(estimator, scale, iu, m);
  }
  for (int r = 0; r < amb_sensors(model); r++)
    y[r] = amb_model_shown(model, r, m);
}
