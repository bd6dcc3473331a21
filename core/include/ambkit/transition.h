/* The matrix exponential and the covariance of integrated white noise, each entry accurate to its
 * own digits.
 *
 * In double in every build, so that the result rounds to the numbers of an export. The exponential
 * is its Taylor series over a fraction of the time, followed by squaring. The fraction is such that
 * the gain of cycles between states is below one half; a Padé approximant is accurate relative to
 * the largest entry only, and metres beside newtons would lose digits. Truncation is below 1e-19 of
 * an entry's series of magnitudes, and rounding below (terms + n) u of it for each of the 2^k
 * fractions, u = 2^-53 (Higham 2008, Functions of Matrices, ch. 10.3); measured, 8 machine epsilons
 * if the terms of an entry do not cancel (tests/test_sampling.py).
 *
 * Matrices are row by row. All memory is the caller's, and nothing may overlap.
 */
#ifndef AMBKIT_TRANSITION_H
#define AMBKIT_TRANSITION_H

#include "ambkit/precision.h"
#include <stdbool.h>

#if defined(__cplusplus)
extern "C" {
#endif

/* Workspace of functions of n states. */
#define AMB_SAMPLING_WORK(n) ((5 * (n) * (n)) + (2 * (n)))

/* Phi = exp(A time), n x n. Returns false with Phi unchanged if A time is not finite. */
bool amb_transition(int n, const double A[], double time, double Phi[], double work[]);

/* For `count` sources of white noise, each with an intensity for every state (count x n), the
 * covariances N (count x n x n) of the state after a time: dN/dt = A N + N A' + diag(intensity)
 * from N = 0 (Van Loan 1978, without the exponential of -A, which overflows for a fast sensor).
 * Returns false as amb_transition does. */
bool amb_process_noise(int n, const double A[], double time, int count, const double intensity[],
                       double N[], double work[]);

#if defined(__cplusplus)
}
#endif

#endif
