#include "coupling.h"

/* T_n(u) and its derivatives by recurrence (Abramowitz and Stegun 1964, 22.7.4). */
static void polynomials(amb_real u, amb_real T[], amb_real slope[])
{
  const amb_real at = amb_clamp(u, -1, 1);
  T[0] = 1;
  T[1] = at;
  slope[0] = 0;
  slope[1] = 1;
  for (int n = 1; n + 1 < AMB_COUPLING_DEGREES; n++) {
    T[n + 1] = 2 * at * T[n] - T[n - 1];
    slope[n + 1] = 2 * T[n] + 2 * at * slope[n] - slope[n - 1];
  }
}

void amb_coupling_force(const amb_coupling *of, const amb_real i[2], const amb_real s[2],
                        amb_real F[2])
{
  amb_real T[4][AMB_COUPLING_DEGREES], slope[4][AMB_COUPLING_DEGREES];
  for (int k = 0; k < 2; k++) {
    polynomials(i[k] / of->current, T[k], slope[k]);
    polynomials(s[k] / of->place, T[2 + k], slope[2 + k]);
  }
  amb_real sum[2] = {0, 0};
  for (int n = 0; n < of->terms; n++) {
    const int *d = &of->degree[4 * n];
    const amb_real by_currents = of->energy[n] * T[0][d[0]] * T[1][d[1]];
    sum[0] += by_currents * slope[2][d[2]] * T[3][d[3]];
    sum[1] += by_currents * T[2][d[2]] * slope[3][d[3]];
  }
  F[0] = sum[0] / of->place;
  F[1] = sum[1] / of->place;
}
