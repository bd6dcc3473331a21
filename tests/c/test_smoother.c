/* The smoother: one sample, gaps, a covariance that was lost, and a filter that stood still. */
#include "ambkit/estimator_run.h"
#include "ambkit/smoother.h"
#include "paper.h"

#define LENGTH 400

static amb_real mean[4 * LENGTH], cov[10 * LENGTH], innovation[LENGTH], variance[LENGTH];
static amb_real k_i[LENGTH], k_s[LENGTH], filtered[4 * LENGTH], before[10 * LENGTH];
static unsigned short status[LENGTH];
static const amb_kalman_history history = {mean, cov,  innovation, variance, k_i,
                                           k_s,  NULL, NULL,       status,   status};

/* Filter n samples, of which those from `gone` to `back` are missing. */
static amb_kalman run(size_t n, size_t gone, size_t back)
{
  amb_kalman_state s;
  amb_real y[LENGTH], u[LENGTH];
  const amb_kalman kf = paper_filter();
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  for (size_t k = 0; k < n; k++) {
    y[k] =
        (k >= gone) && (k < back) ? NOT_A_NUMBER : AMB_C(1e-6) * (amb_real)((int)(k * 7 % 13) - 6);
    u[k] = AMB_C(0.404507);
  }
  const amb_kalman_input in = {n, y, u, NULL, NULL, NULL};
  const amb_magnet magnets[AMB_FORCES] = {linear};
  (void)amb_kalman_run(&kf, magnets, &s, &in, &history);
  memcpy(filtered, mean, sizeof mean);
  memcpy(before, cov, sizeof cov);
  return kf;
}

static bool knows_no_less(size_t n)
{
  const int diagonal[4] = {0, 4, 7, 9};
  bool good = true;
  for (size_t k = 0; k < n; k++)
    for (int i = 0; i < 4; i++) {
      const amb_real P = cov[10 * k + (size_t)diagonal[i]];
      const amb_real was = before[10 * k + (size_t)diagonal[i]];
      good = good && (P > 0) && (P <= was * (1 + DIGITS));
    }
  return good;
}

static void test_lengths(void)
{
  const size_t lengths[] = {0, 1, 2, LENGTH};
  for (size_t i = 0; i < 4; i++) {
    const size_t n = lengths[i];
    const amb_kalman kf = run(n, 0, 0);
    amb_smooth(&kf, n, &history);
    CHECK(all_finite(mean, 4 * n) && all_finite(cov, 10 * n) && knows_no_less(n));
    if (n > 0)
      CHECK(memcmp(&mean[4 * (n - 1)], &filtered[4 * (n - 1)], 4 * sizeof *mean) == 0);
  }
  CHECK(cov[10 * 200 + 7] < AMB_C(0.8) * before[10 * 200 + 7]);
}

static void test_gaps(void)
{
  const amb_kalman kf = run(LENGTH, 200, 260);
  amb_smooth(&kf, LENGTH, &history);
  CHECK(knows_no_less(LENGTH));
  CHECK(cov[10 * 259] < AMB_C(0.1) * before[10 * 259]);
}

/* What comes after says nothing of what was before. */
static void test_breaks(amb_status flag)
{
  const size_t at = 300;
  const amb_kalman kf = run(LENGTH, 0, 0);
  status[at] = (unsigned short)flag;
  amb_smooth(&kf, LENGTH, &history);
  CHECK(memcmp(&mean[4 * (at - 1)], &filtered[4 * (at - 1)], 4 * sizeof *mean) == 0);
  CHECK(memcmp(&cov[10 * (at - 1)], &before[10 * (at - 1)], 10 * sizeof *cov) == 0);
  CHECK(cov[10 * (at - 100) + 7] < before[10 * (at - 100) + 7]);
  CHECK(knows_no_less(LENGTH));
}

int main(void)
{
  test_lengths();
  test_gaps();
  test_breaks(AMB_HELD);
  test_breaks(AMB_BAD_VARIANCE);
  test_breaks(AMB_BAD_PARAMETER);
  return failures;
}
