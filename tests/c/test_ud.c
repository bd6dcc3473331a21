/* The filter on a factor: starts, bad input, and a factor that stays one. */
#include "ambkit/ud.h"
#include "paper.h"

static amb_kalman filter(amb_real var_y)
{
  amb_kalman_settings s = paper;
  s.var_y[0] = var_y;
  amb_kalman kf;
  CHECK(paper_init(&kf, &s) == AMB_OK);
  return kf;
}

static bool sound(const amb_ud_state *s)
{
  bool unit = true;
  for (int i = 0; i < AXIS_STATES; i++)
    for (int j = 0; j <= i; j++)
      unit = unit && same(s->U[i][j], i == j ? 1 : 0);
  return unit && axis_finite(&s->base) && s->D[0] > 0 && s->D[1] > 0 && s->D[2] > 0 &&
         s->D[3] > 0 && all_finite(s->D, AXIS_STATES);
}

static void test_reset(void)
{
  const amb_kalman kf = filter(paper.var_y[0]);
  const amb_estimator e = {&amb_ud_methods, &kf, &closed, NULL};
  amb_ud_state s;
  CHECK(e.methods->state_size == sizeof s);
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(sound(&s) && same(s.base.cov[4], some[1] * some[1]) && same(s.base.cov[1], 0));
  const amb_real bad[AMB_STATES] = {0, 0, NOT_A_NUMBER, 0};
  CHECK(e.methods->reset(&e, &s, bad, some) == AMB_BAD_PARAMETER);
  CHECK(e.methods->reset(&e, &s, at_rest, at_rest) == AMB_BAD_PARAMETER);
  CHECK(sound(&s) && same(s.D[1], some[1] * some[1]));
}

/* The same as the extended filter, and the same words about what it is given. */
static void test_beside_the_extended_filter(void)
{
  const amb_kalman kf = filter(paper.var_y[0]);
  const amb_estimator e = {&amb_ud_methods, &kf, &closed, NULL};
  const amb_estimator plain = {&amb_extended_methods, &kf, &closed, NULL};
  amb_ud_state s;
  amb_kalman_state p;
  amb_kalman_result r, q;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(plain.methods->reset(&plain, &p, at_rest, some) == AMB_OK);
  const amb_real odd[] = {NOT_A_NUMBER, TOO_MUCH, AMB_C(9e-3), 1, -TOO_MUCH};
  for (int k = 0; k < 2000; k++) {
    const amb_real y = k % 100 == 50 ? odd[(k / 100) % 5] : axis_wobble(k);
    const amb_real u = k % 300 == 10 ? NOT_A_NUMBER : (k % 300 == 20 ? 100 : AMB_C(0.4));
    CHECK(axis_step(&e, &s, y, u, &r) == axis_step(&plain, &p, y, u, &q));
    CHECK(sound(&s));
    CHECK_WITHIN(r.variance[0], q.variance[0], AMB_ROOT_EPSILON);
  }
  for (int i = 0; i < AXIS_ENTRIES; i++)
    CHECK_WITHIN(s.base.cov[i], p.cov[i], 10 * AMB_ROOT_EPSILON);
  amb_real a[AMB_STATES] = {AMB_C(1e-4), 0, 1, 0}, b[AMB_STATES] = {AMB_C(1e-4), 0, 1, 0};
  axis_advance(&e, AMB_C(1.1), AMB_C(0.2), a);
  axis_advance(&plain, AMB_C(1.1), AMB_C(0.2), b);
  CHECK(same(a[0], b[0]) && same(a[1], b[1]));
}

/* From no sensor at all to one of a nanometre, again and again. */
static void test_outages(void)
{
  const amb_kalman kf = filter(AMB_C(1e-18));
  const amb_estimator e = {&amb_ud_methods, &kf, &closed, NULL};
  amb_ud_state s;
  amb_kalman_result r;
  amb_status all = AMB_OK;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  for (int k = 0; k < 20000; k++) {
    all |= axis_step(&e, &s, k % 4000 < 3000 ? NOT_A_NUMBER : axis_wobble(k), AMB_C(0.4), &r);
    CHECK(sound(&s));
  }
  CHECK((all & AMB_HELD) && !(all & (AMB_BAD_VARIANCE | AMB_BAD_PARAMETER)));
}

static void test_a_magnet_that_knows_nothing(void)
{
  const amb_stiffness nothing = {NOT_A_NUMBER, 1};
  const amb_magnet magnet = {&amb_constant_magnet, &nothing};
  const amb_kalman kf = filter(paper.var_y[0]);
  const amb_estimator e = {&amb_ud_methods, &kf, &magnet, NULL};
  amb_ud_state s;
  amb_kalman_result r;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(axis_step(&e, &s, axis_wobble(1), 0, &r) == AMB_BAD_PARAMETER);
  CHECK(sound(&s));
}

/* A variance that is none is told as none, and the factor is made anew. */
static void test_a_covariance_that_is_none(void)
{
  const amb_kalman kf = filter(paper.var_y[0]);
  const amb_estimator e = {&amb_ud_methods, &kf, &closed, NULL};
  const amb_real y[AMB_SENSORS] = {0};
  amb_ud_state s;
  amb_kalman_result r;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  s.base.cov[9] = TOO_MUCH;
  CHECK((e.methods->update(&e, &s, y, &r) & AMB_RESTARTED) == AMB_RESTARTED);
  CHECK(same(r.variance[0], 0) && same(r.innovation[0], 0));
  CHECK(sound(&s));
}

int main(void)
{
  test_a_covariance_that_is_none();
  test_reset();
  test_beside_the_extended_filter();
  test_outages();
  test_a_magnet_that_knows_nothing();
  return failures;
}
