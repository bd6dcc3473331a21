/* Many runs of estimators, side by side in SIMD lanes; for the host.
 *
 * Each run has its own estimator, record and state, so that a Monte Carlo may change anything
 * between them; what goes side by side must only be of the same kind. The numbers are those of each
 * run by itself, to the last bit, whatever the instructions and whoever is beside it.
 */
#ifndef AMBKIT_SIM_BATCH_H
#define AMBKIT_SIM_BATCH_H

#include "ambkit/estimator_run.h"

#define AMB_BATCH_JUDGED 3 /* the first states: x, v, f_d of an axis */
#define AMB_BATCH_BLOCK 16 /* samples that are fetched, written and summed up together */

/* One run of n samples. What is not wanted is NULL. */
typedef struct amb_batch_run {
  const amb_estimator *estimator;
  void *state;                      /* after a reset; left at the end of the record */
  const amb_real *y;                /* n x sensors [m] */
  const amb_real *u;                /* n x controls [V]; u[k] acts from sample k to k + 1 */
  const amb_real *truth;            /* n x 3: x [m], v [m/s], f_d [N]; NULL for all together */
  amb_real *mean;                   /* out, n x states, or NULL */
  amb_real *innovation;             /* out, n x sensors [m], or NULL */
  amb_real *variance;               /* out, n x sensors [m^2], or NULL */
  unsigned short *status;           /* out, n, or NULL */
  double squares[AMB_BATCH_JUDGED]; /* out: sums of squared errors against the truth */
  amb_status all;                   /* out: all flags that were raised */
} amb_batch_run;

/* What the processor computes the lanes with. */
typedef enum amb_instructions {
  AMB_SCALAR,   /* one run after the other, as ambkit/estimator.h does it */
  AMB_BASELINE, /* 16 bytes: what every processor of the kind has */
  AMB_AVX2,     /* 32 bytes */
  AMB_AVX512    /* 64 bytes */
} amb_instructions;

/* Whether this build and this processor have them. */
bool amb_batch_has(amb_instructions instructions);

/* The fastest that there are. */
amb_instructions amb_batch_fastest(void);

/* How many runs go side by side. */
size_t amb_batch_lanes(amb_instructions instructions);

/* Runs whose estimators have the same number here can go side by side; 0: by themselves only. */
unsigned int amb_batch_group(const amb_estimator *estimator);

/* `count` runs of the same group, at most as many as there are lanes, along n samples each. Errors
 * are summed from sample `skip` on. */
void amb_batch_advance(amb_instructions instructions, amb_batch_run *const runs[], size_t count,
                       size_t n, size_t skip);

/* As amb_estimator_run: the core is compiled for any processor, and here its loop once more for
 * each set of instructions. No multiplication is fused with an addition in any of them: the bits
 * are the same. */
amb_status amb_batch_one(amb_instructions instructions, const amb_estimator *estimator, void *state,
                         const amb_kalman_input *in, const amb_kalman_history *history);

#endif
