/* A rotor on several bearings under its PIDs, in the build with loops: a flight, and a rotor under
 * the hand. The page writes the description as numbers one after the other, in the order of `read`.
 */
#include "rotor.h"

#define ENTRIES 256
#define WIDEST (2 * WIDE + WIDE)

typedef struct rows {
  unsigned short start[WIDE + 1], column[ENTRIES];
  double value[ENTRIES];
} rows;

static double input[4096];
static rows H, B, C, A;
static double spin[ENTRIES], g[WIDE], cosine[WIDE], sine[WIDE], bias[WIDE], farthest[WIDE];
static double gain[WIDE], lag[WIDE], k_ui[WIDE], iu_min[WIDE], iu_max[WIDE];
static double place[WIDE], held[WIDE], integral[WIDE], var_u[WIDE], var_y[WIDE];
static double reference[WIDE * WIDE], position[WIDE * WIDE], spread[WIDE * WIDE];
static amb_law law[WIDE];
static amb_magnet magnet[WIDE], coil[WIDE];
static amb_parts amplifier[WIDE], sensor[WIDE], stop[WIDE];
static amb_ring ring[WIDE];
static amb_pid pid[WIDE];
static int current[WIDE], second[WIDE], shows[WIDE];
static amb_controllers controllers;
static amb_loop loop;
static uint64_t seed;
static bool noisy;

static double r[MOST * WIDE], load[MOST * WIDE], speed[MOST + 1];
static double noise_u[MOST * WIDE], noise_y[MOST * WIDE];
static double X[WIDEST][MOST], iu[MOST * WIDE], force[MOST * WIDE], y[MOST * WIDE], u[MOST * WIDE];
static unsigned char at_stop[MOST];

static const double *next; /* what of the description is read next */

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

static void take_controllers(int p, int m)
{
  take(p, k_ui);
  take(p, iu_min);
  take(p, iu_max);
  for (int c = 0; c < p; c++) {
    double k[6];
    take(6, k);
    pid[c] = (amb_pid){.T = loop.T, .kp = k[0], .ki = k[1], .kd = k[2], .T_f = k[3], .T_t = k[4]};
    pid[c].weight = k[5];
    pid[c].iu_min = iu_min[c];
    pid[c].iu_max = iu_max[c];
  }
  take(p * p, reference);
  take(p * m, position);
  take(p * p, spread);
  controllers = (amb_controllers){.axes = p,
                                  .states = m,
                                  .pids = p,
                                  .pid = pid,
                                  .reference = reference,
                                  .position = position,
                                  .spread = spread,
                                  .iu_min = iu_min,
                                  .iu_max = iu_max};
  loop.controllers = &controllers;
  loop.k_ui = k_ui;
  loop.iu_min = iu_min;
  loop.iu_max = iu_max;
}

EXPORT(description) double *description(void)
{
  return input;
}

EXPORT(read) void read(void)
{
  amb_plant *plant = &loop.plant;
  next = input;
  *plant = (amb_plant){0};
  const int q = plant->positions = count(), p = plant->axes = count(), m = plant->sensors = count();
  plant->states = count();
  plant->delay = count();
  plant->delay_rest = *next++;
  plant->substeps = count();
  loop.T = *next++;
  seed = (uint64_t)*next++;
  noisy = *next++ > 0;
  plant->H = take_rows(&H, p);
  plant->B = take_rows(&B, q);
  plant->C = take_rows(&C, m);
  plant->A = take_rows(&A, q);
  take((int)A.start[q], spin);
  take(q, g);
  take(q, cosine);
  take(q, sine);
  take(p, bias);
  take(p, farthest);
  take(m, gain);
  take(m, lag);
  take_magnets(p);
  for (int i = 0; i < m; i++) {
    shows[i] = count();
    sensor[i] = (amb_parts){.step = *next++};
  }
  take_rings(plant);
  take_controllers(p, m);
  take(q, place);
  take(p, held);
  take(p, integral);
  take(p, var_u);
  take(m, var_y);
  plant->spin = spin;
  plant->g = g;
  bool unbalanced = false;
  for (int k = 0; k < q; k++)
    unbalanced = unbalanced || (cosine[k] < 0) || (cosine[k] > 0) || (sine[k] < 0) || (sine[k] > 0);
  plant->cosine = unbalanced ? cosine : NULL;
  plant->sine = sine;
  plant->magnet = magnet;
  plant->coil = coil;
  plant->bias = bias;
  plant->farthest = farthest;
  plant->current = current;
  plant->second = second;
  plant->shows = shows;
  plant->gain = gain;
  plant->lag = lag;
  plant->amplifier = amplifier;
  plant->sensor = sensor;
}

static void draw(double variance, uint32_t stream, size_t first, size_t n, size_t stride,
                 double *to)
{
  const amb_noise_key key = {seed, 0};
  const double std = noisy ? sqrt(variance) : 0;
  double drawn[AMB_NOISE_DRAWN];
  for (size_t done = 0; done < n; done += AMB_NOISE_DRAWN) {
    const size_t some = (n - done < AMB_NOISE_DRAWN) ? n - done : AMB_NOISE_DRAWN;
    amb_noise_normal(key, stream, first + done, some, drawn);
    for (size_t i = 0; i < some; i++)
      to[(done + i) * stride] = noisy ? std * drawn[i] : 0;
  }
}

static void settle(amb_loop_state *state)
{
  *state = (amb_loop_state){0};
  amb_plant_settle(&loop.plant, &state->plant, place, held);
  for (int c = 0; c < loop.plant.axes; c++)
    amb_pid_reset(&state->pid[c], integral[c]);
}

EXPORT(series) void *series(int which)
{
  void *const all[] = {r, load, speed, X[0], iu, force, y, u, at_stop};
  return all[which];
}

/* Fly under the PIDs, with a filter over the readings: 1 linear, 2 extended, 0 none. Returns
 * whether there was one. */
EXPORT(fly) int fly(int samples, int kind, double k_known)
{
  const size_t n = (size_t)samples, p = (size_t)loop.plant.axes, m = (size_t)loop.plant.sensors;
  double *columns[WIDEST];
  amb_loop_state state;
  for (size_t c = 0; c < p; c++)
    draw(var_u[c], AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_CONTROL, 0, n, p, noise_u + c);
  for (size_t c = 0; c < m; c++)
    draw(var_y[c], AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_SENSOR, 0, n, m, noise_y + c);
  for (int j = 0; j < WIDEST; j++)
    columns[j] = X[j];
  settle(&state);
  amb_loop with = loop;
  with.estimator = kind > 0 ? rotor_filter(kind > 1, k_known, law) : NULL;
  const amb_loop_input in = {.n = n,
                             .r = r,
                             .load = load,
                             .noise_u = noise_u,
                             .noise_y = noise_y,
                             .speed = speed,
                             .off = n};
  amb_loop_output out = {.X = columns,
                         .columns = 2 * loop.plant.positions + loop.plant.sensors,
                         .iu = iu,
                         .force = force,
                         .y = y,
                         .u = u,
                         .estimate = rotor_filter_history(),
                         .at_stop = at_stop};
  (void)amb_loop_run(&with, &in, &state, rotor_filter_state(), &out);
  return with.estimator != NULL ? 1 : 0;
}

/* ---- The rotor under the hand ---- */

static amb_loop_state state;
static double k, push[WIDE], shown[5 * WIDE + 2];

EXPORT(live_push) double *live_push(void)
{
  return push;
}

EXPORT(live_start) void live_start(void)
{
  settle(&state);
  k = 0;
}

/* So many samples on at a speed [rad/s]. Returns displacements along the axes, velocities, currents
 * and forces of each, then cosine and sine of the angle. */
EXPORT(live_step) double *live_step(int n, double turns, int off)
{
  const size_t p = (size_t)loop.plant.axes, m = (size_t)loop.plant.sensors;
  const double none[WIDE] = {0}, speeds[2] = {turns, turns};
  double w_u[WIDE], w_y[WIDE];
  const amb_loop_sample sample = {.r = none,
                                  .load = push,
                                  .noise_u = w_u,
                                  .noise_y = w_y,
                                  .speed = speeds,
                                  .scale = 1,
                                  .off = off != 0,
                                  .fly = true};
  for (int i = 0; i < n; i++) {
    for (size_t c = 0; c < p; c++)
      draw(var_u[c], AMB_NOISE_STREAMS * (uint32_t)c, (size_t)k, 1, 1, &w_u[c]);
    for (size_t c = 0; c < m; c++)
      draw(var_y[c], AMB_NOISE_STREAMS * (uint32_t)c + 1U, (size_t)k, 1, 1, &w_y[c]);
    (void)amb_loop_step(&loop, &state, NULL, &sample);
    if (off != 0)
      for (size_t c = 0; c < p; c++)
        amb_pid_reset(&state.pid[c], integral[c]);
    k += 1;
  }
  const double *at = state.plant.X;
  for (int f = 0; f < loop.plant.axes; f++) {
    shown[f] = amb_plant_along(&loop.plant, f, at);
    shown[p + (size_t)f] = amb_plant_along(&loop.plant, f, at + loop.plant.positions);
    shown[2 * p + (size_t)f] = state.acting[f].iu;
    shown[3 * p + (size_t)f] = state.acting[f].force + bias[f];
  }
  shown[4 * p] = state.plant.cosine;
  shown[4 * p + 1] = state.plant.sine;
  return shown;
}
