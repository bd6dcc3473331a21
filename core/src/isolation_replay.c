#include "isolation_replay.h"
#include "kalman_step.h"

/* Columns are dependent where less than this share of one is left beside the others. */
#define SAME AMB_C(1e-4)

/* Gauss-Newton steps at most; another one is worth while if it promises to gain so much [1], and
 * this share of l. */
#define STEPS 6
#define WORTH AMB_C(1.0)
#define WORTH_SHARE AMB_C(1e-4)

/* Error of the filter made by the faults (p = 0), and its derivatives by their sizes. */
typedef struct motion {
  amb_real d[1 + MOST_COLUMNS][AMB_STATES];
  amb_real read[AMB_SENSORS][1 + MOST_COLUMNS];   /* of the last reading */
  amb_real lagged[AMB_SENSORS][1 + MOST_COLUMNS]; /* of the reading with more lag */
  amb_real signal[AMB_SIGNALS];                   /* of the rotor, not of the estimate */
  amb_stiffness k[AMB_FORCES];
  apart by;
  amb_real rho[1 + MOST_COLUMNS]; /* force or reading along one direction */
  amb_real residual[AMB_SENSORS]; /* of the last sample */
  int first[MOST_COLUMNS];        /* terms of each column: the first ... */
  int after[MOST_COLUMNS];        /* ... and the one after the last */
} motion;

/* Normal equations of the next step. */
typedef struct normal {
  amb_real explains;
  amb_real correlated;
  amb_real g[MOST_COLUMNS];
  amb_real M[MOST_COLUMNS][MOST_COLUMNS];
} normal;

amb_real amb_explained(int count, amb_real M[MOST_COLUMNS][MOST_COLUMNS],
                       const amb_real g[MOST_COLUMNS], amb_real size[], amb_real variance[])
{
  amb_real L[MOST_COLUMNS][MOST_COLUMNS]; /* unit lower triangle */
  amb_real D[MOST_COLUMNS];
  amb_real v[MOST_COLUMNS];
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < count; i++) {
    D[i] = M[i][i];
    v[i] = g[i];
    const amb_real own = SAME * D[i];
    for (int k = 0; k < i; k++) {
      amb_real m = M[i][k];
      for (int l = 0; l < k; l++) {
        m -= L[i][l] * L[k][l] * D[l];
      }
      L[i][k] = (D[k] > AMB_C(0.0)) ? (m / D[k]) : AMB_C(0.0);
      D[i] -= L[i][k] * L[i][k] * D[k];
      v[i] -= L[i][k] * v[k];
    }
    D[i] = ((D[i] > own) && (D[i] > AMB_C(0.0))) ? D[i] : AMB_C(0.0);
    sum += (D[i] > AMB_C(0.0)) ? ((v[i] * v[i]) / D[i]) : AMB_C(0.0);
  }
  if ((size != NULL) && (variance != NULL)) {
    for (int i = count - 1; i >= 0; i--) {
      amb_real inverse[MOST_COLUMNS]; /* row i of the inverse of L' */
      amb_clear(MOST_COLUMNS, inverse);
      size[i] = (D[i] > AMB_C(0.0)) ? (v[i] / D[i]) : AMB_C(0.0);
      variance[i] = AMB_C(0.0);
      for (int l = i + 1; l < count; l++) {
        size[i] -= L[l][i] * size[l];
      }
      inverse[i] = AMB_C(1.0);
      for (int l = i; l < count; l++) {
        for (int k = i; k < l; k++) {
          inverse[l] -= L[l][k] * inverse[k];
        }
        variance[i] += (D[l] > AMB_C(0.0)) ? ((inverse[l] * inverse[l]) / D[l]) : AMB_C(0.0);
      }
    }
  }
  return sum;
}

/* What error p adds to the signal of a term, which has a gradient. */
static amb_real by_error(const amb_isolation *iso, const amb_fault_term *term, const motion *now,
                         int p)
{
  const int n = iso->states;
  const int f = (int)term->gradient - 1;
  amb_real more = AMB_C(0.0);
  if (f < iso->forces) {
    more = now->k[f].k_s * dot(n, iso->h + (f * n), now->d[p]);
  } else if (f < (iso->forces + iso->gradients)) {
    more = dot(n, iso->gradient + ((f - iso->forces) * n), now->d[p]);
  } else { /* a reading with more lag */
    const int r = f - iso->forces - iso->gradients;
    more = now->lagged[r][p] - dot(n, iso->H + (r * n), now->d[p]);
  }
  return more;
}

/* Force or reading added by the faults along a direction, and its derivatives by their sizes. */
static void act(const amb_isolation *iso, int direction, const replay *of, const amb_real size[],
                motion *now)
{
  amb_clear(1 + of->columns, now->rho);
  for (int j = 0; j < of->columns; j++) {
    for (int k = now->first[j]; k < now->after[j]; k++) {
      const amb_fault_term *term = &iso->term[k];
      if ((int)term->direction == direction) {
        const amb_real own = term->weight * now->signal[term->signal];
        now->rho[0] += size[j] * own;
        now->rho[1 + j] += own;
        if (term->gradient > 0U) {
          const bool of_force = (int)term->gradient <= iso->forces; /* of the rotor already */
          for (int p = of_force ? 1 : 0; p <= of->columns; p++) {
            const amb_real more = term->weight * by_error(iso, term, now, p);
            now->rho[p] += size[j] * more;
            now->rho[1 + j] += (p == 0) ? more : AMB_C(0.0);
          }
        }
      }
    }
  }
}

static void step_over_prediction(const samples *in, const amb_real *row, const replay *of,
                                 const amb_real size[], motion *now)
{
  const amb_isolation *iso = in->iso;
  const int n = iso->states;
  amb_real next[1 + MOST_COLUMNS][AMB_STATES];
  amb_real estimated[AMB_FORCES] = {0};
  for (int f = 0; f < iso->forces; f++) {
    amb_stiffness k;
    const amb_real *from = row + (ROW_OF_FORCE * f);
    estimated[f] = amb_step_force(in->kf, in->magnet, f, from[0], from[1], &k);
    now->by.s[f] = dot(n, iso->h + (f * n), now->d[0]);
  }
  amb_row_signals(in, row, &now->by, now->signal, now->k);
  for (int p = 0; p <= of->columns; p++) {
    for (int i = 0; i < n; i++) {
      next[p][i] = dot(n, iso->A + (i * n), now->d[p]);
    }
  }
  for (int f = 0; f < iso->forces; f++) {
    act(iso, f, of, size, now);
    for (int p = 0; p <= of->columns; p++) { /* A has a constant stiffness, the magnet its law */
      const amb_real own = (p == 0) ? (now->signal[1 + (AMB_OF_FORCE * f)] - estimated[f])
                                    : (now->k[f].k_s * dot(n, iso->h + (f * n), now->d[p]));
      const amb_real beyond = own - (iso->k_s[f] * dot(n, iso->h + (f * n), now->d[p]));
      for (int i = 0; i < n; i++) {
        next[p][i] += iso->b[(f * n) + i] * (now->rho[p] + beyond);
      }
    }
  }
  for (int p = 0; p <= of->columns; p++) {
    amb_copy(n, next[p], now->d[p]);
  }
}

static void step_over_update(const amb_isolation *iso, const amb_real *row, int r, const replay *of,
                             const amb_real size[], motion *now, normal *sum)
{
  const int n = iso->states;
  const int m = iso->sensors;
  const amb_real *measured = row + amb_isolation_row(iso) - (m * (2 + n));
  const amb_real S = measured[(2 * r) + 1];
  if (S > AMB_C(0.0)) {
    const amb_real *K = measured + (2 * m) + (r * n);
    amb_real s[1 + MOST_COLUMNS];
    amb_clear(1 + MOST_COLUMNS, s);
    for (int p = 0; p <= of->columns; p++) {
      s[p] = dot(n, iso->H + (r * n), now->d[p]);
      now->lagged[r][p] += (iso->lag[2 * r] * (now->read[r][p] - now->lagged[r][p])) +
                           (iso->lag[(2 * r) + 1] * (s[p] - now->read[r][p]));
      now->read[r][p] = s[p];
    }
    act(iso, iso->forces + r, of, size, now);
    for (int p = 0; p <= of->columns; p++) {
      s[p] += now->rho[p];
      for (int i = 0; i < n; i++) {
        now->d[p][i] -= K[i] * s[p];
      }
    }
    sum->explains += s[0] * ((AMB_C(2.0) * measured[2 * r]) - s[0]) / S;
    const amb_real residual = measured[2 * r] - s[0];
    sum->correlated += residual * now->residual[r] / S;
    now->residual[r] = residual;
    for (int j = 0; j < of->columns; j++) {
      const amb_real share = s[1 + j] / S;
      sum->g[j] += share * residual;
      for (int k = 0; k <= j; k++) {
        sum->M[j][k] += share * s[1 + k];
      }
    }
  }
}

/* Terms of each column: they are in the order of their columns. */
static void find_terms(const amb_isolation *iso, const replay *of, motion *now)
{
  for (int j = 0; j < of->columns; j++) {
    now->first[j] = iso->terms;
    now->after[j] = iso->terms;
    for (int k = iso->terms - 1; k >= 0; k--) {
      const int column = (int)iso->term[k].column;
      now->first[j] = (column >= of->column[j]) ? k : now->first[j];
      now->after[j] = (column > of->column[j]) ? k : now->after[j];
    }
  }
}

/* Set the changes of currents and gaps, the states of the lags, and what acts in the first sample
 * only. Where a lag grows, its reading goes on from the last one. */
static void begin_motion(const samples *in, const replay *of, const amb_real size[], motion *now)
{
  const amb_isolation *iso = in->iso;
  const amb_real *row = row_of(in, of->since);
  const amb_real *last = row + (ROW_OF_FORCE * iso->forces);
  for (int p = 0; p <= MOST_COLUMNS; p++) {
    amb_clear(AMB_STATES, now->d[p]);
  }
  for (int r = 0; r < iso->sensors; r++) {
    amb_clear(1 + MOST_COLUMNS, now->read[r]);
    amb_clear(1 + MOST_COLUMNS, now->lagged[r]);
    now->lagged[r][0] = -last[(AMB_OF_SENSOR * r) + 1];
  }
  amb_clear(AMB_SENSORS, now->residual);
  amb_clear(AMB_FORCES, now->by.s);
  amb_clear(AMB_FORCES, now->by.half);
  amb_clear(AMB_FORCES, now->by.gap);
  for (int j = 0; j < of->columns; j++) {
    for (int k = now->first[j]; k < now->after[j]; k++) {
      const amb_fault_term *term = &iso->term[k];
      const int f = ((int)term->signal - 1) / AMB_OF_FORCE;
      const amb_real change = term->weight * size[j];
      if ((f < iso->forces) && ((int)term->signal == (2 + (AMB_OF_FORCE * f)))) {
        now->by.half[f] += AMB_C(0.5) * change;
      }
      if ((f < iso->forces) && ((int)term->signal == (3 + (AMB_OF_FORCE * f)))) {
        now->by.gap[f] -= change / AMB_C(3.0);
      }
    }
  }
  amb_row_signals(in, row, &now->by, now->signal, now->k);
  for (int f = 0; f < iso->forces; f++) {
    act(iso, iso->forces + iso->sensors + f, of, size, now);
    for (int p = 0; p <= of->columns; p++) {
      for (int i = 0; i < iso->states; i++) {
        now->d[p][i] += iso->b[(f * iso->states) + i] * now->rho[p];
      }
    }
  }
}

/* Step the error made by faults of these sizes through the window; `now` has their terms. */
static normal along(const samples *in, const replay *of, const amb_real size[], motion *now)
{
  const amb_isolation *iso = in->iso;
  normal sum;
  sum.explains = AMB_C(0.0);
  sum.correlated = AMB_C(0.0);
  amb_clear(MOST_COLUMNS, sum.g);
  for (int j = 0; j < MOST_COLUMNS; j++) {
    amb_clear(MOST_COLUMNS, sum.M[j]);
  }
  begin_motion(in, of, size, now);
  for (int ago = of->since - 1; ago >= 0; ago--) {
    const amb_real *row = row_of(in, ago);
    step_over_prediction(in, row, of, size, now);
    for (int r = 0; r < iso->sensors; r++) {
      step_over_update(iso, row, r, of, size, now, &sum);
    }
  }
  return sum;
}

void amb_replay_promise(const samples *in, replay *of)
{
  amb_real step[MOST_COLUMNS];
  motion now;
  find_terms(in->iso, of, &now);
  normal sum = along(in, of, of->size, &now);
  of->promised = true;
  of->explains = sum.explains + amb_explained(of->columns, sum.M, sum.g, step, of->variance);
  for (int j = 0; j < of->columns; j++) {
    of->size[j] += step[j];
  }
}

void amb_replay_fit(const samples *in, replay *of)
{
  amb_real trial[MOST_COLUMNS];
  amb_real step[MOST_COLUMNS];
  motion now;
  bool begun = false;
  bool worth = true;
  find_terms(in->iso, of, &now);
  amb_copy(of->columns, of->size, trial);
  amb_clear(MOST_COLUMNS, step);
  for (int k = 0; worth && (k < STEPS); k++) {
    normal sum = along(in, of, trial, &now);
    if (!begun || (sum.explains > of->explains)) {
      begun = true;
      of->explains = sum.explains;
      of->correlated = sum.correlated;
      amb_copy(of->columns, trial, of->size);
      worth = amb_explained(of->columns, sum.M, sum.g, step, of->variance) >
              amb_at_least(WORTH, WORTH_SHARE * sum.explains);
    } else { /* too far: halve the step */
      for (int j = 0; j < of->columns; j++) {
        step[j] *= AMB_C(0.5);
      }
    }
    for (int j = 0; j < of->columns; j++) {
      trial[j] = of->size[j] + step[j];
    }
  }
  if (!worth) { /* the last step explains hardly more, but improves the sizes */
    amb_copy(of->columns, trial, of->size);
  }
}
