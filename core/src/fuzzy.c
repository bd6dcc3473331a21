#include "ambkit/fuzzy.h"
#include "ambkit/exponential.h"

/* An output and its derivatives with respect to iu [A] and x [m]. */
typedef struct surface {
  amb_real value;
  amb_real d_iu;
  amb_real d_x;
} surface;

/* Sums of two arrays over the rules, in four interleaved chains: this hides the latency of the
 * adder, and fixes the order of the additions for every compiler. */
typedef struct sums {
  amb_real plain;
  amb_real weighted;
} sums;

static sums add_up(const amb_real *u, const amb_real *weight, int rules)
{
  amb_real s[4] = {AMB_C(0.0), AMB_C(0.0), AMB_C(0.0), AMB_C(0.0)};
  amb_real w[4] = {AMB_C(0.0), AMB_C(0.0), AMB_C(0.0), AMB_C(0.0)};
  int r = 0;
  for (; (r + 4) <= rules; r += 4) {
    for (int lane = 0; lane < 4; lane++) {
      s[lane] += u[r + lane];
      w[lane] += weight[r + lane] * u[r + lane];
    }
  }
  for (; r < rules; r++) {
    s[0] += u[r];
    w[0] += weight[r] * u[r];
  }
  const sums total = {(s[0] + s[1]) + (s[2] + s[3]), (w[0] + w[1]) + (w[2] + w[3])};
  return total;
}

static void exponents(const amb_fuzzy *net, const amb_real *sharpness, amb_real p, amb_real q,
                      amb_real *e)
{
  for (int r = 0; r < net->rules; r++) {
    const amb_real dp = p - net->centre_iu[r];
    const amb_real dq = q - net->centre_x[r];
    e[r] = (dp * dp + dq * dq) * sharpness[r];
  }
}

/* Terms of both outputs, which share the distances. */
static void both_exponents(const amb_fuzzy *net, amb_real p, amb_real q, amb_real *e_i,
                           amb_real *e_s)
{
  const int rules = net->rules;
  for (int r = 0; r < rules; r++) {
    const amb_real dp = p - net->centre_iu[r];
    const amb_real dq = q - net->centre_x[r];
    const amb_real square = dp * dp + dq * dq;
    e_i[r] = square * net->k_i.sharpness[r];
    e_s[r] = square * net->k_s.sharpness[r];
  }
}

static void exponentials(amb_real *e, int n)
{
  for (int r = 0; r < n; r++) {
    e[r] = amb_exp_negative(e[r]);
  }
}

/* Sums of one output from its memberships u. If a normalised network is so far from every rule that
 * all memberships vanish, the smallest exponent is subtracted from all first. */
static sums total(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real p, amb_real q,
                  amb_real *u)
{
  sums s = add_up(u, output->weight, net->rules);
  if (net->normalised && !(s.plain >= AMB_C(1e-6))) {
    exponents(net, output->sharpness, p, q, u);
    amb_real least = u[0];
    for (int r = 1; r < net->rules; r++) {
      least = amb_at_most(u[r], least);
    }
    for (int r = 0; r < net->rules; r++) {
      u[r] = amb_at_least(u[r] - least, AMB_C(0.0));
    }
    exponentials(u, net->rules);
    s = add_up(u, output->weight, net->rules);
    s.plain = amb_at_least(s.plain, AMB_C(1.0)); /* the nearest rule contributes 1 */
  }
  return s;
}

static sums memberships(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real p,
                        amb_real q, amb_real *u)
{
  exponents(net, output->sharpness, p, q, u);
  exponentials(u, net->rules);
  return total(net, output, p, q, u);
}

void amb_fuzzy_basis(const amb_fuzzy *net, const amb_fuzzy_output *output, amb_real iu, amb_real x,
                     amb_real *out)
{
  const sums s = memberships(net, output, amb_clamp(iu, net->iu_min, net->iu_max) * net->per_ampere,
                             amb_clamp(x, net->x_min, net->x_max) * net->per_metre, out);
  if (net->normalised) {
    for (int r = 0; r < net->rules; r++) {
      out[r] /= s.plain;
    }
  }
}

/* Both outputs together: one loop over twice as many exponentials fills the vector registers. */
static amb_stiffness fuzzy_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_fuzzy *net = (const amb_fuzzy *)self;
  const amb_real p = amb_clamp(iu, net->iu_min, net->iu_max) * net->per_ampere;
  const amb_real q = amb_clamp(x, net->x_min, net->x_max) * net->per_metre;
  amb_real u[2 * AMB_FUZZY_MAX_RULES];
  amb_real *const u_s = &u[net->rules];
  both_exponents(net, p, q, u, u_s);
  exponentials(u, 2 * net->rules);
  const sums i = total(net, &net->k_i, p, q, u);
  const sums s = total(net, &net->k_s, p, q, u_s);
  amb_stiffness k = {i.weighted, s.weighted};
  if (net->normalised) {
    k.k_i /= i.plain;
    k.k_s /= s.plain;
  }
  k.k_i = amb_clamp(k.k_i, -AMB_STIFFEST, AMB_STIFFEST);
  k.k_s = amb_clamp(k.k_s, -AMB_STIFFEST, AMB_STIFFEST);
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
  const amb_real p = iu * net->per_ampere;
  const amb_real q = x * net->per_metre;
  amb_real u[AMB_FUZZY_MAX_RULES];
  const sums both = memberships(net, output, p, q, u);
  amb_real sum_p = AMB_C(0.0);
  amb_real sum_q = AMB_C(0.0);
  amb_real weighted_p = AMB_C(0.0);
  amb_real weighted_q = AMB_C(0.0);
  for (int r = 0; r < net->rules; r++) {
    const amb_real slope = AMB_C(-2.0) * output->sharpness[r] * u[r];
    const amb_real u_p = slope * (p - net->centre_iu[r]);
    const amb_real u_q = slope * (q - net->centre_x[r]);
    sum_p += u_p;
    sum_q += u_q;
    weighted_p += output->weight[r] * u_p;
    weighted_q += output->weight[r] * u_q;
  }
  surface s = {both.weighted, weighted_p, weighted_q};
  if (net->normalised) {
    s.value = both.weighted / both.plain;
    s.d_iu = (weighted_p - s.value * sum_p) / both.plain;
    s.d_x = (weighted_q - s.value * sum_q) / both.plain;
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
  /* Beyond the box the stiffnesses are constant, and their derivatives zero. */
  const amb_real in_iu = (held_iu == iu) ? AMB_C(1.0) : AMB_C(0.0);
  const amb_real in_x = (held_x == x) ? AMB_C(1.0) : AMB_C(0.0);
  const amb_stiffness k = {k_i.value + in_iu * (k_i.d_iu * iu + k_s.d_iu * x),
                           k_s.value + in_x * (k_i.d_x * iu + k_s.d_x * x)};
  return k;
}

const amb_magnet_methods amb_fuzzy_magnet = {fuzzy_force, fuzzy_through_origin, fuzzy_tangent};
