/* ADALINE on a rotor at rest under its weight, unexcited, and with what is no number. */
#include "ambkit/adaline.h"
#include "check.h"

static const amb_adaline element = {
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
};
static const amb_real k_true = AMB_C(6.7e-6);

/* Control signal that carries the rotor at x = 0. */
static amb_real carrying(void)
{
  const amb_real k_i = 4 * k_true * element.law.i0 / (element.law.s0 * element.law.s0);
  return AMB_C(5.0) / k_i / element.k_ui;
}

static void test_learns_from_the_weight(void)
{
  amb_adaline_state s;
  amb_adaline_reset(&s, AMB_C(1.5) * k_true);
  CHECK(amb_adaline_step(&element, &s, 0, carrying(), 0) == AMB_UNEXCITED);
  amb_status last = AMB_UNEXCITED;
  for (int n = 0; n < 10000; n++)
    last = amb_adaline_step(&element, &s, 0, carrying(), 0);
  CHECK(last == AMB_OK);
  CHECK_WITHIN(s.k, k_true, AMB_C(1e-4));
  CHECK_WITHIN(s.force, 5, AMB_C(1e-4));
  CHECK(s.excitation > element.least_excitation * element.least_excitation);
}

static void test_holds_still(void)
{
  amb_adaline horizontal = element;
  horizontal.f_0 = 0;
  amb_adaline_state s;
  amb_adaline_reset(&s, 1);
  for (int n = 0; n < 1000; n++)
    CHECK(amb_adaline_step(&horizontal, &s, 0, 0, 0) == AMB_UNEXCITED);
  CHECK(same(s.k, 1) && same(s.excitation, 0));
}

static void test_bad_input(void)
{
  const amb_real s0 = element.law.s0;
  const amb_real no_place[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH, s0, -s0, AMB_REAL_MAX};
  const amb_real no_number[] = {NOT_A_NUMBER, TOO_MUCH, -TOO_MUCH};
  amb_adaline_state s;
  amb_adaline_reset(&s, k_true);
  CHECK(amb_adaline_step(&element, &s, NOT_A_NUMBER, 0, 0) == AMB_MISSING && !s.started);
  (void)amb_adaline_step(&element, &s, AMB_C(1e-5), AMB_C(0.4), 0);
  (void)amb_adaline_step(&element, &s, AMB_C(2e-5), AMB_C(0.4), 0);
  const amb_adaline_state before = s;
  for (size_t i = 0; i < sizeof no_place / sizeof *no_place; i++)
    CHECK(amb_adaline_step(&element, &s, no_place[i], AMB_C(0.4), 0) == AMB_MISSING);
  for (size_t i = 0; i < sizeof no_number / sizeof *no_number; i++) {
    CHECK(amb_adaline_step(&element, &s, 0, no_number[i], 0) == AMB_BAD_CONTROL);
    CHECK(amb_adaline_step(&element, &s, 0, 0, no_number[i]) == AMB_BAD_CONTROL);
  }
  CHECK(same(s.x, before.x) && same(s.v, before.v) && same(s.phi, before.phi) &&
        same(s.force, before.force) && same(s.k, before.k) && same(s.last_y, before.last_y));
  /* Next to the pole, and with a current far beyond its limit, everything stays a number. */
  const amb_real nearly = s0 * element.K_sen * (1 - 4 * AMB_ROOT_EPSILON * AMB_ROOT_EPSILON);
  (void)amb_adaline_step(&element, &s, nearly, AMB_REAL_MAX, 0);
  for (int n = 0; n < 1000; n++)
    (void)amb_adaline_step(&element, &s, 0, carrying(), 0);
  CHECK(amb_is_finite(s.k) && amb_is_finite(s.force) && amb_is_finite(s.excitation));
}

int main(void)
{
  test_learns_from_the_weight();
  test_holds_still();
  test_bad_input();
  return failures;
}
