#include "ambkit/fuzzy.h"
#include "ambkit/exponential.h"

/* An output and its derivatives after iu [A] and x [m]. */
typedef struct surface {
  amb_real value, d_iu, d_x;
} surface;

static void memberships(const amb_fuzzy *net, const amb_real *sharpness, amb_real p, amb_real q,
                        amb_real *u)
{
  amb_real least = AMB_REAL_MAX;
  for (int r = 0; r < net->rules; r++) {
    const amb_real dp = p - net->centre_iu[r], dq = q - net->centre_x[r];
    u[r] = (dp * dp + dq * dq) * sharpness[r];
    least = u[r] < least ? u[r] : least;
  }
  const amb_real taken_out = net->normalised ? least : AMB_C(0.0);
  for (int r = 0; r < net->rules; r++)
    u[r] = amb_exp_negative(u[r] - taken_out);
}

void amb_fuzzy_membership(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real iu,
                          amb_real x, amb_real *out)
{
  memberships(net, output->sharpness, amb_clamp(iu, net->iu_min, net->iu_max) * net->per_ampere,
              amb_clamp(x, net->x_min, net->x_max) * net->per_metre, out);
}

static amb_real value(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real p, amb_real q)
{
  amb_real u[AMB_FUZZY_MAX_RULES];
  memberships(net, output->sharpness, p, q, u);
  amb_real sum = 0, weighted = 0;
  for (int r = 0; r < net->rules; r++) {
    sum += u[r];
    weighted += output->weight[r] * u[r];
  }
  return net->normalised ? weighted / sum : weighted;
}

static amb_stiffness fuzzy_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_fuzzy *net = (const amb_fuzzy *)self;
  const amb_real p = amb_clamp(iu, net->iu_min, net->iu_max) * net->per_ampere;
  const amb_real q = amb_clamp(x, net->x_min, net->x_max) * net->per_metre;
  const amb_stiffness k = {value(net, &net->k_i, p, q), value(net, &net->k_s, p, q)};
  return k;
}

static amb_real fuzzy_force(const void *self, amb_real iu, amb_real x)
{
  const amb_stiffness k = fuzzy_through_origin(self, iu, x);
  return k.k_i * iu + k.k_s * x;
}

static surface with_slopes(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real iu,
                           amb_real x)
{
  const amb_real p = iu * net->per_ampere, q = x * net->per_metre;
  amb_real u[AMB_FUZZY_MAX_RULES];
  memberships(net, output->sharpness, p, q, u);
  amb_real sum = 0, sum_p = 0, sum_q = 0, weighted = 0, weighted_p = 0, weighted_q = 0;
  for (int r = 0; r < net->rules; r++) {
    const amb_real slope = -2 * output->sharpness[r] * u[r];
    const amb_real u_p = slope * (p - net->centre_iu[r]), u_q = slope * (q - net->centre_x[r]);
    sum += u[r];
    sum_p += u_p;
    sum_q += u_q;
    weighted += output->weight[r] * u[r];
    weighted_p += output->weight[r] * u_p;
    weighted_q += output->weight[r] * u_q;
  }
  surface s = {weighted, weighted_p, weighted_q};
  if (net->normalised) {
    s.value = weighted / sum;
    s.d_iu = (weighted_p - s.value * sum_p) / sum;
    s.d_x = (weighted_q - s.value * sum_q) / sum;
  }
  s.d_iu *= net->per_ampere;
  s.d_x *= net->per_metre;
  return s;
}

static amb_stiffness fuzzy_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_fuzzy *net = (const amb_fuzzy *)self;
  const amb_real held_iu = amb_clamp(iu, net->iu_min, net->iu_max);
  const amb_real held_x = amb_clamp(x, net->x_min, net->x_max);
  const surface k_i = with_slopes(net, &net->k_i, held_iu, held_x);
  const surface k_s = with_slopes(net, &net->k_s, held_iu, held_x);
  /* Held at the edge, the stiffnesses do not change with what lies outside. */
  const amb_real in_iu = held_iu == iu ? AMB_C(1.0) : AMB_C(0.0);
  const amb_real in_x = held_x == x ? AMB_C(1.0) : AMB_C(0.0);
  const amb_stiffness k = {k_i.value + in_iu * (k_i.d_iu * iu + k_s.d_iu * x),
                           k_s.value + in_x * (k_i.d_x * iu + k_s.d_x * x)};
  return k;
}

const amb_magnet_methods amb_fuzzy_magnet = {fuzzy_force, fuzzy_through_origin, fuzzy_tangent};
