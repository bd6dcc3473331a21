/* Starts from anywhere and any faults, for every kind of the family: none is ever not finite, and
 * all come back to the rotor. */
#include "ambkit/envelope.h"
#include "family.h"

static bool sound(const family_kind *tried, const amb_kalman_state *s)
{
  return tried->certain ? axis_sound(s) : axis_finite(s);
}

/* Good samples of a rotor that hangs at the middle: it is found within 50 ms, and not held. */
static void comes_back(const family_kind *tried, const amb_estimator *e, family_state *s)
{
  amb_kalman_result r;
  amb_status last = AMB_OK;
  for (int k = 0; k < 500; k++) {
    last = axis_step(e, s, axis_wobble(k), family_control(k), &r);
    CHECK(sound(tried, &s->base));
  }
  CHECK((last & (AMB_HELD | AMB_RESTARTED | AMB_OUTLIER | AMB_MISSING)) == 0U);
  CHECK(amb_magnitude(s->base.mean[0]) < AMB_C(1e-4));
}

static void test_starts(const family_kind *tried)
{
  static const amb_real scale[AXIS_STATES] = {AMB_C(1e-3), AMB_C(0.1), 5, AMB_C(1e-3)};
  const amb_kalman kf = family_filter();
  const amb_estimator e = {tried->methods, &kf, &closed, tried->own};
  family_state s;
  CHECK(tried->methods->state_size <= sizeof s);
  for (int start = 0; start < 100; start++) {
    amb_real mean[AMB_STATES], std[AMB_STATES];
    for (int i = 0; i < AXIS_STATES; i++) {
      mean[i] = (start % 3 == 0)
                    ? 0
                    : family_uniform() * scale[i] * ((start % 3 == 1) ? 1 : family_decades(12));
      std[i] = scale[i] * family_decades(12);
    }
    CHECK(tried->methods->reset(&e, &s, mean, (start % 10 == 9) ? NULL : std) == AMB_OK);
    comes_back(tried, &e, &s);
    if (failures > 0)
      return;
  }
  const amb_real farthest[AMB_STATES] = {AMB_REAL_MAX, -AMB_REAL_MAX, AMB_REAL_MAX, AMB_REAL_MAX};
  const amb_real surest[AMB_STATES] = {AMB_REAL_MIN, AMB_REAL_MIN, AMB_REAL_MIN, AMB_REAL_MIN};
  CHECK(tried->methods->reset(&e, &s, farthest, surest) == AMB_OK);
  comes_back(tried, &e, &s);
  const amb_real unsure[AMB_STATES] = {AMB_REAL_MAX, AMB_REAL_MAX, AMB_REAL_MAX, AMB_REAL_MAX};
  CHECK(tried->methods->reset(&e, &s, at_rest, unsure) == AMB_OK);
  comes_back(tried, &e, &s);
}

static void test_faults(const family_kind *tried)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {tried->methods, &kf, &closed, tried->own};
  family_state s;
  amb_kalman_result r;
  CHECK(tried->methods->reset(&e, &s, at_rest, some) == AMB_OK);
  unsigned long of_y = 9, of_u = 9;
  amb_real y_stuck = AMB_C(1e-3), u_stuck = 0;
  for (int k = 0; k < 50000; k++) {
    if (k % 499 == 0) {
      of_y = family_draw() % 12UL;
      of_u = family_draw() % 12UL;
    }
    const amb_real y = family_faulty(of_y, k, axis_wobble(k), &y_stuck);
    const amb_real u = family_faulty(of_u, k, family_control(k), &u_stuck);
    (void)axis_step(&e, &s, y, u, &r);
    CHECK(sound(tried, &s.base) && amb_is_finite(r.variance[0]) && amb_is_finite(r.innovation[0]));
    if (k % 10000 == 9999)
      for (int again = 0; again < 20; again++) /* 1 s, by when noise is learned anew as well */
        comes_back(tried, &e, &s);
    if (failures > 0)
      return;
  }
}

static void test_diffuse(void)
{
  const amb_kalman kf = family_filter();
  amb_kalman_state s;
  amb_kalman_result r;
  CHECK(amb_kalman_reset(&kf, &s, at_rest, NULL) == AMB_OK);
  CHECK(same(s.cov[0], kf.widest[0]) && same(s.cov[4], kf.set.cap[1] * kf.set.cap[1]));
  CHECK(axis_update(&kf, &s, AMB_C(-8e-4), &r) == AMB_OK);
  CHECK_WITHIN(s.mean[0], AMB_C(-8e-4), AMB_C(0.02));
}

static void test_restart(void)
{
  const amb_kalman kf = family_filter();
  amb_kalman_state s;
  amb_kalman_result r;
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  for (int k = 0; k < 3; k++)
    CHECK((axis_update(&kf, &s, AMB_C(8e-4) + axis_wobble(k), &r) & AMB_OUTLIER) != 0U);
  CHECK((axis_update(&kf, &s, AMB_C(8e-4), &r) & ~AMB_INCONSISTENT) == AMB_RESTARTED);
  CHECK(same(s.mean[0], AMB_C(8e-4)) && same(s.mean[3], AMB_C(8e-4)) && same(s.mean[2], 0));
  CHECK_NEAR(s.cov[7], 100 * some[2] * some[2]);
  CHECK(s.cov[0] * s.cov[9] > s.cov[3] * s.cov[3]);
  /* By the velocity it goes away from what the sensor shows, over the lag and a sample. */
  const amb_real away = (kf.set.T + kf.set.lag[0]) * 10 * some[1];
  CHECK_WITHIN(s.cov[0] - s.cov[3] * s.cov[3] / s.cov[9], 100 * some[0] * some[0] + away * away,
               AMB_C(1e-3));
  s.cov[0] = NOT_A_NUMBER;
  CHECK(axis_predict(&kf, &s, centre, 0) == (AMB_HELD | AMB_RESTARTED));
  CHECK(axis_finite(&s) && same(s.cov[0], kf.widest[0]));
}

int main(void)
{
  for (size_t i = 0; i < FAMILY_KINDS; i++) {
    test_starts(&family_kinds[i]);
    test_faults(&family_kinds[i]);
    if (failures > 0) {
      (void)fprintf(stderr, "kind %d\n", (int)i);
      return failures;
    }
  }
  test_diffuse();
  test_restart();
  return failures;
}
