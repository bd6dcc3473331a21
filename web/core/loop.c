/* The closed loop from the machine's parameters. */
#include "axis.h"

#define PI 3.141592653589793
#define EPSILON_4 8.881784197001252e-16 /* 4 2^-52 */

#define SHORTEST_LAG 1e-3 /* relative to a sample */

amb_law axis_law(const axis_parameters *p, double scale)
{
  const amb_law law = {.k = p->k * scale,
                       .s0 = p->s0,
                       .i0 = p->i0,
                       .two_sided = p->two_sided > 0,
                       .ampere = p->i0 / 1.5,
                       .metre = p->s0 / 2};
  return law;
}

double axis_bias_force(const amb_law *law)
{
  return law->two_sided ? 0.0 : -amb_law_magnet.force(law, -law->i0, 0.0);
}

double axis_weight(const axis_parameters *p)
{
  return p->gravity * p->mass * AMB_GRAVITY;
}

double axis_least_current(const axis_parameters *p)
{
  const bool both = (p->two_sided > 0) || (p->current_limit < p->i0);
  return both ? -p->current_limit : -p->i0;
}

double axis_lag(const axis_parameters *p)
{
  return p->lag > SHORTEST_LAG * p->T ? p->lag : SHORTEST_LAG * p->T;
}

/* Brent's method (1973, ch. 4), in the order of Python's `base.root`: the same bits. */
static double secant(double a, double f_a, double x, double f, double c, double f_c)
{
  if (!((a < c) || (a > c)))
    return -f * (x - a) / (f - f_a);
  const double of_a = (f_a - f) / (a - x), of_c = (f_c - f) / (c - x);
  return -f * (f_c * of_c - f_a * of_a) / (of_c * of_a * (f_c - f_a));
}

static bool opposite(double a, double b)
{
  return (a < 0 && b > 0) || (a > 0 && b < 0);
}

typedef double (*function)(const void *self, double at);

static double root(function f, const void *self, double low, double high, double tolerance)
{
  double last = low, at = high, f_last = f(self, low), f_at = f(self, high);
  double far = low, f_far = f_last, before = 0, step = 0;
  for (int n = 0; n < 200; n++) {
    if (opposite(f_last, f_at)) {
      far = last;
      f_far = f_last;
      before = step = at - last;
    }
    if (amb_magnitude(f_far) < amb_magnitude(f_at)) {
      last = at;
      f_last = f_at;
      at = far;
      f_at = f_far;
      far = last;
      f_far = f_last;
    }
    const double least = (tolerance + EPSILON_4 * amb_magnitude(at)) / 2, half = (far - at) / 2;
    if (!((f_at < 0) || (f_at > 0)) || (amb_magnitude(half) < least))
      return at;
    double trial = AMB_REAL_MAX;
    if ((amb_magnitude(before) > least) && (amb_magnitude(f_at) < amb_magnitude(f_last)))
      trial = secant(last, f_last, at, f_at, far, f_far);
    const double most = 3 * amb_magnitude(half) - least;
    const bool good =
        2 * amb_magnitude(trial) < (amb_magnitude(before) < most ? amb_magnitude(before) : most);
    before = good ? step : half;
    step = good ? trial : half;
    last = at;
    f_last = f_at;
    at += amb_magnitude(step) > least ? step : (half < 0 ? -least : least);
    f_at = f(self, at);
  }
  return at;
}

typedef struct held {
  const amb_magnet *magnet;
  double x, force;
} held;

static double net_force(const void *self, double iu)
{
  const held *of = (const held *)self;
  return of->magnet->methods->force(of->magnet->self, iu, of->x) + of->force;
}

double bench_levitation(const amb_magnet *magnet, double x, double force, double low, double high)
{
  const held of = {magnet, x, force};
  const double at_low = net_force(&of, low), at_high = net_force(&of, high);
  if (at_low * at_high > 0)
    return amb_magnitude(at_low) < amb_magnitude(at_high) ? low : high;
  if (!((at_low < 0) || (at_low > 0)))
    return low;
  return root(net_force, &of, low, high, 1e-15 * (high - low));
}

double axis_levitation_current(const axis_parameters *p, double x, double load)
{
  const amb_law law = axis_law(p, 1.0);
  const amb_magnet magnet = {&amb_law_magnet, &law};
  return bench_levitation(&magnet, x, axis_weight(p) + axis_bias_force(&law) + load,
                          axis_least_current(p), p->current_limit);
}

static int at_least(int least, double needed)
{
  const int down = (int)needed;
  const int up = (double)down < needed ? down + 1 : down;
  return up > least ? up : least;
}

static void make_plant(const axis_parameters *p, axis_loop *l)
{
  amb_plant *plant = &l->loop.plant;
  const bool lags = p->bandwidth > 0;
  const double slow = 2 * PI * p->bandwidth, fast = 1 / (1e-3 * p->T);
  l->law = axis_law(p, 1.0);
  l->magnet = (amb_magnet){&amb_law_magnet, &l->law};
  l->coil = (amb_magnet){NULL, NULL};
  l->bias = axis_bias_force(&l->law);
  l->mass = p->mass;
  l->g = axis_weight(p) + l->bias;
  l->farthest = p->clearance;
  l->gain = p->K_sen;
  l->lag = axis_lag(p);
  l->amplifier = (amb_parts){.corner = lags ? (slow < fast ? slow : fast) : 0};
  l->sensor = (amb_parts){.step = p->step};
  l->stop = (amb_parts){0};
  l->ring = (amb_ring){0, -1, p->clearance, &l->stop};
  l->current = lags ? 3 : -1;
  l->second = -1;
  l->shows = 2;
  const double samples = p->delay / p->T;
  const int whole = (int)(samples + 1e-9), next = (int)(samples + 0.5);
  const double off = samples - next;
  const bool exact = (off < 1e-9) && (off > -1e-9);
  *plant = (amb_plant){.positions = 1,
                       .axes = 1,
                       .sensors = 1,
                       .states = 5,
                       .own = true,
                       .mass = &l->mass,
                       .g = &l->g,
                       .magnet = &l->magnet,
                       .coil = &l->coil,
                       .bias = &l->bias,
                       .farthest = &l->farthest,
                       .current = &l->current,
                       .second = &l->second,
                       .shows = &l->shows,
                       .gain = &l->gain,
                       .lag = &l->lag,
                       .amplifier = &l->amplifier,
                       .sensor = &l->sensor,
                       .rings = 1,
                       .ring = &l->ring,
                       .delay = exact ? next : whole,
                       .delay_rest = exact ? 0.0 : (samples - whole) * p->T,
                       .plain = !lags};
  plant->substeps = at_least(at_least(4, 2 * p->T / l->lag), 4 * p->T * l->amplifier.corner);
}

void axis_make_loop(const axis_parameters *p, const bench_filter *fed, axis_loop *l)
{
  const double low = axis_least_current(p), high = p->current_limit;
  make_plant(p, l);
  l->k_ui = p->gain;
  l->iu_min = low;
  l->iu_max = high;
  l->loop.T = p->T;
  l->loop.k_ui = &l->k_ui;
  l->loop.iu_min = &l->iu_min;
  l->loop.iu_max = &l->iu_max;
  l->loop.estimator = fed != NULL ? &fed->estimator : NULL;
  l->loop.feedback_estimate = fed != NULL;
  l->loop.pid = (amb_pid){.T = p->T,
                          .kp = p->kp,
                          .ki = p->ki,
                          .kd = p->kd,
                          .T_f = p->T_f,
                          .T_t = p->T_t,
                          .weight = p->weight,
                          .iu_min = low,
                          .iu_max = high};
  const bool levitated = p->start < LANDED;
  const double at = levitated ? p->reference : 0.0;
  const double down = axis_weight(p) > 0 ? p->clearance : -p->clearance;
  const double held = levitated ? axis_levitation_current(p, at, p->load) : 0.0;
  l->place = levitated ? at : (p->start > LANDED ? 0.0 : down);
  l->held = amb_clamp(held, low, high);
  l->integral = held + (1 - p->weight) * p->kp * at;
}
