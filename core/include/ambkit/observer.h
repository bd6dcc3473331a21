/* Observers with a constant gain and the linear force law: `own` is an amb_observer.
 *
 * The gain determines the kind: from poles, a Luenberger observer (Luenberger 1964), and because
 * the disturbance force is a state, an extended state observer (Han 1995; with one bandwidth for
 * all poles, Gao 2003); from the algebraic Riccati equation, the steady-state Kalman filter.
 *
 * Without measurements the unstable estimate diverges: the mean is then limited to the caps of
 * ambkit/envelope.h, AMB_HELD. With measurements it is not limited, because a limit within the
 * loop's transients would cause a limit cycle; beyond `far`, which no transient reaches, the
 * observer restarts from the measurement, AMB_RESTARTED.
 */
#ifndef AMBKIT_OBSERVER_H
#define AMBKIT_OBSERVER_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_observer {
  amb_real gain[AMB_SENSORS][AMB_STATES]; /* of each innovation, at the measurement update */
  amb_real cov[AMB_TRIANGLE];             /* steady-state covariance of the estimate */
  amb_real variance[AMB_SENSORS];         /* and of the innovations [m^2] */
  amb_real far[AMB_STATES]; /* limits that the transient of any start between the caps does not
                               exceed */
} amb_observer;

/* The covariance is the steady-state one from the start on, consistent with the constant gain. */
extern const amb_estimator_methods amb_observer_methods;

AMB_EXTERN_C_END

#endif
