/* The network with 1 and with the most rules, plain and normalised, near and far, and off its box.
 */
#include "ambkit/fuzzy.h"
#include "check.h"

#define MOST AMB_FUZZY_MAX_RULES

static amb_real centre_iu[MOST], centre_x[MOST], sharpness[MOST], weight_i[MOST], weight_s[MOST];

static amb_fuzzy network(int rules, bool normalised, amb_real sharp)
{
  for (int r = 0; r < rules; r++) {
    centre_iu[r] = (amb_real)(r % 8) / 4 - 1;
    centre_x[r] = (amb_real)(r / 8) / 4 - 1;
    sharpness[r] = sharp;
    weight_i[r] = 10 + (amb_real)r;
    weight_s[r] = 7000 - 10 * (amb_real)r;
  }
  const amb_fuzzy net = {
      .rules = rules,
      .normalised = normalised,
      .per_ampere = 1,
      .per_metre = 1000,
      .iu_min = -1,
      .iu_max = 1,
      .x_min = AMB_C(-1e-3),
      .x_max = AMB_C(1e-3),
      .centre_iu = centre_iu,
      .centre_x = centre_x,
      .k_i = {sharpness, weight_i},
      .k_s = {sharpness, weight_s},
  };
  return net;
}

/* Eq. 32, 33 by libm, in double. */
static double naive(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real iu, amb_real x)
{
  double sum = 0, weighted = 0;
  for (int r = 0; r < net->rules; r++) {
    const double p = (double)(iu * net->per_ampere - net->centre_iu[r]);
    const double q = (double)(x * net->per_metre - net->centre_x[r]);
    const double u = exp(-(p * p + q * q) * (double)output->sharpness[r]);
    sum += u;
    weighted += u * (double)output->weight[r];
  }
  return net->normalised ? weighted / sum : weighted;
}

static void test_values(int rules, bool normalised)
{
  const amb_fuzzy net = network(rules, normalised, 2);
  for (int i = -4; i <= 4; i++) {
    const amb_real iu = (amb_real)i / 4, x = (amb_real)i / -5000;
    const amb_stiffness k = amb_fuzzy_magnet.through_origin(&net, iu, x);
    CHECK_WITHIN(k.k_i, (amb_real)naive(&net, &net.k_i, iu, x), 10 * DIGITS);
    CHECK_WITHIN(k.k_s, (amb_real)naive(&net, &net.k_s, iu, x), 10 * DIGITS);
    CHECK_NEAR(amb_fuzzy_magnet.force(&net, iu, x), k.k_i * iu + k.k_s * x);

    amb_real basis[MOST], sum = 0, made = 0;
    amb_fuzzy_basis(&net, &net.k_s, iu, x, basis);
    for (int r = 0; r < rules; r++) {
      sum += basis[r];
      made += basis[r] * weight_s[r];
    }
    CHECK_WITHIN(made, k.k_s, 10 * DIGITS);
    CHECK(sum > 0);
    if (normalised)
      CHECK_WITHIN(sum, 1, 10 * DIGITS);
  }
}

static void test_one_rule_is_a_constant(void)
{
  const amb_fuzzy net = network(1, true, 2);
  const amb_stiffness k = amb_fuzzy_magnet.through_origin(&net, AMB_C(0.9), AMB_C(9e-4));
  CHECK_NEAR(k.k_i, weight_i[0]);
  CHECK_NEAR(amb_fuzzy_magnet.tangent(&net, AMB_C(0.3), AMB_C(2e-4)).k_i, weight_i[0]);
}

static void test_far_from_every_rule(int rules)
{
  const amb_real place = AMB_C(0.07), off = AMB_C(1.1e-4);
  amb_fuzzy net = network(rules, true, AMB_C(1e6));
  int nearest = 0;
  double least = 1e9;
  for (int r = 0; r < rules; r++) {
    const double distance =
        hypot((double)(place - centre_iu[r]), (double)(1000 * off - centre_x[r]));
    nearest = distance < least ? r : nearest;
    least = distance < least ? distance : least;
  }
  const amb_stiffness k = amb_fuzzy_magnet.through_origin(&net, place, off);
  CHECK_NEAR(k.k_i, weight_i[nearest]);
  CHECK_NEAR(k.k_s, weight_s[nearest]);
  CHECK(amb_is_finite(amb_fuzzy_magnet.tangent(&net, place, off).k_i));
  CHECK(amb_is_finite(amb_fuzzy_magnet.tangent(&net, place, off).k_s));
  net.normalised = false;
  const amb_stiffness plain = amb_fuzzy_magnet.through_origin(&net, place, off);
  CHECK(plain.k_i >= 0 && plain.k_i < AMB_C(1e-30));
}

static void test_outside_the_box_and_no_numbers(int rules, bool normalised)
{
  const amb_fuzzy net = network(rules, normalised, 2);
  const amb_stiffness corner = amb_fuzzy_magnet.through_origin(&net, net.iu_max, net.x_min);
  const amb_real far[] = {2, AMB_REAL_MAX, TOO_MUCH};
  for (size_t i = 0; i < sizeof far / sizeof *far; i++) {
    const amb_stiffness k = amb_fuzzy_magnet.through_origin(&net, far[i], -far[i]);
    CHECK(same(k.k_i, corner.k_i) && same(k.k_s, corner.k_s));
  }
  const amb_stiffness edge = amb_fuzzy_magnet.tangent(&net, 2, AMB_C(-2e-3));
  CHECK_WITHIN(edge.k_i, corner.k_i, 10 * DIGITS); /* held: no slope */

  /* Any answer will do, as long as memory and time are left alone. */
  amb_real basis[MOST];
  (void)amb_fuzzy_magnet.through_origin(&net, NOT_A_NUMBER, NOT_A_NUMBER);
  (void)amb_fuzzy_magnet.tangent(&net, NOT_A_NUMBER, TOO_MUCH);
  amb_fuzzy_basis(&net, &net.k_i, NOT_A_NUMBER, 0, basis);
  CHECK(isnan(amb_fuzzy_magnet.force(&net, NOT_A_NUMBER, 0)));
}

int main(void)
{
  const int sizes[] = {1, 2, 3, 4, 25, MOST - 1, MOST};
  for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
    for (int normalised = 0; normalised < 2; normalised++) {
      test_values(sizes[i], normalised == 1);
      test_outside_the_box_and_no_numbers(sizes[i], normalised == 1);
    }
    test_far_from_every_rule(sizes[i]);
  }
  test_one_rule_is_a_constant();
  return failures;
}
