/* The rotor's angle from a sensor: a Kalman filter of angle, speed and acceleration.
 *
 *   x = [angle, speed, acceleration],  d^3 angle / dt^3 = white noise of intensity `jerk`
 *   reading of the time t - a:  angle:  H = [1, -a, a^2 / 2]     speed:  H = [0, 1, -a]
 *
 * A reading is of a pulse per turn (keyphasor) or several, of an encoder, or of a speed signal. The
 * age a is the known latency plus the time since the reading came; it is taken back exactly but for
 * the jerk within it. An angle is known but for whole marks: the nearest one is meant, as long as
 * the prediction is surer than a sixth of their distance (AMB_ANGLE_LOST otherwise). Pulses then
 * give the speed by their distance, and do not tell which way the rotor turns.
 *
 * Errors that no reading shows, of the latency and of the gain of a speed signal, are considered:
 * they are in the variances of the estimate and not in its gains (Schmidt 1966).
 */
#ifndef AMBKIT_ANGLE_H
#define AMBKIT_ANGLE_H

#include "ambkit/real.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

/* What a step has to say of the angle: zero, or a sum of these flags. */
#define AMB_ANGLE_OUTLIER 1U   /* a reading far from its prediction was left out */
#define AMB_ANGLE_LOST 2U      /* the angle is not known to a sixth of the marks' distance */
#define AMB_ANGLE_ASSUMED 4U   /* the direction is that of before: pulses do not tell it */
#define AMB_ANGLE_RESTARTED 8U /* started afresh from the last readings */

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
  amb_real latency;       /* by which a reading comes late [s], >= 0 */
  amb_real latency_error; /* standard deviation of the latency [s], >= 0 */
  amb_real gain_error;    /* standard deviation of a speed signal's gain [1], >= 0 */
  amb_real acceleration;  /* what is usual [rad/s^2], > 0 */
  amb_real max_speed;     /* what is the highest speed at the start [rad/s], > 0 */
  bool reverses;          /* whether the rotor turns both ways */
  bool backwards;         /* which way it turns where no reading tells */
} amb_angle_settings;

/* Angle [rad], speed [rad/s], acceleration [rad/s^2]; covariance: upper triangle. */
typedef struct amb_angle_state {
  amb_real mean[3]; /* the angle from -pi to pi */
  amb_real cov[6];
  amb_real since;        /* time since the last mark [s] */
  amb_real moved;        /* angle since then, as predicted [rad] */
  unsigned int outliers; /* readings in a row that were left out */
  bool marked;           /* whether there was a mark since the start */
  bool backwards;        /* which way it went when that was last known */
  amb_real predicted;    /* variance of the speed before the last reading [rad^2/s^2] */
  bool followed;         /* whether one follows it already ... */
  bool waits;            /* ... and nothing is known of the angle since */
} amb_angle_state;

/* The rotation at a sample, for a filter (ambkit/turning.h) and controllers. */
typedef struct amb_rotation {
  amb_real speed;        /* mean over the sample before [rad/s] ... */
  amb_real acceleration; /* ... and its growth there [rad/s^2] */
  amb_real kept;         /* of the speed's error before: the share that is left [1], ... */
  amb_real noise;        /* ... and the variance of what came to it [rad^2/s^2] */
  amb_real change;       /* variance of the error's change [rad^2/s^2] */
  bool lost;    /* nothing is known of the angle, not to a turn: nothing can be learned by it */
  bool afresh;  /* it is known again after that: what was learned before is of no use */
  amb_real now; /* speed at the sample, 0 where the angle is lost [rad/s] */
} amb_rotation;

/* AMB_OK, or AMB_BAD_PARAMETER where a setting is out of range. */
amb_status amb_angle_check(const amb_angle_settings *set);

/* Nothing is known but the highest speed. */
void amb_angle_reset(const amb_angle_settings *set, amb_angle_state *state);

/* One sample on. Of pulses, `reading` is the time since one came within the last sample [s], 0 <=
 * reading < T; of an encoder the angle [rad], of a speed signal the speed [rad/s]; not a number
 * where there is none. Returns flags of AMB_ANGLE. */
unsigned int amb_angle_step(const amb_angle_settings *set, amb_angle_state *state,
                            amb_real reading);

/* The same, and the rotation: the speed grows evenly from the estimate before; a
 * correction of the angle is no rotation. */
unsigned int amb_angle_follow(const amb_angle_settings *set, amb_angle_state *state,
                              amb_real reading, amb_rotation *rotation);

/* Variances of angle [rad^2] and speed [rad^2/s^2], with what no reading shows. */
amb_real amb_angle_variance(const amb_angle_settings *set, const amb_angle_state *state);
amb_real amb_angle_speed_variance(const amb_angle_settings *set, const amb_angle_state *state);

AMB_EXTERN_C_END

#endif
