/* Interacting multiple models (Blom & Bar-Shalom 1988) over the magnet constant: `own` is an
 * amb_multiple_model.
 *
 * Up to five extended filters run in parallel, each with its own scale of the magnet force, theta =
 * k / nominal k, weighted by how well they predict the measurement. The scale changes to each of
 * the other values with equal probability, a Markov chain; mixing then needs no pairs of models.
 * With the combined mean X and covariance P, the weight mu_j of model j before mixing, d = X_j - X
 * and w = (stay - leave) mu_j / (probability of j after mixing):
 *
 *   X_j <- X + w d,   P_j <- (1 - w) P + w P_j + w (1 - w) d d'
 *
 * which equals the sum over all pairs, without differences of large numbers.
 *
 * While k and a disturbance force cannot be distinguished (ambkit/excitation.h), weights are held
 * and nothing is mixed: the filters continue in parallel, and the step returns AMB_UNEXCITED.
 *
 * Theta is taken for beyond all models, AMB_OUTSIDE, if the disturbance force of the nearest model
 * has followed the magnet forces as if it were (`offset` of ambkit/excitation.h), by a factor
 * AMB_OUTSIDE_FACTOR beyond the last model, for AMB_OUTSIDE_WINDOWS of informative samples. A
 * disturbance that the controller balances looks like a weaker magnet, never like a stronger one;
 * for a weaker one theta times `balanced`, which is 1 for such a disturbance, must exceed
 * AMB_OUTSIDE_BALANCE.
 */
#ifndef AMBKIT_MULTIPLE_MODEL_H
#define AMBKIT_MULTIPLE_MODEL_H

#include "ambkit/estimator.h"
#include "ambkit/excitation.h"

AMB_EXTERN_C_BEGIN

#define AMB_MODELS 5
#define AMB_OUTSIDE_FACTOR AMB_C(1.2)
#define AMB_OUTSIDE_BALANCE AMB_C(1.5)
#define AMB_OUTSIDE_WINDOWS AMB_C(5.0)

typedef struct amb_multiple_model {
  int n;                      /* models, 2 to AMB_MODELS */
  amb_real theta[AMB_MODELS]; /* their scales [1], > 0 */
  amb_real leave;             /* probability that the scale changes in a sample, below 1 - 1 / n */
  amb_real bias[AMB_FORCES];  /* bias force of the known magnet, part of the settings' f_0 [N] */
  amb_excitation_settings learn;
} amb_multiple_model;

typedef struct amb_one_model {
  amb_real mean[AMB_STATES];
  amb_real cov[AMB_TRIANGLE];
  amb_real weight; /* probability [1] */
} amb_one_model;

typedef struct amb_multiple_model_state {
  amb_kalman_state base; /* combined mean and covariance */
  amb_one_model model[AMB_MODELS];
  amb_real trusted[AMB_MODELS]; /* weights before control signals were beyond their limit */
  amb_excitation excitation;    /* of the model nearest to the estimated scale */
  amb_real beyond; /* informative time of theta beyond all models less the other [windows] */
  bool excited;
} amb_multiple_model_state;

extern const amb_estimator_methods amb_multiple_model_methods;

AMB_EXTERN_C_END

#endif
