/* The plant and the closed loop: no sample, one sample, with and without an estimator, bad input.
 */
#include "family.h"
#include "loop.h"
#include "plant_axis.h"

#define N 2000

static const amb_axis axis = {
    .magnet = {&amb_law_magnet, &law},
    .m = AMB_C(0.518),
    .f_0 = AMB_C(-5.08158),
    .K_sen = 1,
    .T_sen = AMB_C(2e-4),
    .travel = AMB_C(1e-3),
    .substeps = 4,
};
static const amb_pid pid = {
    .T = AMB_C(1e-4),
    .kp = 3000,
    .ki = 20000,
    .kd = 12,
    .T_f = AMB_C(2e-4),
    .T_t = AMB_C(25e-3),
    .weight = 1,
    .iu_min = AMB_C(-1.5),
    .iu_max = AMB_C(1.5),
};
static const amb_real gain = 1;
static amb_real r[N], f_d[N], noise_u[N], noise_y[N];
static amb_real x[N], v[N], x_m[N], iu[N], force[N], y[N], u[N];
static amb_real mean[AXIS_STATES * N], cov[AXIS_ENTRIES * N], innovation[N], variance[N], k_i[N],
    k_s[N];
static unsigned short status[N];
static unsigned char at_stop[N];

static bool never(const unsigned char *flags, size_t n)
{
  size_t count = 0;
  for (size_t k = 0; k < n; k++)
    count += flags[k];
  return count == 0;
}

static amb_loop_output output(void)
{
  static amb_real *const X[] = {x, v, x_m};
  const amb_loop_output out = {
      .X = X,
      .columns = 3,
      .iu = iu,
      .force = force,
      .y = y,
      .u = u,
      .at_stop = at_stop,
      .estimate = {mean, cov, innovation, variance, k_i, k_s, NULL, NULL, status, status}};
  return out;
}

static amb_kalman never_frozen(void)
{
  amb_kalman kf = family_filter();
  kf.set.frozen_limit = 0;
  return kf;
}

static amb_axis_room room;

/* On by 0.1 ms with this current [A] and load [N]. */
static bool advance(const amb_axis *of, amb_plant_state *s, amb_real iu, amb_real f_d)
{
  const amb_plant plant = plant_of_axis(of, &room);
  const amb_acts acts = {.demanded = &iu, .load = &f_d, .scale = 1};
  return amb_plant_advance(&plant, s, AMB_C(1e-4), &acts);
}

static void test_plant(void)
{
  amb_plant_state s = {.X = {0}};
  amb_axis once = axis;
  once.substeps = 1;
  CHECK(!advance(&once, &s, AMB_C(0.5), 1));
  CHECK(s.X[1] > 0 && s.X[0] > 0 && s.X[2] > 0 && s.X[2] < s.X[0]);

  /* Pressed against a stop it stays; in the pole of the law it is put back; a push off moves it. */
  s.X[0] = law.s0;
  s.X[1] = 100;
  CHECK(advance(&axis, &s, 0, 100));
  CHECK(same(s.X[0], axis.travel) && same(s.X[1], 0));
  CHECK_WITHIN(s.X[2], axis.travel * AMB_C(0.39346934), AMB_C(1e-3));
  for (int k = 0; k < 100; k++)
    CHECK(advance(&axis, &s, 0, 100) && s.X[2] <= axis.travel);
  for (int k = 0; k < 10; k++)
    (void)advance(&axis, &s, 0, -100);
  CHECK(s.X[0] < axis.travel && s.X[1] < 0);
}

static amb_loop loop_of(const amb_estimator *estimator, bool fed_by_estimate)
{
  const amb_loop loop = {
      .plant = plant_of_axis(&axis, &room),
      .pid = pid,
      .T = AMB_C(1e-4),
      .k_ui = &gain,
      .iu_min = &pid.iu_min,
      .iu_max = &pid.iu_max,
      .estimator = estimator,
      .feedback_estimate = fed_by_estimate,
  };
  return loop;
}

static amb_status loop_run(size_t n, const amb_kalman *kf, bool fed_by_estimate,
                           amb_kalman_state *kalman, amb_loop_output *out)
{
  const amb_estimator estimator = {&amb_kalman_methods, kf, &closed, NULL};
  const amb_loop loop = loop_of(kf != NULL ? &estimator : NULL, fed_by_estimate);
  const amb_loop_input in = {.n = n, .r = r, .load = f_d, .noise_u = noise_u, .noise_y = noise_y};
  amb_loop_state state = {0};
  amb_pid_reset(&state.pid[0], 0);
  return amb_loop_run(&loop, &in, &state, kalman, out);
}

static void test_loop(bool fed_by_estimate)
{
  amb_kalman_state s;
  const amb_kalman kf = never_frozen();
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  amb_loop_output out = output();
  x[0] = 9;
  CHECK(loop_run(0, &kf, fed_by_estimate, &s, &out) == AMB_OK && same(x[0], 9));
  CHECK(loop_run(1, &kf, fed_by_estimate, &s, &out) == AMB_OK && same(x[0], 0));

  for (int k = 0; k < N; k++) {
    r[k] = AMB_C(1e-4);
    noise_y[k] = AMB_C(1e-7) * (amb_real)(k % 5 - 2);
  }
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  CHECK(loop_run(N, &kf, fed_by_estimate, &s, &out) == AMB_OK);
  CHECK(never(out.at_stop, N) && all_finite(x, N) && all_finite(mean, (size_t)4 * N));
  CHECK_WITHIN(x[N - 1], AMB_C(1e-4), AMB_C(0.4));
  CHECK_WITHIN(mean[4 * (N - 1)], x[N - 1], AMB_C(0.05));

  /* A measurement and a reference that are no numbers: the loop goes on, and holds the rotor. */
  noise_y[500] = NOT_A_NUMBER;
  r[600] = TOO_MUCH;
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  CHECK(loop_run(N, &kf, fed_by_estimate, &s, &out) == AMB_MISSING);
  CHECK(status[500] == AMB_MISSING && never(out.at_stop, N) && all_finite(u, N));
  CHECK_WITHIN(x[N - 1], AMB_C(1e-4), AMB_C(0.4));
  noise_y[500] = r[600] = 0;
}

static void test_loop_without_estimator(void)
{
  amb_loop_output out = output();
  CHECK(loop_run(N, NULL, false, NULL, &out) == AMB_OK);
  CHECK(never(out.at_stop, N) && all_finite(x, N));
  CHECK_WITHIN(x[N - 1], AMB_C(1e-4), AMB_C(0.4));
}

/* Sample by sample it is the same run, to the last bit. */
static void test_steps(bool fed_by_estimate)
{
  amb_kalman_state s;
  const amb_kalman kf = never_frozen();
  CHECK(amb_kalman_reset(&kf, &s, at_rest, some) == AMB_OK);
  amb_kalman_state own = s;
  amb_loop_state step = {.sampled = false};
  amb_pid_reset(&step.pid[0], 0);
  amb_loop_output out = output();
  CHECK(loop_run(N, &kf, fed_by_estimate, &s, &out) == AMB_OK);
  const amb_estimator estimator = {&amb_kalman_methods, &kf, &closed, NULL};
  const amb_loop loop = loop_of(&estimator, fed_by_estimate);
  int different = 0;
  for (int k = 0; k < N; k++) {
    const amb_loop_sample sample = {.r = &r[k],
                                    .load = &f_d[k],
                                    .noise_u = &noise_u[k],
                                    .noise_y = &noise_y[k],
                                    .scale = 1,
                                    .fly = true};
    different += !same(step.plant.X[0], x[k]);
    CHECK(!amb_loop_step(&loop, &step, &own, &sample));
    different += !same(step.u[0], u[k]) + !same(own.mean[2], mean[4 * k + 2]);
  }
  CHECK(different == 0 && !same(x[N - 1], x[N - 2]));
}

int main(void)
{
  test_plant();
  test_loop(false);
  test_loop(true);
  test_loop_without_estimator();
  test_steps(false);
  test_steps(true);
  return failures;
}
