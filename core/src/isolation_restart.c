#include "isolation_restart.h"
#include "kalman_step.h"

/* After a restart the filter counts as recovered when the variance of its innovations is within
 * this of the one before, and a filter without the restart joins it at this share of its variances.
 */
#define RECOVERED AMB_C(1.02)
#define REJOINED AMB_C(1e-4)

/* Mean after one sample, without noise. */
static void advance_mean(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                         const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES])
{
  amb_real F[AMB_FORCES];
  amb_stiffness k[AMB_FORCES];
  amb_step_forces(kf, magnet, iu, mean, F, k);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += kf->set.f_0[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

/* Begin to go on without a restart: with the gains of the last row in which all readings were used.
 * Returns whether there is one. */
static bool hold_gains(const amb_isolation *iso, amb_isolation_state *state)
{
  const int rows = iso->window + iso->spare;
  const int size = amb_isolation_row(iso);
  bool used = false;
  for (int ago = 1; !used && (ago < state->filled) && (ago < AMB_ISOLATION_LEAST); ago++) {
    state->held = (state->newest + rows - ago) % rows;
    const amb_real *K = &state->ring[((state->held + 1) * size) - (iso->sensors * iso->states)];
    used = true;
    for (int r = 0; r < iso->sensors; r++) {
      const amb_real *gain = &K[r * iso->states];
      used = used && (dot(iso->states, gain, gain) > AMB_C(0.0));
    }
  }
  state->holds = used ? iso->window : 0;
  return used;
}

/* Whether the filter has recovered from a restart: its innovations are as certain as before. */
static bool has_recovered(const amb_isolation *iso, const amb_kalman_result *result,
                          const amb_real *held)
{
  bool recovered = true;
  for (int r = 0; r < iso->sensors; r++) {
    recovered = recovered && ((result->health[r] & (AMB_OUTLIER | AMB_RESTARTED)) == 0U) &&
                (result->variance[r] <= (RECOVERED * held[(2 * r) + 1]));
  }
  return recovered;
}

/* Whether the mean is that of the filter, but for a small share of its standard deviations. */
static bool has_rejoined(const amb_isolation *iso, const amb_kalman_state *filter,
                         const amb_real mean[])
{
  bool near = true;
  for (int i = 0; i < iso->states; i++) {
    const amb_real off = mean[i] - filter->mean[i];
    const amb_real variance = filter->cov[amb_entry(iso->states, i, i)];
    near = near && ((off * off) <= (REJOINED * variance));
  }
  return near;
}

/* Put the reading that this filter predicts in place of the other's. */
static void put_predicted(const amb_isolation *iso, amb_isolation_state *state, int r,
                          amb_real predicted, amb_real signal[])
{
  state->lagged[r] += iso->lag[(2 * r) + 1] * (predicted - state->read[r]);
  state->read[r] = predicted;
  signal[AMB_OF_SENSOR * r] = predicted;
  signal[(AMB_OF_SENSOR * r) + 1] = state->lagged[r] - predicted;
}

bool amb_restart_go_on(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_magnet magnet[AMB_FORCES], const amb_real iu[AMB_CONTROLS],
                       const amb_kalman_state *filter, const amb_kalman_result *result,
                       amb_real row[])
{
  const int n = iso->states;
  const int size = amb_isolation_row(iso);
  const int gains = size - (iso->sensors * n);
  const int measured = gains - (2 * iso->sensors);
  bool within = ((result->status & AMB_RESTARTED) == 0U) || hold_gains(iso, state);
  const amb_real *held = &state->ring[state->held * size];
  const bool hold = (state->holds > 0) && !has_recovered(iso, result, &held[measured]);
  state->holds = hold ? (state->holds - 1) : 0;
  advance_mean(kf, magnet, iu, state->mean);
  for (int r = 0; r < iso->sensors; r++) {
    if ((result->health[r] & MISSING) == 0U) {
      const amb_real predicted = amb_model_shown(&kf->model, r, state->mean);
      const amb_real e = filter->sensor[r].last_y - predicted;
      const amb_real *from = hold ? held : row;
      row[measured + (2 * r)] = e;
      row[measured + (2 * r) + 1] = from[measured + (2 * r) + 1];
      put_predicted(iso, state, r, predicted, &row[ROW_OF_FORCE * iso->forces]);
      for (int i = 0; i < n; i++) {
        const amb_real K = from[gains + (r * n) + i];
        row[gains + (r * n) + i] = K;
        state->mean[i] += K * iso->unit[i] * e;
      }
      within = within && AMB_WITHIN(predicted, AMB_C(2.0) * limit_of(kf, r));
    }
  }
  state->apart = !has_rejoined(iso, filter, state->mean);
  return within;
}
