/* The magnet constant by recursive least squares, from the same force and regressor as ADALINE's.
 *
 * ADALINE's first element (paper, eq. 24) finds the force of the magnet, and delays the regressor
 * phi of eq. 25 alike. Its second, a gradient step, is replaced by least squares (ambkit/rls.h) in
 *     F_Magnet = load + k phi,
 * with a load that need not be known: what does not move with phi is not taken for k. Without
 * `with_load` the load counts as known, and the element answers the same question as eq. 25.
 */
#ifndef AMBKIT_MAGNET_RLS_H
#define AMBKIT_MAGNET_RLS_H

#include "ambkit/adaline.h"
#include "ambkit/rls.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_magnet_rls {
  amb_adaline front;   /* its first element; rate_k and least_excitation count for its own k */
  amb_real forgetting; /* as in amb_rls */
  amb_real least_excitation; /* root mean square of phi, or with a load of what moves of it, over
                                phi at iu = i0, x = 0 [1]: below it k is held */
  unsigned int settling;     /* samples until the force has settled that ADALINE starts from */
  bool with_load;
} amb_magnet_rls;

typedef struct amb_magnet_rls_state {
  amb_adaline_state front;
  amb_rls_state rls;
  amb_real k;           /* identified magnet constant [N m^2/A^2] */
  amb_real load;        /* identified force that the magnet is taken to lack [N]; 0 without */
  amb_real excitation;  /* mean square of what k is learned from [1] */
  unsigned int samples; /* that counted, up to `settling` */
} amb_magnet_rls_state;

/* Start from a magnet constant, and no load. Returns AMB_OK or AMB_BAD_PARAMETER. */
amb_status amb_magnet_rls_reset(const amb_magnet_rls *m, amb_magnet_rls_state *state, amb_real k);

/* One sample, as amb_adaline_step; AMB_UNEXCITED where k is held. */
amb_status amb_magnet_rls_step(const amb_magnet_rls *m, amb_magnet_rls_state *state, amb_real y,
                               amb_real u, amb_real f_d);

AMB_EXTERN_C_END

#endif
