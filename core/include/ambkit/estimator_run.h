/* Any estimator of the family along a whole record, with its history; for the host. */
#ifndef AMBKIT_ESTIMATOR_RUN_H
#define AMBKIT_ESTIMATOR_RUN_H

#include "ambkit/estimator.h"
#include "ambkit/kalman_run.h"

/* As amb_kalman_run, which serves the paper's filter: the first sample is only taken in. */
amb_status amb_estimator_run(const amb_estimator *estimator, void *state,
                             const amb_kalman_input *input, const amb_kalman_history *history);

/* Write sample k of a history. */
void amb_estimator_note(const amb_estimator *estimator, const void *state,
                        const amb_kalman_result *result, size_t k,
                        const amb_kalman_history *history);

/* Mean of the measurement `ahead` samples on [m], from `mean` and without new measurements, while
 * the control signals u[0 .. ahead - 1] act on a magnet whose force is `scale` times the known one;
 * f_d stays what it is. */
amb_real amb_estimator_forecast(const amb_estimator *estimator, amb_real scale,
                                const amb_real mean[AMB_AXIAL_STATES], const amb_real *u,
                                size_t ahead);

#endif
