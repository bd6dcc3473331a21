/* A continuous linear model over one sample, each entry of the result to its own digits. A
 * controller can make its model anew with it where a parameter has changed.
 *
 * In double in every build, so that what is computed here rounds to the numbers of an export. The
 * exponential is its Taylor series over a share of the time, squared. The share is such that what
 * states pass on to each other in circles shrinks to half; a Padé approximant is right to a
 * rounding of the greatest entry only, and metres beside newtons would lose digits. Truncation is
 * below 1e-19 of an entry's series of magnitudes, and rounding below (terms + n) u of it for each
 * of the 2^k shares, u = 2^-53 (Higham 2008, Functions of Matrices, ch. 10.3); measured, 8 machine
 * epsilons where the terms of an entry do not cancel (tests/test_sampling.py).
 *
 * Matrices are row by row. All memory is the caller's, and nothing may overlap.
 */
#ifndef AMBKIT_SAMPLING_H
#define AMBKIT_SAMPLING_H

#include "ambkit/precision.h"
#include <stdbool.h>

#if defined(__cplusplus)
extern "C" {
#endif

/* Numbers of room for functions of n states. */
#define AMB_SAMPLING_WORK(n) ((5 * (n) * (n)) + (2 * (n)))

/* Phi = exp(A time), n x n. Returns false where A time is not finite, and leaves Phi as it was. */
bool amb_transition(int n, const double A[], double time, double Phi[], double work[]);

/* For `count` sources of white noise, each with an intensity of every state (count x n), the
 * covariances N (count x n x n) that they leave in the state over a time: dN/dt = A N + N A' +
 * diag(intensity) from N = 0 (Van Loan 1978, without the exponential of -A, which overflows for a
 * fast sensor). Returns false as amb_transition does. */
bool amb_process_noise(int n, const double A[], double time, int count, const double intensity[],
                       double N[], double work[]);

/* A demanded current that acts late. */
typedef struct amb_late {
  int control;
  int count;                  /* of the states that are the demands of samples before, ... */
  const unsigned short *past; /* ... the last one first */
  double share;               /* of the sample, after which the last but one acts; to 1 */
} amb_late;

/* What a term is part of: the motion over a sample, and what spreads noise. */
#define AMB_MOVES 1U
#define AMB_SPREADS 2U

/* A continuous model as a list of terms: `row` grows by `value` a second for 1 of `column`. What
 * moves or is held over the sample stands in this order: states, forces, controls; integrals of the
 * forces' displacements, integrals of their currents. */
typedef struct amb_plan {
  double T; /* sampling time [s] */
  int states;
  int forces;
  int controls;
  int noises;
  int terms;
  const unsigned short *row;    /* [terms] */
  const unsigned short *column; /* [terms] */
  const unsigned char *use;     /* [terms]: AMB_MOVES, AMB_SPREADS, or both */
  const double *value;          /* [terms] [1/s, times the units] */
  const double *k_i; /* [forces]: current stiffness of a force that follows its current within the
                      * sample [N/A]; 0: it is held */
  int lates;
  const amb_late *late;
  const double *intensity; /* noises x states */
} amb_plan;

/* The order of its transition matrix. */
#define AMB_PLAN_SIZE(plan) ((plan)->states + (3 * (plan)->forces) + (plan)->controls)

/* One sample: Phi, how everything moves on (AMB_PLAN_SIZE squared), with the forces held at their
 * means; and the covariance N that each noise of variance 1 leaves in the states (noises x states x
 * states). `work` has room for two matrices of Phi's size more than AMB_SAMPLING_WORK of it.
 * Returns false where a number is not finite. */
bool amb_plan_sampled(const amb_plan *plan, double Phi[], double N[], double work[]);

#if defined(__cplusplus)
}
#endif

#endif
