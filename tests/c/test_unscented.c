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
  const amb_estimator unscented = {&amb_unscented_methods, &kf, &linear, &own};
  const amb_estimator extended = {&amb_extended_methods, &kf, &linear, NULL};
  amb_kalman_state a, b;
  CHECK(unscented.methods->reset(&unscented, &a, at_rest, some) == AMB_OK);
  CHECK(extended.methods->reset(&extended, &b, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 2000; k++) {
    const amb_real y = axis_wobble(k), u = family_control(k);
    CHECK(axis_step(&unscented, &a, y, u, &r) == AMB_OK);
    (void)axis_step(&extended, &b, y, u, &r);
  }
  for (int i = 0; i < AXIS_STATES; i++)
    CHECK(apart(a.mean[i], b.mean[i]) <= AMB_C(1e-3) * some[i]);
  CHECK_WITHIN(a.cov[0], b.cov[0], AMB_C(1e-3));
}

/* Where position and speed are known to all digits, and where not at all. */
static void test_spread(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_unscented_methods, &kf, &closed, &own};
  amb_kalman_state s;
  amb_kalman_result r;
  const amb_real sharp[AMB_STATES] = {AMB_REAL_MIN, AMB_C(1e-9), 1, AMB_C(1e-5)};
  CHECK(e.methods->reset(&e, &s, at_rest, sharp) == AMB_OK);
  CHECK(axis_predict_by(&e, &s, AMB_C(0.3), &r) == AMB_OK);
  CHECK(axis_finite(&s));
  const amb_stiffness tangent = amb_law_magnet.tangent(&law, AMB_C(0.3), 0);
  CHECK_NEAR(r.stiffness[0].k_s, tangent.k_s);

  const amb_real blunt[AMB_STATES] = {AMB_C(9.9e-4), 9, 1,
                                      AMB_C(1e-3)}; /* points beyond the stops */
  CHECK(e.methods->reset(&e, &s, at_rest, blunt) == AMB_OK);
  CHECK(axis_predict_by(&e, &s, AMB_C(0.3), &r) == AMB_OK);
  CHECK(axis_finite(&s));
  CHECK(r.stiffness[0].k_s > tangent.k_s);
  CHECK(axis_predict_by(&e, &s, AMB_C(0.3), &r) == AMB_HELD);
}

int main(void)
{
  test_linear();
  test_spread();
  family_faults(&amb_unscented_methods, &own);
  return failures;
}
