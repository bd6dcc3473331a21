/* A plan over one sample: closed forms, doubled time, and what is not finite. In double whatever
 * the build. */
#include "ambkit/sampling.h"
#include "check.h"

#define N 3

static bool near(double a, double b)
{
  return fabs(a - b) <= 1e-14 * fabs(b);
}

/* A mass and its lagged position: x' = v, x_m' = (x - x_m) / lag. */
static const double A[N * N] = {0, 1, 0, 0, 0, 0, 5e3, 0, -5e3};

static void test_transition(void)
{
  double Phi[N * N], half[N * N], work[AMB_SAMPLING_WORK(N)];
  const double T = 1e-4, z = 0.5;
  CHECK(amb_transition(N, A, T, Phi, work));
  CHECK(near(Phi[1], T) && near(Phi[8], exp(-z)) && near(Phi[6], -expm1(-z)));
  CHECK(near(Phi[7], T * (1.0 + expm1(-z) / z)));
  CHECK(!(Phi[0] < 1.0) && !(Phi[0] > 1.0) && !(Phi[2] < 0.0) && !(Phi[2] > 0.0));
  CHECK(amb_transition(N, A, 0.5 * T, half, work));
  double twice = 0.0;
  for (int k = 0; k < N; k++)
    twice += half[2 * N + k] * half[k * N + 1];
  CHECK(near(twice, Phi[7]));
  /* A sensor far faster than a sample follows; a slow one hardly moves. */
  CHECK(amb_transition(N, A, 1.0, Phi, work));
  CHECK(near(Phi[6], 1.0) && near(Phi[7], 1.0 - 2e-4));
}

static void test_noise(void)
{
  double many[2 * N * N], work[AMB_SAMPLING_WORK(N)];
  const double T = 1e-4, intensity[2 * N] = {0, 3, 0, 0, 0, 2};
  CHECK(amb_process_noise(N, A, T, 2, intensity, many, work));
  CHECK(near(many[0], T * T * T) && near(many[4], 3 * T) && near(many[1], 1.5 * T * T));
  CHECK(near(many[17], -2.0 * expm1(-1e4 * T) / 1e4));
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++)
      CHECK(!(many[i * N + j] < many[j * N + i]));
}

static void test_what_is_not_finite(void)
{
  double bad[N * N] = {0}, Phi[N * N] = {7}, work[AMB_SAMPLING_WORK(N)];
  for (int k = 0; k < 2; k++) {
    bad[4] = k == 0 ? HUGE_VAL : (double)NAN;
    CHECK(!amb_transition(N, bad, 1e-4, Phi, work) && !(Phi[0] < 7.0) && !(Phi[0] > 7.0));
    CHECK(!amb_process_noise(N, bad, 1e-4, 1, bad, Phi, work));
  }
}

/* A mass of 2 kg, its demand 1.25 samples late. */
static void test_plan(void)
{
  static const unsigned short row[] = {0, 1, 6, 7}, column[] = {1, 4, 0, 5}, past[] = {2, 3};
  static const unsigned char use[] = {3, 3, 3, 3};
  static const double intensity[4] = {0, 1, 0, 0}, held[] = {0};
  const double T = 1e-3, value[] = {1.0, 0.5, 1.0 / T, 1.0 / T};
  const amb_late late = {0, 2, past, 0.25};
  amb_plan plan = {T, 4, 1, 1, 1, 4, row, column, use, value, held, 1, &late, intensity};
  enum { ORDER = 4 + 3 + 1 };
  double Phi[ORDER * ORDER], spread[16], work[AMB_SAMPLING_WORK(ORDER) + 2 * ORDER * ORDER];
  CHECK(AMB_PLAN_SIZE(&plan) == ORDER);
  CHECK(amb_plan_sampled(&plan, Phi, spread, work));
  CHECK(near(Phi[ORDER * 0 + 4], T * T / 4) && near(Phi[ORDER * 1 + 4], T / 2));
  CHECK(near(Phi[ORDER * 7 + 3], 0.25) && near(Phi[ORDER * 7 + 2], 0.75)); /* mean current */
  CHECK(near(Phi[ORDER * 6 + 1], T / 2));                                  /* mean displacement */
  CHECK(near(Phi[ORDER * 2 + 5], 1) && near(Phi[ORDER * 3 + 2], 1));       /* demands move on */
  CHECK(near(spread[5], T) && near(spread[0], T * T * T / 3));
  plan.T = (double)NAN;
  CHECK(!amb_plan_sampled(&plan, Phi, spread, work));
}

int main(void)
{
  test_transition();
  test_noise();
  test_what_is_not_finite();
  test_plan();
  return failures;
}
