/* Multiple models: their weights, alone and all together, at rest, and what no model predicts. */
#include "ambkit/multiple_model.h"
#include "family.h"

static const amb_multiple_model own = {
    5, {AMB_C(0.7), AMB_C(0.85), 1, AMB_C(1.15), AMB_C(1.3)}, AMB_C(1e-4), {0}, {AMB_C(0.012), 0}};

static amb_real sum_of_weights(const amb_multiple_model_state *s, int n)
{
  amb_real sum = 0;
  for (int j = 0; j < n; j++) {
    CHECK(s->model[j].weight > 0);
    sum += s->model[j].weight;
  }
  return sum;
}

static void test_equal_models_are_one(void)
{
  const amb_kalman kf = family_filter();
  const amb_multiple_model equal = {3, {1, 1, 1, 0, 0}, AMB_C(1e-3), {0}, {AMB_C(0.012), 0}};
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &closed, &equal};
  const amb_estimator plain = {&amb_extended_methods, &kf, &closed, NULL};
  amb_multiple_model_state s;
  amb_kalman_state p;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  CHECK(plain.methods->reset(&plain, &p, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 1000; k++) {
    CHECK(axis_step(&e, &s, axis_wobble(k), family_control(k), &r) == AMB_OK);
    (void)axis_step(&plain, &p, axis_wobble(k), family_control(k), &r);
  }
  for (int i = 0; i < AXIS_STATES; i++)
    CHECK(amb_magnitude(s.base.mean[i] - p.mean[i]) <= AMB_C(1e-3) * some[i]);
  CHECK_WITHIN(s.base.cov[7], p.cov[7], AMB_C(1e-3));
  CHECK_WITHIN(s.model[1].weight, AMB_C(1.0) / 3, AMB_C(1e-3));
}

/* Innovations of many standard deviations, let in: the likelihoods of all vanish, their weights
 * do not. */
static void test_the_unlikely(void)
{
  amb_kalman kf = family_filter();
  kf.gate_squared = AMB_C(1e12);
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &closed, &own};
  amb_multiple_model_state s;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 3000; k++) {
    const amb_real y = ((k / 100) % 2 == 0 ? AMB_C(1e-3) : AMB_C(-1e-3)) + axis_wobble(k);
    (void)axis_step(&e, &s, y, family_control(k), &r);
    CHECK_WITHIN(sum_of_weights(&s, own.n), 1, AMB_C(1e-5));
    CHECK(axis_finite(&s.base));
  }
}

static void test_at_rest_nothing_is_weighed(void)
{
  const amb_kalman kf = family_filter();
  amb_multiple_model careful = own;
  careful.learn.least = AMB_C(0.108);
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &closed, &careful};
  amb_multiple_model_state s;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 5000; k++)
    CHECK(axis_step(&e, &s, axis_wobble(k), family_control(k), &r) == AMB_UNEXCITED);
  for (int j = 0; j < own.n; j++)
    CHECK(same(s.model[j].weight, AMB_C(0.2)));
}

/* Means that are none are told as none, and all models begin anew. */
static void test_models_that_are_none(void)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &closed, &own};
  const amb_real y[AMB_SENSORS] = {0};
  amb_multiple_model_state s;
  amb_kalman_result r;
  CHECK(e.methods->reset(&e, &s, at_rest, some) == AMB_OK);
  s.base.mean[3] = s.model[2].mean[3] = NOT_A_NUMBER;
  CHECK((e.methods->update(&e, &s, y, &r) & AMB_RESTARTED) == AMB_RESTARTED);
  CHECK(same(r.variance[0], 0) && same(r.innovation[0], 0));
  for (int j = 0; j < own.n; j++)
    CHECK(all_finite(s.model[j].mean, AXIS_STATES) && all_finite(s.model[j].cov, AXIS_ENTRIES));
}

int main(void)
{
  test_models_that_are_none();
  test_equal_models_are_one();
  test_the_unlikely();
  test_at_rest_nothing_is_weighed();
  family_faults(&amb_multiple_model_methods, &own);
  return failures;
}
