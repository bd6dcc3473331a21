/* Smoother for records: what all samples say about each, not only those before it; for the host.
 *
 * Fixed interval, in the form of Bryson and Frazier modified by Bierman (1973). It gives what the
 * smoother of Rauch, Tung and Striebel (1965) gives, but inverts no covariance: in metres and
 * newtons that of this plant has a condition of 1e13 and more, and without a lag in the sensor it
 * is singular. Backwards run an adjoint of the mean, lambda, and one of the covariance, Lambda:
 *
 *     sample used   lambda <- (I - K H)' lambda - H' e / S
 *                   Lambda <- (I - K H)' Lambda (I - K H) + H' H / S
 *     one back      lambda <- A' lambda        Lambda <- A' Lambda A
 *     smoothed      X - P lambda               P - P Lambda P      of the filter's X and P
 *
 * Of the filter it asks mean, covariance, innovation e, its variance S, the stiffnesses of each
 * prediction, and the status: for the paper's filter, the extended one, and that on a factor. R and
 * the growth of f_d are not asked; where the filter adapted them, it smooths with what they were.
 */
#ifndef AMBKIT_SMOOTHER_H
#define AMBKIT_SMOOTHER_H

#include "ambkit/kalman_run.h"

AMB_EXTERN_C_BEGIN

/* Smooth n samples of a filter's history in place: mean and cov, which must not be NULL. Unused
 * samples add nothing. Where the filter was held (AMB_HELD, AMB_BAD_PARAMETER) or had lost its
 * covariance (AMB_BAD_VARIANCE) the recursion restarts: later samples carry no information on
 * earlier ones. */
void amb_smooth(const amb_kalman *kf, size_t n, const amb_kalman_history *history);

AMB_EXTERN_C_END

#endif
