/* Recursive least squares with forgetting, for up to four parameters.
 *
 * In  y = phi' theta + noise  it keeps, in step with the data, the theta that minimises the sum of
 * squared errors, each older sample weighing less by `forgetting` (Astroem and Wittenmark, Adaptive
 * Control, 1995, ch. 2). Kept is the weighted mean of phi phi', and not its inverse P: that one
 * grows without limit where nothing is learned while the old is forgotten, this one goes to zero.
 *
 * A parameter is learned where there is something to learn it from. Its excitation is the weighted
 * mean square of that part of its regressor which the regressors before it do not have: the pivot
 * of the factorisation L D L'. Where it is below its limit the parameter is held, and counts as
 * known for the others. So the order of the parameters matters: of two that cannot be told apart
 * the earlier one is learned. As pivots are bounded from below, so is the gain.
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
  amb_real least_excitation; /* least root mean square of a regressor [its unit], >= 0 */
} amb_rls;

typedef struct amb_rls_state {
  amb_real theta[AMB_RLS_MAX];
  amb_real moment[AMB_RLS_TRIANGLE]; /* weighted mean of phi phi', lower triangle, row by row */
  amb_real excitation[AMB_RLS_MAX];  /* mean square of what is each parameter's own */
  amb_real error;                    /* last y - phi' theta, before theta learned from it */
} amb_rls_state;

/* Start from theta [n] and from what is known of it, as the mean square of regressors that would
 * tell as much [n]: 0 where nothing is. Returns AMB_OK, or AMB_BAD_PARAMETER and leaves the state
 * as it was. */
amb_status amb_rls_reset(const amb_rls *rls, amb_rls_state *state, const amb_real theta[],
                         const amb_real known[]);

/* Learn from one sample, regressor phi [n] and output y. Returns AMB_OK; AMB_UNEXCITED (one or more
 * parameters are held); AMB_MISSING where an input is not finite or too large to be squared, with
 * the state as it was. */
amb_status amb_rls_step(const amb_rls *rls, amb_rls_state *state, const amb_real phi[], amb_real y);

AMB_EXTERN_C_END

#endif
