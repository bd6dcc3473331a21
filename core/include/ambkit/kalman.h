/* Kalman filter of a machine on magnetic bearings (paper, eq. 7-21), linear or adaptive.
 *
 * The filter is linear or adaptive by the magnets it is given: with constant ones it is the paper's
 * linear filter, with fuzzy ones its adaptive one (Fig. 8), and any other implementation of
 * ambkit/magnet.h takes part in the same way. What it is a filter of is its model
 * (ambkit/model.h); the paper's has the state X = [x, v, f_d, x_m]: displacement [m], velocity
 * [m/s], disturbance force F_St [N], lagged position [m times sensor gain]. Covariance: upper
 * triangle, row by row.
 *
 * Sensors are taken in one after the other, each with a health of its own: one that is missing,
 * frozen or jumps leaves the others alone.
 *
 * Nothing here allocates, prints or keeps anything of its own: parameters are read only, the state
 * is the caller's, history belongs to whoever wants one.
 */
#ifndef AMBKIT_KALMAN_H
#define AMBKIT_KALMAN_H

#include "ambkit/model.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

/* A measurement beyond this many clearances cannot be the rotor: it counts as missing. */
#define AMB_FAR AMB_C(10.0)

/* Standard deviations of so many caps are none, and correlations of such neither. */
#define AMB_BOUNDLESS AMB_C(1000.0)

/* An acceleration that nobody reckoned with, that of a load of ten weights [m/s^2]: what a rotor
 * under it can do within a sample is no outlier. */
#define AMB_SUDDEN AMB_C(100.0)

/* Of the innovations of a filter whose model and noise are right, one in 22 is beyond twice its
 * standard deviation; with this share over the last AMB_MEMORY samples something is wrong. */
#define AMB_INCONSISTENT_SHARE AMB_C(0.25)
#define AMB_MEMORY AMB_C(128.0)

/* Square of a step over the variance of the noise. Up to the first the rounding is white, of
 * variance step^2 / 12 (Widrow & Kollar 2008). Up to the second a measurement says that the rotor
 * is within its step. Beyond, a rotor at rest is rounded alike for long: a measurement says
 * something where it changes, and where the prediction has left its step. */
#define AMB_COARSE AMB_C(4.0)
#define AMB_VERY_COARSE AMB_C(121.0)

/* The same, beyond which a healthy rotor can stay in a step for longer than it needs to fall: a
 * step of five standard deviations is not beyond. */
#define AMB_STAYING AMB_C(26.0)

/* Least square of a change of the measurement that counts, over the variance of the noise. */
#define AMB_FINEST AMB_C(1e-4)

/* A sensor that repeats a measurement is frozen where this is the probability that it is not. A
 * series of repeats can start at each sample: at 10 kHz, 3.6e7 times an hour. So a healthy sensor
 * whose noise decides, with steps up to two standard deviations, is flagged at most 4e-6 times per
 * hour of flight, once in 30 years. 1e-16 would notice a stuck one later by a fifth, at two
 * standard deviations after 3.1 to 3.7 time constants of rotors with 22 to 25 samples in one. */
#define AMB_IMPROBABLE AMB_C(1e-13)

/* What the user sets. */
typedef struct amb_kalman_settings {
  amb_real T;                    /* sampling time [s], > 0 */
  amb_real K_sen[AMB_SENSORS];   /* sensor gain [1], not 0 */
  amb_real lag[AMB_SENSORS];     /* by which a sensor is late [s], >= 0 */
  amb_real travel[AMB_SENSORS];  /* what the stops leave at the sensor [m], > 0 */
  amb_real k_ui[AMB_CONTROLS];   /* amplifier gain [A/V], not 0 */
  amb_real iu_min[AMB_CONTROLS]; /* limits of the control current [A] */
  amb_real iu_max[AMB_CONTROLS];
  amb_real f_0[AMB_FORCES];     /* known constant force: weight and bias force of the magnet [N] */
  amb_real x_max[AMB_FORCES];   /* what the stops leave at the magnet [m], > 0 */
  amb_real cap[AMB_STATES];     /* the most that each state can be (ambkit/envelope.h), > 0 */
  amb_real var_u[AMB_CONTROLS]; /* variance of the control signal [V^2], >= 0 */
  amb_real var_d[AMB_NOISES];   /* what each noise of the model grows by in a sample, such as a
                                   disturbance force's variance [N^2], >= 0 */
  amb_real var_y[AMB_SENSORS];  /* variance of the measurement in the middle [m^2], > 0 */
  amb_real rise[AMB_SENSORS];   /* by which share its deviation rises a metre shown [1/m] */
  amb_real step[AMB_SENSORS];   /* quantisation of the measurement [m], >= 0; 0: not stated */
  amb_real dwell; /* samples for which a rotor at rest stays within a very coarse step, >= 0 */
  amb_real gate;  /* innovations beyond this many of their standard deviations are outliers, > 0 */
  unsigned int frozen_limit;  /* least number of equal measurements in a row that can be a frozen
                                 sensor; 0: never */
  unsigned int outlier_limit; /* outliers in a row that are left out; then the filter starts
                                 afresh from the measurement. 0: none is left out */
} amb_kalman_settings;

/* Settings and model, and what is computed from them once. */
typedef struct amb_kalman {
  amb_kalman_settings set;
  amb_model model;
  amb_real growth[AMB_TRIANGLE];  /* covariance that var_d leaves in a sample; follows it */
  amb_real far[AMB_SENSORS];      /* the farthest measurement of a rotor [m] */
  amb_real rounding[AMB_SENSORS]; /* variance of the rounding to steps, step^2 / 12 [m^2] */
  amb_real gate_squared;          /* of the settings' gate [1] */
  amb_real widest[AMB_STATES];    /* square of the cap: no position is less certain */
  amb_real most[AMB_TRIANGLE];    /* what no covariance is beyond, by AMB_BOUNDLESS caps */
} amb_kalman;

/* The health of a sensor. */
typedef struct amb_sensor_state {
  amb_real last_y;        /* last measurement [m] */
  amb_real residual;      /* last measurement taken in, less what it left of the estimate [m] */
  amb_real surprise;      /* share of late innovations beyond twice their standard deviation [1] */
  amb_real chance;        /* probability that a moving rotor has repeated it so often [1] */
  amb_real least_change;  /* square of the smallest change of late: the steps are no finer [m^2] */
  unsigned int unchanged; /* how many times in a row the last measurement has come again */
  unsigned int outliers;  /* how many measurements in a row were left out as outliers */
} amb_sensor_state;

typedef struct amb_kalman_state {
  amb_real mean[AMB_STATES];
  amb_real cov[AMB_TRIANGLE];
  amb_real last_u[AMB_CONTROLS]; /* last finite control signal [V] */
  amb_sensor_state sensor[AMB_SENSORS];
#if defined(AMB_MODEL_LOOPS)
  amb_real work[AMB_WORK]; /* room for a prediction; means nothing between two steps */
#endif
} amb_kalman_state;

/* What one step leaves behind besides the state. */
typedef struct amb_kalman_result {
  amb_real innovation[AMB_SENSORS];    /* y - H X [m] as each sensor was taken in; 0 where the
                                          measurement was not used, but for outliers */
  amb_real variance[AMB_SENSORS];      /* S, its variance [m^2] */
  amb_status health[AMB_SENSORS];      /* what there is to say of each sensor */
  amb_stiffness stiffness[AMB_FORCES]; /* k_i, k_s that the prediction used */
  amb_status status;
} amb_kalman_result;

/* A measurement that is rounded to steps, as one without rounding that says the same. */
typedef struct amb_rounded {
  amb_real moved;  /* from the measurement to the one without rounding [m] */
  amb_real noise;  /* variance of that one [m^2] */
  amb_real chance; /* probability of this step by the prediction [1] */
} amb_rounded;

/* The measurement of innovation e [m] says that the unrounded one is within half a step [m] of it.
 * Of a prediction of variance `shown` and white noise of variance `noise` [m^2], both as normal,
 * mean and variance are those of the truncated normal distribution (Simon 2006, ch. 7.5). */
amb_rounded amb_kalman_rounded(const amb_kalman *kf, int r, amb_real e, amb_real shown,
                               amb_real noise);

/* A very coarse measurement of innovation e [m], by `change` [m] after the last one. A change by
 * one step says that the rotor has just crossed the edge between the two: it is between this edge
 * and the prediction. A repeated measurement says hardly anything of a prediction that is
 * narrower than its step, and as much as any rounded one of a wide one. */
amb_rounded amb_kalman_edge(const amb_kalman *kf, int r, amb_real e, amb_real change,
                            amb_real shown, amb_real noise);

/* Probability that sensor r repeats its measurement though it shows the rotor, where the innovation
 * has variance S [m^2]. Its steps may be coarser than stated, but are no coarser than the smallest
 * change of late, least_change [m^2]. Of a fine step it is at most that of an innovation within
 * half a step (Polya's bound of the normal distribution). In a coarse one a rotor at rest stays
 * long, and where that step is stated, the noise must have left it there as well. */
amb_real amb_kalman_repeats(const amb_kalman *kf, int r, amb_real least_change, amb_real S);

/* The same of a coarse step, where the prediction says `chance`. That counts on the disturbance
 * force which the filter assumes; a rotor under less stays longer. So it is no less than of a rotor
 * at rest, or than what takes three of its time constants, where a rotor at rest takes longer. */
amb_real amb_kalman_rests(const amb_kalman *kf, int r, amb_real least_change, amb_real noise,
                          amb_real chance);

/* Check the settings and compute the constants. Returns AMB_OK, or AMB_BAD_PARAMETER and leaves
 * `kf` as it was. */
amb_status amb_kalman_init(amb_kalman *kf, const amb_model *model,
                           const amb_kalman_settings *settings);

/* Start from a mean and standard deviations of all states, uncorrelated; NULL: a diffuse start,
 * where nothing is known but the sensors. What is beyond what a rotor can do is brought back as by
 * ambkit/envelope.h, so any start ends at the rotor. Returns AMB_OK, or AMB_BAD_PARAMETER (not
 * finite, not positive) and leaves the state as it was. */
amb_status amb_kalman_reset(const amb_kalman *kf, amb_kalman_state *state,
                            const amb_real mean[AMB_STATES], const amb_real std[AMB_STATES]);

/* What the magnets say at the control currents iu [A] and a mean of the states, each at its current
 * and its displacement, which is held between the stops: beyond them the rotor cannot be, though an
 * estimate can. A function of its own, so that a step has the one place where a magnet is asked. */
void amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                          amb_stiffness k[AMB_FORCES]);

/* Eq. 9, 10: one sample on, with the control currents iu [A] that acted and the stiffnesses.
 * Returns AMB_OK; AMB_HELD, perhaps with AMB_RESTARTED, where the envelope held it; or
 * AMB_BAD_PARAMETER with the state as it was, where a stiffness is not finite. */
amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state,
                              const amb_stiffness k[AMB_FORCES], const amb_real iu[AMB_CONTROLS]);

/* Eq. 11-13: take in the measurements y [m]. */
amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state,
                             const amb_real y[AMB_SENSORS], amb_kalman_result *result);

AMB_EXTERN_C_END

#endif
