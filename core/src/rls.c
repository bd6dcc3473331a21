#include "ambkit/rls.h"

/* Index of row i, column j <= i in a lower triangle. */
static size_t at(size_t i, size_t j)
{
  return ((i * (i + 1U)) / 2U) + j;
}

amb_status amb_rls_reset(const amb_rls *rls, amb_rls_state *state, const amb_real theta[],
                         const amb_real known[])
{
  bool good = (rls->n >= 1U) && (rls->n <= (size_t)AMB_RLS_MAX) && (rls->forgetting > AMB_C(0.0)) &&
              (rls->forgetting < AMB_C(1.0)) && (rls->least_excitation >= AMB_C(0.0)) &&
              amb_is_finite(rls->least_excitation * rls->least_excitation);
  for (size_t i = 0U; good && (i < rls->n); i++) {
    good = amb_is_finite(theta[i]) && amb_is_finite(known[i]) && (known[i] >= AMB_C(0.0));
  }
  if (!good) {
    return AMB_BAD_PARAMETER;
  }
  const amb_rls_state fresh = {0};
  *state = fresh;
  for (size_t i = 0U; i < rls->n; i++) {
    state->theta[i] = theta[i];
    state->moment[at(i, i)] = known[i];
    state->excitation[i] = known[i];
  }
  return AMB_OK;
}

/* Solves  moment gain = phi  for the excited parameters; the gain of the others is zero. Returns
 * whether all are excited. */
static bool solve(const amb_rls *rls, const amb_real moment[], const amb_real phi[],
                  amb_real excitation[], amb_real gain[])
{
  const amb_real least = rls->least_excitation * rls->least_excitation;
  amb_real L[AMB_RLS_TRIANGLE];
  amb_real scaled[AMB_RLS_MAX]; /* D^-1 L^-1 phi */
  amb_real forward[AMB_RLS_MAX];
  bool complete = true;
  for (size_t j = 0U; j < rls->n; j++) {
    amb_real pivot = moment[at(j, j)];
    amb_real left = phi[j];
    forward[j] = AMB_C(0.0);
    scaled[j] = AMB_C(0.0);
    for (size_t i = 0U; i < j; i++) {
      pivot -= L[at(j, i)] * L[at(j, i)] * excitation[i];
      left -= L[at(j, i)] * forward[i];
    }
    excitation[j] = amb_at_least(pivot, AMB_C(0.0));
    /* Held: its row and column stay zero. Rounding leaves a relative residue in a pivot that should
     * be zero, which does not count as excitation. */
    const amb_real rounding = AMB_ROOT_EPSILON * AMB_ROOT_EPSILON * moment[at(j, j)];
    const bool excited = (pivot > (AMB_C(16.0) * rounding)) && (pivot >= least);
    if (excited) {
      forward[j] = left;
      scaled[j] = left / pivot;
    }
    for (size_t i = 0U; (i < j) && !excited; i++) {
      L[at(j, i)] = AMB_C(0.0);
    }
    for (size_t row = j + 1U; row < rls->n; row++) {
      amb_real below = moment[at(row, j)];
      for (size_t i = 0U; i < j; i++) {
        below -= L[at(row, i)] * L[at(j, i)] * excitation[i];
      }
      L[at(row, j)] = excited ? (below / pivot) : AMB_C(0.0);
    }
    complete = complete && excited;
  }
  for (size_t j = rls->n; j > 0U; j--) {
    amb_real g = scaled[j - 1U];
    for (size_t row = j; row < rls->n; row++) {
      g -= L[at(row, j - 1U)] * gain[row];
    }
    gain[j - 1U] = g;
  }
  return complete;
}

amb_status amb_rls_step(const amb_rls *rls, amb_rls_state *state, const amb_real phi[], amb_real y)
{
  const amb_real fresh = AMB_C(1.0) - rls->forgetting;
  amb_rls_state next = *state;
  bool finite = amb_is_finite(y);
  amb_real error = y;
  for (size_t i = 0U; i < rls->n; i++) {
    for (size_t j = 0U; j <= i; j++) {
      amb_real *entry = &next.moment[at(i, j)];
      *entry = (rls->forgetting * *entry) + (fresh * phi[i] * phi[j]);
      finite = finite && amb_is_finite(*entry);
    }
    error -= phi[i] * next.theta[i];
  }
  amb_real gain[AMB_RLS_MAX];
  const bool complete = solve(rls, next.moment, phi, next.excitation, gain);
  next.error = error;
  for (size_t i = 0U; i < rls->n; i++) {
    next.theta[i] += fresh * gain[i] * error;
    finite = finite && amb_is_finite(next.theta[i]);
  }
  if (!finite) {
    return AMB_MISSING;
  }
  *state = next;
  return complete ? AMB_OK : AMB_UNEXCITED;
}
