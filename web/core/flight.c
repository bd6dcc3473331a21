/* What the page calls: a flight of the closed loop, up to four filters over it, and a rotor that
 * moves sample by sample under the hand. Arrays are here; the page reads and writes them. */
#include "axis.h"

#define EXPORT(name) __attribute__((export_name(#name)))

typedef struct wb_history {
  double mean[WB_MOST * AMB_STATES], cov[WB_MOST * AMB_TRIANGLE];
  double innovation[WB_MOST], variance[WB_MOST], k_i[WB_MOST], k_s[WB_MOST];
  unsigned short status[WB_MOST];
} wb_history;

static wb_parameters stated;
static wb_filter filters[WB_FILTERS];
static wb_history histories[WB_FILTERS];
static wb_loop closed;
static double r[WB_MOST], load[WB_MOST], noise_u[WB_MOST], noise_y[WB_MOST];
static double X[3][WB_MOST], iu[WB_MOST], force[WB_MOST], y[WB_MOST], u[WB_MOST];
static unsigned char at_stop[WB_MOST];

/* A flight of its own, that goes on from frame to frame. */
static struct wb_live {
  wb_loop closed;
  wb_filter filter;
  amb_loop_state state;
  double k; /* samples so far */
  double shown[10];
} live;

EXPORT(names) const char *names(void)
{
#define WB_NAME(name) #name " "
  return WB_PARAMETERS(WB_NAME);
}

EXPORT(parameters) double *parameters(void)
{
  return (double *)&stated;
}

/* Series of the flight, by the letters of the page. */
EXPORT(series) void *series(int which)
{
  void *const all[] = {r, load, noise_u, noise_y, X[0], X[1], X[2], iu, force, y, u, at_stop};
  return all[which];
}

EXPORT(history) void *history(int filter, int which)
{
  wb_history *h = &histories[filter];
  void *const all[] = {h->mean, h->cov, h->innovation, h->variance, h->k_i, h->k_s, h->status};
  return all[which];
}

static amb_kalman_history history_of(int filter)
{
  wb_history *h = &histories[filter];
  const amb_kalman_history to = {.mean = h->mean,
                                 .cov = h->cov,
                                 .innovation = h->innovation,
                                 .variance = h->variance,
                                 .k_i = h->k_i,
                                 .k_s = h->k_s,
                                 .status = h->status,
                                 .health = h->status};
  return to;
}

static void draw(double variance, uint32_t stream, size_t first, size_t n, double *to)
{
  const amb_noise_key key = {(uint64_t)stated.seed, 0};
  const double std = sqrt(variance);
  amb_noise_normal(key, stream, first, n, to);
  for (size_t i = 0; i < n; i++)
    to[i] = std * to[i];
}

static void draw_noise(size_t n)
{
  if (stated.noisy > 0) {
    draw(stated.noise_u, AMB_NOISE_CONTROL, 0, n, noise_u);
    draw(stated.noise_y, AMB_NOISE_SENSOR, 0, n, noise_y);
  } else
    for (size_t i = 0; i < n; i++)
      noise_u[i] = noise_y[i] = 0;
}

static void settle(const wb_loop *l, amb_loop_state *state)
{
  *state = (amb_loop_state){0};
  amb_plant_settle(&l->loop.plant, &state->plant, &l->place, &l->held);
  amb_pid_reset(&state->pid[0], l->integral);
}

/* Fly; the first filter, of this kind, is in the loop. Returns whether settings are possible. */
EXPORT(fly) int fly(int kind)
{
  const size_t n = (size_t)stated.samples;
  wb_filter *first = &filters[0];
  double *columns[3] = {X[0], X[1], X[2]};
  amb_loop_state state;
  if ((n > WB_MOST) || !wb_make_filter(&stated, kind, first))
    return 0;
  wb_make_loop(&stated, first, &closed);
  closed.loop.feedback_estimate = stated.feedback > 0;
  draw_noise(n);
  settle(&closed, &state);
  const amb_real start[AMB_STATES] = {closed.place, 0, 0, stated.K_sen * closed.place};
  (void)first->estimator.methods->reset(&first->estimator, &first->state, start, first->std);
  const amb_loop_input in = {
      .n = n, .r = r, .load = load, .noise_u = noise_u, .noise_y = noise_y, .off = n};
  amb_loop_output out = {.X = columns,
                         .columns = 3,
                         .iu = iu,
                         .force = force,
                         .y = y,
                         .u = u,
                         .estimate = history_of(0),
                         .at_stop = at_stop};
  (void)amb_loop_run(&closed.loop, &in, &state, &first->state, &out);
  return 1;
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

/* Another filter over the record of the flight, or over a record that the page has written. */
EXPORT(estimate) int estimate(int filter, int kind)
{
  const size_t n = (size_t)stated.samples;
  wb_filter *of = &filters[filter];
  if ((n > WB_MOST) || !wb_make_filter(&stated, kind, of))
    return 0;
  const double first = first_reading(n);
  const amb_real start[AMB_STATES] = {first / stated.K_sen, 0, 0, first};
  (void)of->estimator.methods->reset(&of->estimator, &of->state, start, of->std);
  const amb_kalman_input in = {.n = n, .y = y, .u = u};
  const amb_kalman_history to = history_of(filter);
  (void)amb_estimator_run(&of->estimator, &of->state, &in, &to);
  return 1;
}

/* Force [N], bias force and all, and its tangents, at a current and a displacement. */
EXPORT(magnet_at) double *magnet_at(double current, double x)
{
  static double at[3];
  const amb_law law = wb_law(&stated, 1.0);
  const amb_stiffness k = amb_law_magnet.tangent(&law, current, x);
  at[0] = amb_law_magnet.force(&law, current, x) + wb_bias_force(&law);
  at[1] = k.k_i;
  at[2] = k.k_s;
  return at;
}

EXPORT(levitation) double levitation(double x, double at_load)
{
  return wb_levitation_current(&stated, x, at_load);
}

/* What the filters assume by default: R [m^2] and Q [N^2/s], where the page leaves them open. */
EXPORT(assumed) double *assumed(void)
{
  static double at[2];
  wb_filter filter;
  at[0] = at[1] = 0;
  if (wb_make_filter(&stated, WB_LINEAR, &filter)) {
    at[0] = filter.kf.set.var_y[0];
    at[1] = filter.kf.set.var_d[0] / stated.T;
  }
  return at;
}

/* ---- The rotor under the hand ---- */

/* Take over what is stated; `anew`: from its start, else from where the rotor is. */
EXPORT(live_set) int live_set(int kind, int anew)
{
  static wb_filter tried;
  if (!wb_make_filter(&stated, kind, &tried))
    return 0;
  const bool keeps = (anew == 0) && (tried.estimator.methods == live.filter.estimator.methods);
  const amb_real at = live.state.plant.X[0];
  (void)wb_make_filter(&stated, kind, &live.filter); /* its state stays */
  wb_make_loop(&stated, &live.filter, &live.closed);
  live.closed.loop.feedback_estimate = stated.feedback > 0;
  if (anew != 0) {
    settle(&live.closed, &live.state);
    live.k = 0;
  }
  if (!keeps) {
    const amb_real x = anew != 0 ? live.closed.place : at;
    const amb_real start[AMB_STATES] = {x, 0, 0, stated.K_sen * x};
    (void)live.filter.estimator.methods->reset(&live.filter.estimator, &live.filter.state, start,
                                               live.filter.std);
  }
  return 1;
}

static void show(void)
{
  const amb_loop_state *s = &live.state;
  const amb_kalman_state *filter = &live.filter.state.base;
  const double all[10] = {s->plant.X[0],
                          s->plant.X[1],
                          s->acting[0].iu,
                          s->acting[0].force + live.closed.bias,
                          s->y[0],
                          filter->mean[0],
                          filter->mean[1],
                          filter->mean[2],
                          filter->cov[amb_entry(AMB_STATES, 2, 2)],
                          live.k};
  for (int i = 0; i < 10; i++)
    live.shown[i] = all[i];
}

/* So many samples on, with a reference [m], a load [N], and magnets that are on or off. Returns x,
 * v, iu, the magnet's force, y, the filter's x, v, f_d and its variance, and samples so far. */
EXPORT(live_step) double *live_step(int n, double reference, double push, int off)
{
  amb_loop_sample sample = {
      .r = &reference, .load = &push, .scale = 1, .off = off != 0, .fly = true};
  double w_u = 0, w_y = 0;
  sample.noise_u = &w_u;
  sample.noise_y = &w_y;
  for (int i = 0; i < n; i++) {
    const size_t k = (size_t)live.k;
    if (stated.noisy > 0) {
      draw(stated.noise_u, AMB_NOISE_CONTROL, k, 1, &w_u);
      draw(stated.noise_y, AMB_NOISE_SENSOR, k, 1, &w_y);
    }
    (void)amb_loop_step(&live.closed.loop, &live.state, &live.filter.state, &sample);
    if (off != 0)
      amb_pid_reset(&live.state.pid[0], live.closed.integral);
    live.k += 1;
  }
  show();
  return live.shown;
}
