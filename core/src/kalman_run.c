#include "ambkit/kalman_run.h"
#include "kalman_step.h"

/* Element by element: a block copy would force the state out of registers. */
AMB_INLINE void note(const amb_model *model, const amb_kalman_state *state,
                     const amb_kalman_result *result, size_t k, const amb_kalman_history *h)
{
  const size_t n = (size_t)amb_states(model), entries = (n * (n + 1)) / 2;
  const size_t p = (size_t)amb_forces(model), m = (size_t)amb_sensors(model);
  for (size_t i = 0; i < n; i++)
    h->mean[k * n + i] = state->mean[i];
  for (size_t r = 0; r < m; r++) {
    h->innovation[k * m + r] = result->innovation[r];
    h->variance[k * m + r] = result->variance[r];
    if (m > 1)
      h->health[k * m + r] = (unsigned short)result->health[r];
  }
  for (size_t f = 0; f < p; f++) {
    h->k_i[k * p + f] = result->stiffness[f].k_i;
    h->k_s[k * p + f] = result->stiffness[f].k_s;
  }
  h->status[k] = (unsigned short)result->status;
  if (h->cov != NULL)
    for (size_t i = 0; i < entries; i++)
      h->cov[k * entries + i] = state->cov[i];
}

void amb_kalman_note(const amb_kalman *kf, const amb_kalman_state *state,
                     const amb_kalman_result *result, size_t k, const amb_kalman_history *history)
{
  note(&kf->model, state, result, k, history);
}

static bool all_constant(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES])
{
  bool constant = true;
  for (int f = 0; f < amb_forces(&kf->model); f++)
    constant = constant && (magnet[f].methods == &amb_constant_magnet);
  return constant;
}

/* Prediction with the control currents iu [A] that acted and the result's stiffnesses, then update
 * with the measurements y [m]. Rare cases work on a copy, so that the state stays in registers. */
AMB_INLINE void step(const amb_kalman *kf, amb_kalman_state *s, const amb_real iu[AMB_CONTROLS],
                     const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  const amb_status predicted = amb_step_predict(kf, s, result->stiffness, iu);
  if ((predicted != AMB_OK) || amb_step_is_lost(kf, s)) {
    amb_kalman_state held;
    amb_kalman_result r;
    held = *s;
    result->status |= predicted | amb_step_contain(kf, &held);
    result->status |= amb_kalman_update(kf, &held, y, &r);
    for (int i = 0; i < amb_sensors(&kf->model); i++) {
      result->innovation[i] = r.innovation[i];
      result->variance[i] = r.variance[i];
      result->health[i] = r.health[i];
    }
    *s = held;
  } else {
    result->status |= amb_step_update_all(kf, s, y, result);
  }
}

/* Source of the stiffnesses of a step. */
typedef enum source { GIVEN, CONSTANT, ASKED } source;

/* All samples but the first. Inlined for each source separately: a call would clear the registers
 * even when no magnet is evaluated. */
AMB_INLINE amb_status go_on(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                            amb_kalman_state *state, const amb_kalman_input *in, source from,
                            const amb_kalman_result *first, const amb_kalman_history *h)
{
  const size_t m = (size_t)amb_sensors(&kf->model), controls = (size_t)amb_controls(&kf->model);
  amb_kalman_result result = *first;
  amb_status all = AMB_OK;
  amb_kalman_state s = *state;
  for (size_t i = 1; i < in->n; i++) {
    amb_real iu[AMB_CONTROLS];
    result.status = amb_step_currents(kf, &s, in->u + (i - 1) * controls, iu);
    if (from == GIVEN) {
      amb_step_given(kf, in->k_i, in->k_s, i - 1, result.stiffness);
    } else if (from == ASKED) {
      amb_step_stiffnesses(kf, magnet, iu, s.mean, result.stiffness);
    } else { /* the given stiffnesses are kept */
    }
    step(kf, &s, iu, in->y + i * m, &result);
    all |= result.status;
    note(&kf->model, &s, &result, i, h);
  }
  *state = s;
  return all;
}

amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          amb_kalman_state *state, const amb_kalman_input *input,
                          const amb_kalman_history *history)
{
  const amb_kalman own = *kf; /* copies: the compiler can assume that no output aliases them */
  const amb_kalman_history h = *history;
  const amb_kalman_input in = *input;
  const bool known_stiffness = (in.k_i != NULL) && (in.k_s != NULL);
  if (in.n == 0) {
    return AMB_OK;
  }
  /* The first sample has only a measurement update, with the first stiffnesses. */
  const amb_real none[AMB_CONTROLS] = {0};
  amb_kalman_result first;
  if (known_stiffness) {
    amb_step_given(&own, in.k_i, in.k_s, 0, first.stiffness);
  } else {
    amb_step_stiffnesses(&own, magnet, none, state->mean, first.stiffness);
  }
  first.status = amb_kalman_update(&own, state, in.y, &first);
  amb_kalman_note(&own, state, &first, 0, &h);
  amb_status rest = AMB_OK;
  if (known_stiffness) {
    rest = go_on(&own, magnet, state, &in, GIVEN, &first, &h);
  } else if (all_constant(&own, magnet)) {
    rest = go_on(&own, magnet, state, &in, CONSTANT, &first, &h);
  } else {
    rest = go_on(&own, magnet, state, &in, ASKED, &first, &h);
  }
  return first.status | rest;
}
