#include "ambkit/isolation.h"
#include "ambkit/root.h"
#include "kalman_step.h"

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

#define MOST_COLUMNS 4 /* of two faults */

/* Share of its travel from which on a rotor is taken to be on its stop. */
#define ON_STOP AMB_C(0.95)

/* Health of a reading that says nothing. */
#define MISSING (AMB_MISSING | AMB_FROZEN | AMB_BAD_VARIANCE)

/* Share of a column that is left beside others, below which they are the same. */
#define SAME AMB_C(1e-4)

/* Samples after a contact: a window in which the filter forgets it, and one that is searched. */
static int free_of(const amb_isolation *iso)
{
  return 2 * iso->window;
}

int amb_isolation_row(const amb_isolation *iso)
{
  return 1 + (AMB_OF_FORCE * iso->forces) + (AMB_OF_SENSOR * iso->sensors) + iso->forms +
         (2 * iso->tones) + (iso->sensors * (2 + iso->states)) + 1;
}

int amb_isolation_work(const amb_isolation *iso)
{
  const int n = iso->states;
  const int c = iso->columns;
  return (2 * n) + (2 * n * n) + (c * n) + (4 * c) + (c * c);
}

static sweep begin(const amb_isolation *iso, const amb_isolation_state *state, bool crossed)
{
  const int n = iso->states;
  const int c = iso->columns;
  sweep w;
  w.z = state->work;
  w.Z = w.z + n;
  w.Y = w.Z + (n * n);
  w.g = w.Y + (c * n);
  w.M = w.g + c;
  w.rho = w.M + (c * c);
  w.y = w.rho + c;
  w.diagonal = w.y + c;
  w.t = w.diagonal + c;
  w.AZ = w.t + n;
  w.energy = AMB_C(0.0);
  w.crossed = crossed;
  amb_clear(amb_isolation_work(iso), state->work);
  return w;
}

static amb_real dot(int n, const amb_real a[], const amb_real b[])
{
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    sum += a[i] * b[i];
  }
  return sum;
}

void amb_isolation_reset(const amb_isolation *iso, amb_isolation_state *state)
{
  state->newest = iso->window + iso->spare - 1;
  state->count = 0U;
  state->contact = free_of(iso);
  state->filled = 0;
  state->seen = 0;
  amb_clear(AMB_STATES, state->mean);
  amb_clear(AMB_SENSORS, state->lagged);
  for (int k = 0; k <= AMB_ISOLATION_LEAST; k++) {
    amb_clear(AMB_FORCES, state->current[k]);
  }
}

/* Signals of a force at the currents that acted; they belong to the mean before. */
static void put_forces(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_magnet magnet[AMB_FORCES], const amb_real last_u[AMB_CONTROLS],
                       amb_real *row)
{
  const amb_kalman_settings *set = &kf->set;
  amb_real iu[AMB_CONTROLS];
  for (int c = 0; c < amb_controls(&kf->model); c++) {
    iu[c] = amb_clamp(set->k_ui[c] * last_u[c], set->iu_min[c], set->iu_max[c]);
  }
  for (int k = AMB_ISOLATION_LEAST; k > 0; k--) {
    amb_copy(iso->forces, state->current[k - 1], state->current[k]);
  }
  for (int f = 0; f < iso->forces; f++) {
    amb_stiffness k;
    amb_stiffness late;
    const amb_real i = amb_model_current(&kf->model, f, state->mean, iu);
    const amb_real s = amb_model_displacement(&kf->model, f, state->mean);
    amb_real *to = row + (AMB_OF_FORCE * f);
    to[0] = amb_step_force(kf, magnet, f, i, s, &k);
    to[1] = k.k_i * i;
    to[2] = k.k_s * s;
    state->current[0][f] = i;
    to[3] = amb_step_force(kf, magnet, f, state->current[iso->late][f], s, &late) - to[0];
  }
}

/* Signals of the sensors come from the prediction: the mean has taken the innovation in. */
static void put_measurements(const amb_isolation *iso, amb_isolation_state *state,
                             const amb_kalman_state *filter, const amb_kalman_result *result,
                             amb_real *signal, amb_real *measured)
{
  for (int r = 0; r < iso->sensors; r++) {
    const bool missing = (result->health[r] & MISSING) != 0U;
    const amb_real e = missing ? AMB_C(0.0) : result->innovation[r];
    const amb_real predicted = missing ? state->lagged[r] : (filter->sensor[r].last_y - e);
    signal[AMB_OF_SENSOR * r] = predicted;
    state->lagged[r] += iso->lag[r] * (predicted - state->lagged[r]);
    signal[(AMB_OF_SENSOR * r) + 1] = state->lagged[r] - predicted;
    measured[2 * r] = e;
    measured[(2 * r) + 1] = missing ? AMB_C(0.0) : result->variance[r];
  }
}

/* Gains of the sensors, each after those before it, by the covariance after the last one: that
 * before a sensor is the one after it and K K' S. */
static void put_gains(const amb_isolation *iso, const amb_kalman *kf,
                      const amb_kalman_state *filter, const amb_kalman_result *result,
                      amb_real *gains)
{
  const int n = iso->states;
  for (int r = iso->sensors - 1; r >= 0; r--) {
    const amb_real R = amb_step_noise(kf, r, filter->mean) + kf->rounding[r];
    amb_real *K = gains + (r * n);
    amb_real with_y[AMB_STATES];
    amb_model_shown_with(&kf->model, r, filter->cov, with_y);
    for (int i = 0; i < n; i++) {
      K[i] = with_y[i] / iso->unit[i];
    }
    for (int q = r + 1; q < iso->sensors; q++) {
      const amb_real *later = gains + (q * n);
      const amb_real share = result->variance[q] * dot(n, iso->H + (r * n), later);
      for (int i = 0; i < n; i++) {
        K[i] += share * later[i];
      }
    }
    const bool used = (result->health[r] & (MISSING | AMB_OUTLIER | AMB_RESTARTED)) == 0U;
    for (int i = 0; i < n; i++) {
      K[i] = !used ? AMB_C(0.0) : ((iso->K != NULL) ? iso->K[(r * n) + i] : (K[i] / R));
    }
  }
}

/* Turn a cosine and a sine; `to` may be `from`. */
static void rotate_tone(const amb_real from[2], amb_real cosine, amb_real sine, amb_real to[2])
{
  const amb_real real = (from[0] * cosine) - (from[1] * sine);
  const amb_real imaginary = (from[1] * cosine) + (from[0] * sine);
  const amb_real longer = AMB_C(1.5) - (AMB_C(0.5) * ((real * real) + (imaginary * imaginary)));
  to[0] = real * longer; /* rounding changes no length */
  to[1] = imaginary * longer;
}

/* Cosine and sine of the tones, advanced from the row before; the last one by a small angle
 * more, of which the first terms of both series are enough. */
static void put_tones(const amb_isolation *iso, const amb_real *before, amb_real more,
                      amb_real *tone)
{
  static const amb_real zero_angle[2] = {AMB_C(1.0), AMB_C(0.0)};
  for (int k = 0; k < iso->tones; k++) {
    const amb_real *by = iso->turn + (2 * k);
    rotate_tone((before == NULL) ? zero_angle : (before + (2 * k)), by[0], by[1], tone + (2 * k));
  }
  if (amb_magnitude(more) > AMB_C(0.0)) {
    const amb_real a = amb_clamp(more, AMB_C(-1.0), AMB_C(1.0));
    const amb_real q = a * a;
    amb_real *last = tone + (2 * (iso->tones - 1));
    rotate_tone(last, AMB_C(1.0) - ((AMB_C(0.5) * q) * (AMB_C(1.0) - (q / AMB_C(12.0)))),
                a * (AMB_C(1.0) - ((q / AMB_C(6.0)) * (AMB_C(1.0) - (q / AMB_C(20.0))))), last);
  }
}

static bool is_on_stop(const amb_isolation *iso, const amb_kalman *kf,
                       const amb_kalman_state *filter)
{
  bool on_stop = false;
  for (int r = 0; r < iso->sensors; r++) {
    const amb_real limit = amb_magnitude(kf->set.K_sen[r]) * kf->set.travel[r];
    on_stop = on_stop || (amb_magnitude(filter->sensor[r].last_y) > (ON_STOP * limit));
  }
  return on_stop;
}

void amb_isolation_put(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_magnet magnet[AMB_FORCES], const amb_kalman_state *filter,
                       const amb_kalman_result *result, amb_real faster)
{
  const amb_real *mean = filter->mean;
  const int n = amb_states(&kf->model);
  const int rows = iso->window + iso->spare;
  const int size = amb_isolation_row(iso);
  const int sensors = 1 + (AMB_OF_FORCE * iso->forces);
  const int forms = sensors + (AMB_OF_SENSOR * iso->sensors);
  const int tones = forms + iso->forms;
  const amb_real *before =
      (state->filled > 0) ? (state->ring + (state->newest * size) + tones) : NULL;
  state->newest = (state->newest + 1) % rows;
  amb_real *row = state->ring + (state->newest * size);
  amb_real *measured = row + tones + (2 * iso->tones);
  row[0] = AMB_C(1.0);
  put_forces(iso, state, kf, magnet, filter->last_u, row + 1);
  put_measurements(iso, state, filter, result, row + sensors, measured);
  put_gains(iso, kf, filter, result, measured + (2 * iso->sensors));
  const bool afresh = (result->status & (AMB_RESTARTED | AMB_BAD_VARIANCE)) != 0U;
  const bool on_stop = is_on_stop(iso, kf, filter);
  const int apart = state->contact + ((state->contact < free_of(iso)) ? 1 : 0);
  state->contact = on_stop ? 0 : apart;
  row[size - 1] = afresh ? AMB_C(1.0) : AMB_C(0.0);
  for (int k = 0; k < iso->forms; k++) {
    row[forms + k] = dot(n, iso->form + (k * n), mean);
  }
  put_tones(iso, before, faster, row + tones);
  amb_copy(n, mean, state->mean);
  state->count++;
  if (state->seen < AMB_ISOLATION_LEAST) {
    state->seen++; /* signals of the past are none yet */
    state->filled = 1;
  } else {
    state->filled = (state->filled < rows) ? (state->filled + 1) : rows;
  }
}

/* What each fault does along a direction in a sample. */
static void regress(const amb_isolation *iso, const amb_real *row, int direction, amb_real rho[])
{
  amb_clear(iso->columns, rho);
  for (int k = 0; k < iso->terms; k++) {
    const amb_fault_term *term = &iso->term[k];
    if ((int)term->direction == direction) {
      rho[term->column] += term->weight * row[term->signal];
    }
  }
}

/* M += a rho rho' + rho y' + y rho', g += s rho. */
static void learn(const amb_isolation *iso, sweep *w, amb_real a, amb_real s)
{
  const int c = iso->columns;
  for (int j = 0; j < c; j++) {
    w->g[j] += s * w->rho[j];
    const int last = w->crossed ? (c - 1) : ((j + 1 < c) ? (j + 1) : j);
    for (int l = j; l <= last; l++) {
      w->M[(j * c) + l] +=
          (a * w->rho[j] * w->rho[l]) + (w->rho[j] * w->y[l]) + (w->y[j] * w->rho[l]);
    }
  }
}

/* Back before the measurements of a sample. */
static void back_over_update(const amb_isolation *iso, const amb_real *row, sweep *w)
{
  const int n = iso->states;
  const int m = iso->sensors;
  const amb_real *measured = row + amb_isolation_row(iso) - 1 - (m * (2 + n));
  for (int r = m - 1; r >= 0; r--) {
    const amb_real *H = iso->H + (r * n);
    const amb_real S = measured[(2 * r) + 1];
    if (S > AMB_C(0.0)) { /* measured */
      const amb_real *K = measured + (2 * m) + (r * n);
      w->energy += measured[2 * r] * measured[2 * r] / S;
      for (int i = 0; i < n; i++) {
        w->t[i] = dot(n, w->Z + (i * n), K);
      }
      const amb_real s = (measured[2 * r] / S) - dot(n, K, w->z);
      const amb_real weight = (AMB_C(1.0) / S) + dot(n, K, w->t);
      regress(iso, row, iso->forces + r, w->rho);
      for (int j = 0; j < iso->columns; j++) {
        w->y[j] = -dot(n, K, w->Y + (j * n));
      }
      learn(iso, w, weight, s);
      for (int j = 0; j < iso->columns; j++) {
        const amb_real along = (weight * w->rho[j]) + w->y[j];
        for (int i = 0; i < n; i++) {
          w->Y[(j * n) + i] += (H[i] * along) - (w->t[i] * w->rho[j]);
        }
      }
      for (int i = 0; i < n; i++) {
        w->z[i] += H[i] * s;
        for (int l = 0; l < n; l++) {
          w->Z[(i * n) + l] += (weight * H[i] * H[l]) - (w->t[i] * H[l]) - (H[i] * w->t[l]);
        }
      }
    }
  }
}

/* x <- A' x, by way of `room`. */
static void carry(int n, const amb_real *A, amb_real x[], amb_real room[])
{
  for (int l = 0; l < n; l++) {
    const amb_real *column = A + l;
    amb_real sum = AMB_C(0.0);
    for (int i = 0; i < n; i++) {
      sum += column[i * n] * x[i];
    }
    room[l] = sum;
  }
  amb_copy(n, room, x);
}

/* Back to the sample before, by the forces that acted in between. */
static void back_over_prediction(const amb_isolation *iso, const amb_real *row, sweep *w)
{
  const int n = iso->states;
  for (int f = 0; f < iso->forces; f++) {
    const amb_real *b = iso->b + (f * n);
    for (int i = 0; i < n; i++) {
      w->t[i] = dot(n, w->Z + (i * n), b);
    }
    regress(iso, row, f, w->rho);
    for (int j = 0; j < iso->columns; j++) {
      w->y[j] = dot(n, b, w->Y + (j * n));
    }
    learn(iso, w, dot(n, b, w->t), dot(n, b, w->z));
    for (int j = 0; j < iso->columns; j++) {
      for (int i = 0; i < n; i++) {
        w->Y[(j * n) + i] += w->t[i] * w->rho[j];
      }
    }
  }
  carry(n, iso->A, w->z, w->t);
  for (int j = 0; j < iso->columns; j++) {
    carry(n, iso->A, w->Y + (j * n), w->t);
  }
  for (int i = 0; i < n; i++) { /* Z is symmetric: rows of Z A */
    carry(n, iso->A, w->Z + (i * n), w->t);
  }
  for (int i = 0; i < n; i++) {
    for (int l = 0; l < n; l++) {
      w->AZ[(i * n) + l] = w->Z[(l * n) + i];
    }
  }
  for (int i = 0; i < n; i++) {
    carry(n, iso->A, w->AZ + (i * n), w->t);
  }
  for (int i = 0; i < n; i++) { /* what rounding makes unsymmetric would grow with the plant */
    for (int l = i; l < n; l++) {
      w->Z[(i * n) + l] = w->AZ[(i * n) + l];
      w->Z[(l * n) + i] = w->AZ[(i * n) + l];
    }
  }
}

/* Columns of which hardly anything is left are nothing but rounding. */
static void forget_rounding(const amb_isolation *iso, sweep *w)
{
  const int c = iso->columns;
  for (int j = 0; j < c; j++) {
    if (!(w->M[(j * c) + j] > (AMB_ROOT_EPSILON * w->diagonal[j]))) {
      w->g[j] = AMB_C(0.0);
      for (int l = 0; l < c; l++) {
        w->M[(j * c) + l] = AMB_C(0.0);
        w->M[(l * c) + j] = AMB_C(0.0);
      }
    }
  }
}

/* What is in the window but for an error of any size at its start: that is eliminated from g and M
 * by columns of Z, and those of Z that the samples do not show are none. Returns what that error
 * explains. */
static amb_real eliminate_start(const amb_isolation *iso, sweep *w)
{
  const int n = iso->states;
  const int c = iso->columns;
  amb_real explains = AMB_C(0.0);
  for (int j = 0; j < c; j++) {
    w->diagonal[j] = w->M[(j * c) + j];
  }
  for (int k = 0; k < n; k++) {
    w->t[k] = w->Z[(k * n) + k];
  }
  for (int k = 0; k < n; k++) {
    const amb_real pivot = w->Z[(k * n) + k];
    if (pivot > (AMB_ROOT_EPSILON * w->t[k])) {
      for (int j = 0; j < c; j++) {
        w->rho[j] = w->Y[(j * n) + k];
        w->y[j] = AMB_C(0.0);
      }
      explains += (w->z[k] * w->z[k]) / pivot;
      learn(iso, w, AMB_C(-1.0) / pivot, -w->z[k] / pivot);
      for (int i = k + 1; i < n; i++) {
        const amb_real share = w->Z[(k * n) + i] / pivot;
        for (int l = k + 1; l < n; l++) {
          w->Z[(i * n) + l] -= share * w->Z[(k * n) + l];
        }
        for (int j = 0; j < c; j++) {
          w->Y[(j * n) + i] -= share * w->rho[j];
        }
        w->z[i] -= share * w->z[k];
      }
    }
  }
  forget_rounding(iso, w);
  return explains;
}

/* The filter started afresh: later samples know nothing of the error before. */
static void back_over_restart(const amb_isolation *iso, sweep *w)
{
  const int n = iso->states;
  (void)eliminate_start(iso, w);
  amb_clear(n, w->z);
  amb_clear(n * n, w->Z);
  amb_clear(iso->columns * n, w->Y);
}

/* Back over sample `ago` before the newest. */
static void back(const amb_isolation *iso, const amb_isolation_state *state, int newest, int ago,
                 sweep *w)
{
  const int rows = iso->window + iso->spare;
  const int place = (newest + rows - ago) % rows;
  const amb_real *row = state->ring + (place * amb_isolation_row(iso));
  if (row[amb_isolation_row(iso) - 1] > AMB_C(0.0)) {
    back_over_restart(iso, w);
  }
  back_over_update(iso, row, w);
  back_over_prediction(iso, row, w);
}

static amb_real entry(const amb_isolation *iso, const sweep *w, int j, int l)
{
  return (j <= l) ? w->M[(j * iso->columns) + l] : w->M[(l * iso->columns) + j];
}

/* l of some columns together; their sizes and variances where wanted. A column that is the same as
 * those before it explains nothing more. */
static amb_real explained(const amb_isolation *iso, const sweep *w, int count, const int column[],
                          amb_real size[], amb_real variance[])
{
  amb_real L[MOST_COLUMNS][MOST_COLUMNS]; /* unit lower triangle */
  amb_real D[MOST_COLUMNS];
  amb_real v[MOST_COLUMNS];
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < count; i++) {
    D[i] = entry(iso, w, column[i], column[i]);
    v[i] = w->g[column[i]];
    const amb_real own = SAME * D[i];
    for (int k = 0; k < i; k++) {
      amb_real m = entry(iso, w, column[i], column[k]);
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
      amb_real inverse[MOST_COLUMNS]; /* row i of L' to the minus one */
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

/* Columns of one fault, or of two. */
static int columns_of(const amb_isolation *iso, int j, int l, int column[MOST_COLUMNS])
{
  int count = 0;
  for (int k = 0; k < (int)iso->fault[j].columns; k++) {
    column[count] = (int)iso->fault[j].column + k;
    count++;
  }
  for (int k = 0; (l >= 0) && (k < (int)iso->fault[l].columns); k++) {
    column[count] = (int)iso->fault[l].column + k;
    count++;
  }
  return count;
}

static amb_real likelihood(const amb_isolation *iso, const sweep *w, int j, int l)
{
  int column[MOST_COLUMNS];
  return explained(iso, w, columns_of(iso, j, l, column), column, NULL, NULL);
}

/* Keep the best likelihood of each fault. */
static void keep_best(const amb_isolation *iso, const sweep *w, int since, bool before,
                      amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    const amb_real l = likelihood(iso, w, j, -1);
    if (l > result[j].likelihood) {
      result[j].likelihood = l;
      result[j].since = since;
      result[j].before = before;
    }
  }
}

static int samples_in(const amb_isolation *iso, const amb_isolation_state *state)
{
  const int filled = state->filled - 1; /* the first has no past */
  return (filled < iso->window) ? filled : iso->window;
}

/* The sweep to where a fault began, with all of M. */
static sweep to_begin(const amb_isolation *iso, const amb_isolation_state *state, int newest,
                      int since, bool before)
{
  sweep w = begin(iso, state, true);
  for (int ago = 0; ago < since; ago++) {
    back(iso, state, newest, ago, &w);
  }
  if (before) {
    (void)eliminate_start(iso, &w);
  }
  return w;
}

static void write_sizes(const amb_isolation *iso, const sweep *w, int j, int l,
                        amb_isolation_result result[])
{
  int column[MOST_COLUMNS];
  amb_real size[MOST_COLUMNS];
  amb_real variance[MOST_COLUMNS];
  const int count = columns_of(iso, j, l, column);
  (void)explained(iso, w, count, column, size, variance);
  for (int k = 0; k < count; k++) {
    const int own = (int)iso->fault[j].columns;
    amb_isolation_result *of = (k < own) ? &result[j] : &result[l];
    of->size[(k < own) ? k : (k - own)] = size[k];
    of->variance[(k < own) ? k : (k - own)] = variance[k];
  }
}

/* Whether two faults are of one group. */
static bool are_alike(const amb_isolation *iso, int j, int k)
{
  return (j != k) && (iso->fault[j].group > 0U) && (iso->fault[j].group == iso->fault[k].group);
}

/* The share of what a fault explains by which another one must differ from it. */
static amb_real share_of(const amb_isolation *iso, int j, int k)
{
  return are_alike(iso, j, k) ? iso->alike : iso->like;
}

/* Two faults, and what they explain together since so many samples. */
typedef struct pair {
  int of[2];
  int since;
  amb_real most;
  amb_real adds[2]; /* what each explains beside the other */
} pair;

static void keep_best_two(const amb_isolation *iso, const sweep *w, int since, pair *best)
{
  for (int j = 0; j < iso->faults; j++) {
    for (int l = j + 1; l < iso->faults; l++) {
      const amb_real both = likelihood(iso, w, j, l);
      if (both > best->most) {
        best->of[0] = j;
        best->of[1] = l;
        best->since = since;
        best->most = both;
      }
    }
  }
}

/* The likeliest two that began where one of them does by itself. */
static pair likeliest_two(const amb_isolation *iso, const amb_isolation_state *state, int newest,
                          int samples, const amb_isolation_result result[], bool before)
{
  pair best;
  best.of[0] = 0;
  best.of[1] = 0;
  best.since = samples;
  best.most = AMB_C(0.0);
  sweep w = begin(iso, state, true);
  for (int ago = 0; ago < samples; ago++) {
    bool begins = false;
    back(iso, state, newest, ago, &w);
    for (int j = 0; j < iso->faults; j++) {
      begins = begins || (result[j].since == (ago + 1));
    }
    if (begins && !before) {
      keep_best_two(iso, &w, ago + 1, &best);
    }
  }
  if (before) {
    (void)eliminate_start(iso, &w);
    keep_best_two(iso, &w, samples, &best);
  }
  for (int k = 0; k < 2; k++) {
    best.adds[k] = best.most - result[best.of[1 - k]].likelihood;
  }
  return best;
}

/* Whether no single fault explains nearly as much as two. */
static bool needs_two(const amb_isolation *iso, const amb_isolation_result result[],
                      const pair *two, amb_real limit)
{
  bool needed = !are_alike(iso, two->of[0], two->of[1]);
  for (int j = 0; j < iso->faults; j++) {
    amb_real least = amb_at_least(limit, AMB_C(2.0) * iso->like * two->most);
    for (int k = 0; k < 2; k++) {
      const bool alike = are_alike(iso, j, two->of[k]);
      least = alike ? amb_at_least(least, AMB_C(2.0) * iso->alike * two->adds[k]) : least;
    }
    needed = needed && ((two->most - result[j].likelihood) >= least);
  }
  return needed;
}

/* In whose place of the two a fault explains as much: beside the other, or beside any; -1: none. */
static int instead_of_two(const amb_isolation *iso, const sweep *w, int j, const pair *two,
                          amb_real least)
{
  const amb_real less = amb_at_most(two->adds[0], two->adds[1]);
  int place = -1;
  amb_real best = AMB_C(0.0);
  for (int k = 0; k < 2; k++) {
    const amb_real margin = amb_at_least(least, share_of(iso, j, two->of[k]) * two->adds[k]);
    const amb_real both = (j == two->of[k]) ? two->most : likelihood(iso, w, j, two->of[1 - k]);
    if ((both > best) && ((two->most - both) < margin)) {
      best = both;
      place = two->of[k];
    }
  }
  for (int l = 0; (place < 0) && (l < iso->faults); l++) {
    const amb_real left = two->most - likelihood(iso, w, j, l);
    place = ((l != j) && (left < amb_at_least(least, iso->like * less))) ? two->of[0] : -1;
  }
  return place;
}

static void name_two(const amb_isolation *iso, const sweep *w, const pair *two, amb_real least,
                     amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    result[j].instead = instead_of_two(iso, w, j, two, least);
  }
  for (int k = 0; k < 2; k++) {
    result[two->of[k]].since = two->since;
  }
  write_sizes(iso, w, two->of[0], two->of[1], result);
}

static void name_one(const amb_isolation *iso, const sweep *w, int first, amb_real least,
                     amb_isolation_result result[])
{
  const amb_real most = result[first].likelihood;
  for (int j = 0; j < iso->faults; j++) {
    const amb_real margin = amb_at_least(least, share_of(iso, j, first) * most);
    result[j].instead = ((most - result[j].likelihood) < margin) ? first : -1;
    write_sizes(iso, w, j, -1, result);
  }
}

static void name_none(const amb_isolation *iso, amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    amb_isolation_result *of = &result[j];
    of->likelihood = AMB_C(0.0);
    amb_clear(2, of->size);
    amb_clear(2, of->variance);
    of->since = 0;
    of->before = false;
    of->instead = -1;
  }
}

static int likeliest(const amb_isolation *iso, const amb_isolation_result result[])
{
  int first = 0;
  for (int j = 1; j < iso->faults; j++) {
    first = (result[j].likelihood > result[first].likelihood) ? j : first;
  }
  return first;
}

/* The scale of the innovations by what is left of them. */
static amb_real scale_of(const amb_isolation *iso, int samples, amb_real left)
{
  return amb_at_least(left / ((amb_real)samples * (amb_real)iso->sensors), AMB_C(1.0));
}

int amb_isolation_evaluate(const amb_isolation *iso, const amb_isolation_state *state,
                           amb_isolation_result result[])
{
  const int samples = samples_in(iso, state); /* first: more may come in between */
  const unsigned int count = state->count;
  const int newest = state->newest;
  name_none(iso, result);
  if ((samples < AMB_ISOLATION_LEAST) || (state->contact < free_of(iso))) {
    return 0;
  }
  sweep w = begin(iso, state, false);
  for (int ago = 0; ago < samples; ago++) {
    back(iso, state, newest, ago, &w);
    if ((ago + 1) >= AMB_ISOLATION_LEAST) {
      keep_best(iso, &w, ago + 1, false, result);
    }
  }
  const amb_real energy = w.energy;
  const amb_real start = eliminate_start(iso, &w);
  amb_real known = AMB_C(0.0);
  int first = likeliest(iso, result);
  if ((start - (amb_real)iso->states) > (result[first].likelihood - iso->margin)) {
    known = start; /* something before the window explains as much as what began in it */
    name_none(iso, result);
    keep_best(iso, &w, samples, true, result);
    first = likeliest(iso, result);
  }
  const amb_real most = result[first].likelihood;
  const amb_real unexplained = energy - known;
  amb_real scale = scale_of(iso, samples, unexplained - most);
  int named = 0;
  if (most >= (iso->limit * scale)) {
    const bool before = result[first].before;
    w = to_begin(iso, state, newest, result[first].since, before);
    name_one(iso, &w, first, iso->margin * scale, result);
    named = 1;
    pair two;
    two = likeliest_two(iso, state, newest, samples, result, before);
    const amb_real scale_of_two = scale_of(iso, samples, unexplained - two.most);
    if (needs_two(iso, result, &two, iso->limit * scale_of_two)) {
      w = to_begin(iso, state, newest, two.since, before);
      scale = scale_of_two;
      name_two(iso, &w, &two, iso->margin * scale, result);
      named = 2;
    }
  }
  for (int j = 0; j < iso->faults; j++) {
    result[j].likelihood /= scale;
    result[j].variance[0] *= scale;
    result[j].variance[1] *= scale;
  }
  if ((state->count - count) > (unsigned int)iso->spare) { /* what was read was written over */
    name_none(iso, result);
    named = -1;
  }
  return named;
}

void amb_isolation_information(const amb_isolation *iso, const amb_isolation_state *state,
                               int since, bool before, amb_real information[])
{
  const int samples = samples_in(iso, state);
  const sweep w = to_begin(iso, state, state->newest, (since < samples) ? since : samples, before);
  for (int j = 0; j < iso->columns; j++) {
    for (int l = 0; l < iso->columns; l++) {
      information[(j * iso->columns) + l] = entry(iso, &w, j, l);
    }
  }
}
