/* The sweep of fault isolation from the newest sample back, and what its files share. */
#ifndef AMBKIT_ISOLATION_SWEEP_H
#define AMBKIT_ISOLATION_SWEEP_H

#include "ambkit/isolation.h"

AMB_EXTERN_C_BEGIN

/* Parts of the memory for a sweep. */
typedef struct sweep {
  amb_real *z;   /* states */
  amb_real *Z;   /* states x states */
  amb_real *Y;   /* columns x states */
  amb_real *g;   /* columns */
  amb_real *M;   /* columns x columns; without `crossed` its diagonal, and pairs of one fault */
  amb_real *rho; /* columns */
  amb_real *y;   /* columns */
  amb_real *diagonal; /* columns: diagonal of M before */
  amb_real *t;        /* states */
  amb_real *AZ;       /* states x states */
  amb_real energy;
  bool crossed;
} sweep;

/* Samples after a contact: a window in which the filter forgets it, and one that is searched. */
static inline int free_of(const amb_isolation *iso)
{
  return 2 * iso->window;
}

static inline amb_real dot(int n, const amb_real a[], const amb_real b[])
{
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    sum += a[i] * b[i];
  }
  return sum;
}

static inline amb_real entry(const amb_isolation *iso, const sweep *w, int j, int l)
{
  return (j <= l) ? w->M[(j * iso->columns) + l] : w->M[(l * iso->columns) + j];
}

/* Start at the newest sample; `crossed`: with all of M. */
sweep amb_sweep_begin(const amb_isolation *iso, const amb_isolation_state *state, bool crossed);

/* Back over sample `ago` before the newest. */
void amb_sweep_back(const amb_isolation *iso, const amb_isolation_state *state, int newest, int ago,
                    sweep *w);

/* What is in the window but for an error of any size at its start: that is eliminated from g and M
 * by columns of Z, and those of Z that the samples do not show are none. Returns what that error
 * explains. */
amb_real amb_sweep_eliminate_start(const amb_isolation *iso, sweep *w);

AMB_EXTERN_C_END

#endif
