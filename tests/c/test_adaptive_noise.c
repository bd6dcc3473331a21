/* Noise found online: parameters, a wrong R, what is not used, and the ends of the range. */
#include "ambkit/adaptive_noise.h"
#include "paper.h"
#include <stdint.h>

static amb_kalman kf;

static amb_adaptive_noise around(const amb_estimator_methods *methods)
{
  CHECK(paper_init(&kf, &paper) == AMB_OK);
  const amb_adaptive_noise own = {
      .inner = {methods, &kf, &linear, NULL},
      .measurement = true,
      .disturbance = true,
      .share = AMB_C(1e-3),
      .first_share = AMB_C(1e-2),
      .most = 100,
      .window = 50U,
  };
  return own;
}

/* Uniform in -1 to 1. */
static amb_real noise(void)
{
  static uint32_t seed = 1U;
  seed = seed * 1664525U + 1013904223U;
  return (amb_real)(seed >> 8) / AMB_C(8388608.0) - 1;
}

static void test_finds_r(const amb_estimator_methods *methods)
{
  amb_adaptive_noise own = around(methods);
  own.disturbance = false;
  const amb_estimator e = {&amb_adaptive_noise_methods, &kf, &linear, &own};
  amb_adaptive_noise_state s;
  amb_kalman_result r;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(same(s.kf.set.var_y[0], paper.var_y[0]));
  const amb_real wide = AMB_C(5e-5); /* uniform: its variance is a third of the square */
  for (int k = 0; k < 20000; k++)
    (void)axis_step(&e, &s, wide * noise(), AMB_C(0.404507), &r);
  CHECK_WITHIN(s.kf.set.var_y[0], wide * wide / 3, AMB_C(0.1));
  CHECK(same(s.kf.set.var_d[0], paper.var_d[0]));
  CHECK(same(kf.set.var_y[0], paper.var_y[0]));

  const amb_real found = s.kf.set.var_y[0];
  const amb_real odd[] = {NOT_A_NUMBER, TOO_MUCH, AMB_C(5e-3)};
  for (size_t i = 0; i < 3; i++)
    (void)axis_step(&e, &s, odd[i], AMB_C(0.404507), &r);
  CHECK(same(s.kf.set.var_y[0], found));
  const amb_real bad[AMB_STATES] = {NOT_A_NUMBER, 0, 0, 0};
  CHECK(e.methods->reset(&e, &s, bad, some) == AMB_BAD_PARAMETER);
  CHECK(same(s.kf.set.var_y[0], found));
  amb_real a[AMB_STATES] = {AMB_C(1e-4), 0, 1, 0}, b[AMB_STATES] = {AMB_C(1e-4), 0, 1, 0};
  axis_advance(&e, 1, AMB_C(0.2), a);
  axis_advance(&own.inner, 1, AMB_C(0.2), b);
  CHECK(same(a[0], b[0]) && same(a[1], b[1]));
}

/* A silent sensor, and one that is noisier than can be: the ends of the range, each told. */
static void test_ends(void)
{
  amb_adaptive_noise own = around(&amb_kalman_methods);
  own.most = 4;
  const amb_estimator e = {&amb_adaptive_noise_methods, &kf, &linear, &own};
  amb_adaptive_noise_state s;
  amb_kalman_result r;
  const amb_real wide[2] = {AMB_C(1e-9), AMB_C(3e-4)};
  for (int i = 0; i < 2; i++) {
    amb_status all = AMB_OK;
    CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
    for (int k = 0; k < 5000; k++)
      all |= axis_step(&e, &s, wide[i] * noise(), AMB_C(0.404507), &r);
    CHECK(all & AMB_NOISE_LIMIT);
    CHECK_WITHIN(s.kf.set.var_y[0], i == 0 ? paper.var_y[0] / 4 : paper.var_y[0] * 4, AMB_C(0.2));
    CHECK(axis_finite(&s.inner.base));
  }
}

/* Whatever comes: finite and within the range. */
static void test_rubbish(const amb_estimator_methods *methods)
{
  const amb_adaptive_noise own = around(methods);
  const amb_estimator e = {&amb_adaptive_noise_methods, &kf, &linear, &own};
  amb_adaptive_noise_state s;
  amb_kalman_result r;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  const amb_real odd[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, AMB_C(7e-3), AMB_REAL_MAX, 0};
  for (int k = 0; k < 20000; k++) {
    const bool strange = (k / 1000) % 3 == 1;
    const amb_real y = strange ? odd[(k / (1 + k % 5)) % 6] : AMB_C(1e-3) * noise();
    (void)axis_step(&e, &s, y, strange ? odd[k % 6] : noise(), &r);
    CHECK(s.kf.set.var_y[0] >= paper.var_y[0] / 100 && s.kf.set.var_y[0] <= paper.var_y[0] * 100);
    CHECK(s.kf.set.var_d[0] >= paper.var_d[0] / 100 && s.kf.set.var_d[0] <= paper.var_d[0] * 100);
    CHECK(axis_finite(&s.inner.base));
  }
}

/* A noise below its range is held to it, also where it is not a number. */
static void test_a_noise_that_is_none(void)
{
  const amb_adaptive_noise own = around(&amb_kalman_methods);
  const amb_estimator e = {&amb_adaptive_noise_methods, &kf, &linear, &own};
  const amb_real y[AMB_SENSORS] = {0};
  const amb_real odd[] = {NOT_A_NUMBER, -1, 0};
  for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
    amb_adaptive_noise_state s;
    amb_kalman_result r;
    CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
    s.kf.set.var_y[0] = odd[i];
    (void)e.methods->update(&e, &s, y, &r);
    CHECK(s.kf.set.var_y[0] >= kf.set.var_y[0] / own.most);
    CHECK(amb_is_positive(r.variance[0]));
  }
}

int main(void)
{
  test_a_noise_that_is_none();
  const amb_estimator_methods *const kinds[] = {&amb_kalman_methods, &amb_extended_methods,
                                                &amb_ud_methods};
  for (size_t i = 0; i < 3; i++) {
    test_finds_r(kinds[i]);
    test_rubbish(kinds[i]);
  }
  test_ends();
  return failures;
}
