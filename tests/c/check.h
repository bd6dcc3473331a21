/* Checks for the C tests: each one that fails prints its place; the exit code says how many did. */
#ifndef AMBKIT_TESTS_CHECK_H
#define AMBKIT_TESTS_CHECK_H

#include "ambkit/real.h"
#include <math.h>
#include <stdio.h>

/* Not numbers, and one that no sensor gives. */
#define NOT_A_NUMBER ((amb_real)NAN)
#define TOO_MUCH ((amb_real)INFINITY)

/* A few units in the last place, for what takes a few operations. */
#if defined(AMB_FLOAT)
#define DIGITS AMB_C(4e-6)
#else
#define DIGITS AMB_C(1e-13)
#endif

static int failures = 0;

static inline bool check_at(bool good, const char *what, const char *file, int line)
{
  if (!good) {
    failures++;
    (void)fprintf(stderr, "%s:%d: %s\n", file, line, what);
  }
  return good;
}

/* |a - b| within `room` of the larger one. */
static inline void check_near_at(amb_real a, amb_real b, amb_real room, const char *what,
                                 const char *file, int line)
{
  const amb_real size_a = a < 0 ? -a : a, size_b = b < 0 ? -b : b;
  const amb_real apart = a > b ? a - b : b - a;
  if (!check_at(apart <= room * (size_a > size_b ? size_a : size_b), what, file, line))
    (void)fprintf(stderr, "    is %.17g, expected %.17g\n", (double)a, (double)b);
}

#define CHECK(condition) ((void)check_at((condition), #condition, __FILE__, __LINE__))
#define CHECK_NEAR(a, b) check_near_at((a), (b), DIGITS, #a " near " #b, __FILE__, __LINE__)
#define CHECK_WITHIN(a, b, room)                                                                   \
  check_near_at((a), (b), (room), #a " within " #room " of " #b, __FILE__, __LINE__)

/* The same bits, and not merely equal numbers: -Wfloat-equal is for those who mean something else.
 */
static inline bool same(amb_real a, amb_real b)
{
  return !(a < b) && !(a > b) && (a <= b);
}

static inline bool all_finite(const amb_real *a, size_t n)
{
  bool finite = true;
  for (size_t i = 0; i < n; i++)
    finite = finite && amb_is_finite(a[i]);
  return finite;
}

#endif
