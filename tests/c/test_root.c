/* The square root: its error over all of the range, and what is no normal number. */
#include "ambkit/root.h"
#include "check.h"

static void test_error(void)
{
  /* Across a power of four the start has each error there is; then the exponents. */
  amb_real worst = 0;
  for (int i = 0; i < 30000; i++) {
    const double a = 1.0 + i * 1e-4;
    const double root = (double)amb_root((amb_real)a);
    const double right = sqrt((double)(amb_real)a);
    const amb_real off = (amb_real)fabs(root / right - 1.0);
    worst = off > worst ? off : worst;
  }
#if defined(AMB_FLOAT)
  CHECK(worst < AMB_C(1.5) * FLT_EPSILON);
  const int least = -126, most = 127;
#else
  CHECK(worst < 1.5 * DBL_EPSILON);
  const int least = -1022, most = 1023;
#endif
  for (int exponent = least; exponent <= most; exponent++) {
    const amb_real a = (amb_real)ldexp(1.7, exponent);
    CHECK_WITHIN(amb_root(a), (amb_real)sqrt((double)a), DIGITS);
  }
}

static void test_zero(void)
{
  CHECK(same(amb_root(0), 0));
  CHECK(amb_root(AMB_REAL_MIN) > 0);
}

int main(void)
{
  test_error();
  test_zero();
  return failures;
}
