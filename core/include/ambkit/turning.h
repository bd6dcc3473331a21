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

AMB_EXTERN_C_END

#endif
