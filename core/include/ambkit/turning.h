/* The model of a machine at a variable speed of rotation: gain scheduling by cubic interpolation
 * between models sampled at equidistant speeds (nodes). Only for models in loops (ambkit/loops.h).
 *
 *   number = sum over four nodes of w (at + acceleration by_growth)
 *
 * The sampled model depends on the speed by gyroscopic terms, synchronous states and internal
 * damping, and on the angular acceleration by the transverse force of unbalance.
 */
#ifndef AMBKIT_TURNING_H
#define AMBKIT_TURNING_H

#include "ambkit/angle.h"
#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_turning {
  int nodes;                   /* >= 4 */
  int numbers;                 /* of a model */
  int changing;                /* numbers that depend on the speed ... */
  int growing;                 /* ... and on the acceleration */
  int lowest;                  /* speed of the first node in steps */
  amb_real step;               /* between nodes [rad/s], > 0 */
  const amb_real *still;       /* [numbers]: at the nominal speed; the model points into it */
  const unsigned short *which; /* [changing]: indices of numbers */
  const amb_real *at;          /* nodes x changing */
  const unsigned short *grown; /* [growing]: indices, a subset of those above */
  const amb_real *by_growth;   /* nodes x growing, per rad/s^2 */
} amb_turning;

/* Whether a speed [rad/s] is finite, and between the first node and the last. */
bool amb_turning_takes(const amb_turning *turning, amb_real speed);

/* The numbers at a speed [rad/s] and an acceleration `growth` [rad/s^2], from two nodes on either
 * side; beyond the nodes those of the nearest one. */
void amb_turning_to(const amb_turning *turning, amb_real speed, amb_real growth,
                    amb_real numbers[]);

/* A copy of the filter `from` at the nominal speed, with the caller's numbers. Where these move,
 * call amb_turning_point. */
void amb_turning_begin(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       amb_real numbers[]);

/* Lets the filter's model point to these numbers. */
void amb_turning_point(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       const amb_real numbers[]);

/* The filter's model for a sample in which the speed changes linearly [rad/s]. */
void amb_turning_step(const amb_turning *turning, amb_kalman *kf, amb_real numbers[],
                      amb_real before, amb_real after);

/* A pair of states that rotates with the rotor: unbalance in a plane, or a sensor's runout. */
typedef struct amb_synchronous {
  int state;      /* the first of the two */
  int noise;      /* index of their random walk in the model's noises */
  amb_real order; /* periods per revolution */
  amb_real power; /* of the speed, to which its effect is proportional: 2 unbalance, 0 runout */
  amb_real usual; /* variance of the random walk per sample */
  amb_real vague; /* initial standard deviation if nothing is described */
} amb_synchronous;

/* The error of an estimated speed (ambkit/angle.h) as a state. */
typedef struct amb_speed_error {
  int state; /* -1: the model has none */
  int noise; /* index of its process noise */
  int pairs;
  const amb_synchronous *pair;
  const amb_real *std; /* [states]: initial standard deviations */
  bool reverses;       /* no reading shows the direction (AMB_ANGLE_ASSUMED) */
} amb_speed_error;

/* State of the pairs between samples: their size while the angle is known, and the direction of
 * rotation where no reading shows it. All zero at the start. */
typedef struct amb_direction {
  amb_real size[2];      /* greatest mean square of runout and of unbalance over that of a start
                          * [1]; 0: unknown */
  bool held;             /* the pairs' phase is known without the angle sensor ... */
  amb_real drift;        /* ... to so much, since that lost the angle [rad] */
  bool mirrored;         /* the rotor rotates against the direction that the readings assume */
  amb_real abandoned;    /* squared mean of the corrections at the last reversal [1] */
  amb_real predicted[2]; /* sum of the pairs of first order at the next sample ... */
  amb_real angle;        /* ... and the size of the angle until then [rad] */
  amb_real phase[2];     /* cosine and sine of the angle since the pairs began ... */
  amb_real passed;       /* ... and its size [rad] */
  amb_real back[2];      /* sum of the weighted directions of the last corrections, in a frame that
                          * rotates backwards ... */
  amb_real forth[2];     /* ... and forwards, ... */
  amb_real weight;       /* ... sum of their weights ... */
  amb_real by_chance;    /* ... and the mean square of either sum by noise */
} amb_direction;

/* The filter's model for a sample of this rotation. The speed includes its estimated error d, and
 * the pairs Z rotate by n T d in addition to the known angle: the column of L for d is the
 * derivative n T J L Z, and for the force of unbalance 2 speed / (speed^2 + |acceleration|) L Z,
 * which is finite at zero speed; the part of d in the mean is subtracted.
 *
 * Where the angle filter restarts, the pairs continue if their phase is known: readings of the
 * position give the speed too, and both are fused. Otherwise error and pairs restart once the angle
 * is known, and all states but known ones become as uncertain as at the start, or as pairs of the
 * previous size allow; until then the rotor keeps its last speed.
 *
 * At a start with an unknown speed the pairs are Gauss-Markov processes of their initial variance,
 * which act at the greatest possible speed.
 *
 * The direction of rotation shows in that speed, or in the corrections of the pairs, which
 * otherwise rotate with the rotor. If it was wrong, speed and acceleration change their sign.
 * Returns the speed at the sample [rad/s], 0 where the angle is lost, and after a loss until the
 * first revolution. */
amb_real amb_rotate(const amb_turning *nodes, const amb_speed_error *error, amb_kalman *kf,
                    amb_kalman_state *state, amb_real numbers[], amb_direction *direction,
                    const amb_rotation *rotation);

/* AMB_MIRRORED where the rotor rotates against its readings, at a speed other than 0. */
amb_status amb_direction_status(const amb_direction *direction, amb_real speed);

AMB_EXTERN_C_END

#endif
