/* Recursive least squares with forgetting, for up to four parameters.
 *
 * For y = phi' theta + noise it updates the theta that minimises the sum of squared errors, with
 * the weight of older samples reduced by `forgetting` (Astroem and Wittenmark, Adaptive Control,
 * 1995, ch. 2). The weighted mean of phi phi' is stored, not its inverse P: that grows without
 * limit while nothing is learned and old data is forgotten, this tends to zero.
 *
 * A parameter is learned if it is excited. Its excitation is the weighted mean square of the part
 * of its regressor that is orthogonal to the preceding ones: the pivot of the factorisation L D L'.
 * Below its limit the parameter is held, and counts as known for the others. The order of the
 * parameters matters: of two that cannot be distinguished the first is learned. As pivots are
 * bounded from below, the gain is bounded.
 */
#ifndef AMBKIT_RLS_H
#define AMBKIT_RLS_H

#include "ambkit/real.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

#define AMB_RLS_MAX 4
#define AMB_RLS_TRIANGLE 10

typedef struct amb_rls {
  size_t n;                  /* parameters, 1 to AMB_RLS_MAX */
  amb_real forgetting;       /* weight of a sample against the next one [1], in (0, 1) */
  amb_real least_excitation; /* minimum root mean square of a regressor [its unit], >= 0 */
} amb_rls;

typedef struct amb_rls_state {
  amb_real theta[AMB_RLS_MAX];
  amb_real moment[AMB_RLS_TRIANGLE]; /* weighted mean of phi phi', lower triangle, row by row */
  amb_real excitation[AMB_RLS_MAX];  /* mean square of each parameter's own excitation */
  amb_real error;                    /* last y - phi' theta, before the update of theta */
} amb_rls_state;

/* Start from theta [n] and its prior information, as the mean square of equivalent regressors [n]:
 * 0 for none. Returns AMB_OK, or AMB_BAD_PARAMETER with the state unchanged. */
amb_status amb_rls_reset(const amb_rls *rls, amb_rls_state *state, const amb_real theta[],
                         const amb_real known[]);

/* Update with one sample, regressor phi [n] and output y. Returns AMB_OK; AMB_UNEXCITED (one or
 * more parameters are held); AMB_MISSING if an input is not finite or too large to be squared, with
 * the state unchanged. */
amb_status amb_rls_step(const amb_rls *rls, amb_rls_state *state, const amb_real phi[], amb_real y);

AMB_EXTERN_C_END

#endif
