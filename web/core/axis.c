/* Functions of the page for a machine with one axis: a run of the closed loop, filters over its
 * record, and the interactive rotor. */
#include "axis.h"

typedef struct live {
  axis_loop closed;
  bench_filter filter;
  amb_loop_state state;
  int kind;
  double k; /* samples so far */
  double shown[10];
} live;

static axis_parameters stated;
static bench_filter filters[FILTERS];
static axis_loop closed;
static double r[MOST], load[MOST], noise_u[MOST], noise_y[MOST];
static double X[3][MOST], iu[MOST], force[MOST], y[MOST], u[MOST];
static unsigned char at_stop[MOST];
static live hand;

EXPORT(names) const char *names(void)
{
#define AXIS_NAME(name) #name " "
  return AXIS_PARAMETERS(AXIS_NAME);
}

EXPORT(parameters) double *parameters(void)
{
  return (double *)&stated;
}

/* Time series of the run, by the page's letters. */
EXPORT(series) void *series(int which)
{
  void *const all[] = {r, load, noise_u, noise_y, X[0], X[1], X[2], iu, force, y, u, at_stop};
  return all[which];
}

/* ---- Filters ---- */

/* A filter of a kind with the page's settings. */
static bool make_filter(int kind, bench_filter *filter)
{
  static const double zero = 0.0, one = 1.0;
  const axis_parameters *p = &stated;
  const double parameters[] = {p->T, p->mass, p->K_sen, axis_lag(p), p->bandwidth};
  const amb_law law = axis_law(p, p->filter_k);
  bench_known known = {.view = {.T = p->T,
                                .axes = 1,
                                .mass = &p->mass,
                                .clearance = &p->clearance,
                                .k_ui = &p->gain,
                                .current_limit = &p->current_limit,
                                .var_u = &p->noise_u,
                                .sensors = 1,
                                .K_sen = &p->K_sen,
                                .lag = &p->lag,
                                .step = &p->step,
                                .var_y = &p->noise_y,
                                .range = &p->clearance,
                                .run_out = &zero,
                                .positions = 1,
                                .travel = &p->clearance,
                                .seen = &one,
                                .bent = &zero},
                       .law = {law},
                       .scale = p->filter_k,
                       .lag = {axis_lag(p)},
                       .iu_min = {axis_least_current(p)},
                       .iu_max = {p->current_limit},
                       .f_0 = {axis_weight(p) + axis_bias_force(&law)},
                       .R = p->filter_R,
                       .Q = p->filter_Q,
                       .R_times = 1,
                       .Q_times = 1};
  return bench_filter_of(&known, bench_model_of(p->T, parameters), kind, filter);
}

/* Start a filter in equilibrium with this current. */
static void start_filter(bench_filter *filter, double x, double reading, double current)
{
  amb_real mean[AMB_STATES] = {x, 0, 0, reading};
  for (int i = 4 /* x, v, f_d, x_m */; i < filter->kf.model.states; i++)
    mean[i] = current;
  bench_start(filter, mean);
}

/* The current that holds the rotor according to a filter's model: at the centre, and its slope. */
static double known_current(const bench_filter *filter, double x)
{
  const amb_kalman_settings *set = &filter->kf.set;
  const double step = 0.1 * stated.clearance, at[3] = {-step, 0.0, step};
  double current[3];
  for (int k = 0; k < 3; k++)
    current[k] =
        bench_levitation(filter->magnet, at[k], set->f_0[0], set->iu_min[0], set->iu_max[0]);
  return current[1] + (current[2] - current[0]) / (2 * step) * x;
}

/* The first reading between the stops, at which a filter starts. */
static double first_reading(size_t n)
{
  const double most = amb_magnitude(stated.K_sen) * stated.clearance;
  for (size_t k = 0; k < n; k++)
    if (amb_magnitude(y[k]) <= most)
      return y[k];
  return 0.0;
}

/* Another filter over the record of the run, or over a record written by the page. */
EXPORT(estimate) int estimate(int filter, int kind)
{
  const size_t n = (size_t)stated.samples;
  bench_filter *of = &filters[filter];
  if ((n > MOST) || !make_filter(kind, of))
    return 0;
  const double first = first_reading(n), x = first / stated.K_sen;
  start_filter(of, x, first, known_current(of, x));
  const amb_kalman_input in = {.n = n, .y = y, .u = u};
  const amb_kalman_history to = bench_history(filter, &of->kf.model, n);
  (void)amb_estimator_run(&of->estimator, &of->state, &in, &to);
  return of->kf.model.states;
}

/* Default R [m^2] and Q [N^2/s] of the filters. */
EXPORT(assumed) double *assumed(void)
{
  static double at[2];
  static bench_filter filter;
  at[0] = at[1] = 0;
  if (make_filter(LINEAR, &filter)) {
    at[0] = filter.kf.set.var_y[0];
    at[1] = filter.kf.set.var_d[0] / stated.T;
  }
  return at;
}

/* ---- Runs ---- */

static void settle(const axis_loop *l, amb_loop_state *state)
{
  *state = (amb_loop_state){0};
  amb_plant_settle(&l->loop.plant, &state->plant, &l->place, &l->held);
  amb_pid_reset(&state->pid[0], l->integral);
}

static void make_loop(bench_filter *filter, axis_loop *of)
{
  axis_make_loop(&stated, filter, of);
  of->loop.feedback_estimate = stated.feedback > 0;
}

/* Run with a filter of this kind in the loop. Returns its number of states, 0 if the settings are
 * invalid. */
EXPORT(fly) int fly(int kind)
{
  const size_t n = (size_t)stated.samples;
  bench_filter *first = &filters[0];
  double *columns[3] = {X[0], X[1], X[2]};
  amb_loop_state state;
  if ((n > MOST) || !make_filter(kind, first))
    return 0;
  make_loop(first, &closed);
  const double noise = stated.noisy > 0 ? 1 : 0;
  bench_draw(stated.seed, AMB_NOISE_CONTROL, 0, n, 1, noise * stated.noise_u, noise_u);
  bench_draw(stated.seed, AMB_NOISE_SENSOR, 0, n, 1, noise * stated.noise_y, noise_y);
  settle(&closed, &state);
  start_filter(first, closed.place, stated.K_sen * closed.place, closed.held);
  const amb_loop_input in = {.n = n, .r = r, .load = load, .noise_u = noise_u, .noise_y = noise_y};
  amb_loop_output out = {.X = columns,
                         .columns = 3,
                         .iu = iu,
                         .force = force,
                         .y = y,
                         .u = u,
                         .estimate = bench_history(0, &first->kf.model, n),
                         .at_stop = at_stop};
  (void)amb_loop_run(&closed.loop, &in, &state, &first->state, &out);
  return first->kf.model.states;
}

/* abs(S) of the loop in equilibrium at the reference, with a filter of this kind. Returns 1 if the
 * loop is stable, 0 if not, and -1 without a filter. */
EXPORT(sensitivity) int sensitivity(int kind)
{
  static bench_filter filter;
  static axis_loop l;
  const double added = 1e-6 * stated.clearance, shown = 1, at = stated.reference;
  amb_loop_state state;
  if (!make_filter(kind, &filter))
    return -1;
  const bool fed = stated.feedback > 0;
  make_loop(&filter, &l);
  l.loop.estimator = fed ? l.loop.estimator : NULL;
  l.sensor.step = 0;
  settle(&l, &state);
  start_filter(&filter, l.place, stated.K_sen * l.place, l.held);
  const bench_pulse pulse = {&added, &shown, &filter};
  return bench_sensitivity(&l.loop, &state, &at, 0, &pulse) ? 1 : 0;
}

/* Force [N] with the bias force, and its tangents, at a current and a displacement. */
EXPORT(magnet_at) double *magnet_at(double current, double x)
{
  static double at[3];
  const amb_law law = axis_law(&stated, 1.0);
  const amb_stiffness k = amb_law_magnet.tangent(&law, current, x);
  at[0] = amb_law_magnet.force(&law, current, x) + axis_bias_force(&law);
  at[1] = k.k_i;
  at[2] = k.k_s;
  return at;
}

EXPORT(levitation) double levitation(double x, double at_load)
{
  return axis_levitation_current(&stated, x, at_load);
}

/* ---- The interactive rotor ---- */

/* Apply the settings; `anew`: from the start, else from the present state. */
EXPORT(live_set) int live_set(int kind, int anew)
{
  static bench_filter tried;
  if (!make_filter(kind, &tried))
    return 0;
  const bool keeps =
      (anew == 0) && (kind == hand.kind) && (tried.kf.model.states == hand.filter.kf.model.states);
  const amb_real at = hand.state.plant.X[0];
  (void)make_filter(kind, &hand.filter); /* its state is kept */
  make_loop(&hand.filter, &hand.closed);
  hand.kind = kind;
  if (anew != 0) {
    settle(&hand.closed, &hand.state);
    hand.k = 0;
  }
  if (!keeps) {
    const amb_real x = anew != 0 ? hand.closed.place : at;
    start_filter(&hand.filter, x, stated.K_sen * x, hand.closed.held);
  }
  return 1;
}

static void show(void)
{
  const amb_loop_state *s = &hand.state;
  const amb_kalman_state *filter = &hand.filter.state.base;
  const double all[10] = {s->plant.X[0],
                          s->plant.X[1],
                          s->acting[0].iu,
                          s->acting[0].force + hand.closed.bias,
                          s->y[0],
                          filter->mean[0],
                          filter->mean[1],
                          filter->mean[2],
                          filter->cov[amb_entry(hand.filter.kf.model.states, 2, 2)],
                          hand.k};
  amb_copy(10, all, hand.shown);
}

/* Advances by so many samples with a reference [m], a load [N], and magnets on or off. Returns x,
 * v, iu, the magnet's force, y, the filter's x, v, f_d and its variance, and the number of samples.
 * */
EXPORT(live_step) double *live_step(int n, double reference, double push, int off)
{
  double w_u = 0, w_y = 0;
  const amb_loop_sample sample = {.r = &reference,
                                  .load = &push,
                                  .noise_u = &w_u,
                                  .noise_y = &w_y,
                                  .scale = 1,
                                  .off = off != 0,
                                  .fly = true};
  for (int i = 0; i < n; i++) {
    const size_t k = (size_t)hand.k;
    if (stated.noisy > 0) {
      bench_draw(stated.seed, AMB_NOISE_CONTROL, k, 1, 1, stated.noise_u, &w_u);
      bench_draw(stated.seed, AMB_NOISE_SENSOR, k, 1, 1, stated.noise_y, &w_y);
    }
    (void)amb_loop_step(&hand.closed.loop, &hand.state, &hand.filter.state, &sample);
    if (off != 0)
      amb_pid_reset(&hand.state.pid[0], hand.closed.integral);
    hand.k += 1;
  }
  show();
  return hand.shown;
}
