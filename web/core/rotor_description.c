/* The description of a rotor on several bearings: consecutive numbers, which the page writes in the
 * order of `read_rotor`. */
#include "rotor.h"

#define ENTRIES 2048

typedef struct rows {
  unsigned short start[BENDS + 1], column[ENTRIES];
  double value[ENTRIES];
} rows;

bench_rotor rotor;

static double input[16384];
static rows H, B, C, A;
static double spin[ENTRIES], g[BENDS], cosine[BENDS], sine[BENDS], farthest[WIDE];
static double gain[WIDE], lag[WIDE], k_ui[WIDE], iu_min[WIDE], iu_max[WIDE];
static double reference[WIDE * WIDE], spread[WIDE * WIDE];
static double position[WIDE * AMB_STATES], velocity[WIDE * AMB_STATES];
static double view[8 * WIDE + 4 * WIDE * WIDE];
static amb_law law[WIDE];
static amb_magnet magnet[WIDE], coil[WIDE];
static amb_parts amplifier[WIDE], sensor[WIDE], stop[WIDE];
static amb_ring ring[WIDE];
static amb_pid pid[WIDE];
static int current[WIDE], second[WIDE], shows[WIDE];
static amb_controllers controllers;

static const double *next; /* next number to be read */

static void take(int n, double to[])
{
  amb_copy(n, next, to);
  next += n;
}

static int count(void)
{
  return (int)*next++;
}

static amb_sparse take_rows(rows *to, int n)
{
  for (int i = 0; i <= n; i++)
    to->start[i] = (unsigned short)count();
  for (int i = 0; i < (int)to->start[n]; i++)
    to->column[i] = (unsigned short)count();
  take((int)to->start[n], to->value);
  const amb_sparse all = {to->start, to->column, to->value};
  return all;
}

/* Linear states between a magnet's force and the rotor. */
static void take_behind(amb_parts *of)
{
  const int n = of->behind = count();
  if (n == 0)
    return;
  for (int i = 0; i < n; i++)
    of->behind_at[i] = count();
  take(n * n, of->behind_A);
  take(n, of->behind_b);
  take(n, of->behind_c);
  of->behind_d = *next++;
  take(n, of->behind_rest);
}

static void take_magnets(int p)
{
  for (int f = 0; f < p; f++) {
    double k[4];
    take(4, k);
    law[f] = (amb_law){.k = k[0], .s0 = k[1], .i0 = k[2], .two_sided = k[3] > 0};
    law[f].ampere = k[2] / 1.5;
    law[f].metre = k[1] / 2;
    magnet[f] = (amb_magnet){&amb_law_magnet, &law[f]};
    coil[f] = (amb_magnet){NULL, NULL};
    second[f] = -1;
    current[f] = count();
    amplifier[f] = (amb_parts){.corner = *next++};
    take_behind(&amplifier[f]);
  }
}

static void take_rings(amb_plant *plant)
{
  plant->rings = count();
  plant->ring = ring;
  for (int k = 0; k < plant->rings; k++) {
    ring[k].first = count();
    ring[k].second = count();
    ring[k].travel = *next++;
    stop[k] = (amb_parts){.stiffness = next[0], .damping = next[1]};
    next += 2;
    ring[k].stop = &stop[k];
  }
}

static void take_controllers(int p)
{
  take(p, k_ui);
  take(p, iu_min);
  take(p, iu_max);
  for (int c = 0; c < p; c++) {
    double k[6];
    take(6, k);
    pid[c] =
        (amb_pid){.T = rotor.loop.T, .kp = k[0], .ki = k[1], .kd = k[2], .T_f = k[3], .T_t = k[4]};
    pid[c].weight = k[5];
    pid[c].iu_min = iu_min[c];
    pid[c].iu_max = iu_max[c];
  }
  rotor.loop.feedback_estimate = count() > 0;
  const int states = count();
  take(p * p, reference);
  take(p * states, position);
  take(p * count(), velocity);
  take(p * p, spread);
  controllers = (amb_controllers){.axes = p,
                                  .states = states,
                                  .pids = p,
                                  .pid = pid,
                                  .reference = reference,
                                  .position = position,
                                  .velocity = rotor.loop.feedback_estimate ? velocity : NULL,
                                  .spread = spread,
                                  .iu_min = iu_min,
                                  .iu_max = iu_max};
  rotor.loop.controllers = &controllers;
  rotor.loop.k_ui = k_ui;
  rotor.loop.iu_min = iu_min;
  rotor.loop.iu_max = iu_max;
}

static const double *take_view(int n)
{
  static double *at;
  if (n < 0)
    at = view;
  else {
    take(n, at);
    at += n;
  }
  return at - (n < 0 ? 0 : n);
}

/* The filters' models, in the order of the page. */
static void take_known(void)
{
  const int p = rotor.loop.plant.axes, m = rotor.loop.plant.sensors, q = count(), n = count();
  (void)take_view(-1);
  rotor.known.view = (amb_view){.T = rotor.loop.T, .axes = p, .sensors = m, .positions = q};
  rotor.known.view.mass = take_view(p);
  rotor.known.view.clearance = take_view(p);
  rotor.known.view.k_ui = take_view(p);
  rotor.known.view.current_limit = take_view(p);
  rotor.known.view.var_u = take_view(p);
  rotor.known.view.K_sen = take_view(m);
  rotor.known.view.lag = take_view(m);
  rotor.known.view.step = take_view(m);
  rotor.known.view.var_y = take_view(m);
  rotor.known.view.range = take_view(m);
  rotor.known.view.run_out = take_view(m);
  rotor.known.view.travel = take_view(q);
  rotor.known.view.seen = take_view(q * m);
  rotor.known.view.bent = take_view(q);
  take(m, rotor.known.lag);
  take(p, rotor.known.f_0);
  amb_copy(p, iu_min, rotor.known.iu_min);
  amb_copy(p, iu_max, rotor.known.iu_max);
  for (int f = 0; f < p; f++) {
    rotor.known.law[f] = law[f];
    rotor.known.law[f].k *= next[0];
  }
  rotor.known.R_times = next[1];
  rotor.known.Q_times = next[2];
  next += 3;
  take(n, rotor.rest);
  take(n * m, rotor.by_reading);
  take(p * m, rotor.along_axes);
  take(m * p, rotor.added);
}

EXPORT(description) double *description(void)
{
  return input;
}

EXPORT(read_rotor) void read_rotor(void)
{
  amb_plant *plant = &rotor.loop.plant;
  next = input;
  *plant = (amb_plant){0};
  const int q = plant->positions = count(), p = plant->axes = count(), m = plant->sensors = count();
  plant->states = count();
  plant->delay = count();
  plant->delay_rest = *next++;
  plant->substeps = count();
  rotor.loop.T = *next++;
  rotor.seed = *next++;
  rotor.noisy = *next++ > 0;
  plant->H = take_rows(&H, p);
  plant->B = take_rows(&B, q);
  plant->C = take_rows(&C, m);
  plant->A = take_rows(&A, q);
  take((int)A.start[q], spin);
  take(q, g);
  take(q, cosine);
  take(q, sine);
  take(p, rotor.bias);
  take(p, farthest);
  take(m, gain);
  take(m, lag);
  take_magnets(p);
  for (int i = 0; i < m; i++) {
    shows[i] = count();
    sensor[i] = (amb_parts){.step = *next++};
  }
  take_rings(plant);
  take_controllers(p);
  take(q, rotor.place);
  take(p, rotor.held);
  take(p, rotor.integral);
  take(p, rotor.var_u);
  take(m, rotor.var_y);
  if (*next++ > 0)
    take_known();
  plant->spin = spin;
  plant->g = g;
  bool unbalanced = false;
  for (int k = 0; k < q; k++)
    unbalanced = unbalanced || (cosine[k] < 0) || (cosine[k] > 0) || (sine[k] < 0) || (sine[k] > 0);
  plant->cosine = unbalanced ? cosine : NULL;
  plant->sine = sine;
  plant->magnet = magnet;
  plant->coil = coil;
  plant->bias = rotor.bias;
  plant->farthest = farthest;
  plant->current = current;
  plant->second = second;
  plant->shows = shows;
  plant->gain = gain;
  plant->lag = lag;
  plant->amplifier = amplifier;
  plant->sensor = sensor;
}
