#include "ambkit/smoother.h"
#include <string.h>

#define N AMB_AXIAL_STATES
#define BROKEN (AMB_HELD | AMB_RESTARTED | AMB_BAD_PARAMETER | AMB_BAD_VARIANCE)

/* What the samples after the present one say of it. */
typedef struct adjoint {
  amb_real lambda[N];
  amb_real Lambda[N][N];
} adjoint;

static void unfold(const amb_real triangle[AMB_AXIAL_TRIANGLE], amb_real P[N][N])
{
  int entry = 0;
  for (int i = 0; i < N; i++) {
    for (int j = i; j < N; j++) {
      P[i][j] = P[j][i] = triangle[entry];
      entry++;
    }
  }
}

/* C = A B, or with `transposed` A' B. */
static void multiply(amb_real A[N][N], amb_real B[N][N], bool transposed, amb_real C[N][N])
{
  for (int i = 0; i < N; i++) {
    for (int j = 0; j < N; j++) {
      C[i][j] = AMB_C(0.0);
      for (int k = 0; k < N; k++)
        C[i][j] += (transposed ? A[k][i] : A[i][k]) * B[k][j];
    }
  }
}

/* A of eq. 20: what the linear transition makes of the unit vectors. */
static void transition(const amb_kalman *kf, amb_real k_s, amb_real A[N][N])
{
  for (int j = 0; j < N; j++) {
    amb_real column[N] = {0};
    column[j] = AMB_C(1.0);
    const amb_real f = k_s * amb_axial_displacement(&kf->model, column);
    amb_axial_predict_mean(&kf->model, f, column);
    for (int i = 0; i < N; i++)
      A[i][j] = column[i];
  }
}

/* With which the filter took in sample k: the prediction's covariance with x_m, over S. The growth
 * of f_d has a small part in it; how large that was the filter's variances of f_d before and after
 * tell, P+ = P + var - K S K, and a filter that adapts it shows the same. `after`: the filter's P+.
 */
static void gain(const amb_kalman *kf, const amb_kalman_history *h, size_t k, amb_real after,
                 amb_real K[N])
{
  const amb_axial_model *g = &kf->model;
  const amb_real *before = h->cov + (k - 1) * AMB_AXIAL_TRIANGLE;
  const amb_real S = h->variance[k];
  const amb_real none[AMB_AXIAL_TRIANGLE] = {0};
  amb_real P[AMB_AXIAL_TRIANGLE];
  memcpy(P, before, sizeof P);
  amb_axial_predict_covariance(g, h->k_i[k], h->k_s[k], kf->set.k_ui, kf->set.var_u, none, P);
  const amb_real known[N] = {P[3], P[6], P[8], P[9]};
  const amb_real grown[N] = {g->N03, g->N13, g->N23, g->N33};
  amb_real var_d = 0;
  for (int pass = 0; pass < 4; pass++) { /* each is right to three digits more */
    for (int i = 0; i < N; i++)
      K[i] = (known[i] + grown[i] * var_d) / S;
    var_d = (after - before[7]) + K[2] * S * K[2];
  }
}

/* Back over the update with the innovation e of variance S; K: the gain. */
static void over_update(adjoint *a, const amb_real K[N], amb_real e, amb_real S)
{
  amb_real w[N]; /* Lambda K */
  amb_real q = AMB_C(0.0), p = AMB_C(0.0);
  for (int i = 0; i < N; i++) {
    w[i] = AMB_C(0.0);
    for (int j = 0; j < N; j++)
      w[i] += a->Lambda[i][j] * K[j];
    q += K[i] * w[i];
    p += K[i] * a->lambda[i];
  }
  const amb_real last = a->Lambda[N - 1][N - 1] - 2 * w[N - 1] + q + 1 / S;
  for (int i = 0; i < N; i++) {
    a->Lambda[i][N - 1] -= w[i];
    a->Lambda[N - 1][i] = a->Lambda[i][N - 1];
  }
  a->Lambda[N - 1][N - 1] = last;
  a->lambda[N - 1] -= p + e / S;
}

/* Back over the prediction. */
static void over_prediction(adjoint *a, amb_real A[N][N])
{
  amb_real B[N][N], before[N];
  multiply(A, a->Lambda, true, B); /* A' Lambda, and then that times A */
  for (int i = 0; i < N; i++) {
    before[i] = AMB_C(0.0);
    for (int j = 0; j < N; j++) {
      before[i] += A[j][i] * a->lambda[j];
      if (j >= i) {
        amb_real sum = AMB_C(0.0);
        for (int k = 0; k < N; k++)
          sum += B[i][k] * A[k][j];
        a->Lambda[i][j] = a->Lambda[j][i] = sum;
      }
    }
  }
  memcpy(a->lambda, before, sizeof before);
}

static void smooth_sample(adjoint *a, amb_real mean[N], amb_real cov[AMB_AXIAL_TRIANGLE])
{
  amb_real P[N][N], M[N][N];
  unfold(cov, P);
  multiply(P, a->Lambda, false, M);
  int entry = 0;
  for (int i = 0; i < N; i++) {
    for (int j = 0; j < N; j++) {
      mean[i] -= P[i][j] * a->lambda[j];
      if (j >= i) {
        for (int k = 0; k < N; k++)
          cov[entry] -= M[i][k] * P[k][j];
        entry++;
      }
    }
  }
}

void amb_smooth(const amb_kalman *kf, size_t n, const amb_kalman_history *h)
{
  adjoint a;
  memset(&a, 0, sizeof a);
  for (size_t k = n; k-- > 0;) {
    const amb_real after = h->cov[k * AMB_AXIAL_TRIANGLE + 7]; /* before it is smoothed */
    smooth_sample(&a, h->mean + k * N, h->cov + k * AMB_AXIAL_TRIANGLE);
    if ((k == 0) || ((h->status[k] & BROKEN) != 0U)) {
      memset(&a, 0, sizeof a);
      continue;
    }
    amb_real A[N][N];
    transition(kf, h->k_s[k], A);
    if ((h->status[k] & AMB_UNUSED) == 0U) {
      amb_real K[N];
      gain(kf, h, k, after, K);
      over_update(&a, K, h->innovation[k], h->variance[k]);
    }
    over_prediction(&a, A);
  }
}
