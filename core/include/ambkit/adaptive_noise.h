/* Noise found online, around any filter of the family that has a covariance: `own` is an
 * amb_adaptive_noise, which holds the filter.
 *
 * Measurement noise R, of each sensor. An innovation e of variance S should have e^2 = S on the
 * average; where it has not, R <- R + d (e^2 - S), which is R <- (1 - d) R + d (e^2 - H P H') (Sage
 * and Husa 1969; over a window: Mehra 1972, Mohamed and Schwarz 1999).
 *
 * Growth Q of each disturbance force, by the noise that drives it. Each measurement corrects f_d by
 * K e, which should have the variance P - P+, its own part of K S K'. Over a window of N samples
 * the corrections add to a sum c of variance V, the sum of these: Q <- Q + d (c^2 - V) / N. With N
 * = 1 that is the rule of Sage and Husa, Q <- (1 - d) Q + d (K e e' K' + P+ - A P+ A'). A window
 * longer than the memory of the filter sees more: corrections that go the same way again and again
 * are what a Q too small shows most, and any one alone hardly shows it. Where one noise drives
 * several loads, c^2 and V are the sums over these; other noises, a sensor's with a memory, stay
 * what they are.
 *
 * Both steps are taken relative to what the sample can tell: times R / S, and times N Q / V. In the
 * steady state that is about one, or one; after a start or an outage, when an innovation is mostly
 * the doubt of the prediction, it is small. And neither R nor Q can become negative.
 *
 * Estimating R and Q at once is ill-conditioned (Mehra 1972): with N = 1 both rules ask whether e^2
 * is S, one equation for two unknowns. Over a window they ask two. What is no random walk, a step
 * of the load or a wrong stiffness, is still taken for Q, for a while. Choose the one that is
 * not known.
 *
 * A start that is wrong looks like noise as well: where, within AMB_YOUNG samples after it, an
 * innovation is beyond five standard deviations, or R four times what was assumed, nothing is
 * learned before these are over.
 */
#ifndef AMBKIT_ADAPTIVE_NOISE_H
#define AMBKIT_ADAPTIVE_NOISE_H

#include "ambkit/augmented.h"
#include "ambkit/multiple_model.h"
#include "ambkit/ud.h"

AMB_EXTERN_C_BEGIN

/* Samples after a start. */
#define AMB_YOUNG 256U

typedef struct amb_adaptive_noise {
  amb_estimator inner;  /* the filter: methods and own; plant, magnet and noise are the outer
                           filter's */
  bool measurement;     /* estimate R */
  bool disturbance;     /* estimate Q, for a model with a disturbance force */
  amb_real share;       /* d, weight of a new sample in the end, in (0, 1) */
  amb_real first_share; /* d of the first sample, in [share, 1): decreases from there on */
  amb_real most;        /* maximum factor between estimated and assumed noise, > 1 */
  unsigned int window;  /* N samples, > 0 */
} amb_adaptive_noise;

/* Room for the state of the inner filter, all of which begin with an amb_kalman_state. */
typedef union amb_adaptive_noise_inner {
  amb_kalman_state base;
  amb_ud_state ud;
  amb_augmented_state augmented;
  amb_multiple_model_state multiple_model;
} amb_adaptive_noise_inner;

typedef struct amb_adaptive_noise_state {
  amb_adaptive_noise_inner inner;
  amb_kalman kf;                   /* with the estimated noise */
  amb_real share;                  /* current d */
  amb_real correction[AMB_STATES]; /* c of each disturbance force, sum of its corrections in this
                                      window [N] */
  amb_real expected[AMB_STATES];   /* V, its expected variance [N^2] */
  unsigned int samples;            /* of this window */
  unsigned int young;              /* samples until large innovations are no longer attributed to
                                      the start */
  bool amiss;                      /* whether there were such since the start */
} amb_adaptive_noise_state;

/* Adds AMB_NOISE_LIMIT to the status if the estimated noise is at the end of its range. */
extern const amb_estimator_methods amb_adaptive_noise_methods;

/* The same around a filter that estimates the scale of the magnet's force. */
extern const amb_estimator_methods amb_adaptive_noise_scale_methods;

AMB_EXTERN_C_END

#endif
