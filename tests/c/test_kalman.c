/* The filter: settings, starts, and each status with what it leaves behind. */
#include "ambkit/estimator_run.h"
#include "paper.h"

static amb_status step(const amb_kalman *kf, const amb_magnet *magnet, amb_kalman_state *s,
                       amb_real y, amb_real u, amb_kalman_result *r)
{
  const amb_estimator e = {&amb_kalman_methods, kf, magnet, NULL};
  return axis_step(&e, s, y, u, r);
}

static amb_kalman_state start(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s;
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  return s;
}

static bool unchanged(const amb_kalman_state *a, const amb_kalman_state *b)
{
  return memcmp(a->mean, b->mean, AXIS_STATES * sizeof *a->mean) == 0 &&
         memcmp(a->cov, b->cov, AXIS_ENTRIES * sizeof *a->cov) == 0;
}

static void test_settings(void)
{
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, 0, -1};
  amb_kalman kf = paper_filter();
  const amb_kalman before = kf;
  amb_kalman_settings s = paper;
  amb_real *const positive[] = {&s.T,      &s.gate,   s.x_max,   s.travel, s.var_y,
                                &s.cap[0], &s.cap[1], &s.cap[2], &s.cap[3]};
  for (size_t i = 0; i < sizeof positive / sizeof *positive; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *positive[i] = bad[j];
      CHECK(paper_init(&kf, &s) == AMB_BAD_PARAMETER);
    }
  }
  amb_real *const not_negative[] = {s.var_u, s.var_d, s.lag};
  for (size_t i = 0; i < sizeof not_negative / sizeof *not_negative; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *not_negative[i] = bad[j];
      CHECK((paper_init(&kf, &s) == AMB_OK) == (j == 3));
    }
  }
  amb_real *const gains[] = {s.K_sen, s.k_ui};
  for (size_t i = 0; i < 2; i++) {
    for (size_t j = 0; j < sizeof bad / sizeof *bad; j++) {
      s = paper;
      *gains[i] = bad[j];
      CHECK((paper_init(&kf, &s) == AMB_OK) == (j == 4));
    }
  }
  s = paper;
  s.iu_min[0] = s.iu_max[0];
  CHECK(paper_init(&kf, &s) == AMB_BAD_PARAMETER);
  s = paper;
  s.f_0[0] = NOT_A_NUMBER;
  kf = before;
  CHECK(paper_init(&kf, &s) == AMB_BAD_PARAMETER);
  CHECK(memcmp(&kf, &before, sizeof kf) == 0);
}

static void test_start(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  const amb_kalman_state before = s;
  CHECK(same(s.cov[0], some[0] * some[0]) && same(s.cov[9], some[3] * some[3]));
  CHECK(same(s.cov[1], 0) && same(s.cov[8], 0));
  const amb_real lost[AMB_STATES] = {0, NOT_A_NUMBER, 0, 0}, certain[AMB_STATES] = {1, 1, 0, 1};
  const amb_real endless[AMB_STATES] = {1, 1, 1, TOO_MUCH};
  CHECK(amb_kalman_reset(&kf, &s, lost, some) == AMB_BAD_PARAMETER);
  CHECK(amb_kalman_reset(&kf, &s, at_rest, certain) == AMB_BAD_PARAMETER);
  CHECK(amb_kalman_reset(&kf, &s, at_rest, endless) == AMB_BAD_PARAMETER);
  CHECK(unchanged(&s, &before));
}

static void test_predict_is_eq_9_and_10(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  s.mean[0] = AMB_C(1e-4);
  s.mean[1] = AMB_C(0.02);
  s.mean[2] = 2;
  CHECK(axis_predict(&kf, &s, centre, AMB_C(0.5)) == AMB_OK);
  /* At the mean displacement, 0.101 mm; the lag follows position, speed and acceleration. */
  const amb_real f = AMB_C(10.05) * AMB_C(0.5) + AMB_C(0.7612875) - AMB_C(5.08158) + 2;
  CHECK_NEAR(s.mean[0], AMB_C(1.02e-4) + AMB_C(5e-9) / AMB_C(0.518) * f);
  CHECK_NEAR(s.mean[1], AMB_C(0.02) + AMB_C(1e-4) / AMB_C(0.518) * f);
  CHECK(same(s.mean[2], 2));
  CHECK_NEAR(s.mean[3], AMB_C(0.8) * (AMB_C(1e-4) * AMB_C(0.39346934028736657640) +
                                      AMB_C(0.02) * AMB_C(2.13061319425266847e-5) +
                                      f / AMB_C(0.518) * AMB_C(7.38773611494663e-10)));
  CHECK_NEAR(s.cov[7], 25 + AMB_C(1e-2));
  CHECK(axis_sound(&s));
}

static void test_as_printed_the_sensor_follows_the_position_alone(void)
{
  const amb_model model = axis_model(PAPER_T, PAPER_M, PAPER_K_SEN, PAPER_T_SEN, AXIS_AS_PRINTED);
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &model, &paper) == AMB_OK);
  amb_kalman_state s = start();
  s.mean[0] = AMB_C(1e-4);
  s.mean[1] = AMB_C(0.02);
  CHECK(axis_predict(&kf, &s, centre, AMB_C(0.5)) == AMB_OK);
  const amb_real f = AMB_C(10.05) * AMB_C(0.5) + AMB_C(0.75375) - AMB_C(5.08158);
  CHECK_NEAR(s.mean[1], AMB_C(0.02) + AMB_C(1e-4) / AMB_C(0.518) * f);
  CHECK_NEAR(s.mean[3], AMB_C(0.8) * AMB_C(1e-4) * AMB_C(0.39346934028736657640));
  CHECK(axis_sound(&s));
}

static void test_update_is_eq_11_to_13(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  amb_kalman_result r;
  CHECK(axis_update(&kf, &s, AMB_C(1e-5), &r) == AMB_OK);
  const amb_real S = AMB_C(9e-10) + AMB_C(8.3e-11);
  CHECK(same(r.innovation[0], AMB_C(1e-5)));
  CHECK_NEAR(r.variance[0], S);
  CHECK_NEAR(s.mean[3], AMB_C(9e-10) / S * AMB_C(1e-5));
  CHECK_WITHIN(s.cov[9], AMB_C(9e-10) * AMB_C(8.3e-11) / S, 20 * DIGITS);
  CHECK(same(s.mean[0], 0) && same(s.cov[0], some[0] * some[0])); /* not correlated yet */
}

static void test_measurements_that_are_none(void)
{
  const amb_kalman kf = paper_filter();
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, AMB_C(8.1e-3), AMB_C(-8.1e-3)};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    amb_kalman_state s = start();
    const amb_kalman_state before = s;
    amb_kalman_result r = {.innovation = {9}, .variance = {9}, .health = {AMB_FROZEN}};
    CHECK(axis_update(&kf, &s, bad[i], &r) == AMB_MISSING);
    CHECK(unchanged(&s, &before) && same(r.innovation[0], 0) && r.variance[0] > 0);
    CHECK(r.health[0] == AMB_MISSING);
  }
  amb_kalman_state s = start();
  amb_kalman_result r;
  for (int k = 0; k < 30; k++)
    CHECK(axis_update(&kf, &s, AMB_C(1e-5), &r) == (k < 10 ? AMB_OK : AMB_FROZEN));
  CHECK(axis_update(&kf, &s, AMB_C(1.1e-5), &r) == AMB_OK);
}

/* Of a stuck sensor; bits flip where it has repeated its measurement twice. */
static bool is_frozen_after_a_flip(amb_real chance, amb_real least_change)
{
  amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  amb_kalman_result r;
  kf.set.dwell = AMB_C(40.0);
  for (int k = 0; k < 50; k++)
    CHECK(axis_update(&kf, &s, axis_wobble(k), &r) == AMB_OK);
  s.sensor[0].least_change = least_change;
  CHECK(axis_update(&kf, &s, AMB_C(1.1e-6), &r) == AMB_OK);
  CHECK(axis_update(&kf, &s, AMB_C(1.1e-6), &r) == AMB_OK);
  s.sensor[0].chance = chance;
  for (int k = 0; k < 30; k++)
    (void)axis_update(&kf, &s, AMB_C(1.1e-6), &r);
  return r.health[0] == AMB_FROZEN;
}

static void test_what_flips_of_a_sensors_health_heals(void)
{
  const amb_real flipped[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, AMB_C(1e30), AMB_C(-1.0)};
  for (size_t i = 0; i < sizeof flipped / sizeof *flipped; i++) {
    CHECK(is_frozen_after_a_flip(flipped[i], AMB_C(1e-12)));
    CHECK(is_frozen_after_a_flip(AMB_C(1.0), flipped[i]));
  }
}

static void test_control_signals_that_are_none(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  amb_status status = AMB_OK;
  CHECK(same(axis_current(&kf, &s, AMB_C(0.4), &status), AMB_C(0.5)) && status == AMB_OK);
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    CHECK(same(axis_current(&kf, &s, bad[i], &status), AMB_C(0.5)));
    CHECK(status == AMB_BAD_CONTROL);
  }
  CHECK(same(axis_current(&kf, &s, AMB_REAL_MAX, &status), AMB_C(1.5)));
  CHECK(status == AMB_SATURATED);
  CHECK(same(axis_current(&kf, &s, NOT_A_NUMBER, &status), AMB_C(1.5)));
  CHECK(status == (AMB_BAD_CONTROL | AMB_SATURATED));
}

static void test_stiffnesses_that_are_none(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  const amb_kalman_state before = s;
  const amb_stiffness bad[] = {{NOT_A_NUMBER, 1}, {1, NOT_A_NUMBER}, {TOO_MUCH, 1}, {1, TOO_MUCH}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    CHECK(axis_predict(&kf, &s, bad[i], 0) == AMB_BAD_PARAMETER && unchanged(&s, &before));
  /* In the gap the law has its pole: it is asked at the stop. */
  s.mean[0] = law.s0;
  const amb_stiffness k = axis_stiffness(&kf, &closed, AMB_C(0.5), s.mean);
  const amb_stiffness stop = amb_law_magnet.through_origin(&law, AMB_C(0.5), PAPER_X_MAX);
  CHECK(same(k.k_i, stop.k_i) && same(k.k_s, stop.k_s));
}

static void test_a_long_outage(const amb_magnet *magnet, amb_real var_y)
{
  amb_kalman_settings set = paper;
  set.var_y[0] = var_y;
  amb_kalman kf;
  CHECK(paper_init(&kf, &set) == AMB_OK);
  amb_kalman_state s = start();
  amb_kalman_result r;
  amb_status last = AMB_OK;
  const amb_real shaken = (var_y < AMB_C(1e-12)) ? AMB_C(0.01) : 1;
  for (int k = 0; k < 50000; k++)
    last = step(&kf, magnet, &s, NOT_A_NUMBER, AMB_C(0.4), &r);
  CHECK(last == (AMB_MISSING | AMB_HELD));
  CHECK(axis_sound(&s) && same(s.cov[0], PAPER_X_MAX * PAPER_X_MAX) && same(s.mean[0], 0));
  for (int k = 0; k < 1000; k++) {
    last = step(&kf, magnet, &s, shaken * axis_wobble(k), AMB_C(0.4045), &r);
    CHECK(axis_sound(&s));
  }
  CHECK((last & ~(AMB_INCONSISTENT | AMB_OUTLIER | AMB_RESTARTED)) ==
        AMB_OK); /* the record is none of this plant */
  CHECK(s.mean[0] < AMB_C(1e-4) && s.mean[0] > AMB_C(-1e-4));
}

static void test_a_covariance_that_is_lost(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  amb_kalman_result r;
  s.cov[3] = s.cov[0] * 2; /* x and x_m correlated by two: no covariance has that */
  CHECK(axis_update(&kf, &s, AMB_C(1e-5), &r) == AMB_BAD_VARIANCE);
  CHECK(axis_sound(&s) && same(s.cov[3], 0) && same(s.cov[0], some[0] * some[0]));
  s.cov[9] = -1;
  CHECK(axis_update(&kf, &s, AMB_C(2e-5), &r) == AMB_BAD_VARIANCE);
  CHECK(axis_sound(&s) && same(s.cov[9], 1));
}

/* A variance of exactly nothing is one: what is known is known. Less than nothing is none. */
static void test_what_is_known_to_the_last_digit(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state s = start();
  amb_kalman_result r;
  s.cov[7] = 0;
  CHECK(axis_update(&kf, &s, AMB_C(1e-5), &r) == AMB_OK);
  CHECK(axis_finite(&s) && same(s.cov[7], 0) && s.cov[9] < some[3] * some[3]);
  const amb_real none[] = {-AMB_REAL_MIN, NOT_A_NUMBER};
  for (size_t i = 0; i < 2; i++) {
    s = start();
    s.cov[7] = none[i];
    CHECK(axis_update(&kf, &s, AMB_C(1e-5), &r) == AMB_BAD_VARIANCE);
  }
}

static void test_a_step_is_its_parts(void)
{
  const amb_kalman kf = paper_filter();
  amb_kalman_state whole = start(), parts = start();
  amb_kalman_result r, q;
  for (int k = 0; k < 100; k++) {
    const amb_real y = axis_wobble(k), u = AMB_C(0.4) + 1000 * axis_wobble(k + 3);
    CHECK(step(&kf, &closed, &whole, y, u, &r) == AMB_OK);
    amb_status status = AMB_OK;
    const amb_real iu = axis_current(&kf, &parts, u, &status);
    const amb_stiffness stiffness = axis_stiffness(&kf, &closed, iu, parts.mean);
    CHECK(axis_predict(&kf, &parts, stiffness, iu) == AMB_OK);
    CHECK(axis_update(&kf, &parts, y, &q) == AMB_OK && status == AMB_OK);
    CHECK(unchanged(&whole, &parts) && same(r.stiffness[0].k_s, stiffness.k_s));
  }
}

static void test_forecast(void)
{
  const amb_kalman kf = paper_filter();
  const amb_estimator estimator = {&amb_kalman_methods, &kf, &linear, NULL};
  const amb_real mean[AMB_STATES] = {AMB_C(1e-4), AMB_C(0.02), 1, AMB_C(7e-5)};
  const amb_real u[3] = {AMB_C(0.4), 100, AMB_C(0.3)};
  amb_real y[AMB_SENSORS];
  amb_estimator_forecast(&estimator, 1, mean, NULL, 0, y);
  CHECK(same(y[0], mean[3]));
  amb_kalman_state s = start();
  memcpy(s.mean, mean, sizeof mean);
  for (int k = 0; k < 3; k++) {
    amb_status status = AMB_OK;
    const amb_real iu = axis_current(&kf, &s, u[k], &status);
    (void)axis_predict(&kf, &s, centre, iu);
  }
  amb_estimator_forecast(&estimator, 1, mean, u, 3, y);
  CHECK(same(y[0], s.mean[3]));
}

#define N 200

static void test_run(void)
{
  const amb_kalman kf = paper_filter();
  static amb_real y[N], u[N], k_i[N], k_s[N];
  static amb_real mean[AXIS_STATES * N], cov[AXIS_ENTRIES * N], innovation[N], variance[N],
      out_i[N], out_s[N];
  static unsigned short status[N];
  for (int k = 0; k < N; k++) {
    y[k] = axis_wobble(k);
    u[k] = AMB_C(0.4) + 1000 * axis_wobble(k + 3);
    k_i[k] = 10 + (amb_real)(k % 3);
    k_s[k] = 7000 + 100 * (amb_real)(k % 5);
  }
  y[50] = NOT_A_NUMBER;
  u[60] = TOO_MUCH;
  u[70] = 9;
  const amb_magnet magnets[AMB_FORCES] = {closed};
  amb_kalman_input in = {N, y, u, NULL, NULL, NULL};
  amb_kalman_history h = {mean,  cov,  innovation, variance, out_i,
                          out_s, NULL, NULL,       status,   status};
  amb_kalman_state s = start();
  CHECK(amb_kalman_run(&kf, magnets, &s, &in, &h) ==
        (AMB_MISSING | AMB_BAD_CONTROL | AMB_SATURATED));
  CHECK(status[50] == AMB_MISSING && status[61] == AMB_BAD_CONTROL && status[71] == AMB_SATURATED);

  amb_kalman_state steps = start();
  amb_kalman_result r;
  for (size_t k = 0; k < N; k++) {
    if (k > 0)
      (void)step(&kf, &closed, &steps, y[k], u[k - 1], &r);
    else
      (void)axis_update(&kf, &steps, y[0], &r);
    CHECK(memcmp(mean + AXIS_STATES * k, steps.mean, AXIS_STATES * sizeof *mean) == 0);
    CHECK(memcmp(cov + AXIS_ENTRIES * k, steps.cov, AXIS_ENTRIES * sizeof *cov) == 0);
  }
  CHECK(unchanged(&s, &steps));
  amb_kalman_note(&kf, &steps, &r, 0, &h);
  CHECK(same(mean[3], steps.mean[3]) && same(cov[9], steps.cov[9]) &&
        same(out_s[0], r.stiffness[0].k_s));

  in.n = 0;
  h.cov = NULL;
  s = start();
  const amb_kalman_state before = s;
  mean[0] = AMB_C(0.125);
  CHECK(amb_kalman_run(&kf, magnets, &s, &in, &h) == AMB_OK);
  CHECK(unchanged(&s, &before) && same(mean[0], AMB_C(0.125)));
  in.n = 1;
  CHECK(amb_kalman_run(&kf, magnets, &s, &in, &h) == AMB_OK && same(innovation[0], y[0]));
  in = (amb_kalman_input){N, y, u, k_i, k_s, NULL};
  s = start();
  k_s[80] = NOT_A_NUMBER;
  CHECK((amb_kalman_run(&kf, NULL, &s, &in, &h) & AMB_BAD_PARAMETER) && axis_sound(&s));
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
  test_what_flips_of_a_sensors_health_heals();
  test_control_signals_that_are_none();
  test_stiffnesses_that_are_none();
  test_a_long_outage(&linear, paper.var_y[0]);
  test_a_long_outage(&closed, paper.var_y[0]);
  test_a_long_outage(&closed, AMB_C(1e-16));
  test_a_covariance_that_is_lost();
  test_what_is_known_to_the_last_digit();
  test_a_step_is_its_parts();
  test_forecast();
  test_run();
  return failures;
}
