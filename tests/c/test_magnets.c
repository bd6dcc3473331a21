/* Constant stiffness, the laws, table and surface: values, edges, and what is no number. */
#include "ambkit/exponential.h"
#include "ambkit/saturating.h"
#include "ambkit/surface.h"
#include "ambkit/table.h"
#include "check.h"
#include "generated/closed_law.h"

static const amb_law two_sided = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_law one_sided = {AMB_C(1e-4), AMB_C(1.2e-2), AMB_C(0.9), false, 1, AMB_C(1e-3)};

static void test_real(void)
{
  CHECK(amb_is_finite(0) && amb_is_finite(AMB_REAL_MAX) && amb_is_finite(-AMB_REAL_MAX));
  CHECK(!amb_is_finite(NOT_A_NUMBER) && !amb_is_finite(TOO_MUCH) && !amb_is_finite(-TOO_MUCH));
  CHECK(same(amb_clamp(5, -1, 1), 1) && same(amb_clamp(-5, -1, 1), -1));
  CHECK(same(amb_clamp(AMB_C(0.5), -1, 1), AMB_C(0.5)));
  CHECK(same(amb_clamp(TOO_MUCH, -1, 1), 1) && same(amb_clamp(-TOO_MUCH, -1, 1), -1));
  CHECK(isnan(amb_clamp(NOT_A_NUMBER, -1, 1)));
  CHECK_NEAR(AMB_ROOT_EPSILON * AMB_ROOT_EPSILON,
             sizeof(amb_real) == sizeof(float) ? (amb_real)FLT_EPSILON : (amb_real)DBL_EPSILON);
}

static void test_exponential(void)
{
  CHECK(same(amb_exp_negative(0), 1));
  CHECK_NEAR(amb_exp_negative(1), AMB_C(0.36787944117144232160));
  CHECK_NEAR(amb_exp_negative(AMB_C(0.5)), AMB_C(0.60653065971263342360));
  CHECK_NEAR(amb_exp_negative(20), AMB_C(2.0611536224385578280e-9));
  CHECK(amb_exp_negative(AMB_REAL_MAX) > 0);
  CHECK(amb_exp_negative(TOO_MUCH) > 0 && amb_exp_negative(TOO_MUCH) < AMB_C(1e-37));
  CHECK(same(amb_exp_negative(NOT_A_NUMBER), amb_exp_negative(TOO_MUCH)));
}

static void test_constant(void)
{
  const amb_stiffness k = {10, 7000};
  CHECK_NEAR(amb_constant_magnet.force(&k, AMB_C(0.5), AMB_C(-1e-4)), AMB_C(4.3));
  const amb_stiffness got = amb_constant_magnet.through_origin(&k, NOT_A_NUMBER, TOO_MUCH);
  CHECK(same(got.k_i, 10) && same(got.k_s, 7000));
  CHECK(same(amb_constant_magnet.tangent(&k, 0, 0).k_s, 7000));
}

static void test_law(const amb_law *law)
{
  const amb_real bias = law->k * amb_law_regressor(law, law->two_sided ? 1 : 0, 0, 0);
  const amb_real places[][2] = {{0, 0},
                                {AMB_C(0.3), AMB_C(2e-4)},
                                {AMB_C(-0.7), AMB_C(-5e-4)},
                                {0, AMB_C(4e-4)},
                                {AMB_C(0.2), 0}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const amb_real iu = places[i][0], x = places[i][1];
    const amb_real f = amb_law_magnet.force(law, iu, x);
    const amb_stiffness k = amb_law_magnet.through_origin(law, iu, x);
    CHECK_NEAR(f + 1, law->k * amb_law_regressor(law, law->two_sided ? 1 : 0, iu, x) - bias + 1);
    CHECK_NEAR(k.k_i * iu + k.k_s * x + 1, f + 1);
  }
  const amb_stiffness here = amb_law_magnet.tangent(law, 0, 0);
  const amb_real share = law->two_sided ? 4 : 2;
  CHECK_NEAR(here.k_i, share * law->k * law->i0 / (law->s0 * law->s0));
  CHECK_NEAR(here.k_s, share * law->k * law->i0 * law->i0 / (law->s0 * law->s0 * law->s0));
}

static void test_law_at_its_limits(void)
{
  CHECK(same(amb_law_magnet.force(&two_sided, 0, 0), 0));
  CHECK(!amb_is_finite(amb_law_magnet.force(&two_sided, 1, two_sided.s0))); /* the pole */
  CHECK(isnan(amb_law_magnet.force(&two_sided, NOT_A_NUMBER, 0)));
  CHECK(isnan(amb_law_magnet.through_origin(&two_sided, 0, NOT_A_NUMBER).k_s));
  /* So near to the origin that the square of the distance has but some digits left. */
  const amb_real near = (amb_real)sqrt(2.6 * (double)AMB_REAL_MIN) * AMB_ROOT_EPSILON;
  const amb_stiffness k = amb_law_magnet.through_origin(&two_sided, 0, near * two_sided.metre);
  CHECK_NEAR(k.k_s, amb_law_magnet.tangent(&two_sided, 0, 0).k_s);
}

/* The bearing of DESIGN.md, and the same without iron. */
static void test_saturating(void)
{
  const amb_saturating_law iron = {AMB_C(3.64158026e-6), AMB_C(0.78e-3),       AMB_C(2.5),
                                   AMB_C(5e-5),          AMB_C(8.16816340e-5), true,
                                   AMB_C(1.6667),        AMB_C(0.39e-3)};
  const amb_stiffness k = amb_saturating_magnet.tangent(&iron, 0, 0);
  CHECK((k.k_i > AMB_C(49.659)) && (k.k_i < AMB_C(49.661)));
  CHECK((k.k_s > AMB_C(146760.0)) && (k.k_s < AMB_C(146768.0)));
  const amb_real f = amb_saturating_magnet.force(&iron, AMB_C(2.5), 0);
  CHECK((f > AMB_C(119.215)) && (f < AMB_C(119.217)));
  CHECK(same(amb_saturating_magnet.force(&iron, 0, 0), 0));
  CHECK(isnan(amb_saturating_magnet.force(&iron, 0, NOT_A_NUMBER)));
  const amb_saturating_law ideal = {iron.k, iron.s0, iron.i0, 0, 0, true, 1, AMB_C(1e-3)};
  const amb_law law = {iron.k, iron.s0, iron.i0, true, 1, AMB_C(1e-3)};
  const amb_stiffness here = amb_saturating_magnet.through_origin(&ideal, AMB_C(0.7), AMB_C(1e-4));
  const amb_stiffness there = amb_law_magnet.through_origin(&law, AMB_C(0.7), AMB_C(1e-4));
  CHECK_NEAR(here.k_i, there.k_i);
  CHECK_NEAR(here.k_s, there.k_s);
}

static void test_surface(void)
{
  /* F = 2 iu + 3 x + iu x over iu from -1 to 1, x from -1 to 1, the origin in the middle. */
  amb_force_node nodes[9];
  for (int r = 0; r < 3; r++) {
    for (int c = 0; c < 3; c++) {
      const amb_real iu = (amb_real)(c - 1), x = (amb_real)(r - 1);
      const amb_force_node node = {2 * iu + 3 * x + iu * x, 2 + x, 3 + iu, 1};
      nodes[3 * r + c] = node;
    }
  }
  const amb_surface surface = {3, 3, 2, 2, -1, 1, 1, -1, 1, 1, 1, 1, nodes};
  const amb_real places[][2] = {
      {AMB_C(0.3), AMB_C(-0.6)}, {1, 1}, {-1, 1}, {3, -4}, {-2, AMB_C(0.5)}};
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    const amb_real iu = places[i][0], x = places[i][1];
    CHECK_NEAR(amb_surface_magnet.force(&surface, iu, x) + 30, 2 * iu + 3 * x + iu * x + 30);
    const amb_stiffness k = amb_surface_magnet.tangent(&surface, iu, x);
    CHECK_NEAR(k.k_i + 30, 2 + x + 30);
    CHECK_NEAR(k.k_s + 30, 3 + iu + 30);
  }
  CHECK(same(amb_surface_magnet.force(&surface, 0, 0), 0));
  CHECK(isnan(amb_surface_magnet.force(&surface, NOT_A_NUMBER, 0)));
  CHECK(isnan(amb_surface_magnet.through_origin(&surface, 0, NOT_A_NUMBER).k_s));
}

static void test_table(void)
{
  /* k_i = 1 + r, k_s = 10 + c at node (r, c); x from -1 to 1 by 1, iu from 0 to 2 by 2. */
  const amb_stiffness nodes[6] = {{1, 10}, {1, 11}, {2, 10}, {2, 11}, {3, 10}, {3, 11}};
  const amb_table table = {3, 2, 2, 1, -1, 1, 0, AMB_C(0.5), nodes};
  amb_stiffness k = amb_table_magnet.through_origin(&table, 2, 1); /* the last node */
  CHECK(same(k.k_i, 3) && same(k.k_s, 11));
  k = amb_table_magnet.through_origin(&table, 1, AMB_C(-0.5));
  CHECK_NEAR(k.k_i, AMB_C(1.5));
  CHECK_NEAR(k.k_s, AMB_C(10.5));
  CHECK_NEAR(amb_table_magnet.force(&table, 1, AMB_C(-0.5)), AMB_C(1.5) - AMB_C(5.25));
  k = amb_table_magnet.tangent(&table, 1, AMB_C(-0.5)); /* k_i + iu dk_i/diu + x dk_s/diu, ... */
  CHECK_NEAR(k.k_i, AMB_C(1.5) - AMB_C(0.25));
  CHECK_NEAR(k.k_s, AMB_C(10.5) + 1);

  const amb_real outside[] = {3, -9, AMB_REAL_MAX, -AMB_REAL_MAX, TOO_MUCH, -TOO_MUCH};
  for (size_t i = 0; i < sizeof outside / sizeof *outside; i++) {
    const bool above = outside[i] > 0;
    k = amb_table_magnet.through_origin(&table, outside[i], outside[i]);
    CHECK(same(k.k_i, above ? 3 : 1) && same(k.k_s, above ? 11 : 10));
  }
  CHECK(isnan(amb_table_magnet.through_origin(&table, NOT_A_NUMBER, 0).k_s));
  CHECK(isnan(amb_table_magnet.through_origin(&table, 0, NOT_A_NUMBER).k_i));
  CHECK(isnan(amb_table_magnet.tangent(&table, NOT_A_NUMBER, NOT_A_NUMBER).k_i));
  CHECK(isnan(amb_table_magnet.force(&table, NOT_A_NUMBER, NOT_A_NUMBER)));
}

int main(void)
{
  test_real();
  test_exponential();
  test_constant();
  test_law(&two_sided);
  test_law(&one_sided);
  test_law_at_its_limits();
  test_saturating();
  test_surface();
  test_table();
  return failures;
}
