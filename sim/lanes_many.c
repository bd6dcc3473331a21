/* Closed loops with the nonlinear plant side by side, compiled for each instruction set: the same
 * as loop.c, plant.c and controller.c, with masks in place of branches. The filter is that of
 * lanes.c. */
#include "lanes_run.h"

#if defined(AMB_HAS_LANES) && !defined(AMB_FLOAT)
#include "lanes_team.h"
#include "many_figures.h"
#include "noise_block.h"

/* ---- The same text again, with lanes' names except for types that both have. ---- */

/* A plain isolated axis: the pattern closed_axis of plant.c. */
typedef struct lanes_pattern {
  int positions, axes, states;
  bool plain;
} lanes_pattern;

static const lanes_pattern axis = {1, 1, 3, true};

typedef struct lanes_substep_constants {
  lanes h, half, sixth, g[1], per_mass, per_lag, K, travel, iu;
  lanes_law law;
} lanes_substep_constants;

AMB_INLINE lanes lanes_reachable(const lanes_pattern *p, const lanes_substep_constants *of, lanes x,
                                 int k)
{
  (void)p, (void)k;
  return lanes_clamp(x, -of->travel, of->travel);
}

AMB_INLINE lanes lanes_driven(const lanes_pattern *p, const lanes_substep_constants *of,
                              lanes start, lanes by, const lanes F[], int k)
{
  (void)p, (void)k;
  return start + by * of->per_mass * F[0];
}

AMB_INLINE void lanes_stage(const lanes_pattern *p, const lanes_substep_constants *of,
                            const lanes X[], int stage, lanes F[], lanes d[])
{
  (void)p, (void)stage;
  F[0] = lanes_law_force(&of->law, of->iu, X[0]);
  d[2] = (of->K * X[0] - X[2]) * of->per_lag;
}

#define amb_real lanes
#define amb_pattern lanes_pattern
#define amb_substep_constants lanes_substep_constants
#define amb_reachable lanes_reachable
#define amb_driven lanes_driven
#define amb_stage lanes_stage
#define amb_substep lanes_substep
#include "plant_text.h"
#undef amb_real

#define AMB_TALLY(name) lanes_##name
#define amb_judged lanes
#define amb_judged_mask lanes_mask
#define amb_judged_choose lanes_choose
#define amb_judged_where lanes_where
#define amb_judged_all lanes_all_equal
typedef struct lanes_windows {
  lanes first, step_from, step_to, height, there, load_from, band, travel;
} lanes_windows;

#include "tally_step.h"

/* ---- Plant, amplifier and controller. ---- */

#define STRETCH AMB_NOISE_BLOCK /* samples whose noise is generated together */

/* The leading numbers of amb_pid and amb_pid_state, in their order. */
typedef struct lanes_pid {
  lanes T, kp, ki, kd, T_f, T_t, weight, iu_min, iu_max;
} lanes_pid;

typedef struct lanes_pid_state {
  lanes integral, last_r, last_x, velocity;
} lanes_pid_state;

typedef struct loops {
  lanes_substep_constants of;
  lanes m, f_0, k_ui, iu_min, iu_max;
  lanes X[3];
  lanes_pid pid;
  lanes_pid_state at;
  lanes_mask started;
  lanes u; /* control signal since the last sample */
  size_t substeps;
  bool feedback_estimate;
} loops;

typedef struct loops_in_lanes {
  team t; /* its filters; the team's runs here are each run's `filter` */
  loops l;
  lanes_windows windows;
  lanes_tally tally;
  amb_many_run *runs[LANES]; /* the last one is repeated if there are fewer */
  amb_batch_run filter[LANES];
  double noise[LANES][2][STRETCH];
  lanes r[BLOCK], f_d[BLOCK], noise_u[BLOCK], noise_y[BLOCK];
  lanes x[BLOCK], v[BLOCK], u[BLOCK], iu[BLOCK];
  lanes_mask touched[BLOCK];
} loops_in_lanes;

static void fill_loop(loops *l, size_t i, const amb_many_run *run)
{
  const amb_loop *loop = run->loop;
  const amb_plant *plant = &loop->plant;
  const amb_law *law = (const amb_law *)plant->magnet[0].self;
  const amb_pid *pid = &loop->pid;
  const amb_real h = loop->T / (amb_real)plant->substeps;
  l->of.h[i] = h;
  l->of.half[i] = h / 2;
  l->of.sixth[i] = h / 6;
  l->of.per_mass[i] = 1 / plant->mass[0];
  l->of.per_lag[i] = 1 / plant->lag[0];
  l->of.K[i] = plant->gain[0];
  l->of.travel[i] = plant->farthest[0];
  fill((lanes *)&l->of.law, i, &law->k, 3 * sizeof law->k);
  l->m[i] = plant->mass[0];
  l->f_0[i] = plant->g[0];
  l->k_ui[i] = loop->k_ui[0];
  l->iu_min[i] = loop->iu_min[0];
  l->iu_max[i] = loop->iu_max[0];
  fill((lanes *)&l->pid, i, &pid->T, sizeof l->pid / LANES);
  fill(l->X, i, run->state.plant.X, sizeof l->X / LANES);
  fill((lanes *)&l->at, i, &run->state.pid[0].integral, sizeof l->at / LANES);
  l->started[i] = run->state.pid[0].started ? -1 : 0;
  l->substeps = (size_t)plant->substeps;
  l->feedback_estimate = loop->feedback_estimate;
}

AMB_INLINE lanes_mask finite(lanes a)
{
  return (a >= -AMB_REAL_MAX) & (a <= AMB_REAL_MAX);
}

/* amb_pid_step; `known` is the estimated velocity, if the loop provides it. */
AMB_INLINE lanes pid_step(loops *l, lanes r, lanes x, const lanes *known)
{
  const lanes_pid *pid = &l->pid;
  lanes_pid_state *at = &l->at;
  lanes_mask good = finite(x);
  if (known != NULL) {
    good &= finite(*known);
    at->velocity = lanes_choose(good, *known, at->velocity);
  } else {
    const lanes off = (x - at->last_x) - pid->T * at->velocity;
    const lanes changed = at->velocity + off / (pid->T_f + pid->T);
    at->velocity = lanes_choose(good & l->started, changed, at->velocity);
  }
  at->last_x = lanes_choose(good, x, at->last_x);
  l->started |= good;
  at->last_r = lanes_choose(finite(r), r, at->last_r);

  const lanes error = at->last_r - at->last_x, integral = at->integral;
  const lanes weighted = pid->weight * at->last_r - at->last_x;
  const lanes demanded = pid->kp * weighted + integral - pid->kd * at->velocity;
  const lanes iu = lanes_clamp(demanded, pid->iu_min, pid->iu_max);
  const lanes_mask within = ~((iu < demanded) | (iu > demanded));
  const lanes tracking = integral + pid->T * (pid->ki * error + (iu - demanded) / pid->T_t);
  const lanes stopping = lanes_choose(within, integral + pid->T * pid->ki * error, integral);
  at->integral = lanes_choose(pid->T_t > AMB_C(0.0), tracking, stopping);
  return iu;
}

/* stop() of plant.c. */
AMB_INLINE lanes_mask stop(lanes travel, lanes X[])
{
  const lanes_mask touched = (X[0] >= travel) | (X[0] <= -travel);
  X[0] = lanes_choose(touched, lanes_clamp(X[0], -travel, travel), X[0]);
  const lanes_mask above = X[0] > AMB_C(0.0);
  const lanes_mask outward = (above & (X[1] > AMB_C(0.0))) | (~above & (X[1] < AMB_C(0.0)));
  X[1] = lanes_choose(touched & outward, lanes_all_equal(AMB_C(0.0)), X[1]);
  return touched;
}

/* act() of loop.c, then the plant over one sample. */
AMB_INLINE lanes_mask act(loops *l, lanes iu, lanes f_d)
{
  lanes_substep_constants of = l->of;
  lanes X[3] = {lanes_clamp(l->X[0], -of.travel, of.travel), l->X[1], l->X[2]};
  lanes_mask touched = iu != iu;
  touched &= ~touched;
  of.g[0] = (l->f_0 + f_d) / l->m;
  of.iu = iu;
  for (size_t i = 0; i < l->substeps; i++) {
    lanes_substep(&axis, &of, X);
    touched |= stop(of.travel, X);
  }
  for (int j = 0; j < 3; j++)
    l->X[j] = X[j];
  return touched;
}

/* Sample b of the block; `first`: of the run. */
AMB_INLINE void sample(loops_in_lanes *f, size_t b, lanes_of of, lanes_state *s, bool is_first)
{
  loops *l = &f->l;
  const lanes y = l->X[2] + f->noise_y[b];
  f->t.b.y[b] = y;
  f->t.b.u[b] = l->u;
  if (is_first) {
    lanes_state first;
    begin(&f->t, &first);
    *s = first;
  } else {
    step_at(&f->t, b, of, s);
  }
  lanes demanded;
  if (l->feedback_estimate)
    demanded = pid_step(l, f->r[b], s->mean[AMB_FIRST_POSITION], &s->mean[AMB_FIRST_VELOCITY]);
  else
    demanded = pid_step(l, f->r[b], y / l->of.K, NULL);
  l->u = demanded / l->k_ui;
  const lanes iu = lanes_clamp(l->k_ui * (l->u + f->noise_u[b]), l->iu_min, l->iu_max);
  f->x[b] = l->X[0];
  f->v[b] = l->X[1];
  f->u[b] = l->u;
  f->iu[b] = iu;
  f->touched[b] = act(l, iu, f->f_d[b]);
}

AMB_INLINE void samples(loops_in_lanes *f, bool from_start, size_t count, lanes_kind kind,
                        lanes_magnet magnet)
{
  const lanes_of of = {kind, magnet, f->t.magnets};
  lanes_state s = f->t.s;
  if (from_start)
    sample(f, 0, of, &s, true);
  for (size_t b = from_start ? 1 : 0; b < count; b++)
    sample(f, b, of, &s, false);
  f->t.s = s;
}

/* ---- Inputs and outputs. ---- */

static void draw(loops_in_lanes *f, size_t first, size_t n)
{
  for (size_t i = 0; i < f->t.count; i++) {
    const amb_many_run *run = f->runs[i];
    for (uint32_t stream = 0; stream < 2; stream++) {
      double *to = f->noise[i][stream];
      const double *noise = (stream == AMB_NOISE_CONTROL) ? run->noise_u : run->noise_y;
      const double std = (stream == AMB_NOISE_CONTROL) ? run->std_u[0] : run->std_y[0];
      if (noise != NULL) {
        memcpy(to, noise + first, ((n - first < STRETCH) ? n - first : STRETCH) * sizeof *to);
      } else if (std > 0.0) {
        amb_noise_block(run->key, stream, first, to);
        for (size_t k = 0; k < STRETCH; k++)
          to[k] *= std;
      } else { /* stays 0 */
      }
    }
  }
}

static void fetch(loops_in_lanes *f, size_t first, size_t count)
{
  for (size_t i = 0; i < LANES; i++) {
    const size_t own = (i < f->t.count) ? i : f->t.count - 1;
    const amb_real *r = f->runs[i]->in.r + first, *f_d = f->runs[i]->in.load + first;
    const double *u = f->noise[own][AMB_NOISE_CONTROL] + first % STRETCH;
    const double *y = f->noise[own][AMB_NOISE_SENSOR] + first % STRETCH;
    for (size_t b = 0; b < count; b++) {
      f->r[b][i] = r[b];
      f->f_d[b][i] = f_d[b];
      f->noise_u[b][i] = u[b];
      f->noise_y[b][i] = y[b];
    }
  }
}

/* Marks the measurements that were used, if the block has flags; counts the flags. */
static void flags(loops_in_lanes *f, size_t count, lanes_mask used[BLOCK])
{
  for (size_t b = 0; b < count; b++)
    for (size_t i = 0; i < f->t.count; i++) {
      const unsigned int status = f->t.b.status[b][i];
      used[b][i] = ((status & AMB_NOT_USED) == 0U) ? -1 : 0;
      amb_flags_count(f->runs[i], status);
    }
}

static void judge(loops_in_lanes *f, size_t first, size_t count)
{
  lanes_mask used[BLOCK];
  lanes_tally tally = f->tally;
  bool stepping = false;
  for (size_t i = 0; i < f->t.count; i++)
    stepping = stepping || (((double)(first + count) > f->runs[i]->windows->step_from) &&
                            ((double)first < f->runs[i]->windows->step_to));
  memset(used, 0xFF, sizeof used);
  if (f->t.b.nonzero)
    flags(f, count, used);
  for (size_t b = 0; b < count; b++) {
    const lanes e = f->t.b.result[b].innovation, S = f->t.b.result[b].variance;
    const lanes_mask counts = used[b] & (S > 0.0);
    const lanes_seen seen = {lanes_all_equal((double)(first + b)),
                             f->r[b],
                             f->f_d[b],
                             f->x[b],
                             f->v[b],
                             f->u[b],
                             f->iu[b],
                             lanes_judged_magnitude(f->x[b]),
                             lanes_judged_magnitude(f->f_d[b]),
                             {f->t.b.mean[b][AMB_FIRST_POSITION],
                              f->t.b.mean[b][AMB_FIRST_VELOCITY], f->t.b.mean[b][AMB_FIRST_LOAD]},
                             lanes_where(counts, e * e / S),
                             lanes_where(counts, lanes_all_equal(1.0)),
                             f->touched[b]};
    lanes_tally_estimate(&f->windows, &tally, &seen);
    lanes_tally_loop(&f->windows, &tally, &seen);
    if (stepping)
      lanes_tally_response(&f->windows, &tally, &seen);
  }
  f->tally = tally;
}

static void start(loops_in_lanes *f, amb_many_run *const runs[], size_t count)
{
  memset(f, 0, sizeof *f);
  f->t.count = count;
  for (size_t i = 0; i < LANES; i++) {
    amb_many_run *run = runs[(i < count) ? i : count - 1];
    f->runs[i] = run;
    f->filter[i].estimator = run->loop->estimator;
    f->filter[i].state = run->estimator;
    f->t.runs[i] = &f->filter[i];
    f->t.magnets[i] = magnet_in_lanes(run->loop->estimator->magnet);
    fill_parameters(&f->t.p, i, run->loop->estimator);
    fill_loop(&f->l, i, run);
    const amb_tally none = amb_tally_none(run->windows);
    fill((lanes *)&f->windows, i, (const double *)run->windows, sizeof *run->windows);
    fill((lanes *)&f->tally, i, (const double *)&none, sizeof none);
  }
}

void AMB_LANES_NAME(amb_lanes_many)(amb_many_run *const runs[], size_t count, size_t n)
{
  loops_in_lanes f;
  start(&f, runs, count);
  const lanes_of of = made_of(&f.t);
  for (size_t first = 0; first < n; first += BLOCK) {
    const size_t length = (n - first < BLOCK) ? n - first : BLOCK;
    if (first % STRETCH == 0)
      draw(&f, first, n);
    fetch(&f, first, length);
#define SAMPLES(kind, magnet) samples(&f, first == 0, length, kind, magnet)
    FOR_MADE_OF(of, SAMPLES);
#undef SAMPLES
    judge(&f, first, length);
    silence(&f.t);
  }
  for (size_t i = 0; i < count; i++) {
    amb_tally tally;
    lane((const lanes *)&f.tally, i, (double *)&tally, sizeof tally);
    amb_figures_of(runs[i], 0, &tally);
    get(&f.t, &f.t.s, i);
  }
}

#endif
