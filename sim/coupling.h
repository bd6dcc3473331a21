/* Two axes whose magnets share their iron. Their forces are derivatives of one coenergy, so that no
 * closed loop of currents and displacements does work.
 *
 * W = sum_k c_k T_a(i_1) T_b(i_2) T_c(s_1) T_d(s_2),   F_1 = dW/ds_1,   F_2 = dW/ds_2
 *
 * with Chebyshev polynomials T of currents and displacements over their ranges.
 */
#ifndef AMBKIT_SIM_COUPLING_H
#define AMBKIT_SIM_COUPLING_H

#include "ambkit/real.h"

#define AMB_COUPLING_DEGREES 16

typedef struct amb_coupling {
  int first, second; /* axes */
  int terms;
  const int *degree;       /* [terms][4], each less than AMB_COUPLING_DEGREES */
  const amb_real *energy;  /* [terms] [J] */
  amb_real current, place; /* maximum magnitudes [A], [m]; beyond them the force is constant */
} amb_coupling;

/* Forces [N] at control currents i [A] and displacements s [m]. */
void amb_coupling_force(const amb_coupling *of, const amb_real i[2], const amb_real s[2],
                        amb_real F[2]);

#endif
