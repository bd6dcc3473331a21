/* One estimator along a record, with the instructions that the processor has; for the host. The
 * core is compiled for any processor; here its loop is compiled once more for each set of
 * instructions. No multiplication is fused with an addition in any of them: the bits are the same.
 */
#ifndef AMBKIT_SIM_FAST_H
#define AMBKIT_SIM_FAST_H

#include "ambkit/estimator_run.h"
#include "batch.h"

/* The fastest that there are. */
amb_instructions amb_fastest(void);

/* As amb_estimator_run. */
amb_status amb_fast_run(amb_instructions instructions, const amb_estimator *estimator, void *state,
                        const amb_kalman_input *in, const amb_kalman_history *history);

#endif
