/* Interacting multiple models (Blom & Bar-Shalom 1988) over the magnet constant: `own` is an
 * amb_multiple_model.
 *
 * Up to five extended filters run side by side, each with its own scale of the magnet's force,
 * theta = k / known k, and are weighed by how well they predict the measurement. The scale leaves
 * its value with the same probability for each of the others, a Markov chain; then mixing needs
 * none of the pairs of models. With the mean X and covariance P of all together, the weight mu_j of
 * one before mixing, d = X_j - X and w = (stay - leave) mu_j / (probability of j after mixing):
 *
 *   X_j <- X + w d,   P_j <- (1 - w) P + w P_j + w (1 - w) d d'
 *
 * which is what summing over all pairs gives, without a difference of large numbers.
 *
 * Where k and a load cannot be told apart (ambkit/excitation.h), weights are held and nothing is
 * mixed: the filters go on side by side, and the step says AMB_UNEXCITED.
 */
#ifndef AMBKIT_MULTIPLE_MODEL_H
#define AMBKIT_MULTIPLE_MODEL_H

#include "ambkit/estimator.h"
#include "ambkit/excitation.h"

AMB_EXTERN_C_BEGIN

#define AMB_MODELS 5

typedef struct amb_multiple_model {
  int n;                      /* models, 2 to AMB_MODELS */
  amb_real theta[AMB_MODELS]; /* their scales [1], > 0 */
  amb_real leave;             /* probability for a scale to change in a sample, below 1 - 1 / n */
  amb_real bias[AMB_FORCES];  /* bias force of the known magnet, part of the settings' f_0 [N] */
  amb_excitation_settings learn;
} amb_multiple_model;

typedef struct amb_one_model {
  amb_real mean[AMB_STATES];
  amb_real cov[AMB_TRIANGLE];
  amb_real weight; /* probability [1] */
} amb_one_model;

typedef struct amb_multiple_model_state {
  amb_kalman_state base; /* mean and covariance of all together */
  amb_one_model model[AMB_MODELS];
  amb_real trusted[AMB_MODELS]; /* weights before control signals were beyond their limit */
  amb_excitation excitation;    /* of the model nearest to the estimated scale */
  bool excited;
} amb_multiple_model_state;

extern const amb_estimator_methods amb_multiple_model_methods;

AMB_EXTERN_C_END

#endif
