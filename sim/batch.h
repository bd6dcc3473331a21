/* Many runs of estimators, side by side in SIMD lanes; for the host.
 *
 * Each run has its own estimator, record and state, so that a Monte Carlo study may vary anything;
 * runs in the same lanes must only be of the same kind. The results have the bits of single runs,
 * for all instruction sets and neighbours.
 */
#ifndef AMBKIT_SIM_BATCH_H
#define AMBKIT_SIM_BATCH_H

#include "ambkit/estimator_run.h"

#define AMB_BATCH_JUDGED 3 /* the first states: x, v, f_d of an axis */
#define AMB_BATCH_BLOCK 16 /* samples that are loaded, stored and summed together */

/* One run of n samples. Outputs that are not needed are NULL. */
typedef struct amb_batch_run {
  const amb_estimator *estimator;
  void *state;                      /* after a reset; at the end of the record afterwards */
  const amb_real *y;                /* n x sensors [m] */
  const amb_real *u;                /* n x controls [V]; u[k] acts from sample k to k + 1 */
  const amb_real *truth;            /* n x 3: x [m], v [m/s], f_d [N]; NULL for all runs together */
  amb_real *mean;                   /* out, n x states, or NULL */
  amb_real *innovation;             /* out, n x sensors [m], or NULL */
  amb_real *variance;               /* out, n x sensors [m^2], or NULL */
  unsigned short *status;           /* out, n, or NULL */
  double squares[AMB_BATCH_JUDGED]; /* out: sums of squared errors against the truth */
  amb_status all;                   /* out: all flags that were raised */
} amb_batch_run;

/* Instructions for the lanes. */
typedef enum amb_instructions {
  AMB_SCALAR,   /* one run after the other, by ambkit/estimator.h */
  AMB_BASELINE, /* 16 bytes: available on every processor of the architecture */
  AMB_AVX2,     /* 32 bytes */
  AMB_AVX512    /* 64 bytes */
} amb_instructions;

/* Whether this build and this processor support them. */
bool amb_batch_has(amb_instructions instructions);

/* The widest that are available. */
amb_instructions amb_batch_fastest(void);

/* Number of runs side by side. */
size_t amb_batch_lanes(amb_instructions instructions);

/* Group of an estimator: runs of the same group can go side by side; 0: single runs only. */
unsigned int amb_batch_group(const amb_estimator *estimator);

/* `count` runs of the same group, at most one per lane, along n samples each. Errors are summed
 * from sample `skip` on. */
void amb_batch_advance(amb_instructions instructions, amb_batch_run *const runs[], size_t count,
                       size_t n, size_t skip);

/* As amb_estimator_run, with the core's loop compiled for each instruction set. No multiplication
 * is fused with an addition, so the bits are the same. */
amb_status amb_batch_one(amb_instructions instructions, const amb_estimator *estimator, void *state,
                         const amb_kalman_input *in, const amb_kalman_history *history);

#endif
