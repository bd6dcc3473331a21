/* The sweep of fault isolation, from the newest sample back. */
#ifndef AMBKIT_ISOLATION_SWEEP_H
#define AMBKIT_ISOLATION_SWEEP_H

#include "ambkit/isolation.h"

AMB_EXTERN_C_BEGIN

/* Sums of a sweep (ambkit/isolation.h), in the caller's work memory. */
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
  bool crossed; /* with all of M */
} sweep;

/* Samples without a contact before a search: the filter forgets it in one window, and searches
 * another. */
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

/* Eliminate an unknown error of the filter at the start of the window from g and M (Gauss, by the
 * columns of Z that the samples determine). Returns what that error explains. */
amb_real amb_sweep_eliminate_start(const amb_isolation *iso, sweep *w);

/* The sweep over the last `since` samples, with all of M; `before`: the error at their start is
 * eliminated. */
sweep amb_sweep_to(const amb_isolation *iso, const amb_isolation_state *state, int newest,
                   int since, bool before);

AMB_EXTERN_C_END

#endif
