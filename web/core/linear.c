/* The filter in the loop as a linear system at the operating point, for the margins. */
#include "ambkit/sampling.h"
#include "axis.h"

#define EXPORT(name) __attribute__((export_name(#name)))
#define SETTLED 4000 /* samples until a gain has settled */

/* A filter of this kind at the control current iu [A] and the displacement x [m]: the transition A
 * (16, row by row), the control's column B (4), the gain K (4), and the plant's k_i, k_s. NULL
 * where there is no filter. */
EXPORT(linearised) double *linearised(const double *parameters, int kind, double current, double x)
{
  static double to[26];
  static wb_filter filter;
  const wb_parameters *p = (const wb_parameters *)parameters;
  const amb_law plant = wb_law(p, 1.0);
  const amb_stiffness stiff = amb_law_magnet.tangent(&plant, current, x);
  amb_kalman_result result;
  amb_real none[AMB_STATES] = {0};
  if (!wb_make_filter(p, WB_LINEAR, &filter))
    return NULL;
  if ((kind == WB_CLOSED_LAW) || (kind == WB_ADAPTIVE))
    filter.constant = amb_law_magnet.through_origin(&filter.law, current, x);
  else if (kind != WB_LINEAR)
    filter.constant = amb_law_magnet.tangent(&filter.law, current, x);
  const amb_estimator *of = &filter.estimator;
  const amb_real zero[1] = {0}, one[1] = {1};
  of->methods->advance(of, 1, zero, none);
  for (int j = 0; j <= AMB_STATES; j++) {
    amb_real mean[AMB_STATES] = {0};
    if (j < AMB_STATES)
      mean[j] = filter.kf.set.cap[j] * 1e-3;
    of->methods->advance(of, 1, j < AMB_STATES ? zero : one, mean);
    for (int i = 0; i < AMB_STATES; i++) {
      if (j < AMB_STATES)
        to[i * AMB_STATES + j] = (mean[i] - none[i]) / (filter.kf.set.cap[j] * 1e-3);
      else
        to[16 + i] = (mean[i] - none[i]) * p->gain;
    }
  }
  filter.kf.set.frozen_limit = 0U; /* the reading is always the same */
  amb_kalman_state *state = &filter.state.base;
  const amb_real u[1] = {current / p->gain}, y[1] = {p->K_sen * x};
  (void)amb_kalman_reset(&filter.kf, state, none, filter.std);
  for (int n = 0; n < SETTLED; n++) {
    const amb_real at[AMB_STATES] = {x, 0, 0, p->K_sen * x};
    amb_copy(AMB_STATES, at, state->mean);
    (void)of->methods->predict(of, state, u, &result);
    amb_copy(AMB_STATES, at, state->mean);
    (void)of->methods->update(of, state, y, &result);
  }
  const double R = filter.kf.set.var_y[0] + p->step * p->step / 12;
  for (int i = 0; i < AMB_STATES; i++)
    to[20 + i] = state->cov[amb_entry(AMB_STATES, i, 3)] / R;
  to[24] = stiff.k_i;
  to[25] = stiff.k_s;
  return to;
}

#define ORDER 5 /* of the plant that the page samples */

/* The plant's rates, row by row, for the page to write; `transition` puts their exponential there.
 */
EXPORT(rates) double *rates(void)
{
  static double A[ORDER * ORDER];
  return A;
}

EXPORT(transition) int transition(double time)
{
  double Phi[ORDER * ORDER], work[AMB_SAMPLING_WORK(ORDER)];
  const bool finite = amb_transition(ORDER, rates(), time, Phi, work);
  amb_copy(ORDER * ORDER, Phi, rates());
  return finite ? 1 : 0;
}
