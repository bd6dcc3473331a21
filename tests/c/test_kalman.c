/* The filter: settings, starts, and each status with what it leaves behind. */
#include "ambkit/estimator_run.h"
#include "check.h"
#include "paper.h"
#include <string.h>

static const amb_law law = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_magnet closed = {&amb_law_magnet, &law};

static amb_kalman filter(void)
{
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &paper) == AMB_OK);
  return kf;
}

static amb_kalman_state start(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s;
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  return s;
}

static bool unchanged(const amb_kalman_state *a, const amb_kalman_state *b)
{
  return memcmp(a->mean, b->mean, sizeof a->mean) == 0 &&
         memcmp(a->cov, b->cov, sizeof a->cov) == 0;
}

static bool sound(const amb_kalman_state *s)
{
  return all_finite(s->mean, 4) && all_finite(s->cov, 10) && s->cov[0] > 0 && s->cov[4] > 0 &&
         s->cov[7] > 0 && s->cov[9] > 0;
}

/* A measurement that moves, so that it is not frozen. */
static amb_real wobble(int k)
{
  return (k % 2 == 0 ? AMB_C(1e-6) : AMB_C(-1e-6)) * (amb_real)(1 + k % 7);
}

static void test_settings(void)
{
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, 0, -1};
  amb_kalman kf = filter();
  const amb_kalman before = kf;
  amb_kalman_settings s = paper;
  amb_real *const positive[] = {&s.T, &s.m, &s.T_sen, &s.x_max, &s.var_y};
  for (size_t i = 0; i < sizeof positive / sizeof *positive; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *positive[i] = bad[j];
      CHECK(amb_kalman_init(&kf, &s) == AMB_BAD_PARAMETER);
    }
  }
  amb_real *const not_negative[] = {&s.var_u, &s.var_d};
  for (size_t i = 0; i < 2; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *not_negative[i] = bad[j];
      CHECK((amb_kalman_init(&kf, &s) == AMB_OK) == (j == 3));
    }
  }
  amb_real *const gains[] = {&s.K_sen, &s.k_ui};
  for (size_t i = 0; i < 2; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *gains[i] = bad[j];
      CHECK((amb_kalman_init(&kf, &s) == AMB_OK) == (j == 4));
    }
  }
  s = paper;
  s.iu_min = s.iu_max;
  CHECK(amb_kalman_init(&kf, &s) == AMB_BAD_PARAMETER);
  s = paper;
  s.f_0 = NOT_A_NUMBER;
  kf = before;
  CHECK(amb_kalman_init(&kf, &s) == AMB_BAD_PARAMETER);
  CHECK(same(kf.set.f_0, before.set.f_0) && same(kf.model.T_m, before.model.T_m));
}

static void test_start(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  const amb_kalman_state before = s;
  CHECK(same(s.cov[0], some[0] * some[0]) && same(s.cov[9], some[3] * some[3]));
  CHECK(same(s.cov[1], 0) && same(s.cov[8], 0));
  const amb_real lost[4] = {0, NOT_A_NUMBER, 0, 0}, certain[4] = {1, 1, 0, 1};
  const amb_real endless[4] = {1, 1, 1, TOO_MUCH};
  CHECK(amb_kalman_reset(&kf, &s, lost, some) == AMB_BAD_PARAMETER);
  CHECK(amb_kalman_reset(&kf, &s, at_rest, certain) == AMB_BAD_PARAMETER);
  CHECK(amb_kalman_reset(&kf, &s, at_rest, endless) == AMB_BAD_PARAMETER);
  CHECK(unchanged(&s, &before));
}

static void test_predict_is_eq_9_and_10(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  s.mean[0] = AMB_C(1e-4);
  s.mean[1] = AMB_C(0.02);
  s.mean[2] = 2;
  CHECK(amb_kalman_predict(&kf, &s, centre, AMB_C(0.5)) == AMB_OK);
  /* At the mean displacement, 0.101 mm; the lag follows position, speed and acceleration. */
  const amb_real f = AMB_C(10.05) * AMB_C(0.5) + AMB_C(0.7612875) - AMB_C(5.08158) + 2;
  CHECK_NEAR(s.mean[0], AMB_C(1.02e-4) + AMB_C(5e-9) / AMB_C(0.518) * f);
  CHECK_NEAR(s.mean[1], AMB_C(0.02) + AMB_C(1e-4) / AMB_C(0.518) * f);
  CHECK(same(s.mean[2], 2));
  CHECK_NEAR(s.mean[3], AMB_C(0.8) * (AMB_C(1e-4) * AMB_C(0.39346934028736657640) +
                                      AMB_C(0.02) * AMB_C(2.13061319425266847e-5) +
                                      f / AMB_C(0.518) * AMB_C(7.38773611494663e-10)));
  CHECK_NEAR(s.cov[7], 25 + AMB_C(1e-2));
  CHECK(sound(&s));
}

static void test_as_printed_the_sensor_follows_the_position_alone(void)
{
  amb_kalman_settings set = paper;
  set.as_printed = true;
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &set) == AMB_OK);
  amb_kalman_state s = start();
  s.mean[0] = AMB_C(1e-4);
  s.mean[1] = AMB_C(0.02);
  CHECK(amb_kalman_predict(&kf, &s, centre, AMB_C(0.5)) == AMB_OK);
  const amb_real f = AMB_C(10.05) * AMB_C(0.5) + AMB_C(0.75375) - AMB_C(5.08158);
  CHECK_NEAR(s.mean[1], AMB_C(0.02) + AMB_C(1e-4) / AMB_C(0.518) * f);
  CHECK_NEAR(s.mean[3], AMB_C(0.8) * AMB_C(1e-4) * AMB_C(0.39346934028736657640));
  CHECK(sound(&s));
}

static void test_update_is_eq_11_to_13(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  amb_kalman_result r = {0, 0, {0, 0}, AMB_OK};
  CHECK(amb_kalman_update(&kf, &s, AMB_C(1e-5), &r) == AMB_OK);
  const amb_real S = AMB_C(9e-10) + AMB_C(8.3e-11);
  CHECK(same(r.innovation, AMB_C(1e-5)));
  CHECK_NEAR(r.variance, S);
  CHECK_NEAR(s.mean[3], AMB_C(9e-10) / S * AMB_C(1e-5));
  CHECK_WITHIN(s.cov[9], AMB_C(9e-10) * AMB_C(8.3e-11) / S, 20 * DIGITS);
  CHECK(same(s.mean[0], 0) && same(s.cov[0], some[0] * some[0])); /* not correlated yet */
}

static void test_measurements_that_are_none(void)
{
  const amb_kalman kf = filter();
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, AMB_C(8.1e-3), AMB_C(-8.1e-3)};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    amb_kalman_state s = start();
    const amb_kalman_state before = s;
    amb_kalman_result r = {9, 9, {0, 0}, AMB_OK};
    CHECK(amb_kalman_update(&kf, &s, bad[i], &r) == AMB_MISSING);
    CHECK(unchanged(&s, &before) && same(r.innovation, 0) && r.variance > 0);
  }
  amb_kalman_state s = start();
  amb_kalman_result r;
  for (int k = 0; k < 30; k++)
    CHECK(amb_kalman_update(&kf, &s, AMB_C(1e-5), &r) == (k < 10 ? AMB_OK : AMB_FROZEN));
  CHECK(amb_kalman_update(&kf, &s, AMB_C(1.1e-5), &r) == AMB_OK);
}

static void test_control_signals_that_are_none(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  amb_status status = AMB_OK;
  CHECK(same(amb_kalman_current(&kf, &s, AMB_C(0.4), &status), AMB_C(0.5)) && status == AMB_OK);
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    status = AMB_OK;
    CHECK(same(amb_kalman_current(&kf, &s, bad[i], &status), AMB_C(0.5)));
    CHECK(status == AMB_BAD_CONTROL);
  }
  status = AMB_FROZEN; /* added to, not overwritten */
  CHECK(same(amb_kalman_current(&kf, &s, AMB_REAL_MAX, &status), AMB_C(1.5)));
  CHECK(status == (AMB_FROZEN | AMB_SATURATED));
  status = AMB_OK;
  CHECK(same(amb_kalman_current(&kf, &s, NOT_A_NUMBER, &status), AMB_C(1.5)));
  CHECK(status == (AMB_BAD_CONTROL | AMB_SATURATED));
}

static void test_stiffnesses_that_are_none(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  const amb_kalman_state before = s;
  const amb_stiffness bad[] = {{NOT_A_NUMBER, 1}, {1, NOT_A_NUMBER}, {TOO_MUCH, 1}, {1, TOO_MUCH}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    CHECK(amb_kalman_predict(&kf, &s, bad[i], 0) == AMB_BAD_PARAMETER && unchanged(&s, &before));
  /* In the gap the law has its pole: it is asked at the stop. */
  const amb_stiffness k = amb_kalman_stiffness(&kf, &closed, AMB_C(0.5), law.s0);
  const amb_stiffness stop = amb_law_magnet.through_origin(&law, AMB_C(0.5), paper.x_max);
  CHECK(same(k.k_i, stop.k_i) && same(k.k_s, stop.k_s));
}

static void test_a_long_outage(const amb_magnet *magnet, amb_real var_y)
{
  amb_kalman_settings set = paper;
  set.var_y = var_y;
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &set) == AMB_OK);
  amb_kalman_state s = start();
  amb_kalman_result r;
  amb_status last = AMB_OK;
  const amb_real shaken = (var_y < AMB_C(1e-12)) ? AMB_C(0.01) : 1;
  for (int k = 0; k < 50000; k++)
    last = amb_kalman_step(&kf, magnet, &s, NOT_A_NUMBER, AMB_C(0.4), &r);
  CHECK(last == (AMB_MISSING | AMB_HELD));
  CHECK(sound(&s) && same(s.cov[0], set.x_max * set.x_max) && same(s.mean[0], 0));
  for (int k = 0; k < 1000; k++) {
    last = amb_kalman_step(&kf, magnet, &s, shaken * wobble(k), AMB_C(0.4045), &r);
    CHECK(sound(&s));
  }
  CHECK((last & ~(AMB_SURPRISED | AMB_OUTLIER | AMB_RESTARTED)) ==
        AMB_OK); /* the record is none of this plant */
  CHECK(s.mean[0] < AMB_C(1e-4) && s.mean[0] > AMB_C(-1e-4));
}

static void test_a_covariance_that_is_lost(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state s = start();
  amb_kalman_result r;
  s.cov[3] = s.cov[0] * 2; /* x and x_m correlated by two: no covariance has that */
  CHECK(amb_kalman_update(&kf, &s, AMB_C(1e-5), &r) == AMB_BAD_VARIANCE);
  CHECK(sound(&s) && same(s.cov[3], 0) && same(s.cov[0], some[0] * some[0]));
  s.cov[9] = -1;
  CHECK(amb_kalman_update(&kf, &s, AMB_C(2e-5), &r) == AMB_BAD_VARIANCE);
  CHECK(sound(&s) && same(s.cov[9], 1));
}

static void test_a_step_is_its_parts(void)
{
  const amb_kalman kf = filter();
  amb_kalman_state whole = start(), parts = start();
  amb_kalman_result r, q = {0, 0, {0, 0}, AMB_OK};
  for (int k = 0; k < 100; k++) {
    const amb_real y = wobble(k), u = AMB_C(0.4) + 1000 * wobble(k + 3);
    CHECK(amb_kalman_step(&kf, &closed, &whole, y, u, &r) == AMB_OK);
    amb_status status = AMB_OK;
    const amb_real iu = amb_kalman_current(&kf, &parts, u, &status);
    const amb_real s = amb_axial_displacement(&kf.model, parts.mean);
    const amb_stiffness stiffness = amb_kalman_stiffness(&kf, &closed, iu, s);
    CHECK(amb_kalman_predict(&kf, &parts, stiffness, iu) == AMB_OK);
    CHECK(amb_kalman_update(&kf, &parts, y, &q) == AMB_OK && status == AMB_OK);
    CHECK(unchanged(&whole, &parts) && same(r.stiffness.k_s, stiffness.k_s));
  }
}

static void test_forecast(void)
{
  const amb_kalman kf = filter();
  const amb_estimator estimator = {&amb_kalman_methods, &kf, &linear, NULL};
  const amb_real mean[4] = {AMB_C(1e-4), AMB_C(0.02), 1, AMB_C(7e-5)};
  const amb_real u[3] = {AMB_C(0.4), 100, AMB_C(0.3)};
  CHECK(same(amb_estimator_forecast(&estimator, 1, mean, NULL, 0), mean[3]));
  amb_kalman_state s = start();
  memcpy(s.mean, mean, sizeof mean);
  for (int k = 0; k < 3; k++) {
    amb_status status = AMB_OK;
    const amb_real iu = amb_kalman_current(&kf, &s, u[k], &status);
    (void)amb_kalman_predict(&kf, &s, centre, iu);
  }
  CHECK(same(amb_estimator_forecast(&estimator, 1, mean, u, 3), s.mean[3]));
}

#define N 200

static void test_run(void)
{
  const amb_kalman kf = filter();
  static amb_real y[N], u[N], k_i[N], k_s[N];
  static amb_real mean[4 * N], cov[10 * N], innovation[N], variance[N], out_i[N], out_s[N];
  static unsigned short status[N];
  for (int k = 0; k < N; k++) {
    y[k] = wobble(k);
    u[k] = AMB_C(0.4) + 1000 * wobble(k + 3);
    k_i[k] = 10 + (amb_real)(k % 3);
    k_s[k] = 7000 + 100 * (amb_real)(k % 5);
  }
  y[50] = NOT_A_NUMBER;
  u[60] = TOO_MUCH;
  u[70] = 9;
  amb_kalman_input in = {N, y, u, NULL, NULL};
  amb_kalman_history h = {mean, cov, innovation, variance, out_i, out_s, NULL, NULL, status};
  amb_kalman_state s = start();
  CHECK(amb_kalman_run(&kf, &closed, &s, &in, &h) ==
        (AMB_MISSING | AMB_BAD_CONTROL | AMB_SATURATED));
  CHECK(status[50] == AMB_MISSING && status[61] == AMB_BAD_CONTROL && status[71] == AMB_SATURATED);

  amb_kalman_state steps = start();
  amb_kalman_result r;
  for (size_t k = 0; k < N; k++) {
    if (k > 0)
      (void)amb_kalman_step(&kf, &closed, &steps, y[k], u[k - 1], &r);
    else
      (void)amb_kalman_update(&kf, &steps, y[0], &r);
    CHECK(memcmp(mean + 4 * k, steps.mean, sizeof steps.mean) == 0);
    CHECK(memcmp(cov + 10 * k, steps.cov, sizeof steps.cov) == 0);
  }
  CHECK(unchanged(&s, &steps));
  amb_kalman_note(&steps, &r, 0, &h);
  CHECK(same(mean[3], steps.mean[3]) && same(cov[9], steps.cov[9]) &&
        same(out_s[0], r.stiffness.k_s));

  in.n = 0;
  h.cov = NULL;
  s = start();
  const amb_kalman_state before = s;
  mean[0] = AMB_C(0.125);
  CHECK(amb_kalman_run(&kf, &closed, &s, &in, &h) == AMB_OK);
  CHECK(unchanged(&s, &before) && same(mean[0], AMB_C(0.125)));
  in.n = 1;
  CHECK(amb_kalman_run(&kf, &closed, &s, &in, &h) == AMB_OK && same(innovation[0], y[0]));
  in = (amb_kalman_input){N, y, u, k_i, k_s};
  s = start();
  k_s[80] = NOT_A_NUMBER;
  CHECK((amb_kalman_run(&kf, NULL, &s, &in, &h) & AMB_BAD_PARAMETER) && sound(&s));
  CHECK(status[81] == AMB_BAD_PARAMETER && same(out_i[1], k_i[0]) && same(out_s[9], k_s[8]));
}

int main(void)
{
  test_settings();
  test_start();
  test_predict_is_eq_9_and_10();
  test_as_printed_the_sensor_follows_the_position_alone();
  test_update_is_eq_11_to_13();
  test_measurements_that_are_none();
  test_control_signals_that_are_none();
  test_stiffnesses_that_are_none();
  test_a_long_outage(&linear, paper.var_y);
  test_a_long_outage(&closed, paper.var_y);
  test_a_long_outage(&closed, AMB_C(1e-16));
  test_a_covariance_that_is_lost();
  test_a_step_is_its_parts();
  test_forecast();
  test_run();
  return failures;
}
