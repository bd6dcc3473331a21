#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

#include "ambkit/root.h"
#include "machine.h"
#include "parts_step.h"

#define IN_CONTACT 32 /* parts of a substep, where a backup bearing is near */

/* What does not change within a stretch: the demand, loads, and the rotation at the sample. */
typedef struct amb_stretch {
  const amb_machine *machine;
  const amb_real *demanded, *load, *base;
  bool off;
  amb_real speed, growth; /* [rad/s], [rad/s^2] */
  amb_real cosine, sine;
} amb_stretch;

/* The rotation at some time after the sample. */
typedef struct amb_turned {
  amb_real speed, cosine, sine;
} amb_turned;

static amb_turned turned(const amb_stretch *s, amb_real t)
{
  amb_turned now = {s->speed, s->cosine, s->sine};
  amb_real c, d;
  if (!((s->speed < 0) || (s->speed > 0) || (s->growth < 0) || (s->growth > 0)))
    return now;
  amb_parts_turn((s->speed + s->growth * t / 2) * t, &c, &d);
  now.speed = s->speed + s->growth * t;
  now.cosine = s->cosine * c - s->sine * d;
  now.sine = s->sine * c + s->cosine * d;
  return now;
}

static amb_real times(const amb_sparse *A, int row, const amb_real X[])
{
  return amb_sparse_times(A, A->value, row, X);
}

amb_real amb_machine_displacement(const amb_machine *machine, const amb_real X[], int f)
{
  return times(&machine->h, f, X);
}

amb_real amb_machine_current(const amb_machine *machine, const amb_real X[], int f, amb_real iu)
{
  const int first = machine->current[f], second = machine->second[f];
  if (first < 0)
    return iu;
  return second < 0 ? X[first] : (X[first] + X[second]) / 2;
}

amb_real amb_machine_force(const amb_machine *machine, const amb_real X[], int f, amb_real iu)
{
  const amb_real end = machine->farthest[f];
  const amb_real s = amb_clamp(amb_machine_displacement(machine, X, f), -end, end);
  const amb_magnet *coil = &machine->coil[f];
  if ((machine->second[f] >= 0) && (coil->methods != NULL))
    return coil->methods->force(coil->self, X[machine->current[f]], s) -
           coil->methods->force(coil->self, -X[machine->second[f]], -s);
  const amb_real i = amb_machine_current(machine, X, f, iu);
  return machine->magnet[f].methods->force(machine->magnet[f].self, i, s);
}

/* Currents of amplifiers whose voltage is limited. */
static void set_rates(const amb_machine *machine, const amb_real X[], const amb_real demanded[],
                      amb_real slope[])
{
  for (int f = 0; f < machine->axes; f++) {
    const amb_parts *parts = &machine->amplifier[f];
    if (parts->voltage > 0) {
      const int first = machine->current[f], second = machine->second[f];
      const amb_real end = machine->farthest[f];
      const amb_real s = amb_clamp(amb_machine_displacement(machine, X, f), -end, end);
      const amb_real v = times(&machine->v, f, X);
      slope[first] = amb_parts_rate(parts, X[first], demanded[f], s, v);
      if (second >= 0)
        slope[second] = -amb_parts_rate(parts, -X[second], -demanded[f], -s, -v);
    }
  }
}

/* How deep the rotor is in a ring [m], negative where it is clear of it, and the direction. */
static amb_real depth_in(const amb_machine *machine, const amb_ring *ring, const amb_real X[],
                         amb_real way[2])
{
  const amb_real a = amb_machine_displacement(machine, X, ring->first);
  const amb_real b = ring->second < 0 ? 0 : amb_machine_displacement(machine, X, ring->second);
  const amb_real far = amb_root(a * a + b * b);
  way[0] = far > 0 ? a / far : 0;
  way[1] = far > 0 ? b / far : 0;
  return far - ring->travel;
}

/* Forces of the backup bearings, added to those along the axes. */
static void add_contact(const amb_machine *machine, const amb_real X[], amb_real F[])
{
  for (int k = 0; k < machine->rings; k++) {
    const amb_ring *ring = &machine->ring[k];
    amb_real way[2];
    const amb_real depth = depth_in(machine, ring, X, way);
    if (depth > 0) {
      const bool two = ring->second >= 0;
      amb_real inward = way[0] * times(&machine->v, ring->first, X);
      inward += two ? way[1] * times(&machine->v, ring->second, X) : 0;
      const amb_real push = amb_parts_push(&ring->stop, depth, inward);
      F[ring->first] -= push * way[0];
      if (two)
        F[ring->second] -= push * way[1];
    }
  }
}

/* What sensors see beyond a displacement in proportion: runout, and their non-linearity. */
static void add_seen(const amb_machine *machine, const amb_real X[], const amb_turned *now,
                     amb_real slope[])
{
  for (int r = 0; r < machine->sensors; r++) {
    const amb_parts *parts = &machine->sensor[r];
    const amb_real x = times(&machine->seen, r, X), K = machine->gain[r];
    const amb_real more = amb_parts_shown(parts, K, x, now->cosine, now->sine) - K * x;
    slope[machine->shows[r]] += more / machine->lag[r];
  }
}

static void slope(const amb_stretch *s, const amb_real X[], amb_real t, amb_real d[])
{
  const amb_machine *machine = s->machine;
  const amb_turned now = turned(s, t);
  amb_real F[AMB_FORCES];
  for (int f = 0; f < machine->axes; f++)
    F[f] =
        s->load[f] + (s->off ? machine->none[f] : amb_machine_force(machine, X, f, s->demanded[f]));
  add_contact(machine, X, F);
  const amb_real square = now.speed * now.speed;
  const amb_real ahead = square * now.cosine + s->growth * now.sine;
  const amb_real across = square * now.sine - s->growth * now.cosine;
  for (int i = 0; i < machine->states; i++) {
    amb_real sum = machine->g[i] + ahead * machine->cosine[i] + across * machine->sine[i];
    for (int k = machine->A.start[i]; k < machine->A.start[i + 1]; k++)
      sum += (machine->A.value[k] + now.speed * machine->spin[k]) * X[machine->A.column[k]];
    sum += times(&machine->b, i, F) + times(&machine->B_u, i, s->demanded);
    d[i] = sum;
  }
  set_rates(machine, X, s->demanded, d);
  for (int k = 0; k < 3; k++)
    if (machine->base[k] >= 0)
      d[machine->base[k]] -= s->base[k];
  add_seen(machine, X, &now, d);
}

static void along(int n, const amb_real X[], amb_real h, const amb_real d[], amb_real to[])
{
  for (int i = 0; i < n; i++)
    to[i] = X[i] + h * d[i];
}

/* Classical Runge-Kutta of order 4 (Kutta 1901), from t after the sample on by h. */
static void step(const amb_stretch *s, amb_real X[], amb_real t, amb_real h)
{
  const int n = s->machine->states;
  amb_real d1[AMB_STATES], d2[AMB_STATES], d3[AMB_STATES], d4[AMB_STATES], there[AMB_STATES];
  slope(s, X, t, d1);
  along(n, X, h / 2, d1, there);
  slope(s, there, t + h / 2, d2);
  along(n, X, h / 2, d2, there);
  slope(s, there, t + h / 2, d3);
  along(n, X, h, d3, there);
  slope(s, there, t + h, d4);
  for (int i = 0; i < n; i++)
    X[i] += h / 6 * (d1[i] + 2 * (d2[i] + d3[i]) + d4[i]);
}

/* Whether the rotor is in a backup bearing, or could come there within h. */
static bool near(const amb_machine *machine, const amb_real X[], amb_real h, bool *touched)
{
  bool any = false;
  for (int k = 0; k < machine->rings; k++) {
    const amb_ring *ring = &machine->ring[k];
    amb_real way[2];
    const amb_real depth = depth_in(machine, ring, X, way);
    amb_real fast = amb_magnitude(times(&machine->v, ring->first, X));
    fast += ring->second < 0 ? 0 : amb_magnitude(times(&machine->v, ring->second, X));
    any = any || (depth + 2 * h * fast > 0);
    *touched = *touched || (depth > 0);
  }
  return any;
}

static bool go(const amb_stretch *s, amb_real X[], amb_real from, amb_real length, int steps)
{
  const amb_real h = length / (amb_real)steps;
  bool touched = false;
  for (int k = 0; k < steps; k++) {
    const amb_real t = from + h * (amb_real)k;
    const int parts = near(s->machine, X, h, &touched) ? IN_CONTACT : 1;
    for (int j = 0; j < parts; j++)
      step(s, X, t + h * (amb_real)j / (amb_real)parts, h / (amb_real)parts);
  }
  (void)near(s->machine, X, 0, &touched);
  return touched;
}

/* The current that axis c demands from now on, behind the delay, where the newest demand is iu. */
static amb_real acting(const amb_machine *machine, const amb_machine_state *state, size_t c,
                       amb_real iu)
{
  if (machine->delay_rest > 0)
    return state->demanded[machine->delay][c];
  return machine->delay > 0 ? state->demanded[machine->delay - 1][c] : iu;
}

/* How many steps a stretch takes. */
static int steps_in(const amb_machine *machine, amb_real stretch, amb_real T)
{
  return stretch < T ? (int)((amb_real)machine->substeps * stretch / T) + 1 : machine->substeps;
}

bool amb_machine_advance(const amb_machine *machine, amb_machine_state *state, amb_real T,
                         amb_real speed, amb_real next_speed, const amb_real demanded[],
                         const amb_real load[], const amb_real base[3])
{
  for (int n = machine->delay + 1; n > 0; n--)
    for (int c = 0; c < machine->axes; c++)
      state->demanded[n][c] = state->demanded[n - 1][c];
  for (int c = 0; c < machine->axes; c++)
    state->demanded[0][c] = demanded[c];
  const amb_real rest = machine->delay_rest;
  amb_stretch s = {.machine = machine,
                   .demanded = state->demanded[machine->delay + 1],
                   .load = load,
                   .base = base,
                   .off = state->off,
                   .speed = speed,
                   .growth = (next_speed - speed) / T,
                   .cosine = state->cosine,
                   .sine = state->sine};
  bool touched = false;
  if (rest > 0)
    touched = go(&s, state->X, 0, rest, steps_in(machine, rest, T));
  s.demanded = state->demanded[machine->delay];
  touched |= go(&s, state->X, rest, T - rest, steps_in(machine, T - rest, T));
  const amb_turned then = turned(&s, T);
  const amb_real right = (3 - (then.cosine * then.cosine + then.sine * then.sine)) / 2;
  state->cosine = right * then.cosine; /* what rounding did to its length is put right */
  state->sine = right * then.sine;
  return touched;
}

/* ---- The closed loop ---- */

/* What is kept of the controllers from sample to sample. */
typedef struct amb_machine_flown {
  amb_pid_state pid[AMB_CONTROLS];
  amb_control_state control;
  amb_kalman_result result;
  amb_status status;
  bool usable;
  bool off; /* whether the controller has the magnets without current */
  amb_flight_mode mode;
} amb_machine_flown;

static void begin(const amb_machine_loop *loop, const amb_machine_input *in,
                  const amb_real integral[], void *estimator, amb_machine_flown *s)
{
  s->result.status = AMB_OK;
  s->usable = true;
  s->off = false;
  s->mode = AMB_FLYING;
  for (int c = 0; c < loop->controllers.pids; c++)
    amb_pid_reset(&s->pid[c], integral[c]);
  if ((loop->control != NULL) && (in->hover != NULL))
    amb_control_hover(loop->control, &s->control, in->hover, integral);
  else if (loop->control != NULL)
    amb_control_init(loop->control, &s->control, estimator);
}

/* Estimator and controllers at sample k: readings y, control signals that acted before (`acted`)
 * and that act from here on, u [V]. */
static void control(const amb_machine_loop *loop, const amb_machine_input *in, size_t k,
                    amb_machine_flown *s, void *estimator, const amb_real y[],
                    const amb_real acted[], amb_real u[])
{
  const size_t p = (size_t)loop->machine.axes;
  const amb_real *r = in->r + k * p;
  if ((k > 0) && (loop->turn != NULL))
    loop->turn(loop->model, in->speed[k - 1], in->speed[k]);
  if (loop->control != NULL) {
    amb_control_output now;
    const bool fly = (in->fly == NULL) || (in->fly[k] > 0);
    s->status =
        amb_control_step(loop->control, &s->control, estimator, y, r, in->speed[k], fly, &now);
    s->result = now.estimator;
    s->usable = now.usable;
    s->off = !now.on;
    s->mode = now.mode;
    for (size_t c = 0; c < p; c++)
      u[c] = s->control.u[c];
    return;
  }
  if ((loop->estimator != NULL) && (k == 0))
    (void)amb_estimator_start(loop->estimator, estimator, y, &s->result);
  else if (loop->estimator != NULL)
    (void)amb_estimator_step(loop->estimator, estimator, y, acted, &s->result);
  const amb_real *seen = loop->feedback_estimate ? ((const amb_kalman_state *)estimator)->mean : y;
  s->status =
      s->result.status | amb_controllers_step(&loop->controllers, s->pid, r, seen, in->speed[k], u);
  for (size_t c = 0; c < p; c++)
    u[c] /= loop->k_ui[c];
}

void amb_machine_run(const amb_machine_loop *loop, const amb_machine_input *in,
                     amb_machine_state *state, const amb_real integral[], void *estimator,
                     amb_machine_output *out)
{
  const amb_machine *machine = &loop->machine;
  const size_t n = (size_t)machine->states, p = (size_t)machine->axes;
  const size_t m = (size_t)machine->sensors;
  const amb_controllers *controllers = &loop->controllers;
  amb_machine_flown flown;
  begin(loop, in, integral, estimator, &flown);
  out->touched = 0;
  out->first = in->n;
  for (size_t k = 0; k < in->n; k++) {
    amb_real demanded[AMB_CONTROLS];
    amb_real *y = out->y + k * m, *u = out->u + k * p;
    for (size_t i = 0; i < n; i++)
      out->X[k * n + i] = state->X[i];
    for (size_t r = 0; r < m; r++)
      y[r] = amb_parts_reading(&machine->sensor[r], state->X[machine->shows[r]],
                               in->noise_y[k * m + r]);
    control(loop, in, k, &flown, estimator, y, k > 0 ? u - p : NULL, u);
    if (loop->estimator != NULL)
      amb_estimator_note(loop->estimator, estimator, &flown.result, k, &out->estimate);
    out->status[k] = (unsigned short)flown.status;
    if (out->mode != NULL) {
      out->mode[k] = (unsigned char)flown.mode;
      out->usable[k] = flown.usable;
    }
    state->off = flown.off || (k >= in->off);
    for (size_t c = 0; c < p; c++) {
      demanded[c] = amb_clamp(loop->k_ui[c] * (u[c] + in->noise_u[k * p + c]),
                              controllers->iu_min[c], controllers->iu_max[c]);
      const amb_real now = acting(machine, state, c, demanded[c]);
      out->iu[k * p + c] = amb_machine_current(machine, state->X, (int)c, now);
      out->force[k * p + c] =
          state->off ? machine->none[c] : amb_machine_force(machine, state->X, (int)c, now);
    }
    if (amb_machine_advance(machine, state, loop->T, in->speed[k], in->speed[k + 1], demanded,
                            in->load + k * p, in->base + 3 * k)) {
      out->touched++;
      out->first = k < out->first ? k : out->first;
    }
  }
}

#endif
