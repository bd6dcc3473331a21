/* The models of amb_multiple_model as one Gaussian mixture (Blom & Bar-Shalom 1988): mixing,
 * weights, and combined mean and covariance. */
#ifndef AMBKIT_MIXTURE_H
#define AMBKIT_MIXTURE_H

#include "ambkit/multiple_model.h"

/* How well each model predicted the measurements of a sample. */
typedef struct amb_likelihoods {
  amb_multiple_model_state *s;
  bool taken[AMB_SENSORS];
  amb_real square[AMB_MODELS];         /* sum of e^2 / S over the sensors [1] */
  amb_real S[AMB_SENSORS][AMB_MODELS]; /* variances of the innovations [m^2] */
} amb_likelihoods;

/* Mean and covariance of the mixture, into the base; n states. */
void amb_mixture_combine(int n, int models, amb_multiple_model_state *s);

/* All models take the mean and the covariance of the base. */
void amb_mixture_restart(int n, int models, amb_multiple_model_state *s);

/* Replace weights that a flipped bit has made invalid by the trusted ones, and these by those. */
void amb_mixture_repair(int models, amb_multiple_model_state *s);

/* Mix the models, by the Markov chain of the scale. */
void amb_mixture_mix(int n, const amb_multiple_model *own, amb_multiple_model_state *s);

/* Expected scale of the magnet force [1]. */
amb_real amb_mixture_scale(const amb_multiple_model *own, const amb_multiple_model_state *s);

/* The model nearest to the expected scale. */
int amb_mixture_nearest(const amb_multiple_model *own, const amb_multiple_model_state *s);

/* Update the weights with the likelihoods of a sample. */
void amb_mixture_weigh(const amb_model *model, const amb_multiple_model *own,
                       const amb_likelihoods *h);

#endif
