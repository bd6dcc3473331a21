/* A machine's model at any speed of rotation: its numbers at speeds one after the other, by cubics
 * in between. Only where the model is computed by loops (ambkit/loops.h).
 *
 *   number = sum over four nodes of w (at + growth by_growth)
 *
 * What is sampled depends on the speed by gyroscopics, by what turns with the rotor, and by what
 * damps inside of it; and while the speed grows, unbalance pushes across too.
 */
#ifndef AMBKIT_TURNING_H
#define AMBKIT_TURNING_H

#include "ambkit/angle.h"
#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_turning {
  int nodes;                   /* >= 4 */
  int numbers;                 /* all that a model has */
  int changing;                /* those of them that the speed changes ... */
  int growing;                 /* ... and those that its growth changes */
  int lowest;                  /* the first node is at so many steps */
  amb_real step;               /* from node to node [rad/s], > 0 */
  const amb_real *still;       /* [numbers]: at the machine's own speed; the model points into it */
  const unsigned short *which; /* [changing]: places among the numbers */
  const amb_real *at;          /* nodes x changing */
  const unsigned short *grown; /* [growing]: places, some of those above */
  const amb_real *by_growth;   /* nodes x growing, for each rad/s^2 */
} amb_turning;

/* Whether a speed [rad/s] is a number, and between the first node and the last. */
bool amb_turning_takes(const amb_turning *turning, amb_real speed);

/* The numbers of a speed [rad/s] that grows [rad/s^2]; beyond the nodes those of the last one. They
 * follow from two nodes on either side, and not from which others there are. */
void amb_turning_to(const amb_turning *turning, amb_real speed, amb_real growth,
                    amb_real numbers[]);

/* A filter `from` the machine's own speed, with numbers that are the caller's. Where these move, so
 * must the filter: amb_turning_point. */
void amb_turning_begin(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       amb_real numbers[]);

/* Let the filter's model point to these numbers, and not to those that its first one had. */
void amb_turning_point(const amb_turning *turning, const amb_kalman *from, amb_kalman *kf,
                       const amb_real numbers[]);

/* The filter's model while the rotor gets from one speed to another within a sample [rad/s]. */
void amb_turning_step(const amb_turning *turning, amb_kalman *kf, amb_real numbers[],
                      amb_real before, amb_real after);

/* A pair of states that turns with the rotor: unbalance in a plane, or a sensor's runout. */
typedef struct amb_synchronous {
  int state;      /* the first of the two */
  int noise;      /* their random walk, among the model's noises */
  amb_real order; /* how often a turn */
  amb_real power; /* of the speed, by which it acts on other states: 2 of unbalance, 0 of runout */
  amb_real usual; /* variance of the walk in a sample */
} amb_synchronous;

/* The speed of a rotor whose angle is estimated (ambkit/angle.h), with its error as a state. */
typedef struct amb_speed_error {
  int state; /* -1: the model has none */
  int noise; /* what comes to it in a sample */
  int pairs;
  const amb_synchronous *pair;
  const amb_real *std; /* [states]: at the start */
  bool reverses;       /* no reading tells the direction (AMB_ANGLE_ASSUMED) */
} amb_speed_error;

/* What is kept of the pairs from sample to sample: their size before the angle was lost, and where
 * no reading tells the direction of rotation, that. All zero at the start. */
typedef struct amb_direction {
  amb_real size[2];      /* greatest mean square of runout and of unbalance over that of a start
                          * [1]; 0: unknown */
  bool mirrored;         /* the rotor turns the other way than the readings were taken for */
  amb_real abandoned;    /* share of corrections that turned back when that was last changed [1] */
  amb_real predicted[2]; /* sum of the pairs of first order at the next sample ... */
  amb_real angle;        /* ... and the size of the angle until then [rad] */
  amb_real phase[2];     /* cosine and sine of the angle since the pairs began ... */
  amb_real passed;       /* ... and its size [rad] */
  amb_real back[2];      /* sum of the corrections, each of size one, as a rotor sees them that
                          * turns the other way, over the last turns; ... */
  amb_real forth[2];     /* ... as this one sees them ... */
  amb_real by_chance;    /* ... and the mean square of either by noise */
} amb_direction;

/* The filter's model for a sample of this rotation. The speed is corrected by its estimated error
 * d, and the pairs Z turn by n T d beside the known angle: the column of L for d is the derivative
 * n T J L Z, and by the force of unbalance 2 speed / (speed^2 + |growth|) L Z, which is no pole at
 * zero; what d has done already is taken back. Where the angle is known again, error and pairs
 * begin afresh, and nothing but currents is surer than at a start, or where the direction is known,
 * than pairs of the size of before let it be: it was estimated without them.
 *
 * A rotor that turns the other way shows: the corrections of the pairs go round with it. Then speed
 * and growth change their sign, and the pairs begin afresh. Returns the speed at the sample
 * [rad/s], 0 where the angle is lost, and after a loss until the pairs have turned once. */
amb_real amb_rotate(const amb_turning *nodes, const amb_speed_error *error, amb_kalman *kf,
                    amb_kalman_state *state, amb_real numbers[], amb_direction *direction,
                    const amb_rotation *rotation);

/* AMB_MIRRORED where the rotor is found to spin against its readings, at a speed other than 0. */
amb_status amb_direction_status(const amb_direction *direction, amb_real speed);

AMB_EXTERN_C_END

#endif
