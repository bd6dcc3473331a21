/* The unscented filter: bad input, far from the centre, and a magnet whose force is linear. */
#include "ambkit/unscented.h"
#include "check.h"
#include "family.h"

static const amb_unscented own = {AMB_C(1.7320508), 2};

static amb_real apart(amb_real a, amb_real b)
{
  return amb_magnitude(a - b);
}

/* The secant of a straight line is its tangent: the extended filter. */
static void test_linear(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator unscented = {&amb_unscented_methods, &kf, &family_linear, &own};
  const amb_estimator extended = {&amb_extended_methods, &kf, &family_linear, NULL};
  amb_kalman_state a, b;
  CHECK(unscented.methods->reset(&unscented, &a, family_rest, family_std) == AMB_OK);
  CHECK(extended.methods->reset(&extended, &b, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 2000; k++) {
    const amb_real y = family_position(k), u = family_control(k);
    CHECK(amb_estimator_step(&unscented, &a, y, u, &r) == AMB_OK);
    (void)amb_estimator_step(&extended, &b, y, u, &r);
  }
  for (int i = 0; i < 4; i++)
    CHECK(apart(a.mean[i], b.mean[i]) <= AMB_C(1e-3) * family_std[i]);
  CHECK_WITHIN(a.cov[0], b.cov[0], AMB_C(1e-3));
}

/* Where position and speed are known to all digits, and where not at all. */
static void test_spread(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_unscented_methods, &kf, &family_law, &own};
  amb_kalman_state s;
  amb_kalman_result r;
  const amb_real sharp[4] = {AMB_REAL_MIN, AMB_C(1e-9), 1, AMB_C(1e-5)};
  CHECK(e.methods->reset(&e, &s, family_rest, sharp) == AMB_OK);
  CHECK(e.methods->predict(&e, &s, AMB_C(0.3), &r) == AMB_OK);
  CHECK(all_finite(s.mean, 4) && all_finite(s.cov, 10));
  const amb_stiffness tangent = amb_law_magnet.tangent(family_law.self, AMB_C(0.3), 0);
  CHECK_NEAR(r.stiffness.k_s, tangent.k_s);

  const amb_real blunt[4] = {AMB_C(9.9e-4), 9, 1, AMB_C(1e-3)}; /* points beyond the stops */
  CHECK(e.methods->reset(&e, &s, family_rest, blunt) == AMB_OK);
  CHECK(e.methods->predict(&e, &s, AMB_C(0.3), &r) == AMB_OK);
  CHECK(all_finite(s.mean, 4) && all_finite(s.cov, 10));
  CHECK(r.stiffness.k_s > tangent.k_s);
  CHECK(e.methods->predict(&e, &s, AMB_C(0.3), &r) == AMB_HELD);
}

int main(void)
{
  test_linear();
  test_spread();
  family_faults(&amb_unscented_methods, &own);
  return failures;
}
