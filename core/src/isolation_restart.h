/* Fault isolation where the filter restarts: the innovations of one that does not. */
#ifndef AMBKIT_ISOLATION_RESTART_H
#define AMBKIT_ISOLATION_RESTART_H

#include "isolation_sweep.h"

AMB_EXTERN_C_BEGIN

/* Health of a reading without information. */
#define MISSING (AMB_MISSING | AMB_FROZEN | AMB_BAD_VARIANCE)

/* Reading at the stop [m]. */
static inline amb_real limit_of(const amb_kalman *kf, int r)
{
  return amb_magnitude(kf->set.K_sen[r]) * kf->set.travel[r];
}

/* From a restart on: the step of a filter that did not. Its mean is the state's; its innovations
 * and gains take the place of the other's in the row. Returns whether it has gains and stays near
 * the stops. */
bool amb_restart_go_on(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_magnet magnet[AMB_FORCES], const amb_real iu[AMB_CONTROLS],
                       const amb_kalman_state *filter, const amb_kalman_result *result,
                       amb_real row[]);

AMB_EXTERN_C_END

#endif
