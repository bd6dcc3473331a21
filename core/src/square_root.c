#include "ambkit/square_root.h"
#include "kalman_step.h"

#define N AMB_AXIAL_STATES
#define NOISES                                                                                     \
  (1 + N) /* control signal; growth of the disturbance force, which reaches all states */
#define COLUMNS (N + NOISES)

/* P = U D U' for those who ask for it. */
static void multiply_out(amb_square_root_state *s)
{
  int entry = 0;
  for (int i = 0; i < N; i++) {
    for (int j = i; j < N; j++) {
      amb_real sum = s->U[i][j] * s->D[j];
      for (int k = j + 1; k < N; k++) {
        sum += s->U[i][k] * s->D[k] * s->U[j][k];
      }
      s->base.cov[entry] = sum;
      entry++;
    }
  }
}

/* The factor of the base's covariance after a start, where at most x and x_m are correlated. */
static void factor_start(amb_square_root_state *s)
{
  const amb_real *P = s->base.cov;
  for (int i = 0; i < N; i++) {
    for (int j = 0; j < N; j++) {
      s->U[i][j] = (i == j) ? AMB_C(1.0) : AMB_C(0.0);
    }
  }
  s->U[0][N - 1] = P[3] / P[9];
  s->D[0] = P[0] - s->U[0][N - 1] * P[3];
  s->D[1] = P[4];
  s->D[2] = P[7];
  s->D[3] = P[9];
}

static amb_status reset(const amb_estimator *self, void *state, const amb_real mean[N],
                        const amb_real std[N])
{
  amb_square_root_state *s = (amb_square_root_state *)state;
  const amb_status status = amb_kalman_reset(self->kf, &s->base, mean, std);
  if (status == AMB_OK) {
    factor_start(s);
  }
  return status;
}

/* As amb_step_contain. */
static amb_status contain(const amb_kalman *kf, amb_square_root_state *s)
{
  const amb_status status = amb_step_contain(kf, &s->base);
  if (status != AMB_OK) {
    factor_start(s);
  }
  return status;
}

/* Rows W under the weights `weight`, made orthogonal from the last to the first: W weight W' is
 * then U D U'. */
static void orthogonalise(amb_real W[N][COLUMNS], const amb_real weight[COLUMNS],
                          amb_square_root_state *s)
{
  for (int j = N - 1; j >= 0; j--) {
    amb_real weighted[COLUMNS];
    amb_real square = AMB_C(0.0);
    for (int c = 0; c < COLUMNS; c++) {
      weighted[c] = W[j][c] * weight[c];
      square += W[j][c] * weighted[c];
    }
    const amb_real inverse = (square > AMB_C(0.0)) ? (AMB_C(1.0) / square) : AMB_C(0.0);
    s->D[j] = square;
    for (int i = 0; i < j; i++) {
      amb_real product = AMB_C(0.0);
      for (int c = 0; c < COLUMNS; c++) {
        product += W[i][c] * weighted[c];
      }
      const amb_real share = product * inverse;
      s->U[i][j] = share;
      for (int c = 0; c < COLUMNS; c++) {
        W[i][c] -= share * W[j][c];
      }
    }
  }
}

/* What a growth of variance 1 leaves in the state, as columns `to` under the weights `weight`: the
 * factors U and D of its covariance. Where it is singular but for rounding, the rest is 0. */
static void factor_growth(const amb_axial_model *g, amb_real to[N][N], amb_real weight[N])
{
  amb_real P[N][N] = {{g->N00, g->N01, g->N02, g->N03},
                      {g->N01, g->N11, g->N12, g->N13},
                      {g->N02, g->N12, AMB_C(1.0), g->N23},
                      {g->N03, g->N13, g->N23, g->N33}};
  for (int j = N - 1; j >= 0; j--) {
    const bool there = P[j][j] > AMB_C(0.0);
    weight[j] = there ? P[j][j] : AMB_C(0.0);
    for (int i = 0; i < N; i++) {
      to[i][j] = there ? ((i < j) ? (P[i][j] / P[j][j]) : AMB_C(0.0)) : AMB_C(0.0);
    }
    to[j][j] = AMB_C(1.0);
    for (int i = 0; i < j; i++) {
      for (int k = 0; k <= i; k++) {
        P[k][i] -= to[k][j] * (weight[j] * to[i][j]);
        P[i][k] = P[k][i];
      }
    }
  }
}

/* Eq. 10 on the factor. */
static void predict_factor(const amb_kalman *kf, amb_stiffness k, amb_square_root_state *s)
{
  const amb_kalman_settings *set = &kf->set;
  const amb_real g = k.k_i * set->k_ui;
  amb_real W[N][COLUMNS];
  for (int j = 0; j < N; j++) {
    /* A column of A U is what the linear transition makes of a column of U. */
    amb_real column[N] = {s->U[0][j], s->U[1][j], s->U[2][j], s->U[3][j]};
    const amb_real f = k.k_s * amb_axial_displacement(&kf->model, column);
    amb_axial_predict_mean(&kf->model, f, column);
    for (int i = 0; i < N; i++) {
      W[i][j] = column[i];
    }
  }
  const amb_real pushed[N] = {g * kf->model.T2_2m, g * kf->model.T_m, AMB_C(0.0),
                              g * kf->model.d_sen};
  amb_real growth[N][N];
  amb_real weight[COLUMNS];
  factor_growth(&kf->model, growth, &weight[N + 1]);
  for (int i = 0; i < N; i++) {
    weight[i] = s->D[i];
    W[i][N] = pushed[i];
    for (int j = 0; j < N; j++) {
      W[i][N + 1 + j] = growth[i][j];
    }
    weight[N + 1 + i] *= set->var_d;
  }
  weight[N] = set->var_u;
  orthogonalise(W, weight, s);
}

static amb_status predict(const amb_estimator *self, void *state, amb_real u,
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_square_root_state *s = (amb_square_root_state *)state;
  amb_status status = AMB_OK;
  const amb_real iu = amb_step_current(kf, &s->base, u, &status);
  const amb_real at = amb_axial_displacement(&kf->model, s->base.mean);
  const amb_real f = amb_step_force(kf, self->magnet, iu, at, &result->stiffness);
  const amb_stiffness k = result->stiffness;
  if (!amb_is_finite(f) || !amb_is_finite(k.k_i) || !amb_is_finite(k.k_s)) {
    status |= AMB_BAD_PARAMETER;
  } else {
    amb_axial_predict_mean(&kf->model, f + kf->set.f_0, s->base.mean);
    predict_factor(kf, k, s);
    multiply_out(s);
    status |= contain(kf, s);
  }
  result->status = status;
  return status;
}

static amb_status update(const amb_estimator *self, void *state, amb_real y,
                         amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  amb_square_root_state *s = (amb_square_root_state *)state;
  const amb_real P33 = s->D[N - 1];
  const amb_real S = P33 + kf->set.var_y;
  result->innovation = AMB_C(0.0);
  result->variance = S;
  amb_status status = AMB_OK;
  if (!((y * y) <= kf->far_squared)) {
    status = AMB_MISSING;
  } else if (amb_step_frozen(kf, &s->base, y)) {
    status = AMB_FROZEN;
  } else {
    const amb_real e = y - s->base.mean[N - 1];
    result->innovation = e;
    status = amb_step_surprised(&s->base, e, S);
    const amb_status outlier = amb_step_outlier(kf, &s->base, e, S);
    status |= outlier;
    if (outlier == AMB_RESTARTED) {
      amb_envelope_restart(kf, &s->base, y);
      factor_start(s);
    } else if (outlier == AMB_OK) {
      /* The last row of U is that of the unit matrix, H U = H: Bierman's update leaves U alone. */
      const amb_real inverse = AMB_C(1.0) / S;
      for (int i = 0; i < N; i++) {
        s->base.mean[i] += s->U[i][N - 1] * (P33 * inverse) * e;
      }
      s->base.residual = y - s->base.mean[N - 1];
      s->D[N - 1] = P33 * (kf->set.var_y * inverse);
      multiply_out(s);
    } else { /* left out */
    }
  }
  result->status = status;
  return status;
}

static void advance(const amb_estimator *self, amb_real scale, amb_real iu, amb_real mean[N])
{
  amb_extended_methods.advance(self, scale, iu, mean);
}

const amb_estimator_methods amb_square_root_methods = {
    sizeof(amb_square_root_state), reset, predict, update, advance, NULL};
