/* From the machine's parameters to a filter: what Python's `View` and kinds state, in C. */
#include "axis.h"
#include <math.h>

#define GRAVITY 9.81
#define SHORTEST_LAG 1e-3 /* of a sample */

amb_law wb_law(const wb_parameters *p, double scale)
{
  const amb_law law = {.k = p->k * scale,
                       .s0 = p->s0,
                       .i0 = p->i0,
                       .two_sided = p->two_sided > 0,
                       .ampere = p->i0 / 1.5,
                       .metre = p->s0 / 2};
  return law;
}

double wb_bias_force(const amb_law *law)
{
  return law->two_sided ? 0.0 : -amb_law_magnet.force(law, -law->i0, 0.0);
}

double wb_weight(const wb_parameters *p)
{
  return p->gravity * p->mass * GRAVITY;
}

double wb_least_current(const wb_parameters *p)
{
  const bool both = (p->two_sided > 0) || (p->current_limit < p->i0);
  return both ? -p->current_limit : -p->i0;
}

double wb_lag(const wb_parameters *p)
{
  return p->lag > SHORTEST_LAG * p->T ? p->lag : SHORTEST_LAG * p->T;
}

/* sqrt(m/|k_s|), in which the rotor falls away by e [s]. */
static double own_time(const wb_parameters *p, const amb_law *law)
{
  return sqrt(p->mass / amb_magnitude(amb_law_magnet.tangent(law, 0.0, 0.0).k_s));
}

/* Growth of the load's variance by default [N^2/s]. */
static double usual_intensity(const wb_parameters *p, const amb_law *law)
{
  const double T = p->T, R = (p->step * p->step / 12 + p->noise_y) / (p->K_sen * p->K_sen);
  const double by_lag = 1 / (1.5 * T + p->lag), by_pole = 8 / own_time(p, law);
  const double w = by_lag > by_pole ? by_lag : by_pole;
  const double by_current = amb_law_magnet.tangent(law, 0.0, 0.0).k_i * p->gain;
  const double inertia = p->mass * (w * w), twice = 2 * (p->mass * GRAVITY);
  const double known = R * (inertia * inertia) + p->noise_u * (by_current * by_current);
  const double most = twice * twice, least = known * T * (w * w);
  return most < least ? most : least;
}

static amb_kalman_settings settings_of(const wb_parameters *p, const amb_law *law)
{
  const double T = p->T, travel = p->clearance, fast = 0.1 * (travel / T);
  const double Q = p->filter_Q > 0 ? p->filter_Q : usual_intensity(p, law);
  const double half = 0.5 * own_time(p, law) / T;
  const amb_kalman_settings set = {
      .T = T,
      .K_sen = {p->K_sen},
      .lag = {wb_lag(p)},
      .travel = {travel},
      .k_ui = {p->gain},
      .iu_min = {wb_least_current(p)},
      .iu_max = {p->current_limit},
      .f_0 = {wb_weight(p) + wb_bias_force(law)},
      .x_max = {travel},
      .cap = {travel, fast, p->mass * (0.1 * (travel / T) / T),
              3 * amb_magnitude(p->K_sen) * travel},
      .var_u = {p->noise_u},
      .var_d = {T * Q},
      .var_y = {p->filter_R > 0 ? p->filter_R : p->noise_y},
      .rise = {0},
      .step = {p->step},
      .dwell = half > 10.0 ? half : 10.0,
      .gate = 8.0,
      .frozen_limit = 10U,
      .outlier_limit = 3U,
  };
  return set;
}

static void start_std(const wb_parameters *p, const wb_filter *filter, amb_real std[AMB_STATES])
{
  const double sigma = 3 * sqrt(filter->kf.set.var_y[0] + p->step * p->step / 12);
  const double spread = sqrt(sigma * sigma) / amb_magnitude(p->K_sen);
  std[0] = sqrt(spread * spread);
  std[1] = 0.1 * p->clearance / own_time(p, &filter->law);
  std[2] = p->mass * GRAVITY;
  std[3] = sigma;
}

/* 1 - exp(-w T) of a corner w. */
static double share(double w, double T)
{
  return w * T * amb_phi1(w * T);
}

/* The corners of the low-pass filters, of least error by noise that passes and by lag. */
static void low_pass(const wb_parameters *p, wb_filter *filter)
{
  const double pole = 1 / own_time(p, &filter->law), m = p->mass;
  const double R = p->step * p->step / 12 + filter->kf.set.var_y[0];
  const double noise = R / (p->K_sen * p->K_sen) * p->T, Q = filter->kf.set.var_d[0] / p->T;
  const double motion = 0.1 * p->clearance * pole, turn = motion * pole;
  const double x = pow(4 * (motion * motion) / noise, 1.0 / 3);
  const double v = pow(2 * (turn * turn) / (noise * x), 1.0 / 4);
  const double f = pow(Q / (2 * (m * m) * noise * x * (v * v)), 1.0 / 3);
  filter->low_pass.m = m;
  filter->low_pass.position = share(x, p->T);
  filter->low_pass.velocity = share(v, p->T);
  filter->low_pass.force = share(f > 0 ? f : pole, p->T);
}

wb_expert *wb_known_expert(void)
{
  static wb_expert expert;
  return &expert;
}

__attribute__((export_name("expert"))) double *expert(void)
{
  return (double *)wb_known_expert();
}

/* What the filter knows of its magnet. */
static void set_magnet(const wb_parameters *p, int kind, wb_filter *filter)
{
  const wb_expert *e = wb_known_expert();
  if ((kind == WB_LINEAR) || (kind == WB_LOW_PASS))
    filter->magnet = (amb_magnet){&amb_constant_magnet, &filter->constant};
  else if (kind == WB_ADAPTIVE) {
    filter->fuzzy = (amb_fuzzy){.rules = (int)e->rules,
                                .normalised = e->normalised > 0,
                                .per_ampere = e->per_ampere,
                                .per_metre = e->per_metre,
                                .iu_min = e->iu_min,
                                .iu_max = e->iu_max,
                                .x_min = e->x_min,
                                .x_max = e->x_max,
                                .centre_iu = e->centre_iu,
                                .centre_x = e->centre_x,
                                .k_i = {e->sharpness_k_i, e->weight_k_i},
                                .k_s = {e->sharpness_k_s, e->weight_k_s}};
    filter->magnet = (amb_magnet){&amb_fuzzy_magnet, &filter->fuzzy};
    if ((p->filter_k < 1) || (p->filter_k > 1)) {
      filter->scaled = (amb_scaled){filter->magnet, p->filter_k};
      filter->magnet = (amb_magnet){&amb_scaled_magnet, &filter->scaled};
    }
  } else
    filter->magnet = (amb_magnet){&amb_law_magnet, &filter->law};
}

bool wb_make_filter(const wb_parameters *p, int kind, wb_filter *filter)
{
  static const amb_estimator_methods *const methods[WB_KINDS] = {
      &amb_kalman_methods, &amb_kalman_methods,   &amb_extended_methods, &amb_unscented_methods,
      &amb_ud_methods,     &amb_low_pass_methods, &amb_kalman_methods};
  amb_model model;
  if ((kind == WB_ADAPTIVE) && !(wb_known_expert()->rules > 0))
    return false;
  filter->law = wb_law(p, p->filter_k);
  const amb_kalman_settings set = settings_of(p, &filter->law);
  amb_model_init(&model, p->T, p->mass, p->K_sen, wb_lag(p));
  filter->constant = amb_law_magnet.tangent(&filter->law, 0.0, 0.0);
  set_magnet(p, kind, filter);
  filter->unscented.reach = sqrt(3.0);
  filter->unscented.curvature = 2.0;
  filter->estimator.methods = methods[kind];
  filter->estimator.kf = &filter->kf;
  filter->estimator.magnet = &filter->magnet;
  filter->estimator.own = NULL;
  if (kind == WB_UNSCENTED)
    filter->estimator.own = &filter->unscented;
  if (kind == WB_LOW_PASS)
    filter->estimator.own = &filter->low_pass;
  if (amb_kalman_init(&filter->kf, &model, &set) != AMB_OK)
    return false;
  low_pass(p, filter);
  start_std(p, filter, filter->std);
  return true;
}
