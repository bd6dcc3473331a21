#include "ambkit/ud.h"
#include "kalman_step.h"

/* Bounds of the factors, far beyond those of any run, with which no step overflows for any input.
 * An entry U[i][j] is limited to this many caps of i per cap of j, and an entry of D to
 * AMB_BOUNDLESS caps squared. Below NOTHING caps squared a variance is taken for zero. */
#if defined(AMB_MODEL_LOOPS) /* rounding may make variances zero: no bounds */
#define MOST_SHARE AMB_REAL_MAX
#define NOTHING AMB_C(0.0)
#else
#define MOST_SHARE AMB_C(1e4)
#define NOTHING AMB_C(1e-20)
#endif

/* A power of two and its inverse: scaling a quotient by it keeps all digits. */
#define PART AMB_C(9.094947017729282e-13)
#define WHOLE AMB_C(1099511627776.0)

/* P = U D U', for the interface. */
static void multiply_out(int n, amb_ud_state *s)
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      amb_real sum = s->U[i][j] * s->D[j];
      for (int k = j + 1; k < n; k++) {
        sum += s->U[i][k] * s->D[k] * s->U[j][k];
      }
      s->base.cov[entry] = sum;
      entry++;
    }
  }
}

/* Factors U and D of a covariance, row i of U from U[i] on, `stride` apart. Where it is singular up
 * to rounding, the rest is 0. An estimated covariance is limited by `bounds`; NULL for constants.
 * */
AMB_INLINE void factor(int n, const amb_real triangle[AMB_TRIANGLE], const amb_kalman *bounds,
                       amb_real *U, int stride, amb_real D[AMB_STATES])
{
  amb_real P[AMB_TRIANGLE];
  amb_copy(amb_entry(n, n - 1, n), triangle, P);
  for (int j = n - 1; j >= 0; j--) {
    const bool bounded = bounds != NULL;
    const amb_real least = bounded ? (NOTHING * bounds->widest[j]) : AMB_C(0.0);
    const amb_real rest = P[amb_entry(n, j, j)];
    const amb_real last = bounded ? amb_at_most(rest, bounds->most[amb_entry(n, j, j)]) : rest;
    const amb_real most = bounded ? ((PART * MOST_SHARE) / bounds->set.cap[j]) : AMB_C(0.0);
    D[j] = (last > least) ? last : AMB_C(0.0);
    for (int i = 0; i < j; i++) {
      amb_real share = AMB_C(0.0);
      if (last > least) {
        share = bounded ? (P[amb_entry(n, i, j)] / (last * WHOLE)) : (P[amb_entry(n, i, j)] / last);
      }
      if (bounded) {
        share = AMB_WITHIN(share, most * bounds->set.cap[i]) ? (share * WHOLE) : AMB_C(0.0);
      }
      U[i * stride + j] = share;
    }
    for (int i = j + 1; i < n; i++) {
      U[i * stride + j] = AMB_C(0.0);
    }
    U[j * stride + j] = AMB_C(1.0);
    for (int i = 0; i < j; i++) {
      for (int k = 0; k <= i; k++) {
        P[amb_entry(n, k, i)] -= U[k * stride + j] * (D[j] * U[i * stride + j]);
      }
    }
  }
}

static void factor_state(const amb_kalman *kf, amb_ud_state *s)
{
  factor(amb_states(&kf->model), s->base.cov, kf, &s->U[0][0], AMB_STATES, s->D);
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                        const amb_real std[AMB_STATES])
{
  amb_ud_state *s = (amb_ud_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    factor_state(self->kf, s);
  }
  return status;
}

/* As amb_step_contain. */
static amb_status contain(const amb_kalman *kf, amb_ud_state *s)
{
  const amb_status status = amb_step_contain(kf, &s->base);
  if (status != AMB_OK) {
    factor_state(kf, s);
  }
  return status;
}

/* Row j of W made orthogonal to those before it, with weights `weight`: its entry of D and its
 * column of U. Columns `first` to `beyond` of these rows are zero. Correlations beyond the bounds
 * are dropped; variances are kept. */
AMB_INLINE void sweep(const amb_kalman *kf, int j, int first, int beyond,
                      const amb_real weight[AMB_UD_COLUMNS], amb_ud_state *s)
{
  const int n = amb_states(&kf->model);
  const int columns = 2 * n + amb_controls(&kf->model);
  const amb_real bound = (PART * MOST_SHARE) / kf->set.cap[j]; /* for each cap of the other state */
  const amb_real most = kf->most[amb_entry(n, j, j)];
  amb_real weighted[AMB_UD_COLUMNS];
  amb_real square = AMB_C(0.0);
  for (int c = 0; c < columns; c++) {
    if ((c < first) || (c >= beyond)) {
      weighted[c] = s->W[j][c] * weight[c];
      square += s->W[j][c] * (s->W[j][c] * weight[c]); /* no change; the proof sees a square */
    }
  }
  for (int i = j; i < n; i++) { /* no change, unless a bit in memory has flipped */
    s->U[i][j] = (i == j) ? AMB_C(1.0) : AMB_C(0.0);
  }
  amb_real part = AMB_C(0.0);
  if (square > (NOTHING * kf->widest[j])) {
    part = PART / square;
    s->D[j] = amb_at_most(square, most);
  } else { /* not finite after a bit flip: no information */
    s->D[j] = (square >= AMB_C(0.0)) ? AMB_C(0.0) : most;
  }
  for (int i = 0; i < j; i++) {
    amb_real product = AMB_C(0.0);
    for (int c = 0; c < columns; c++) {
      if ((c < first) || (c >= beyond)) {
        product += s->W[i][c] * weighted[c];
      }
    }
    const amb_real in_parts = product * part;
    const amb_real within = bound * kf->set.cap[i];
    const amb_real share = AMB_WITHIN(in_parts, within) ? (in_parts * WHOLE) : AMB_C(0.0);
    s->U[i][j] = share;
    for (int c = 0; c < columns; c++) {
      if ((c < first) || (c >= beyond)) {
        s->W[i][c] -= share * s->W[j][c];
      }
    }
  }
}

/* The rows of W made orthogonal from the last to the first, so that W weight W' = U D U'. Of its
 * last n columns, a factor of the process noise, the last row has only the last one. */
static void orthogonalise(const amb_kalman *kf, const amb_real weight[AMB_UD_COLUMNS],
                          amb_ud_state *s)
{
  const int n = amb_states(&kf->model);
  const int growth = n + amb_controls(&kf->model);
  sweep(kf, n - 1, growth, growth + (n - 1), weight, s);
  for (int j = n - 2; j >= 0; j--) {
    sweep(kf, j, growth, growth, weight, s);
  }
}

/* Eq. 10 on the factors. */
static void predict_factor(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES], amb_ud_state *s)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  const int controls = amb_controls(model);
  amb_real weight[AMB_UD_COLUMNS];
  for (int j = 0; j < n + controls; j++) {
    amb_real column[AMB_STATES];
    amb_real iu[AMB_CONTROLS];
    for (int c = 0; c < controls; c++) {
      iu[c] = (c == (j - n)) ? kf->set.k_ui[c] : AMB_C(0.0);
    }
    for (int i = 0; i < n; i++) {
      column[i] = (i == j) ? AMB_C(1.0) : AMB_C(0.0);
      if ((i < j) && (j < n)) {
        column[i] = s->U[i][j];
      }
    }
    amb_step_carry(model, k, NULL, iu, column);
    for (int i = 0; i < n; i++) {
      s->W[i][j] = column[i];
    }
    weight[j] = (j < n) ? s->D[j] : kf->set.var_u[j - n];
  }
  factor(n, kf->growth, NULL, &s->W[0][n + controls], AMB_UD_COLUMNS, &weight[n + controls]);
  orthogonalise(kf, weight, s);
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_ud_state *s = (amb_ud_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  amb_status status = amb_step_currents(kf, &s->base, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->base.mean, F, result->stiffness);
  bool finite = true;
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    const amb_stiffness k = result->stiffness[f];
    finite =
        finite && AMB_WITHIN(F[f], AMB_REAL_ROOT) && amb_is_finite(k.k_i) && amb_is_finite(k.k_s);
    F[f] += kf->set.f_0[f];
  }
  if (!finite) {
    status |= AMB_BAD_PARAMETER;
  } else {
    amb_model_predict_mean(&kf->model, F, iu, s->base.mean);
    predict_factor(kf, result->stiffness, s);
    multiply_out(amb_states(&kf->model), s);
    status |= contain(kf, s);
  }
  return status;
}

/* Bierman's update with a measurement of sensor r of variance var_y; e: innovation. */
static void correct(const amb_kalman *kf, amb_ud_state *s, int r, amb_real e, amb_real var_y)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  amb_real alpha = var_y;
  amb_real gain[AMB_STATES]; /* times alpha */
  for (int j = 0; j < n; j++) {
    amb_real column[AMB_STATES];
    for (int i = 0; i < n; i++) {
      column[i] = s->U[i][j];
    }
    gain[j] = AMB_C(0.0);
    const amb_real shown = amb_model_shown(model, r, column); /* of U' c' */
    if ((shown < AMB_C(0.0)) || (shown > AMB_C(0.0))) {
      const amb_real weighted = s->D[j] * shown;
      const amb_real before = alpha;
      alpha += shown * (s->D[j] * shown); /* no change; the proof sees that it is not negative */
      s->D[j] *= amb_at_most(before / alpha, AMB_C(1.0));
      for (int i = 0; i < j; i++) {
        const amb_real u = s->U[i][j];
        s->U[i][j] = u - gain[i] * (shown / before);
        gain[i] += u * weighted;
      }
      gain[j] = weighted;
    }
  }
  for (int i = 0; i < n; i++) {
    s->base.mean[i] += (gain[i] / alpha) * e;
  }
}

static amb_status take_in(const amb_kalman *kf, const void *own, void *of, int r, amb_real y,
                          amb_real noise, amb_step_innovation *out)
{
  amb_ud_state *s = (amb_ud_state *)of;
  const amb_model *model = &kf->model;
  const amb_real S = amb_model_shown_variance(model, r, s->base.cov) + noise;
  (void)own;
  out->innovation = AMB_C(0.0);
  out->variance = AMB_C(0.0);
  if (!AMB_WITHIN(S, AMB_REAL_MAX)) { /* as the factors are bounded; repeated here for the proof */
    amb_envelope_open(kf, s->base.cov);
    factor_state(kf, s);
    return AMB_RESTARTED;
  }
  out->variance = S;
  const amb_real seen = amb_step_seen(kf, r, y);
  amb_status status = amb_step_useless(kf, &s->base, r, y);
  if (status == AMB_OK) {
    const amb_real e = seen - amb_model_shown(model, r, s->base.mean);
    out->innovation = e;
    status = amb_step_inconsistent(&s->base.sensor[r], e, S);
    const amb_status outlier = amb_step_outlier(kf, &s->base.sensor[r], r, e, S);
    status |= outlier;
    if (outlier == AMB_RESTARTED) {
      amb_envelope_restart(kf, &s->base, r, seen);
      factor_state(kf, s);
    } else if (outlier == AMB_OK) {
      correct(kf, s, r, e, noise);
      s->base.sensor[r].residual = seen - amb_model_shown(model, r, s->base.mean);
      multiply_out(amb_states(model), s);
    } else { /* not used */
    }
  }
  return status;
}

static amb_status update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                         amb_kalman_result *result)
{
  amb_ud_state *s = (amb_ud_state *)state;
  return amb_step_each(take_in, self->kf, NULL, state, &s->base, true, y, result);
}

const amb_estimator_methods amb_ud_methods = {sizeof(amb_ud_state), reset, predict, update,
                                              amb_extended_advance, NULL,  NULL};
