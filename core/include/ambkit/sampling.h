/* A continuous linear model over one sample, each entry of the result accurate to its own digits. A
 * controller can recompute its model with it after a change of a parameter.
 *
 * In double in every build, so that the result rounds to the numbers of an export. Matrices are row
 * by row. All memory is the caller's, and nothing may overlap.
 */
#ifndef AMBKIT_SAMPLING_H
#define AMBKIT_SAMPLING_H

#include "ambkit/transition.h"

#if defined(__cplusplus)
extern "C" {
#endif

/* A commanded current with dead time. */
typedef struct amb_late {
  int control;
  int count;                  /* number of states with past commands, ... */
  const unsigned short *past; /* ... the latest one first */
  double share;               /* share of the sample, after which the last but one acts; to 1 */
} amb_late;

/* Membership of a term: motion over the sample, or spreading of noise. */
#define AMB_MOVES 1U
#define AMB_SPREADS 2U

/* A continuous model as a list of terms: the rate of `row` has the term `value` times `column`.
 * Quantities that move or are held over the sample are in this order: states, forces, controls;
 * integrals of the forces' displacements, integrals of their currents. */
typedef struct amb_plan {
  double T; /* sampling time [s] */
  int states;
  int forces;
  int controls;
  int noises;
  int terms;
  const unsigned short *row;    /* [terms] */
  const unsigned short *column; /* [terms] */
  const unsigned char *use;     /* [terms]: AMB_MOVES, AMB_SPREADS, or both */
  const double *value;          /* [terms] [1/s, times the units] */
  const double *k_i; /* [forces]: current stiffness of a force that follows its current within the
                        sample [N/A]; 0: held */
  int lates;
  const amb_late *late;
  const double *intensity; /* noises x states */
} amb_plan;

/* Order of its transition matrix. */
#define AMB_PLAN_SIZE(plan) ((plan)->states + (3 * (plan)->forces) + (plan)->controls)

/* One sample: Phi, the transition (AMB_PLAN_SIZE squared), with the forces held at their means; and
 * the covariance N of the states from each noise of variance 1 (noises x states x states). `work`
 * has room for two matrices of Phi's size in addition to AMB_SAMPLING_WORK. Returns false if a
 * number is not finite. */
bool amb_plan_sampled(const amb_plan *plan, double Phi[], double N[], double work[]);

#if defined(__cplusplus)
}
#endif

#endif
