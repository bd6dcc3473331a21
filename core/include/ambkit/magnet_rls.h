/* The magnet constant by recursive least squares, from the force and regressor of ADALINE.
 *
 * ADALINE's first element (paper, eq. 24) identifies the force of the magnet, and delays the
 * regressor phi of eq. 25 equally. Its second, a gradient step, is replaced by least squares
 * (ambkit/rls.h) in F_Magnet = load + k phi, with an unknown load: forces that do not vary with phi
 * do not bias k. Without `with_load` the load is assumed to be known, as in eq. 25.
 */
#ifndef AMBKIT_MAGNET_RLS_H
#define AMBKIT_MAGNET_RLS_H

#include "ambkit/adaline.h"
#include "ambkit/rls.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_magnet_rls {
  amb_adaline front;   /* its first element; rate_k and least_excitation affect its own k only */
  amb_real forgetting; /* as in amb_rls */
  amb_real least_excitation; /* root mean square of phi, or with a load of its varying part, over
                                phi at iu = i0, x = 0 [1]: below it k is held */
  unsigned int settling;     /* samples until ADALINE's initial force has settled */
  bool with_load;
} amb_magnet_rls;

typedef struct amb_magnet_rls_state {
  amb_adaline_state front;
  amb_rls_state rls;
  amb_real k;           /* identified magnet constant [N m^2/A^2] */
  amb_real load;        /* identified load [N]; 0 without */
  amb_real excitation;  /* mean square excitation of k [1] */
  unsigned int samples; /* number of samples, up to `settling` */
} amb_magnet_rls_state;

/* Start from a magnet constant, without load. Returns AMB_OK or AMB_BAD_PARAMETER. */
amb_status amb_magnet_rls_reset(const amb_magnet_rls *m, amb_magnet_rls_state *state, amb_real k);

/* One sample, as in amb_adaline_step; AMB_UNEXCITED if k is held. */
amb_status amb_magnet_rls_step(const amb_magnet_rls *m, amb_magnet_rls_state *state, amb_real y,
                               amb_real u, amb_real f_d);

AMB_EXTERN_C_END

#endif
