/* The augmented filter: held at rest and equal to the plain one there, its limits, faults. */
#include "ambkit/augmented.h"
#include "family.h"

static const amb_augmented own = {{0},        AMB_C(0.2), AMB_C(1e-6),
                                  AMB_C(0.8), AMB_C(1.1), {AMB_C(0.012), AMB_C(0.108)}};

static void test_at_rest_it_is_the_plain_filter(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_augmented_methods, &kf, &closed, &own};
  const amb_estimator plain = {&amb_extended_methods, &kf, &closed, NULL};
  amb_augmented_state s;
  amb_kalman_state p;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(plain.methods->reset(&plain, &p, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 5000; k++) {
    const amb_real y = axis_wobble(k), u = family_control(k);
    CHECK(axis_step(&e, &s, y, u, &r) == AMB_UNEXCITED);
    (void)axis_step(&plain, &p, y, u, &r);
  }
  CHECK(same(s.theta, 1));
  CHECK(memcmp(s.base.mean, p.mean, AXIS_STATES * sizeof *p.mean) == 0);
  CHECK(memcmp(s.cov, p.cov, AXIS_ENTRIES * sizeof *p.cov) == 0);
  CHECK(s.base.cov[7] > p.cov[7]); /* but it knows that it does not know k */
}

/* Made to learn where it should not, it keeps to its limits, and its variance positive. */
static void test_limits(void)
{
  const amb_kalman kf = family_filter();
  amb_augmented always = own;
  always.learn.least = 0;
  const amb_estimator e = {&amb_augmented_methods, &kf, &closed, &always};
  amb_augmented_state s;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 20000; k++) {
    const amb_real pull = AMB_C(1e-5) * (amb_real)(k % 40 - 20); /* as no magnet does */
    const amb_status status = axis_step(&e, &s, pull + axis_wobble(k), 0, &r);
    CHECK((status & AMB_UNEXCITED) == 0U);
    CHECK((s.theta >= own.min) && (s.theta <= own.max) && (s.var > 0));
    CHECK(all_finite(s.base.cov, AXIS_ENTRIES) && all_finite(s.excitation.slope, AXIS_STATES));
  }
}

/* A slope that no machine has is begun anew. */
static void test_a_slope_that_is_none(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_augmented_methods, &kf, &closed, &own};
  const amb_real y[AMB_SENSORS] = {0};
  const amb_real odd[] = {NOT_A_NUMBER, -TOO_MUCH, AMB_C(1e4)}; /* beyond 1,000 m/s */
  for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
    amb_augmented_state s;
    amb_kalman_result r;
    CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
    s.excitation.slope[1] = odd[i];
    (void)e.methods->update(&e, &s, y, &r);
    CHECK(same(s.excitation.slope[1], 0));
    CHECK(all_finite(s.base.cov, AXIS_ENTRIES) && all_finite(s.base.mean, AXIS_STATES));
  }
}

int main(void)
{
  test_a_slope_that_is_none();
  test_at_rest_it_is_the_plain_filter();
  test_limits();
  family_faults(&amb_augmented_methods, &own);
  return failures;
}
