/* A rotor on several bearings under its PIDs: a flight, filters over it, and a rotor under the
 * hand. The page writes the description as numbers one after the other, in the order of
 * `read_rotor`. */
#include "bench.h"
#include <math.h>

#define ENTRIES 2048
#define BENDS 24 /* positions at most, rigid and bending */
#define WIDEST (2 * BENDS + WIDE)

typedef struct rows {
  unsigned short start[BENDS + 1], column[ENTRIES];
  double value[ENTRIES];
} rows;

static double input[16384];
static rows H, B, C, A;
static double spin[ENTRIES], g[BENDS], cosine[BENDS], sine[BENDS], bias[WIDE], farthest[WIDE];
static double gain[WIDE], lag[WIDE], k_ui[WIDE], iu_min[WIDE], iu_max[WIDE];
static double place[BENDS], held[WIDE], integral[WIDE], var_u[WIDE], var_y[WIDE];
static double reference[WIDE * WIDE], spread[WIDE * WIDE], along_axes[WIDE * WIDE];
static double added[WIDE * WIDE], position[WIDE * AMB_STATES], velocity[WIDE * AMB_STATES];
static double view[8 * WIDE + 4 * WIDE * WIDE], rest[AMB_STATES];
static double by_reading[AMB_STATES * WIDE], parameters[64];
static amb_law law[WIDE];
static amb_magnet magnet[WIDE], coil[WIDE];
static amb_parts amplifier[WIDE], sensor[WIDE], stop[WIDE];
static amb_ring ring[WIDE];
static amb_pid pid[WIDE];
static int current[WIDE], second[WIDE], shows[WIDE];
static amb_controllers controllers;
static amb_loop loop;
static bench_known known;
static bench_filter filters[FILTERS], under_hand;
static double seed;
static bool noisy;

static double r[FEWER * WIDE], load[FEWER * WIDE], speed[FEWER + 1];
static double noise_u[FEWER * WIDE], noise_y[FEWER * WIDE];
static double X[WIDEST][FEWER], iu[FEWER * WIDE], force[FEWER * WIDE];
static double y[FEWER * WIDE], u[FEWER * WIDE];
static unsigned char at_stop[FEWER];

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
    pid[c] = (amb_pid){.T = loop.T, .kp = k[0], .ki = k[1], .kd = k[2], .T_f = k[3], .T_t = k[4]};
    pid[c].weight = k[5];
    pid[c].iu_min = iu_min[c];
    pid[c].iu_max = iu_max[c];
  }
  loop.feedback_estimate = count() > 0;
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
                                  .velocity = loop.feedback_estimate ? velocity : NULL,
                                  .spread = spread,
                                  .iu_min = iu_min,
                                  .iu_max = iu_max};
  loop.controllers = &controllers;
  loop.k_ui = k_ui;
  loop.iu_min = iu_min;
  loop.iu_max = iu_max;
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

/* What filters know, in the order of the page. */
static void take_known(void)
{
  const int p = loop.plant.axes, m = loop.plant.sensors, q = count(), n = count();
  (void)take_view(-1);
  known.view = (amb_view){.T = loop.T, .axes = p, .sensors = m, .positions = q};
  known.view.mass = take_view(p);
  known.view.clearance = take_view(p);
  known.view.k_ui = take_view(p);
  known.view.current_limit = take_view(p);
  known.view.var_u = take_view(p);
  known.view.K_sen = take_view(m);
  known.view.lag = take_view(m);
  known.view.step = take_view(m);
  known.view.var_y = take_view(m);
  known.view.range = take_view(m);
  known.view.run_out = take_view(m);
  known.view.travel = take_view(q);
  known.view.seen = take_view(q * m);
  known.view.bent = take_view(q);
  take(m, known.lag);
  take(p, known.f_0);
  amb_copy(p, iu_min, known.iu_min);
  amb_copy(p, iu_max, known.iu_max);
  for (int f = 0; f < p; f++) {
    known.law[f] = law[f];
    known.law[f].k *= next[0];
  }
  known.R_times = next[1];
  known.Q_times = next[2];
  next += 3;
  take(n, rest);
  take(n * m, by_reading);
  take(p * m, along_axes);
  take(m * p, added);
}

EXPORT(description) double *description(void)
{
  return input;
}

EXPORT(read_rotor) void read_rotor(void)
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
  seed = *next++;
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
  take_controllers(p);
  take(q, place);
  take(p, held);
  take(p, integral);
  take(p, var_u);
  take(m, var_y);
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

static void settle(amb_loop_state *state)
{
  *state = (amb_loop_state){0};
  amb_plant_settle(&loop.plant, &state->plant, place, held);
  for (int c = 0; c < loop.plant.axes; c++)
    amb_pid_reset(&state->pid[c], integral[c]);
}

EXPORT(rotor_series) void *rotor_series(int which)
{
  void *const all[] = {r, load, speed, X[0], iu, force, y, u, at_stop, parameters};
  return all[which];
}

/* ---- Filters ---- */

static bool make_filter(int kind, bench_filter *filter)
{
  return bench_filter_of(&known, bench_model_of(loop.T, parameters), kind, filter);
}

/* The current that holds the rotor in the middle by what a filter knows [A], and its slope [A/m].
 */
static void known_current(const bench_filter *filter, int f, double *middle, double *slope)
{
  const amb_kalman_settings *set = &filter->kf.set;
  const double away = 0.1 * known.view.clearance[f], at[3] = {-away, 0.0, away};
  double current[3];
  for (int k = 0; k < 3; k++)
    current[k] =
        bench_levitation(&filter->magnet[f], at[k], set->f_0[f], set->iu_min[f], set->iu_max[f]);
  *middle = current[1];
  *slope = (current[2] - current[0]) / (2 * away);
}

/* Start a filter at rest where the first readings are these [m]; or in the middle, where the
 * currents are these [A]. */
static void start_filter(bench_filter *filter, const double readings[], const double currents[])
{
  amb_real mean[AMB_STATES];
  const amb_model *model = &filter->kf.model;
  const int m = model->sensors;
  for (int i = 0; i < model->states; i++) {
    const int f = filter->states.index[i];
    const bool current = (model->role[i] == AMB_KNOWN) && (f >= 0);
    double middle = rest[i], slope = 0;
    if (current && (readings != NULL))
      known_current(filter, f, &middle, &slope);
    mean[i] = current && (readings == NULL) ? currents[f] : middle;
    for (int j = 0; (j < m) && (readings != NULL); j++)
      mean[i] +=
          (current ? (middle + slope * along_axes[f * m + j]) - middle : by_reading[i * m + j]) *
          readings[j];
  }
  bench_start(filter, mean);
}

/* Another filter over the readings of the flight. */
EXPORT(rotor_estimate) int rotor_estimate(int samples, int filter, int kind)
{
  bench_filter *of = &filters[filter];
  if (!make_filter(kind, of))
    return 0;
  start_filter(of, y, NULL);
  const amb_kalman_input in = {.n = (size_t)samples, .y = y, .u = u};
  const amb_kalman_history to = bench_history(filter, &of->kf.model, in.n);
  (void)amb_estimator_run(&of->estimator, &of->state, &in, &to);
  return of->kf.model.states;
}

/* The loop with a filter in it, or without: then nothing is fed by it. */
static amb_loop with_filter(bench_filter *filter, int kind)
{
  amb_loop with = loop;
  with.estimator = make_filter(kind, filter) ? &filter->estimator : NULL;
  if (with.estimator != NULL)
    start_filter(filter, NULL, held);
  return with;
}

/* Fly under the PIDs, with a filter of this kind; below 0: none. Returns how many states it has. */
EXPORT(rotor_fly) int rotor_fly(int samples, int kind)
{
  const size_t n = (size_t)samples, p = (size_t)loop.plant.axes, m = (size_t)loop.plant.sensors;
  const double noise = noisy ? 1 : 0;
  double *columns[WIDEST];
  amb_loop_state state;
  for (size_t c = 0; c < p; c++)
    bench_draw(seed, AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_CONTROL, 0, n, p, noise * var_u[c],
               noise_u + c);
  for (size_t c = 0; c < m; c++)
    bench_draw(seed, AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_SENSOR, 0, n, m, noise * var_y[c],
               noise_y + c);
  for (int j = 0; j < WIDEST; j++)
    columns[j] = X[j];
  settle(&state);
  const amb_loop with = with_filter(&filters[0], kind);
  if (loop.feedback_estimate && (with.estimator == NULL))
    return -1;
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
                         .estimate = bench_history(0, &filters[0].kf.model, n),
                         .at_stop = at_stop};
  (void)amb_loop_run(&with, &in, &state, &filters[0].state, &out);
  return with.estimator != NULL ? filters[0].kf.model.states : 0;
}

/* abs(S) along an axis at a speed [rad/s], with a filter of this kind. Returns 1 where the loop is
 * stable, 0 where it is not, and -1 without the filter that it needs. */
EXPORT(rotor_sensitivity) int rotor_sensitivity(int axis, int kind, double turns)
{
  static bench_filter filter;
  static amb_parts exact[WIDE];
  double pulse_on[WIDE];
  const double middle[WIDE] = {0};
  amb_loop_state state;
  amb_loop with = with_filter(&filter, kind);
  if (loop.feedback_estimate && (with.estimator == NULL))
    return -1;
  with.estimator = loop.feedback_estimate ? with.estimator : NULL;
  with.plant.sensor = exact;
  with.plant.cosine = NULL; /* the unbalance is there with and without a pulse */
  settle(&state);
  const int m = loop.plant.sensors, p = loop.plant.axes;
  for (int i = 0; i < m; i++)
    pulse_on[i] = 1e-6 * known.view.clearance[axis] * added[i * p + axis];
  const bench_pulse pulse = {pulse_on, &along_axes[axis * m], &filter};
  return bench_sensitivity(&with, &state, middle, turns, &pulse) ? 1 : 0;
}

/* ---- The rotor under the hand ---- */

static amb_loop_state state;
static amb_loop moves;
static double k, push[WIDE], seen[5 * WIDE + BENDS + 2];

EXPORT(live_push) double *live_push(void)
{
  return push;
}

/* Take over what was read; `anew`: from the middle, else from where the rotor is. */
EXPORT(rotor_live_set) void rotor_live_set(int kind, int anew)
{
  bench_filter *filter = &under_hand;
  moves = with_filter(filter, loop.feedback_estimate ? kind : -1);
  if (anew != 0) {
    settle(&state);
    k = 0;
  } else if (moves.estimator != NULL)
    start_filter(filter, state.y, held);
}

/* So many samples on at a speed [rad/s]. Returns displacements along the axes, velocities, currents
 * and forces of each, cosine and sine of the angle, and the positions. */
EXPORT(rotor_live_step) double *rotor_live_step(int n, double turns, int off)
{
  const size_t p = (size_t)loop.plant.axes, m = (size_t)loop.plant.sensors;
  const double none[WIDE] = {0}, speeds[2] = {turns, turns}, noise = noisy ? 1 : 0;
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
      bench_draw(seed, AMB_NOISE_STREAMS * (uint32_t)c, (size_t)k, 1, 1, noise * var_u[c], &w_u[c]);
    for (size_t c = 0; c < m; c++)
      bench_draw(seed, AMB_NOISE_STREAMS * (uint32_t)c + 1U, (size_t)k, 1, 1, noise * var_y[c],
                 &w_y[c]);
    (void)amb_loop_step(&moves, &state, &under_hand.state, &sample);
    if (off != 0)
      for (size_t c = 0; c < p; c++)
        amb_pid_reset(&state.pid[c], integral[c]);
    k += 1;
  }
  const double *at = state.plant.X;
  for (int f = 0; f < loop.plant.axes; f++) {
    seen[f] = amb_plant_along(&loop.plant, f, at);
    seen[p + (size_t)f] = amb_plant_along(&loop.plant, f, at + loop.plant.positions);
    seen[2 * p + (size_t)f] = state.acting[f].iu;
    seen[3 * p + (size_t)f] = state.acting[f].force + bias[f];
  }
  seen[4 * p] = state.plant.cosine;
  seen[4 * p + 1] = state.plant.sine;
  amb_copy(loop.plant.positions, at, &seen[4 * p + 2]);
  return seen;
}
