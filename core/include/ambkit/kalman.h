/* Kalman filter of one axial bearing (paper, eq. 7-21), linear or adaptive.
 *
 * The filter is linear or adaptive by the magnet it is given: with the constant magnet it is the
 * paper's linear filter, with the fuzzy magnet its adaptive one (Fig. 8), and any other
 * implementation of ambkit/magnet.h takes part in the same way.
 *
 * State X = [x, v, f_d, x_m]: displacement [m], velocity [m/s], disturbance force F_St [N], lagged
 * position [m times sensor gain]. Covariance: upper triangle, row by row, 10 entries.
 *
 * Nothing here allocates, prints or keeps anything of its own: parameters are read only, the state
 * is the caller's, history belongs to whoever wants one.
 */
#ifndef AMBKIT_KALMAN_H
#define AMBKIT_KALMAN_H

#include "ambkit/magnet.h"
#include "ambkit/status.h"
#include "generated/axial.h"

/* A measurement beyond this many travel limits cannot be the rotor: it counts as missing. */
#define AMB_FAR AMB_C(10.0)

/* An acceleration that nobody reckoned with, that of a load of ten weights [m/s^2]: what a rotor
 * under it can do within a sample is no outlier. */
#define AMB_SUDDEN AMB_C(100.0)

/* Of the innovations of a filter whose model and noise are right, one in 22 is beyond twice its
 * standard deviation; with this share over the last AMB_MEMORY samples something is wrong. */
#define AMB_SURPRISING AMB_C(0.25)
#define AMB_MEMORY AMB_C(128.0)

/* What the user sets. */
typedef struct amb_kalman_settings {
  amb_real T;      /* sampling time [s], > 0 */
  amb_real m;      /* mass of the rotor [kg], > 0 */
  amb_real K_sen;  /* sensor gain [1], not 0 */
  amb_real T_sen;  /* sensor lag [s], > 0 */
  amb_real k_ui;   /* amplifier gain [A/V], not 0 */
  amb_real f_0;    /* known constant force: weight and bias force of the magnet [N] */
  amb_real iu_min; /* limits of the control current [A] */
  amb_real iu_max;
  amb_real x_max;  /* mechanical stop: no position is less certain than this [m], > 0 */
  amb_real var_u;  /* variance of the control signal [V^2], >= 0 */
  amb_real var_d;  /* growth of the disturbance force's variance in a sample [N^2], >= 0 */
  amb_real var_y;  /* variance of the measurement [m^2], > 0 */
  amb_real gate;   /* innovations beyond this many of their standard deviations are outliers, > 0 */
  bool as_printed; /* eq. 19 as printed: position held over the sample in the sensor's lag */
  unsigned int frozen_limit;  /* equal measurements in a row that are taken for frozen; 0: never */
  unsigned int outlier_limit; /* outliers in a row that are left out; then the filter starts
                                 afresh from the measurement. 0: none is left out */
} amb_kalman_settings;

/* Settings, and what is computed from them once. */
typedef struct amb_kalman {
  amb_kalman_settings set;
  amb_axial_model model;
  amb_real growth[AMB_AXIAL_TRIANGLE]; /* covariance that var_d leaves in a sample; follows it */
  amb_real far_squared;  /* square of the farthest measurement that can be the rotor [m^2] */
  amb_real gate_squared; /* of the settings' gate [1] */
  amb_real widest;       /* x_max squared: no variance of the position is larger [m^2] */
  amb_real cap[AMB_AXIAL_STATES]; /* the most that x, v, f_d, x_m can be (ambkit/envelope.h) */
} amb_kalman;

typedef struct amb_kalman_state {
  amb_real mean[AMB_AXIAL_STATES];
  amb_real cov[AMB_AXIAL_TRIANGLE];
  amb_real last_u;        /* last finite control signal [V] */
  amb_real last_y;        /* last measurement [m] */
  amb_real residual;      /* last measurement taken in, less what it left of the estimate [m] */
  amb_real surprise;      /* share of late innovations beyond twice their standard deviation [1] */
  unsigned int unchanged; /* how many times in a row the last measurement has come again */
  unsigned int outliers;  /* how many measurements in a row were left out as outliers */
} amb_kalman_state;

/* What one step leaves behind besides the state. */
typedef struct amb_kalman_result {
  amb_real
      innovation; /* y - H X(k|k-1) [m]; 0 where the measurement was not used, but for outliers */
  amb_real variance;       /* S, its variance [m^2] */
  amb_stiffness stiffness; /* k_i, k_s that the prediction used */
  amb_status status;
} amb_kalman_result;

/* Check the settings and compute the constants. Returns AMB_OK, or AMB_BAD_PARAMETER and leaves
 * `kf` as it was. */
amb_status amb_kalman_init(amb_kalman *kf, const amb_kalman_settings *settings);

/* Start from a mean [4] and standard deviations [4] of x, v, f_d, x_m, uncorrelated; NULL: a
 * diffuse start, where nothing is known but the sensor. What is beyond what a rotor can do is
 * brought back as by ambkit/envelope.h, so any start ends at the rotor. Returns AMB_OK, or
 * AMB_BAD_PARAMETER (not finite, not positive) and leaves the state as it was. */
amb_status amb_kalman_reset(const amb_kalman *kf, amb_kalman_state *state,
                            const amb_real mean[AMB_AXIAL_STATES],
                            const amb_real std[AMB_AXIAL_STATES]);

/* Control current [A] that the filter takes from a control signal u [V]: the last good one where
 * u is not finite, held to its limits; adds what happened to `status`. */
amb_real amb_kalman_current(const amb_kalman *kf, amb_kalman_state *state, amb_real u,
                            amb_status *status);

/* What the magnet says at the control current iu [A] and the displacement x [m], the mean over the
 * sample (amb_axial_displacement), which is held between the stops: beyond them the rotor cannot
 * be, though an estimate can. */
amb_stiffness amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet *magnet, amb_real iu,
                                   amb_real x);

/* Eq. 9, 10: one sample on, with the control current iu [A] that acted and the stiffnesses.
 * Returns AMB_OK; AMB_HELD, perhaps with AMB_RESTARTED, where the envelope held it; or
 * AMB_BAD_PARAMETER with the state as it was, where a stiffness is not finite. */
amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state, amb_stiffness k,
                              amb_real iu);

/* Eq. 11-13: take in the measurement y [m]. */
amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state, amb_real y,
                             amb_kalman_result *result);

/* Fig. 8: stiffnesses of the magnet at the estimated displacement and the control current, then
 * prediction with the control signal u that acted since the last sample, then measurement y. */
amb_status amb_kalman_step(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *state,
                           amb_real y, amb_real u, amb_kalman_result *result);

/* The same with given stiffnesses. */
amb_status amb_kalman_step_given(const amb_kalman *kf, amb_stiffness k, amb_kalman_state *state,
                                 amb_real y, amb_real u, amb_kalman_result *result);

#endif
