#include "ambkit/smoother.h"
#include "kalman_step.h"
#include <string.h>

#define N AMB_STATES
#define BROKEN (AMB_HELD | AMB_RESTARTED | AMB_BAD_PARAMETER | AMB_BAD_VARIANCE)

/* Information of later samples on the present one, and workspace. */
typedef struct adjoint {
  int n;
  amb_real lambda[N];
  amb_real Lambda[N][N];
  amb_real A[N][N];
  amb_real B[N][N];
  amb_real P[N][N];
  amb_real K[AMB_SENSORS][N]; /* gain of each sensor */
  bool used[AMB_SENSORS];
  amb_real triangle[AMB_TRIANGLE];
  amb_real work[AMB_WORK];
} adjoint;

static void forget(adjoint *a)
{
  memset(a->lambda, 0, sizeof a->lambda);
  memset(a->Lambda, 0, sizeof a->Lambda);
}

/* C = A B, or A' B if `transposed`. */
static void multiply(int n, amb_real A[N][N], amb_real B[N][N], bool transposed, amb_real C[N][N])
{
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      C[i][j] = AMB_C(0.0);
      for (int k = 0; k < n; k++)
        C[i][j] += (transposed ? A[k][i] : A[i][k]) * B[k][j];
    }
  }
}

/* A of eq. 20: the linear transition applied to the unit vectors. */
static void transition(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES], amb_real A[N][N])
{
  const amb_model *model = &kf->model;
  const amb_real none[AMB_CONTROLS] = {0};
  for (int j = 0; j < amb_states(model); j++) {
    amb_real column[N] = {0};
    column[j] = AMB_C(1.0);
    amb_step_carry(model, k, NULL, none, column);
    for (int i = 0; i < amb_states(model); i++)
      A[i][j] = column[i];
  }
}

/* Covariance of the prediction of sample k, without process noise. */
static void predict(adjoint *a, const amb_kalman *kf, const amb_kalman_history *h, size_t k,
                    const amb_stiffness stiffness[AMB_FORCES])
{
  static const amb_real none[AMB_TRIANGLE] = {0};
  const size_t entries = (size_t)(a->n * (a->n + 1) / 2);
  memcpy(a->triangle, h->cov + (k - 1) * entries, entries * sizeof *a->triangle);
  amb_model_predict_covariance(&kf->model, stiffness, kf->set.k_ui, kf->set.var_u, none,
                               a->triangle, a->work);
}

/* Gain with which the filter used sample k of its only sensor: covariance of the prediction with
 * the reading, over S. The process noise contributes a small part. Its size beyond the settings
 * follows from the variances of the first load before and after, P+ = P + growth - K S K, also for
 * a filter that adapts it. `after`: the filter's P+ of the load. */
static void gain_of_one(const adjoint *a, const amb_kalman *kf, int load, amb_real S,
                        amb_real after, amb_real K[N])
{
  const amb_model *model = &kf->model;
  const int entry = amb_entry(a->n, load, load);
  const amb_real before = a->triangle[entry], growth = kf->growth[entry];
  amb_real known[N], grown[N], share = 0;
  amb_model_shown_with(model, 0, a->triangle, known);
  amb_model_shown_with(model, 0, kf->growth, grown);
  for (int pass = 0; pass < 4; pass++) { /* each pass adds three correct digits */
    for (int i = 0; i < a->n; i++)
      K[i] = (known[i] + grown[i] * share) / S;
    share = (growth > 0) ? ((after - before) + K[load] * S * K[load]) / growth : 0;
  }
}

/* Gains of several sensors in sequence, or without a load; process noise as in the settings. */
static void gains_of_all(adjoint *a, const amb_kalman *kf, const amb_real S[AMB_SENSORS])
{
  const int n = a->n;
  amb_real *P = a->triangle;
  for (int i = 0; i < amb_entry(n, n - 1, n); i++)
    P[i] += kf->growth[i];
  for (int r = 0; r < amb_sensors(&kf->model); r++) {
    amb_real with_y[N];
    if (!a->used[r])
      continue;
    amb_model_shown_with(&kf->model, r, P, with_y);
    for (int i = 0; i < n; i++) {
      a->K[r][i] = with_y[i] / S[r];
      for (int j = i; j < n; j++)
        P[amb_entry(n, i, j)] -= a->K[r][i] * with_y[j];
    }
  }
}

/* Backward step over the update by sensor r with innovation e of variance S. */
static void over_update(adjoint *a, const amb_model *model, int r, amb_real e, amb_real S)
{
  const amb_real *K = a->K[r];
  amb_real w[N], H[N]; /* Lambda K; output row of the sensor */
  amb_real q = AMB_C(0.0), p = AMB_C(0.0);
  for (int i = 0; i < a->n; i++) {
    amb_real one[N] = {0};
    one[i] = AMB_C(1.0);
    H[i] = amb_model_shown(model, r, one);
    w[i] = AMB_C(0.0);
    for (int j = 0; j < a->n; j++)
      w[i] += a->Lambda[i][j] * K[j];
    q += K[i] * w[i];
    p += K[i] * a->lambda[i];
  }
  for (int i = 0; i < a->n; i++) {
    for (int j = 0; j < a->n; j++)
      a->Lambda[i][j] += (H[i] * H[j]) * (q + 1 / S) - (H[i] * w[j] + w[i] * H[j]);
    a->lambda[i] -= H[i] * (p + e / S);
  }
}

/* Backward step over the prediction. */
static void over_prediction(adjoint *a)
{
  amb_real before[N];
  multiply(a->n, a->A, a->Lambda, true, a->B); /* A' Lambda, then multiplied by A */
  for (int i = 0; i < a->n; i++) {
    before[i] = AMB_C(0.0);
    for (int j = 0; j < a->n; j++) {
      before[i] += a->A[j][i] * a->lambda[j];
      if (j >= i) {
        amb_real sum = AMB_C(0.0);
        for (int k = 0; k < a->n; k++)
          sum += a->B[i][k] * a->A[k][j];
        a->Lambda[i][j] = a->Lambda[j][i] = sum;
      }
    }
  }
  memcpy(a->lambda, before, sizeof before);
}

static void smooth_sample(adjoint *a, amb_real mean[N], amb_real cov[AMB_TRIANGLE])
{
  amb_unfold(a->n, cov, N, (amb_real *)a->P);
  multiply(a->n, a->P, a->Lambda, false, a->B);
  int entry = 0;
  for (int i = 0; i < a->n; i++) {
    for (int j = 0; j < a->n; j++) {
      mean[i] -= a->P[i][j] * a->lambda[j];
      if (j >= i) {
        for (int k = 0; k < a->n; k++)
          cov[entry] -= a->B[i][k] * a->P[k][j];
        entry++;
      }
    }
  }
}

/* Backward step over sample k; `after`: the filter's variance of the first load, before smoothing.
 * */
static void over_sample(adjoint *a, const amb_kalman *kf, const amb_kalman_history *h, size_t k,
                        int load, amb_real after)
{
  const amb_model *model = &kf->model;
  const size_t m = (size_t)amb_sensors(model);
  const amb_real *e = h->innovation + k * m, *S = h->variance + k * m;
  amb_stiffness stiffness[AMB_FORCES];
  bool any = false;
  amb_step_given(kf, h->k_i, h->k_s, k, stiffness);
  for (size_t r = 0; r < m; r++) {
    a->used[r] = (h->health[k * m + r] & AMB_UNUSED) == 0U;
    any = any || a->used[r];
  }
  transition(kf, stiffness, a->A);
  if (any) {
    predict(a, kf, h, k, stiffness);
    if ((m == 1) && (load >= 0))
      gain_of_one(a, kf, load, S[0], after, a->K[0]);
    else
      gains_of_all(a, kf, S);
    for (int r = (int)m - 1; r >= 0; r--)
      if (a->used[r])
        over_update(a, model, r, e[r], S[r]);
  }
  over_prediction(a);
}

void amb_smooth(const amb_kalman *kf, size_t n, const amb_kalman_history *h)
{
  const int states = amb_states(&kf->model);
  const size_t entries = (size_t)(states * (states + 1) / 2);
  const int load = amb_first(&kf->model, AMB_LOAD);
  adjoint a;
  a.n = states;
  forget(&a);
  for (size_t k = n; k-- > 0;) {
    amb_real *cov = h->cov + k * entries;
    /* before smoothing */
    const amb_real after = (load >= 0) ? cov[amb_entry(states, load, load)] : AMB_C(0.0);
    smooth_sample(&a, h->mean + k * (size_t)states, cov);
    if ((k == 0) || ((h->status[k] & BROKEN) != 0U))
      forget(&a);
    else
      over_sample(&a, kf, h, k, load, after);
  }
}
