/* Observers with a constant gain, on the linear law: `own` is an amb_observer.
 *
 * The gain decides what it is: from poles, a Luenberger observer (Luenberger 1964), and because the
 * disturbance force is a state, an extended state observer (Han 1995; with one bandwidth for all
 * poles, Gao 2003); from the algebraic Riccati equation, the steady-state Kalman filter.
 *
 * Between measurements the unstable plant runs away: the mean is then held to the caps of
 * ambkit/envelope.h, AMB_HELD. While measurements come it is left alone, as a bound within the
 * loop's own transients would be a limit cycle; beyond `far`, which no transient reaches, the
 * observer starts afresh from the measurement, AMB_RESTARTED.
 */
#ifndef AMBKIT_OBSERVER_H
#define AMBKIT_OBSERVER_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_observer {
  amb_real gain[AMB_SENSORS][AMB_STATES]; /* of each innovation, at the update */
  amb_real cov[AMB_TRIANGLE];             /* covariance of the estimate in the steady state */
  amb_real variance[AMB_SENSORS];         /* of the innovations then [m^2] */
  amb_real far[AMB_STATES]; /* beyond all that the error of a start between the caps grows to */
} amb_observer;

/* The covariance is the steady state's from the start on: a constant gain asks no other. */
extern const amb_estimator_methods amb_observer_methods;

AMB_EXTERN_C_END

#endif
