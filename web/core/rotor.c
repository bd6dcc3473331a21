/* A rotor on several bearings with its PIDs: a run, filters over its record, and its sensitivity.
 * */
#include "rotor.h"

#define WIDEST (2 * BENDS + WIDE)

static bench_filter filters[FILTERS];

static double r[FEWER * WIDE], load[FEWER * WIDE], speed[FEWER + 1];
static double noise_u[FEWER * WIDE], noise_y[FEWER * WIDE];
static double X[WIDEST][FEWER], iu[FEWER * WIDE], force[FEWER * WIDE];
static double y[FEWER * WIDE], u[FEWER * WIDE];
static unsigned char at_stop[FEWER];

void rotor_settle(amb_loop_state *state)
{
  *state = (amb_loop_state){0};
  amb_plant_settle(&rotor.loop.plant, &state->plant, rotor.place, rotor.held);
  for (int c = 0; c < rotor.loop.plant.axes; c++)
    amb_pid_reset(&state->pid[c], rotor.integral[c]);
}

EXPORT(rotor_series) void *rotor_series(int which)
{
  void *const all[] = {r, load, speed, X[0], iu, force, y, u, at_stop, rotor.parameters};
  return all[which];
}

/* ---- Filters ---- */

static bool make_filter(int kind, bench_filter *filter)
{
  return bench_filter_of(&rotor.known, bench_model_of(rotor.loop.T, rotor.parameters), kind,
                         filter);
}

/* The current that holds the rotor at the centre according to a filter's model [A], and its slope
 * [A/m]. */
static void known_current(const bench_filter *filter, int f, double *middle, double *slope)
{
  const amb_kalman_settings *set = &filter->kf.set;
  const double away = 0.1 * rotor.known.view.clearance[f], at[3] = {-away, 0.0, away};
  double current[3];
  for (int k = 0; k < 3; k++)
    current[k] =
        bench_levitation(&filter->magnet[f], at[k], set->f_0[f], set->iu_min[f], set->iu_max[f]);
  *middle = current[1];
  *slope = (current[2] - current[0]) / (2 * away);
}

/* Start a filter in equilibrium at these first readings [m]; or at the centre with these currents
 * [A]. */
void rotor_start_filter(bench_filter *filter, const double readings[], const double currents[])
{
  amb_real mean[AMB_STATES];
  const amb_model *model = &filter->kf.model;
  const int m = model->sensors;
  for (int i = 0; i < model->states; i++) {
    const int f = filter->states.index[i];
    const bool current = (model->role[i] == AMB_KNOWN) && (f >= 0);
    double middle = rotor.rest[i], slope = 0;
    if (current && (readings != NULL))
      known_current(filter, f, &middle, &slope);
    mean[i] = current && (readings == NULL) ? currents[f] : middle;
    for (int j = 0; (j < m) && (readings != NULL); j++)
      mean[i] += (current ? (middle + slope * rotor.along_axes[f * m + j]) - middle
                          : rotor.by_reading[i * m + j]) *
                 readings[j];
  }
  bench_start(filter, mean);
}

/* Another filter over the readings of the run. */
EXPORT(rotor_estimate) int rotor_estimate(int samples, int filter, int kind)
{
  bench_filter *of = &filters[filter];
  if (!make_filter(kind, of))
    return 0;
  rotor_start_filter(of, y, NULL);
  const amb_kalman_input in = {.n = (size_t)samples, .y = y, .u = u};
  const amb_kalman_history to = bench_history(filter, &of->kf.model, in.n);
  (void)amb_estimator_run(&of->estimator, &of->state, &in, &to);
  return of->kf.model.states;
}

/* The loop with or without a filter; without one, the readings feed the controllers. */
amb_loop rotor_with_filter(bench_filter *filter, int kind)
{
  amb_loop with = rotor.loop;
  with.estimator = make_filter(kind, filter) ? &filter->estimator : NULL;
  if (with.estimator != NULL)
    rotor_start_filter(filter, NULL, rotor.held);
  return with;
}

/* Run with the PIDs, and a filter of this kind; below 0: none. Returns its number of states. */
EXPORT(rotor_fly) int rotor_fly(int samples, int kind)
{
  const size_t n = (size_t)samples, p = (size_t)rotor.loop.plant.axes,
               m = (size_t)rotor.loop.plant.sensors;
  const double noise = rotor.noisy ? 1 : 0;
  double *columns[WIDEST];
  amb_loop_state state;
  for (size_t c = 0; c < p; c++)
    bench_draw(rotor.seed, AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_CONTROL, 0, n, p,
               noise * rotor.var_u[c], noise_u + c);
  for (size_t c = 0; c < m; c++)
    bench_draw(rotor.seed, AMB_NOISE_STREAMS * (uint32_t)c + AMB_NOISE_SENSOR, 0, n, m,
               noise * rotor.var_y[c], noise_y + c);
  for (int j = 0; j < WIDEST; j++)
    columns[j] = X[j];
  rotor_settle(&state);
  const amb_loop with = rotor_with_filter(&filters[0], kind);
  if (rotor.loop.feedback_estimate && (with.estimator == NULL))
    return -1;
  const amb_loop_input in = {
      .n = n, .r = r, .load = load, .noise_u = noise_u, .noise_y = noise_y, .speed = speed};
  amb_loop_output out = {.X = columns,
                         .columns = 2 * rotor.loop.plant.positions + rotor.loop.plant.sensors,
                         .iu = iu,
                         .force = force,
                         .y = y,
                         .u = u,
                         .estimate = bench_history(0, &filters[0].kf.model, n),
                         .at_stop = at_stop};
  (void)amb_loop_run(&with, &in, &state, &filters[0].state, &out);
  return with.estimator != NULL ? filters[0].kf.model.states : 0;
}

/* abs(S) along an axis at a speed [rad/s], with a filter of this kind. Returns 1 if the loop is
 * stable, 0 if not, and -1 if the filter that feeds it is missing. */
EXPORT(rotor_sensitivity) int rotor_sensitivity(int axis, int kind, double turns)
{
  static bench_filter filter;
  static amb_parts exact[WIDE];
  double pulse_on[WIDE];
  const double middle[WIDE] = {0};
  amb_loop_state state;
  amb_loop with = rotor_with_filter(&filter, kind);
  if (rotor.loop.feedback_estimate && (with.estimator == NULL))
    return -1;
  with.estimator = rotor.loop.feedback_estimate ? with.estimator : NULL;
  with.plant.sensor = exact;
  with.plant.cosine = NULL; /* the response to a pulse does not depend on the unbalance */
  rotor_settle(&state);
  const int m = rotor.loop.plant.sensors, p = rotor.loop.plant.axes;
  for (int i = 0; i < m; i++)
    pulse_on[i] = 1e-6 * rotor.known.view.clearance[axis] * rotor.added[i * p + axis];
  const bench_pulse pulse = {pulse_on, &rotor.along_axes[axis * m], &filter};
  return bench_sensitivity(&with, &state, middle, turns, &pulse) ? 1 : 0;
}
