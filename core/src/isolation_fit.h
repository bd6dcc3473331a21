/* Fault isolation: sizes and onset of the faults, and pairs of faults, that the sweep makes likely.
 */
#ifndef AMBKIT_ISOLATION_FIT_H
#define AMBKIT_ISOLATION_FIT_H

#include "isolation_replay.h"

AMB_EXTERN_C_BEGIN

#define PAIRS 8 /* that are replayed */

/* The samples under test, and what the first sweep over them gives. */
typedef struct window {
  samples data;
  int samples;
  int begin;            /* samples since the innovations became too large */
  amb_real roughness;   /* of the innovations before the window */
  amb_real unexplained; /* sum of e^2 / S */
  amb_real missed;      /* what the likeliest fault leaves unexplained beyond chance */
  amb_real share;       /* share of l that signatures may miss */
} window;

/* Two faults, and what they explain together. */
typedef struct pair {
  int of[2];
  replay fit;
} pair;

typedef struct pairs {
  int count;
  int best;
  pair likely[PAIRS];
} pairs;

/* Whether two different faults are of one group. */
bool amb_fit_alike(const amb_isolation *iso, int j, int k);

/* l of fault j, or of the pair j, l (l < 0: none), by the linearised signatures; sizes and their
 * variances unless NULL. */
amb_real amb_fit_likelihood(const amb_isolation *iso, const sweep *w, int j, int l, amb_real size[],
                            amb_real variance[]);

/* Scale of the variance of the innovations: what the faults leave of them, at least the roughness
 * and 1. */
amb_real amb_fit_scale(const window *in, amb_real explained);

/* Correlation that a fit leaves in the residuals, beyond chance at this scale of their variance. */
amb_real amb_fit_missed(const window *in, const replay *fit, amb_real scale);

/* Write onset, sizes and variances of `count` columns from column `from` of the fit on. */
void amb_fit_write(const replay *fit, int from, int count, amb_isolation_result *of);

/* Replay the faults that explain at least half as much as `first`; returns the likeliest. */
int amb_fit_singles(window *in, int first, amb_isolation_result result[]);

/* Replay the likeliest pairs that began with fault `of`, or where the innovations became too
 * large. */
void amb_fit_pairs(const window *in, int of, amb_isolation_result result[], pairs *list);

AMB_EXTERN_C_END

#endif
