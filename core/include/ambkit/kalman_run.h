/* A filter along a complete record, with its history; for the host. */
#ifndef AMBKIT_KALMAN_RUN_H
#define AMBKIT_KALMAN_RUN_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* A record of n samples. u[k] acts from sample k to k + 1; the first sample has no time update.
 * k_i, k_s: given stiffnesses, u[k] and k_i[k] belong together; or NULL, and the magnets are
 * evaluated. */
typedef struct amb_kalman_input {
  size_t n;
  const amb_real *y;   /* n x sensors [m] */
  const amb_real *u;   /* n x controls [V] */
  const amb_real *k_i; /* n x forces [N/A], or NULL */
  const amb_real *k_s; /* n x forces [N/m], or NULL */
  const amb_real *on;  /* n: 0 if the magnets carry no current from sample k to k + 1, not even the
                          bias, else 1; NULL: always 1. Used by kinds with `deenergise` */
} amb_kalman_input;

/* Destinations of the results; `cov`, `scale` and `scale_variance` may be NULL. */
typedef struct amb_kalman_history {
  amb_real *mean;           /* n x states */
  amb_real *cov;            /* n x triangle, or NULL */
  amb_real *innovation;     /* n x sensors [m] */
  amb_real *variance;       /* n x sensors [m^2] */
  amb_real *k_i;            /* n x forces [N/A] */
  amb_real *k_s;            /* n x forces [N/m] */
  amb_real *scale;          /* n [1]: of the magnet force, if the kind estimates it; or NULL */
  amb_real *scale_variance; /* n [1], or NULL */
  unsigned short *status;   /* n */
  unsigned short *health;   /* n x sensors; with one sensor it is `status` itself */
} amb_kalman_history;

/* Write sample k of a history. */
void amb_kalman_note(const amb_kalman *kf, const amb_kalman_state *state,
                     const amb_kalman_result *result, size_t k, const amb_kalman_history *history);

/* Returns all flags that were raised. `magnet` may be NULL if k_i, k_s are given. */
amb_status amb_kalman_run(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          amb_kalman_state *state, const amb_kalman_input *input,
                          const amb_kalman_history *history);

AMB_EXTERN_C_END

#endif
