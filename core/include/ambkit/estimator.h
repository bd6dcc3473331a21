/* Common interface of all estimators.
 *
 * An estimator consists of methods and their constant data, owned by the caller: plant and noise
 * (an amb_kalman), magnets, and data specific to the kind, such as the gain of an observer. The
 * state is the caller's too: `state_size` bytes, aligned as an amb_kalman_state, with which the
 * state of every kind begins, so that mean and covariance are always at the same place.
 */
#ifndef AMBKIT_ESTIMATOR_H
#define AMBKIT_ESTIMATOR_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_estimator amb_estimator;

/* The interface. Each kind provides one constant of this type. */
typedef struct amb_estimator_methods {
  size_t state_size; /* [bytes] */

  /* Start from a mean and standard deviations of all states, uncorrelated; NULL: with no
   * information but the sensors'. Returns AMB_OK, or AMB_BAD_PARAMETER (not finite, not positive)
   * with the state unchanged. */
  amb_status (*reset)(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                      const amb_real std[AMB_STATES]);

  /* Time update, with the control signals u [V] that acted. Writes the stiffnesses of the result,
   * and returns the status. */
  amb_status (*predict)(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                        amb_kalman_result *result);

  /* Measurement update with y [m]. Writes innovations, variances and health of the result, and
   * returns the status. A variance is 0 if the kind does not compute it. */
  amb_status (*update)(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                       amb_kalman_result *result);

  /* Time update of the mean only, without noise, with the control currents iu [A] and magnet forces
   * multiplied by `scale` [1]. */
  void (*advance)(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                  amb_real mean[AMB_STATES]);

  /* Estimated scale of the magnet force, k over the nominal k [1], and its variance; NULL if the
   * kind does not estimate it. */
  void (*scale)(const amb_estimator *self, const void *state, amb_real *scale, amb_real *variance);

  /* Before a time update: the magnets carried no current over its sample, not even the bias. It
   * holds for that time update only. NULL if the kind predicts with magnet forces always. */
  void (*deenergise)(void *state);
} amb_estimator_methods;

struct amb_estimator {
  const amb_estimator_methods *methods;
  const amb_kalman *kf;
  const amb_magnet *magnet; /* [AMB_FORCES] */
  const void *own;          /* data specific to the kind, or NULL */
};

/* The paper's filter (Fig. 8): linear or adaptive, depending on its magnet; ambkit/kalman.h. */
extern const amb_estimator_methods amb_kalman_methods;

/* Extended Kalman filter (Jazwinski 1970): the force in the prediction of the mean, its tangents in
 * that of the covariance. */
extern const amb_estimator_methods amb_extended_methods;

/* Time update with the control signals u_previous that acted since the last sample, u[k - 1], or
 * none if it is NULL, for the first sample after a reset; then measurement update with y[k].
 * Returns all flags. */
amb_status amb_estimator_step(const amb_estimator *estimator, void *state,
                              const amb_real y[AMB_SENSORS],
                              const amb_real u_previous[AMB_CONTROLS], amb_kalman_result *result);

/* Before a step: the magnets carried no current since the last sample, not even the bias. Kinds
 * without `deenergise` ignore it. */
void amb_deenergise(const amb_estimator *self, void *state);

/* Methods of these two that other kinds share. */
amb_status amb_plain_reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                           const amb_real std[AMB_STATES]);
amb_status amb_plain_update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                            amb_kalman_result *result);
void amb_plain_advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                       amb_real mean[AMB_STATES]);
void amb_extended_advance(const amb_estimator *self, amb_real scale,
                          const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES]);

/* The `advance` of kinds that estimate the magnets' scale: bias forces [N] scale too. */
void amb_scaled_advance(const amb_estimator *self, const amb_real bias[AMB_FORCES], amb_real scale,
                        const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES]);

AMB_EXTERN_C_END

#endif
