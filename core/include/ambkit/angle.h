/* The rotor's angle from a sensor: a Kalman filter of angle, speed and acceleration.
 *
 *   x = [angle, speed, acceleration],  d^3 angle / dt^3 = white noise of intensity `jerk`
 *   reading of the time t - a:  angle:  H = [1, -a, a^2 / 2]     speed:  H = [0, 1, -a]
 *
 * A reading is of a pulse per turn (keyphasor) or several, of an encoder, or of a speed signal. The
 * age a is the known latency plus the time since the reading came; it is taken back exactly but for
 * the jerk within it. An angle is known modulo the distance of the marks: a reading belongs to the
 * mark nearest to the prediction while its standard deviation is at most a sixth of that distance
 * (AMB_ANGLE_LOST otherwise). The time between two pulses then gives the speed, without its sign.
 *
 * Errors that no reading shows, of the latency and of the gain of a speed signal, are considered:
 * they are in the variances of the estimate and not in its gains (Schmidt 1966).
 */
#ifndef AMBKIT_ANGLE_H
#define AMBKIT_ANGLE_H

#include "ambkit/real.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

/* Status of a step: zero, or a sum of these flags. */
#define AMB_ANGLE_OUTLIER 1U   /* a reading far from its prediction was ignored */
#define AMB_ANGLE_LOST 2U      /* the angle is not known to a sixth of the marks' distance */
#define AMB_ANGLE_ASSUMED 4U   /* the direction is the previous one: pulses have no sign */
#define AMB_ANGLE_RESTARTED 8U /* restarted from the last readings */

typedef enum amb_angle_sensor {
  AMB_ANGLE_PULSES,  /* marks that pass, `per_turn` of them */
  AMB_ANGLE_ENCODER, /* an angle, `per_turn` steps a turn */
  AMB_ANGLE_SPEED    /* a signed speed */
} amb_angle_sensor;

typedef struct amb_angle_settings {
  amb_angle_sensor sensor;
  amb_real per_turn;      /* marks or steps a turn, >= 1 */
  amb_real T;             /* sampling time [s], > 0 */
  amb_real noise;         /* standard deviation of a reading [rad], of a speed [rad/s], > 0 */
  amb_real latency;       /* delay of a reading [s], >= 0 */
  amb_real latency_error; /* standard deviation of the latency [s], >= 0 */
  amb_real gain_error;    /* standard deviation of a speed signal's gain [1], >= 0 */
  amb_real acceleration;  /* typical [rad/s^2], > 0 */
  amb_real max_speed;     /* standard deviation of the speed at the start [rad/s], > 0 */
  bool reverses;          /* whether the rotor rotates in both directions */
  bool backwards;         /* the direction where no reading shows it */
} amb_angle_settings;

/* Angle [rad], speed [rad/s], acceleration [rad/s^2]; covariance: upper triangle. */
typedef struct amb_angle_state {
  amb_real mean[3]; /* the angle from -pi to pi */
  amb_real cov[6];
  amb_real since;        /* time since the last mark [s] */
  amb_real moved;        /* predicted angle since then [rad] */
  unsigned int outliers; /* consecutive readings that were ignored */
  bool marked;           /* whether there was a mark since the start */
  bool backwards;        /* the direction when it was last significant */
  amb_real predicted;    /* variance of the speed before the last reading [rad^2/s^2] */
  bool restarted;        /* whether the last sample restarted the speed */
  bool followed;         /* whether amb_angle_follow was called ... */
  bool waits;            /* ... and the angle has been unknown since */
} amb_angle_state;

/* The rotation at a sample, for a filter (ambkit/turning.h) and controllers. From a start until the
 * speed is known to a sixth of max_speed the angle is lost; speed and noise are then mean and
 * variance between zero and the upper limit, by max_speed and by the time without a pulse. */
typedef struct amb_rotation {
  amb_real speed;         /* mean over the previous interval [rad/s] ... */
  amb_real acceleration;  /* ... and the acceleration there [rad/s^2] */
  amb_real kept;          /* share of the previous speed error that remains [1], ... */
  amb_real noise;         /* ... and variance added to it [rad^2/s^2] */
  amb_real change;        /* variance of the error's change [rad^2/s^2] */
  bool lost;              /* the angle is uncertain by a revolution or more */
  bool afresh;            /* it is known again after that */
  amb_real process_noise; /* variance added to the speed over the interval [rad^2/s^2] */
  amb_real prior;         /* variance of the speed before a restart [rad^2/s^2]; 0: no restart */
  amb_real estimate;      /* speed at the sample [rad/s] ... */
  amb_real now;           /* ... and 0 where the angle is lost */
} amb_rotation;

/* AMB_OK, or AMB_BAD_PARAMETER where a setting is out of range. */
amb_status amb_angle_check(const amb_angle_settings *set);

/* Starts with an unknown angle, and a speed of standard deviation max_speed. */
void amb_angle_reset(const amb_angle_settings *set, amb_angle_state *state);

/* Advances by a sample. `reading` is the time since a pulse within the last sample [s], 0 <=
 * reading < T, the angle of an encoder [rad], or the speed of a speed signal [rad/s]; NaN if there
 * is none. Returns flags of AMB_ANGLE. */
unsigned int amb_angle_step(const amb_angle_settings *set, amb_angle_state *state,
                            amb_real reading);

/* The same, and the rotation at the previous estimate of speed and acceleration; corrections of the
 * angle are not part of it. */
unsigned int amb_angle_follow(const amb_angle_settings *set, amb_angle_state *state,
                              amb_real reading, amb_rotation *rotation);

/* Variances of angle [rad^2] and speed [rad^2/s^2], with errors of latency and gain. */
amb_real amb_angle_variance(const amb_angle_settings *set, const amb_angle_state *state);
amb_real amb_angle_speed_variance(const amb_angle_settings *set, const amb_angle_state *state);

AMB_EXTERN_C_END

#endif
