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

/* The samples under test. */
typedef struct samples {
  const amb_isolation *iso;
  const amb_isolation_state *state;
  const amb_kalman *kf;
  const amb_magnet *magnet;
  int newest;
} samples;

/* Numbers of a row of the ring for each force: current, displacement, late current. */
#define ROW_OF_FORCE 3

static inline const amb_real *row_of(const samples *of, int ago)
{
  const int rows = of->iso->window + of->iso->spare;
  return &of->state->ring[((of->newest + rows - ago) % rows) * amb_isolation_row(of->iso)];
}

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

/* How the rotor's forces differ from those of the estimate. */
typedef struct apart {
  amb_real s[AMB_FORCES];    /* displacement of the rotor from the estimated one [m] */
  amb_real half[AMB_FORCES]; /* half the relative change of the current by a faulty amplifier [1]:
                                F(i + di) = F(i) + k_i(i + di / 2) di where F is a square of i */
  amb_real gap[AMB_FORCES];  /* relative change of the air gap [1]: forces depend on i and s over
                                the gap, so F(i, s) becomes F(i, s / (1 + gap)) / (1 + gap)^2 */
} apart;

/* Signals of a row, and the stiffnesses at its displacements. */
void amb_row_signals(const samples *of, const amb_real *row, const apart *by,
                     amb_real signal[AMB_SIGNALS], amb_stiffness k[AMB_FORCES]);

/* Start at the newest sample; `crossed`: with all of M. */
sweep amb_sweep_begin(const samples *of, bool crossed);

/* Back over sample `ago` before the newest. */
void amb_sweep_back(const samples *of, int ago, sweep *w);

/* Eliminate an unknown error of the filter at the start of the window from g and M (Gauss, by the
 * columns of Z that the samples determine). Returns what that error explains. */
amb_real amb_sweep_eliminate_start(const amb_isolation *iso, sweep *w);

/* The sweep over the last `since` samples, with all of M; `before`: the error at their start is
 * eliminated. */
sweep amb_sweep_to(const samples *of, int since, bool before);

AMB_EXTERN_C_END

#endif
