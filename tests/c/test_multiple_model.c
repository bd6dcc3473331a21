/* Multiple models: their weights, alone and all together, at rest, and what no model foretells. */
#include "ambkit/multiple_model.h"
#include "family.h"

static const amb_multiple_model own = {
    5, {AMB_C(0.7), AMB_C(0.85), 1, AMB_C(1.15), AMB_C(1.3)}, AMB_C(1e-4), 0, {AMB_C(0.012), 0}};

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
  const amb_multiple_model equal = {3, {1, 1, 1, 0, 0}, AMB_C(1e-3), 0, {AMB_C(0.012), 0}};
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &family_law, &equal};
  const amb_estimator plain = {&amb_extended_methods, &kf, &family_law, NULL};
  amb_multiple_model_state s;
  amb_kalman_state p;
  CHECK(e.methods->reset(&e, &s, family_rest, family_std) == AMB_OK);
  CHECK(plain.methods->reset(&plain, &p, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 1000; k++) {
    CHECK(amb_estimator_step(&e, &s, family_position(k), family_control(k), &r) == AMB_OK);
    (void)amb_estimator_step(&plain, &p, family_position(k), family_control(k), &r);
  }
  for (int i = 0; i < 4; i++)
    CHECK(amb_magnitude(s.base.mean[i] - p.mean[i]) <= AMB_C(1e-3) * family_std[i]);
  CHECK_WITHIN(s.base.cov[7], p.cov[7], AMB_C(1e-3));
  CHECK_WITHIN(s.model[1].weight, AMB_C(1.0) / 3, AMB_C(1e-3));
}

/* Innovations of many standard deviations, let in: the likelihoods of all vanish, their weights
 * do not. */
static void test_the_unlikely(void)
{
  amb_kalman kf = family_filter();
  kf.gate_squared = AMB_C(1e12);
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &family_law, &own};
  amb_multiple_model_state s;
  CHECK(e.methods->reset(&e, &s, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 3000; k++) {
    const amb_real y = ((k / 100) % 2 == 0 ? AMB_C(1e-3) : AMB_C(-1e-3)) + family_position(k);
    (void)amb_estimator_step(&e, &s, y, family_control(k), &r);
    CHECK_WITHIN(sum_of_weights(&s, own.n), 1, AMB_C(1e-5));
    CHECK(all_finite(s.base.mean, 4) && all_finite(s.base.cov, 10));
  }
}

static void test_at_rest_nothing_is_weighed(void)
{
  const amb_kalman kf = family_filter();
  amb_multiple_model careful = own;
  careful.learn.least = AMB_C(0.108);
  const amb_estimator e = {&amb_multiple_model_methods, &kf, &family_law, &careful};
  amb_multiple_model_state s;
  CHECK(e.methods->reset(&e, &s, family_rest, family_std) == AMB_OK);
  amb_kalman_result r;
  for (int k = 0; k < 5000; k++)
    CHECK(amb_estimator_step(&e, &s, family_position(k), family_control(k), &r) == AMB_UNEXCITED);
  for (int j = 0; j < own.n; j++)
    CHECK(same(s.model[j].weight, AMB_C(0.2)));
}

int main(void)
{
  test_equal_models_are_one();
  test_the_unlikely();
  test_at_rest_nothing_is_weighed();
  family_faults(&amb_multiple_model_methods, &own);
  return failures;
}
