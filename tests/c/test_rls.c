/* Recursive least squares: exact data, unexcited directions, bad input; and on a rotor at rest. */
#include "ambkit/magnet_rls.h"
#include "check.h"

static void test_finds_a_line(void)
{
  const amb_rls rls = {2, AMB_C(0.99), AMB_C(1e-3)};
  const amb_real theta[2] = {0, 0}, known[2] = {AMB_C(1e-6), AMB_C(1e-6)};
  amb_rls_state s;
  CHECK(amb_rls_reset(&rls, &s, theta, known) == AMB_OK);
  amb_status last = AMB_UNEXCITED;
  for (int n = 0; n < 2000; n++) {
    const amb_real phi[2] = {1, (amb_real)(n % 7) - 3};
    last = amb_rls_step(&rls, &s, phi, 5 - 2 * phi[1]);
  }
  CHECK(last == AMB_OK);
  CHECK_WITHIN(s.theta[0], 5, AMB_C(1e-5));
  CHECK_WITHIN(s.theta[1], -2, AMB_C(1e-5));
  CHECK_WITHIN(s.excitation[0], 1, AMB_C(1e-4));
  CHECK_WITHIN(s.excitation[1], 4, AMB_C(0.05)); /* variance of -3 to 3 */
}

/* Of two alike the first one learns; what was known of the second stays, for as long as it lasts.
 */
static void test_holds_what_is_not_excited(void)
{
  const amb_rls rls = {2, AMB_C(0.9), AMB_C(0.01)};
  const amb_real theta[2] = {0, 3}, known[2] = {0, 0};
  amb_rls_state s;
  CHECK(amb_rls_reset(&rls, &s, theta, known) == AMB_OK);
  const amb_real same_way[2] = {1, 2};
  for (int n = 0; n < 100000; n++)
    CHECK(amb_rls_step(&rls, &s, same_way, 10) == AMB_UNEXCITED);
  CHECK(same(s.theta[1], 3));
  CHECK_WITHIN(s.theta[0], 4, AMB_C(1e-5));
  const amb_real nothing[2] = {0, 0};
  for (int n = 0; n < 100000; n++)
    CHECK(amb_rls_step(&rls, &s, nothing, 1) == AMB_UNEXCITED);
  CHECK(same(s.theta[1], 3));
  CHECK(all_finite(s.moment, 3) && all_finite(s.theta, 2));
  /* What rounding leaves between two alike is no excitation, however little is asked for. */
  const amb_rls any = {2, AMB_C(0.9), 0};
  const amb_real rounded[2] = {AMB_C(0.1), AMB_C(0.3)};
  CHECK(amb_rls_reset(&any, &s, theta, known) == AMB_OK);
  for (int n = 0; n < 1000; n++)
    CHECK(amb_rls_step(&any, &s, rounded, 1) == AMB_UNEXCITED);
  CHECK(same(s.theta[1], 3));
}

static void test_bad_input(void)
{
  const amb_rls rls = {1, AMB_C(0.9), 0};
  const amb_real theta[1] = {1}, known[1] = {1};
  amb_rls_state s;
  CHECK(amb_rls_reset(&rls, &s, theta, known) == AMB_OK);
  const amb_real bad[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, AMB_REAL_MAX};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    CHECK(amb_rls_step(&rls, &s, &bad[i], 1) == AMB_MISSING);
  for (size_t i = 0; i < 3; i++)
    CHECK(amb_rls_step(&rls, &s, theta, bad[i]) == AMB_MISSING);
  CHECK(same(s.theta[0], 1) && same(s.moment[0], 1));

  const amb_real none = NOT_A_NUMBER, negative = -1;
  CHECK(amb_rls_reset(&rls, &s, &none, known) == AMB_BAD_PARAMETER);
  CHECK(amb_rls_reset(&rls, &s, theta, &negative) == AMB_BAD_PARAMETER);
  const amb_rls wrong[] = {{0, AMB_C(0.9), 0},
                           {AMB_RLS_MAX + 1, AMB_C(0.9), 0},
                           {1, 0, 0},
                           {1, 1, 0},
                           {1, NOT_A_NUMBER, 0},
                           {1, AMB_C(0.9), -1},
                           {1, AMB_C(0.9), NOT_A_NUMBER}};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
    CHECK(amb_rls_reset(&wrong[i], &s, theta, known) == AMB_BAD_PARAMETER);
  CHECK(same(s.theta[0], 1));
}

static const amb_magnet_rls element = {
    .front =
        {
            .law = {.s0 = AMB_C(2e-3), .i0 = AMB_C(1.5), .two_sided = true},
            .T = AMB_C(1e-4),
            .m = AMB_C(0.518),
            .K_sen = AMB_C(0.8),
            .a_sen = AMB_C(0.6),
            .k_ui = AMB_C(1.25),
            .iu_min = AMB_C(-1.5),
            .iu_max = AMB_C(1.5),
            .f_0 = -5,
            .bandwidth = 240,
            .rate_force = AMB_C(0.05),
            .rate_k = AMB_C(0.002),
            .least_excitation = AMB_C(0.02),
        },
    .forgetting = AMB_C(0.998),
    .least_excitation = AMB_C(0.02),
    .settling = 160,
    .with_load = false,
};
static const amb_real k_true = AMB_C(6.7e-6);

static void test_settles_first(void)
{
  amb_magnet_rls_state s;
  CHECK(amb_magnet_rls_reset(&element, &s, k_true) == AMB_OK);
  const amb_real begun = s.rls.moment[0];
  unsigned int samples = 0;
  while (same(s.rls.moment[0], begun) && (samples < 1000U)) {
    (void)amb_magnet_rls_step(&element, &s, 0, AMB_C(0.5), 0);
    samples++;
  }
  CHECK(samples == element.settling + 1U);
}

static void test_learns_from_the_weight(void)
{
  const amb_real k_i =
      4 * k_true * element.front.law.i0 / (element.front.law.s0 * element.front.law.s0);
  const amb_real carrying = AMB_C(5.0) / k_i / element.front.k_ui;
  amb_magnet_rls loaded = element;
  loaded.with_load = true;
  amb_magnet_rls_state s, with_load;
  CHECK(amb_magnet_rls_reset(&element, &s, AMB_C(1.5) * k_true) == AMB_OK);
  CHECK(amb_magnet_rls_reset(&loaded, &with_load, AMB_C(1.5) * k_true) == AMB_OK);
  amb_status status = AMB_UNEXCITED, of_loaded = AMB_OK;
  for (int n = 0; n < 10000; n++) {
    status = amb_magnet_rls_step(&element, &s, 0, carrying, 0);
    of_loaded = amb_magnet_rls_step(&loaded, &with_load, 0, carrying, 0);
  }
  CHECK(status == AMB_OK);
  CHECK_WITHIN(s.k, k_true, AMB_C(1e-4));
  CHECK(same(s.load, 0));
  /* Where nothing moves, what is wrong with k looks like a load. */
  CHECK(of_loaded == AMB_UNEXCITED);
  CHECK_WITHIN(with_load.k, AMB_C(1.5) * k_true, AMB_C(1e-5));
  CHECK_WITHIN(with_load.load, AMB_C(-2.5), AMB_C(1e-3));

  const amb_magnet_rls_state before = s;
  CHECK(amb_magnet_rls_step(&element, &s, NOT_A_NUMBER, carrying, 0) == AMB_MISSING);
  CHECK(amb_magnet_rls_step(&element, &s, 0, NOT_A_NUMBER, 0) == AMB_BAD_CONTROL);
  CHECK(same(s.k, before.k) && same(s.rls.moment[0], before.rls.moment[0]));
  amb_magnet_rls wrong = element;
  wrong.forgetting = 1;
  CHECK(amb_magnet_rls_reset(&wrong, &s, k_true) == AMB_BAD_PARAMETER);
  CHECK(amb_magnet_rls_reset(&element, &s, TOO_MUCH) == AMB_BAD_PARAMETER);
  CHECK(same(s.k, before.k));
}

int main(void)
{
  test_finds_a_line();
  test_holds_what_is_not_excited();
  test_bad_input();
  test_settles_first();
  test_learns_from_the_weight();
  return failures;
}
