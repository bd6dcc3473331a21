/* Any estimator of the family along a whole record, with its history; for the host. */
#ifndef AMBKIT_ESTIMATOR_RUN_H
#define AMBKIT_ESTIMATOR_RUN_H

#include "ambkit/estimator.h"
#include "ambkit/kalman_run.h"

AMB_EXTERN_C_BEGIN

/* As amb_kalman_run, which serves the paper's filter: the first sample has no time update. */
amb_status amb_estimator_run(const amb_estimator *estimator, void *state,
                             const amb_kalman_input *input, const amb_kalman_history *history);

/* Write sample k of a history. */
void amb_estimator_note(const amb_estimator *estimator, const void *state,
                        const amb_kalman_result *result, size_t k,
                        const amb_kalman_history *history);

/* Mean measurements y `ahead` samples later [m], predicted from `mean`, with the control signals u
 * [V], `ahead` x controls, and magnet forces multiplied by `scale`; disturbance forces are
 * constant. */
void amb_estimator_forecast(const amb_estimator *estimator, amb_real scale,
                            const amb_real mean[AMB_STATES], const amb_real *u, size_t ahead,
                            amb_real y[AMB_SENSORS]);

AMB_EXTERN_C_END

#endif
