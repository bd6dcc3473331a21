#include "ambkit/magnet_rls.h"

/* Scaling of phi, so that both regressors are of order one: 1 for the load, phi over this for k. */
static amb_real reference_of(const amb_law *law)
{
  const amb_real own = (AMB_C(2.0) * law->i0) / law->s0;
  return law->two_sided ? (own * own) : (AMB_C(0.25) * own * own);
}

static amb_rls rls_of(const amb_magnet_rls *m)
{
  const amb_rls rls = {m->with_load ? 2U : 1U, m->forgetting, m->least_excitation};
  return rls;
}

amb_status amb_magnet_rls_reset(const amb_magnet_rls *m, amb_magnet_rls_state *state, amb_real k)
{
  const amb_rls rls = rls_of(m);
  const size_t last = rls.n - 1U;
  const amb_real least = m->least_excitation * m->least_excitation;
  amb_real theta[2] = {AMB_C(0.0), AMB_C(0.0)};
  /* The initial k has the weight of just sufficient excitation. The load has none: it is fitted
   * from the first sample on. */
  amb_real known[2] = {AMB_C(0.0), AMB_C(0.0)};
  known[last] = least;
  theta[last] = k * reference_of(&m->front.law);
  amb_magnet_rls_state fresh = {0};
  const amb_status status = amb_rls_reset(&rls, &fresh.rls, theta, known);
  if (status != AMB_OK) {
    return status;
  }
  amb_adaline_reset(&fresh.front, k);
  fresh.k = k;
  *state = fresh;
  return AMB_OK;
}

amb_status amb_magnet_rls_step(const amb_magnet_rls *m, amb_magnet_rls_state *s, amb_real y,
                               amb_real u, amb_real f_d)
{
  const amb_status seen = amb_adaline_step(&m->front, &s->front, y, u, f_d) & ~AMB_UNEXCITED;
  if (seen != AMB_OK) {
    return seen;
  }
  if (s->samples < m->settling) {
    s->samples++;
    return AMB_UNEXCITED;
  }
  const amb_rls rls = rls_of(m);
  const size_t last = rls.n - 1U;
  const amb_real reference = reference_of(&m->front.law);
  amb_real phi[2] = {AMB_C(1.0), AMB_C(1.0)};
  phi[last] = s->front.phi_late / reference;
  const amb_status status = amb_rls_step(&rls, &s->rls, phi, s->front.force);
  s->k = s->rls.theta[last] / reference;
  s->load = m->with_load ? s->rls.theta[0] : AMB_C(0.0);
  s->excitation = s->rls.excitation[last];
  const amb_real least = m->least_excitation * m->least_excitation;
  return ((status == AMB_OK) || ((status == AMB_UNEXCITED) && (s->excitation >= least))) ? AMB_OK
                                                                                         : status;
}
