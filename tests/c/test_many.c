/* Noise by counters, and closed loops side by side in the baseline's lanes: the same bits as one by
 * one, at the stops too, for any number of runs and of samples. */
#include "ambkit/observer.h"
#include "family.h"
#include "lanes_run.h"
#include "noise_block.h"
#include "plant_axis.h"
#include <math.h>

#define MOST 5
#define SAMPLES 300

static void test_philox(void)
{
  /* Of the authors' known answers (Random123, kat_vectors). */
  static const uint32_t in[3][6] = {
      {0, 0, 0, 0, 0, 0},
      {UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX},
      {0x243F6A88U, 0x85A308D3U, 0x13198A2EU, 0x03707344U, 0xA4093822U, 0x299F31D0U}};
  static const uint32_t out[3][4] = {{0x6627E8D5U, 0xE169C58DU, 0xBC57AC4CU, 0x9B00DBD8U},
                                     {0x408F276DU, 0x41C83B0EU, 0xA20BC7C6U, 0x6D5451FDU},
                                     {0xD16CFE09U, 0x94FDCCEBU, 0x5001E420U, 0x24126EA1U}};
  for (int i = 0; i < 3; i++) {
    uint32_t random[4];
    amb_philox(in[i], in[i] + 4, random);
    CHECK(memcmp(random, out[i], sizeof random) == 0);
  }
}

static void test_normal(void)
{
  CHECK(amb_normal_central(0.0) == 0.0);
  CHECK(fabs(amb_normal_near(0.025) - 1.9599639845400545) < 1e-14);
  CHECK(fabs(amb_normal_far(1e-12) - 7.0344869100478) < 1e-12);
  static double all[SAMPLES], again[SAMPLES];
  const amb_noise_key key = {1, 2}, other = {1, 3};
  amb_noise_normal(key, 0, 0, SAMPLES, all);
  for (size_t first = 0; first < SAMPLES; first += 37) {
    amb_noise_normal(key, 0, first, SAMPLES - first, again);
    CHECK(memcmp(again, all + first, (SAMPLES - first) * sizeof *all) == 0);
    amb_many_noise(key, 0, first, SAMPLES - first, again);
    CHECK(memcmp(again, all + first, (SAMPLES - first) * sizeof *all) == 0);
  }
  amb_noise_normal(other, 0, 0, SAMPLES, again);
  CHECK(memcmp(again, all, sizeof all) != 0);
  amb_noise_normal(key, 1, 0, SAMPLES, again);
  CHECK(memcmp(again, all, sizeof all) != 0);
}

typedef struct one {
  amb_kalman kf;
  amb_estimator estimator;
  amb_axis axis;
  amb_axis_room room;
  amb_loop loop;
  amb_low_pass_state state[2];
  amb_windows windows;
  double std_u, std_y;
  amb_many_run run[2];
} one;

static one all[MOST];
static amb_real r[SAMPLES], f_d[MOST][SAMPLES];
static amb_real signals[7][SAMPLES], noise[2][SAMPLES], numbers[4][SAMPLES];
static amb_real mean[SAMPLES * AXIS_STATES];
static unsigned short status[SAMPLES];
static unsigned char touched[SAMPLES];

static const amb_real gain = 1, least = AMB_C(-1.5), most = AMB_C(1.5);

/* The axis by the estimator's states: x, v and f_d stand first. */
static const unsigned short row[2] = {0, 1}, columns[3] = {0, 1, 2};

static amb_loop_output output(void)
{
  static amb_real *const X[] = {signals[0], signals[1], signals[2]};
  const amb_loop_output out = {.X = X,
                               .columns = 3,
                               .iu = signals[3],
                               .force = signals[4],
                               .y = signals[5],
                               .u = signals[6],
                               .estimate = {mean, NULL, numbers[0], numbers[1], numbers[2],
                                            numbers[3], NULL, NULL, status, status}};
  return out;
}

static void fill(one *o, size_t i, size_t n, const amb_estimator_methods *methods, const void *own,
                 bool fed_by_estimate)
{
  const amb_real std[AMB_STATES] = {AMB_C(3e-5), AMB_C(0.012), 5, AMB_C(3e-5)};
  const amb_kalman_settings settings = family_settings();
  const amb_model model =
      axis_model(PAPER_T, PAPER_M + AMB_C(0.01) * (amb_real)i, 1, PAPER_T_SEN, AXIS_EXACT);
  memset(o, 0, sizeof *o);
  CHECK(amb_kalman_init(&o->kf, &model, &settings) == AMB_OK);
  const amb_estimator e = {methods, &o->kf, &linear, own};
  o->estimator = e;
  const amb_axis axis = {.magnet = {&amb_law_magnet, &law},
                         .m = PAPER_M - AMB_C(0.02) * (amb_real)i,
                         .f_0 = AMB_C(-5.08158),
                         .K_sen = 1,
                         .T_sen = PAPER_T_SEN,
                         .travel = PAPER_X_MAX,
                         .substeps = 4};
  o->axis = axis;
  const amb_loop loop = {.plant = plant_of_axis(&o->axis, &o->room),
                         .pid = {.T = PAPER_T,
                                 .kp = 3000,
                                 .ki = 20000,
                                 .kd = 12,
                                 .T_f = AMB_C(2e-4),
                                 .T_t = (i == 1) ? 0 : AMB_C(25e-3),
                                 .weight = AMB_C(0.5),
                                 .iu_min = AMB_C(-1.5),
                                 .iu_max = AMB_C(1.5)},
                         .T = PAPER_T,
                         .k_ui = &gain,
                         .iu_min = &least,
                         .iu_max = &most,
                         .estimator = &o->estimator,
                         .feedback_estimate = fed_by_estimate};
  o->loop = loop;
  const amb_windows windows = {.first = 10,
                               .step_from = (n > 100) ? 60.0 : 0.0,
                               .step_to = (n > 100) ? (double)(n - 20) : 0.0,
                               .height = 2e-4,
                               .there = 2e-4,
                               .load_from = (n > 100) ? 120.0 : (double)n,
                               .band = 5e-5,
                               .travel = (double)PAPER_X_MAX};
  o->windows = windows;
  o->std_u = 1e-3;
  o->std_y = (i == 2) ? 0.0 : 1e-5;
  for (int which = 0; which < 2; which++) {
    amb_many_run *run = &o->run[which];
    CHECK(methods->reset(&e, &o->state[which], at_rest, std) == AMB_OK);
    run->loop = &o->loop;
    run->estimator = &o->state[which];
    run->in.n = n;
    run->in.r = r;
    run->in.load = f_d[i];
    run->key.seed = 7;
    run->key.run = i;
    run->std_u = &o->std_u;
    run->std_y = &o->std_y;
    run->windows = &o->windows;
    for (int state = 0; state < 3; state++) {
      const amb_sparse along = {row, &columns[state], &gain};
      run->along[state] = along;
    }
    const amb_real x = 0, iu = AMB_C(0.5);
    amb_plant_settle(&o->loop.plant, &run->state.plant, &x, &iu);
    amb_pid_reset(&run->state.pid[0], AMB_C(0.5));
  }
}

/* NaN is not equal to itself, but its bits are. */
static void compare(const amb_estimator_methods *methods, const void *own, bool fed_by_estimate,
                    size_t runs, size_t n)
{
  amb_many_run *beside[MOST] = {NULL};
  for (size_t i = 0; i < runs; i++) {
    fill(&all[i], i, n, methods, own, fed_by_estimate);
    amb_loop_output to = output();
    amb_many_one(&all[i].run[0], noise[0], noise[1], touched, &to);
    beside[i] = &all[i].run[1];
  }
  if (amb_many_group(beside[0]) == 0U)
    return;
  const size_t lanes = amb_batch_lanes(AMB_BASELINE);
  for (size_t i = 0; i < runs; i += lanes)
    amb_many_advance(AMB_BASELINE, &beside[i], (runs - i < lanes) ? runs - i : lanes, n);
  for (size_t i = 0; i < runs; i++) {
    const one *o = &all[i];
    CHECK(memcmp(o->run[0].figures, o->run[1].figures, sizeof o->run[0].figures) == 0);
    CHECK(memcmp(o->run[0].flags, o->run[1].flags, sizeof o->run[0].flags) == 0);
    CHECK(memcmp(&o->state[0], &o->state[1], methods->state_size) == 0);
  }
}

int main(void)
{
  const amb_observer observer = {{{AMB_C(0.1), 10, 100, AMB_C(0.2)}},
                                 {AMB_C(1e-12)},
                                 {AMB_C(1e-10)},
                                 {AMB_C(1e-2), 10, AMB_C(1e4), AMB_C(1e-2)}};
  test_philox();
  test_normal();
  for (size_t k = 0; k < SAMPLES; k++) {
    r[k] = (k < 60) ? 0 : AMB_C(2e-4);
    for (size_t i = 0; i < MOST; i++) /* the last one cannot be borne */
      f_d[i][k] = (k < 120) ? 0 : ((i == MOST - 1) ? AMB_C(-60.0) : AMB_C(-3.0));
  }
  for (size_t runs = 1; runs <= MOST; runs += 2) {
    compare(&amb_kalman_methods, NULL, true, runs, SAMPLES);
    compare(&amb_kalman_methods, NULL, false, runs, 65);
    compare(&amb_extended_methods, NULL, true, runs, 131);
    compare(&amb_observer_methods, &observer, false, runs, SAMPLES);
  }
  fill(&all[0], 0, SAMPLES, &amb_kalman_methods, NULL, true);
  amb_loop_output to = output();
  amb_many_one(&all[0].run[0], noise[0], noise[1], touched, &to);
  const double *figures = all[0].run[0].figures;
  CHECK((figures[AMB_TOUCHED] == 0.0) && (figures[AMB_LOAD_KEPT] == 3.0));
  CHECK((figures[AMB_X_RMS] > 0.0) && (figures[AMB_X_RMS] < figures[AMB_X_PEAK]));
  fill(&all[0], 0, SAMPLES, &amb_kalman_methods, NULL, true);
  all[0].loop.estimator = NULL;
  all[0].loop.feedback_estimate = false;
  amb_many_one(&all[0].run[0], noise[0], noise[1], touched, &to);
  CHECK(isnan(figures[AMB_X_RMS]) && (figures[AMB_CONTROL_RMS] > 0.0));
  return 0;
}
