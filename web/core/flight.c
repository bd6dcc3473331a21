/* Runs: noise, histories of filters, and the response of a loop to a pulse. */
#include "bench.h"
#include <math.h>

#define SETTLING 4000 /* maximum samples until the gain has settled, ... */
#define ANSWER 12000  /* ... and until a response has decayed */
#define LOOKED 256    /* samples over which decay is evaluated */
#define FREQUENCIES 400
#define GONE 1e-10    /* relative to the pulse: the response has decayed */
#define ROUNDING 1e-6 /* relative to the pulse: above rounding errors */

typedef struct history {
  double mean[MEANS], innovation[10 * FEWER], variance[10 * FEWER];
  double k_i[10 * FEWER], k_s[10 * FEWER];
  unsigned short status[MOST], health[10 * FEWER];
} history;

static double frequency[FREQUENCIES], gain[FREQUENCIES];
static history histories[FILTERS];
static double covariances[PAIRS];

EXPORT(history) void *history_at(int filter, int which)
{
  history *h = &histories[filter];
  void *const all[] = {h->mean, covariances, h->innovation, h->variance,
                       h->k_i,  h->k_s,      h->status,     h->health};
  return all[which];
}

amb_kalman_history bench_history(int j, const amb_model *model, size_t n)
{
  history *h = &histories[j];
  const size_t states = (size_t)model->states, pairs = states * (states + 1) / 2;
  return (amb_kalman_history){.mean = h->mean,
                              .cov = (j == 0) && (n * pairs <= PAIRS) ? covariances : NULL,
                              .innovation = h->innovation,
                              .variance = h->variance,
                              .k_i = h->k_i,
                              .k_s = h->k_s,
                              .status = h->status,
                              .health = model->sensors > 1 ? h->health : h->status};
}

void bench_draw(double seed, uint32_t stream, size_t first, size_t n, size_t stride,
                double variance, double *to)
{
  const amb_noise_key key = {(uint64_t)seed, 0};
  const double std = sqrt(variance);
  double normal[AMB_NOISE_BLOCK];
  for (size_t done = 0; done < n; done += AMB_NOISE_BLOCK) {
    const size_t some = (n - done < AMB_NOISE_BLOCK) ? n - done : AMB_NOISE_BLOCK;
    amb_noise_normal(key, stream, first + done, some, normal);
    for (size_t i = 0; i < some; i++)
      to[(done + i) * stride] = std * normal[i];
  }
}

/* ---- The response to a pulse ---- */

EXPORT(frequencies) double *frequencies(int answered)
{
  return answered != 0 ? gain : frequency;
}

static const double none[2 * WIDE] = {0};

/* State of a loop and its filter. */
typedef struct moving {
  amb_loop_state loop;
  bench_filter filter; /* with its own state */
} moving;

static moving calm, struck;
static double answer[ANSWER];
static int answered;
static double sampling_time;

static bool on(const amb_loop *loop, moving *of, const double r[], double speed,
               const double noise_y[])
{
  const double speeds[2] = {speed, speed};
  const amb_loop_sample sample = {.r = r,
                                  .load = none,
                                  .noise_u = none,
                                  .noise_y = noise_y,
                                  .speed = loop->plant.own ? NULL : speeds,
                                  .scale = 1,
                                  .fly = true};
  return amb_loop_step(loop, &of->loop, &of->filter.state, &sample);
}

/* A filter without quantisation but with its variance; otherwise a small pulse would have no
 * effect. */
static bool smooth(bench_filter *filter)
{
  amb_kalman_settings set = filter->kf.set;
  const amb_model model = filter->kf.model;
  for (int r = 0; r < model.sensors; r++) {
    set.var_y[r] += set.step[r] * set.step[r] / 12;
    set.step[r] = 0;
  }
  set.frozen_limit = 0U; /* a rotor at rest repeats its reading */
  return amb_kalman_init(&filter->kf, &model, &set) == AMB_OK;
}

static double trace(const bench_filter *filter)
{
  double sum = 0;
  const int n = filter->kf.model.states;
  for (int i = 0; i < n; i++)
    sum += filter->state.base.cov[amb_entry(n, i, i)] /
           (filter->kf.set.cap[i] * filter->kf.set.cap[i]);
  return sum;
}

static void settle(const amb_loop *loop, const double r[], double speed)
{
  double before = 0;
  bool settled = false;
  for (int k = 1; (k <= SETTLING) && !settled; k++) {
    (void)on(loop, &calm, r, speed, none);
    if (loop->estimator == NULL)
      settled = k > 1; /* a derivative starts at the first sample */
    else if (k % LOOKED == 0) {
      const double now = trace(&calm.filter);
      settled = amb_magnitude(now - before) <= 1e-9 * now;
      before = now;
    }
  }
}

/* abs(S) at f from its impulse response. */
static double gain_at(double cycles, int n, const double answer[])
{
  const double w = 6.283185307179586 * cycles, c = cos(w), s = sin(w);
  double re = 0, im = 0;
  for (int k = n - 1; k >= 0; k--) { /* Horner's scheme in exp(-i w) */
    const double next = re * c + im * s + answer[k];
    im = im * c - re * s;
    re = next;
  }
  return sqrt(re * re + im * im);
}

/* abs(S) of the last response at the first frequencies. */
EXPORT(gains) void gains(int points)
{
  for (int k = 0; k < points; k++)
    gain[k] = gain_at(frequency[k] * sampling_time, answered, answer);
}

bool bench_sensitivity(const amb_loop *loop, const amb_loop_state *start, const double r[],
                       double speed, const bench_pulse *pulse)
{
  amb_loop with = *loop;
  const int m = loop->plant.sensors;
  double size = 0, late = 0, early = 0, last = 0;
  int n = 0;
  bool stable = true, gone = false;
  if (loop->estimator != NULL) {
    const bench_filter *fed = pulse->filter;
    calm.filter = *fed;
    calm.filter.estimator.kf = &calm.filter.kf;
    if (!smooth(&calm.filter))
      return false;
    with.estimator = &calm.filter.estimator;
  }
  calm.loop = *start;
  settle(&with, r, speed);
  struck = calm;
  for (int i = 0; i < m; i++)
    size += pulse->shown[i] * pulse->added[i];
  while ((n < ANSWER) && stable && !gone) {
    const bool hit = on(&with, &calm, r, speed, none) ||
                     on(&with, &struck, r, speed, n == 0 ? pulse->added : none);
    answer[n] = 0;
    for (int i = 0; i < m; i++)
      answer[n] += pulse->shown[i] * (struck.loop.y[i] - calm.loop.y[i]) / size;
    last = amb_magnitude(answer[n]);
    late = last > late ? last : late;
    stable = !hit && (last < 1e4);
    n++;
    if (n % LOOKED == 0) {
      gone = late < GONE;
      early = n == ANSWER / LOOKED / 2 * LOOKED ? late : early;
      late = n < ANSWER / LOOKED * LOOKED ? 0 : late;
    }
  }
  answered = n;
  sampling_time = loop->T;
  /* What rounding leaves of a response neither grows nor decays. */
  return stable && (gone || (late < early) || (late < ROUNDING));
}
