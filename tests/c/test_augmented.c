/* The filter of five states: held at rest and equal to the plain one there, its limits, faults. */
#include "ambkit/extended_k.h"
#include "family.h"

static const amb_extended_k own = {0,          AMB_C(0.2), AMB_C(1e-6),
                                   AMB_C(0.8), AMB_C(1.1), {AMB_C(0.012), AMB_C(0.108)}};

static void test_at_rest_it_is_the_plain_filter(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_extended_k_methods, &kf, &family_law, &own};
  const amb_estimator plain = {&amb_extended_methods, &kf, &family_law, NULL};
  amb_extended_k_state s;
  amb_kalman_state p;
  CHECK(e.methods->reset(&e, &s, family_rest, family_std) == AMB_OK);
  CHECK(plain.methods->reset(&plain, &p, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 5000; k++) {
    const amb_real y = family_position(k), u = family_control(k);
    CHECK(amb_estimator_step(&e, &s, y, u, &r) == AMB_UNEXCITED);
    (void)amb_estimator_step(&plain, &p, y, u, &r);
  }
  CHECK(same(s.theta, 1));
  CHECK(memcmp(s.base.mean, p.mean, sizeof p.mean) == 0);
  CHECK(memcmp(s.cov, p.cov, sizeof p.cov) == 0);
  CHECK(s.base.cov[7] > p.cov[7]); /* but it knows that it does not know k */
}

/* Made to learn where it should not, it keeps to its limits, and its variance positive. */
static void test_limits(void)
{
  const amb_kalman kf = family_filter();
  amb_extended_k always = own;
  always.learn.least = 0;
  const amb_estimator e = {&amb_extended_k_methods, &kf, &family_law, &always};
  amb_extended_k_state s;
  CHECK(e.methods->reset(&e, &s, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 20000; k++) {
    const amb_real pull = AMB_C(1e-5) * (amb_real)(k % 40 - 20); /* as no magnet does */
    const amb_status status = amb_estimator_step(&e, &s, pull + family_position(k), 0, &r);
    CHECK((status & AMB_UNEXCITED) == 0U);
    CHECK((s.theta >= own.min) && (s.theta <= own.max) && (s.var > 0));
    CHECK(all_finite(s.base.cov, 10) && all_finite(s.excitation.slope, 4));
  }
}

int main(void)
{
  test_at_rest_it_is_the_plain_filter();
  test_limits();
  family_faults(&amb_extended_k_methods, &own);
  return failures;
}
