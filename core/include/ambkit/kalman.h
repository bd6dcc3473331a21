/* Kalman filter of a machine on magnetic bearings (paper, eq. 7-21), linear or adaptive.
 *
 * The magnets determine which: with constant stiffnesses it is the paper's linear filter, with
 * fuzzy ones its adaptive filter (Fig. 8); any other implementation of ambkit/magnet.h works too.
 * The plant is defined by its model (ambkit/model.h); the paper's has the state X = [x, v, f_d,
 * x_m]: displacement [m], velocity [m/s], disturbance force F_St [N], lagged position [m times
 * sensor gain]. Covariance: upper triangle, row by row.
 *
 * Sensors are processed in sequence, each with its own health: one that is missing, frozen or jumps
 * does not affect the others.
 *
 * Nothing is allocated, printed or stored internally: parameters are constant, the state is the
 * caller's.
 */
#ifndef AMBKIT_KALMAN_H
#define AMBKIT_KALMAN_H

#include "ambkit/model.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

/* A measurement beyond this many clearances is no rotor position: it counts as missing. */
#define AMB_FAR AMB_C(10.0)

/* Standard deviations of this many caps are meaningless, and so are their correlations. */
#define AMB_BOUNDLESS AMB_C(1000.0)

/* An unmodelled acceleration, by a disturbance force of ten weights [m/s^2]: motion within a sample
 * that it explains is no outlier. */
#define AMB_SUDDEN AMB_C(100.0)

/* With correct model and noise, one in 22 innovations is beyond twice its standard deviation; this
 * share over the last AMB_MEMORY samples indicates an error. */
#define AMB_INCONSISTENT_SHARE AMB_C(0.25)
#define AMB_MEMORY AMB_C(128.0)

/* Square of a quantisation step over the variance of the noise. Up to the first, the rounding is
 * white, with variance step^2 / 12 (Widrow & Kollar 2008). Up to the second, a measurement means
 * that the rotor is within its step. Beyond, a rotor at rest repeats its code for long: a
 * measurement is informative if it changes, or if the prediction has left its step. */
#define AMB_COARSE AMB_C(4.0)
#define AMB_VERY_COARSE AMB_C(121.0)

/* The same, beyond which a healthy rotor can stay in a step for longer than it takes to fall: true
 * for more than five standard deviations. */
#define AMB_STAYING AMB_C(26.0)

/* Minimum square of a change of the measurement, over the variance of the noise. */
#define AMB_FINEST AMB_C(1e-4)

/* A sensor that repeats a measurement is flagged as frozen if the probability of that for a healthy
 * sensor is below this. A series of repeats can start at each sample: at 10 kHz, 3.6e7 times an
 * hour. A healthy sensor whose noise decides, with steps up to two standard deviations, is
 * therefore flagged at most 4e-6 times per hour of levitation, once in 30 years. 1e-16 would take a
 * fifth longer to flag a stuck one, at two standard deviations after 3.1 to 3.7 time constants of
 * rotors with 22 to 25 samples in one. */
#define AMB_IMPROBABLE AMB_C(1e-13)

/* Settings of the user. */
typedef struct amb_kalman_settings {
  amb_real T;                    /* sampling time [s], > 0 */
  amb_real K_sen[AMB_SENSORS];   /* sensor gain [1], not 0 */
  amb_real lag[AMB_SENSORS];     /* time constant of the sensor's lag [s], >= 0 */
  amb_real travel[AMB_SENSORS];  /* clearance at the sensor [m], > 0 */
  amb_real k_ui[AMB_CONTROLS];   /* amplifier gain [A/V], not 0 */
  amb_real iu_min[AMB_CONTROLS]; /* limits of the control current [A] */
  amb_real iu_max[AMB_CONTROLS];
  amb_real f_0[AMB_FORCES];     /* known constant force: weight and bias force of the magnet [N] */
  amb_real x_max[AMB_FORCES];   /* clearance at the magnet [m], > 0 */
  amb_real cap[AMB_STATES];     /* maximum of each state (ambkit/envelope.h), > 0 */
  amb_real var_u[AMB_CONTROLS]; /* variance of the control signal [V^2], >= 0 */
  amb_real var_d[AMB_NOISES];   /* variance growth per sample of each noise of the model, such as a
                                   disturbance force's [N^2], >= 0 */
  amb_real var_y[AMB_SENSORS];  /* variance of the measurement at the centre [m^2], > 0 */
  amb_real rise[AMB_SENSORS];   /* relative increase of its deviation per metre of reading [1/m] */
  amb_real step[AMB_SENSORS];   /* quantisation of the measurement [m], >= 0; 0: unknown */
  amb_real dwell; /* samples for which a rotor at rest stays within a very coarse step, >= 0 */
  amb_real gate;  /* innovations beyond this many of their standard deviations are outliers, > 0 */
  unsigned int frozen_limit;  /* minimum number of equal consecutive measurements of a frozen
                                 sensor; 0: never */
  unsigned int outlier_limit; /* consecutive outliers that are rejected; then the filter restarts
                                 from the measurement. 0: none is rejected */
} amb_kalman_settings;

/* Settings and model, with derived constants. */
typedef struct amb_kalman {
  amb_kalman_settings set;
  amb_model model;
  amb_real growth[AMB_TRIANGLE];  /* covariance of the process noise over a sample, from var_d */
  amb_real far[AMB_SENSORS];      /* largest possible measurement of a rotor [m] */
  amb_real rounding[AMB_SENSORS]; /* variance of the rounding to steps, step^2 / 12 [m^2] */
  amb_real gate_squared;          /* of the settings' gate [1] */
  amb_real widest[AMB_STATES];    /* square of the cap: no position is less certain */
  amb_real most[AMB_TRIANGLE];    /* limit of each covariance, by AMB_BOUNDLESS caps */
} amb_kalman;

/* Health of a sensor. */
typedef struct amb_sensor_state {
  amb_real last_y;        /* last measurement [m] */
  amb_real residual;      /* last used measurement minus the updated estimate [m] */
  amb_real surprise;      /* share of recent innovations beyond twice their standard deviation [1]
                           */
  amb_real chance;        /* probability that a healthy sensor repeats its measurement so often [1]
                           */
  amb_real least_change;  /* square of the smallest recent change: the steps are no finer [m^2] */
  unsigned int unchanged; /* number of consecutive repeats of the last measurement */
  unsigned int outliers;  /* number of consecutive measurements rejected as outliers */
} amb_sensor_state;

typedef struct amb_kalman_state {
  amb_real mean[AMB_STATES];
  amb_real cov[AMB_TRIANGLE];
  amb_real last_u[AMB_CONTROLS]; /* last finite control signal [V] */
  amb_sensor_state sensor[AMB_SENSORS];
#if defined(AMB_MODEL_LOOPS)
  amb_real work[AMB_WORK]; /* workspace of a prediction; undefined between two steps */
#endif
} amb_kalman_state;

/* Results of a step besides the state. */
typedef struct amb_kalman_result {
  amb_real innovation[AMB_SENSORS];    /* y - H X [m] at the update of each sensor; 0 if the
                                          measurement was not used, except for outliers */
  amb_real variance[AMB_SENSORS];      /* S, its variance [m^2] */
  amb_status health[AMB_SENSORS];      /* flags of each sensor */
  amb_stiffness stiffness[AMB_FORCES]; /* k_i, k_s used by the prediction */
  amb_status status;
} amb_kalman_result;

/* An equivalent measurement without quantisation. */
typedef struct amb_rounded {
  amb_real moved;  /* shift from the measurement to the equivalent [m] */
  amb_real noise;  /* its variance [m^2] */
  amb_real chance; /* probability of this step according to the prediction [1] */
} amb_rounded;

/* A measurement with innovation e [m] means that the unquantised one is within half a step [m] of
 * it. For a prediction of variance `shown` and white noise of variance `noise` [m^2], both normal,
 * mean and variance are those of the truncated normal distribution (Simon 2006, ch. 7.5). */
amb_rounded amb_kalman_rounded(const amb_kalman *kf, int r, amb_real e, amb_real shown,
                               amb_real noise);

/* A very coarse measurement with innovation e [m], which differs by `change` [m] from the last one.
 * A change by one step means that the rotor has just crossed the edge between the two: it is
 * between this edge and the prediction. A repeated measurement carries hardly any information for a
 * prediction narrower than its step, and as much as any quantised one for a wide prediction. */
amb_rounded amb_kalman_edge(const amb_kalman *kf, int r, amb_real e, amb_real change,
                            amb_real shown, amb_real noise);

/* Probability that the healthy sensor r repeats its measurement, for an innovation with variance S
 * [m^2]. Its steps may be coarser than stated, but not coarser than the smallest recent change,
 * least_change [m^2]. For a fine step it is at most that of an innovation within half a step
 * (Polya's bound of the normal distribution). In a coarse step a rotor at rest stays long, and if
 * that step is stated, the noise must have left it there as well. */
amb_real amb_kalman_repeats(const amb_kalman *kf, int r, amb_real least_change, amb_real S);

/* The same for a coarse step, with the probability `chance` by the prediction. That relies on the
 * assumed disturbance force; a rotor under less stays longer. It is therefore at least that of a
 * rotor at rest, or that for three of its time constants, if a rotor at rest takes longer. */
amb_real amb_kalman_rests(const amb_kalman *kf, int r, amb_real least_change, amb_real noise,
                          amb_real chance);

/* Check the settings and compute the constants. Returns AMB_OK, or AMB_BAD_PARAMETER with `kf`
 * unchanged. */
amb_status amb_kalman_init(amb_kalman *kf, const amb_model *model,
                           const amb_kalman_settings *settings);

/* Start from a mean and standard deviations of all states, uncorrelated; NULL: a diffuse start,
 * with no information but the sensors'. Values beyond a rotor's physical limits are corrected as in
 * ambkit/envelope.h, so any start converges to the rotor. Returns AMB_OK, or AMB_BAD_PARAMETER (not
 * finite, not positive) with the state unchanged. */
amb_status amb_kalman_reset(const amb_kalman *kf, amb_kalman_state *state,
                            const amb_real mean[AMB_STATES], const amb_real std[AMB_STATES]);

/* Stiffnesses of the magnets at the control currents iu [A] and a mean of the states, each at its
 * current and its displacement, limited to the stops: an estimate may be beyond them. A separate
 * function, so that magnets are evaluated at one place of a step. */
void amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                          amb_stiffness k[AMB_FORCES]);

/* Eq. 9, 10: time update, with the control currents iu [A] that acted and the stiffnesses. Returns
 * AMB_OK; AMB_HELD, possibly with AMB_RESTARTED, if the envelope held it; or AMB_BAD_PARAMETER with
 * the state unchanged, if a stiffness is not finite. */
amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state,
                              const amb_stiffness k[AMB_FORCES], const amb_real iu[AMB_CONTROLS]);

/* Eq. 11-13: measurement update with y [m]. */
amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state,
                             const amb_real y[AMB_SENSORS], amb_kalman_result *result);

AMB_EXTERN_C_END

#endif
